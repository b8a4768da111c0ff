"""Antialiasing: several rays a pixel, for the incident radiance of one.

What is costly, the incident radiance, is gathered once a pixel; edges, textures and bumps are seen by N × N rays. What
a ray meets takes the filtered coefficients of its pixel where it is on the same smooth surface as the pixel's centre,
else the mean over those of the pixel's window that are on its own (the tests are the filter's), and where there are
none, on something that no neighbour's centre is on, it is gathered by itself. That incident radiance depends on no
shading normal is what allows this (paper 004 §3.3, which shades a pixel by its own normal for the same reason).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.igi.filter import Reach, same_surface, window_means
from lightwell.igi.gbuffer import GBuffer

RAYS_AT_ONCE = 1 << 16
"""What they see and get is in memory at once, some 500 bytes a ray."""

ELSEWHERE, UNSEEN = -1, -2


def strips(height: int, width: int, samples: int) -> list[tuple[int, int]]:
    """Return first and last rows of parts of ``height`` rows with about `RAYS_AT_ONCE` rays each."""
    step = max(1, RAYS_AT_ONCE // (width * samples**2))
    return [(first, min(first + step, height)) for first in range(0, height, step)]


def own_pixels(fine: GBuffer, centre: GBuffer, samples: int) -> NDArray[np.int64]:
    """Return for each ray the pixel whose coefficients it takes, ``(h N · w N,)``: its index ``row · w + column``.

    `ELSEWHERE` where the pixel's centre is on another surface, `UNSEEN` where the ray meets nothing. ``fine``
    ``(h N, w N)`` is what the rays see, ``centre`` ``(h, w)`` what the pixels' centres do.
    """
    out = np.empty(fine.seen.shape, np.int64)
    _own_pixels(
        fine.seen, fine.place, fine.geometric, fine.depth, centre.seen, centre.place, centre.geometric, samples, out
    )
    return out.ravel()


def neighbours_means(
    values: NDArray[Any],
    wide: GBuffer,
    fine: GBuffer,
    chosen: NDArray[np.int64],
    samples: int,
    reach: Reach,
    first_row: int,
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the means over the windows of some rays' pixels, of what is on the rays' surfaces.

    Parameters
    ----------
    values
        ``(H, W, C)``: of the pixels with the margins of the last pass of the filter, before it.
    wide
        What their centres see.
    fine
        ``(h N, w N)``: what the rays see, of the rows of pixels from ``first_row`` on, without margins.
    chosen
        ``(E,)``: which of the rays.
    samples
        N.
    reach
        Margins: left, right, up, down.
    first_row
        Of the rectangle without its margins.

    Returns
    -------
    means, found
        ``(E, C)``; ``(E,)`` whether there is any pixel on that surface.
    """
    rows, columns = np.divmod(chosen, fine.seen.shape[1])
    windows = rows // samples + (first_row + reach.up), columns // samples + reach.left
    return window_means(values, wide, windows, fine, (rows, columns), reach)


def pixel_means(values: NDArray[np.floating], samples: int) -> NDArray[np.float32]:
    """Return the means ``(h, w, …)`` over N × N rays each, of ``(h N, w N, …)``."""
    # One addition after the other: a pixel's bits must not depend on the shape of the whole.
    total = np.zeros((values.shape[0] // samples, values.shape[1] // samples, *values.shape[2:]), np.float32)
    for row in range(samples):
        for column in range(samples):
            total += values[row::samples, column::samples]
    return np.asarray(total / np.float32(samples**2))


@njit(cache=True, nogil=True)
def _own_pixels(  # type: ignore[no-untyped-def]
    fine_seen, fine_place, fine_normal, fine_depth, seen, place, normal, samples, out
):
    height, width = fine_seen.shape
    for i in range(height):
        for j in range(width):
            if not fine_seen[i, j]:
                out[i, j] = UNSEEN
                continue
            a, b = i // samples, j // samples
            p, n = fine_place[i, j], fine_normal[i, j]
            same = seen[a, b] and same_surface(
                p[0], p[1], p[2], n[0], n[1], n[2], fine_depth[i, j], place[a, b], normal[a, b]
            )
            out[i, j] = a * seen.shape[1] + b if same else ELSEWHERE
