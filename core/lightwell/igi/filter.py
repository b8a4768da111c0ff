"""The discontinuity filter: means over as many pixels as there are sets (paper 004 §2.3, §3; MATHS §10).

A window of k n × k m pixels holds each of the n × m sets k² times, wherever it is. A neighbour j counts where it is on
the same smooth surface as the pixel i: the geometric normals are less than 25° apart, and j is in the plane of i,
within `PLANE_TOLERANCE` of i's depth. Bumps and normal maps do not matter: coefficients of incident radiance do not
depend on them. Irradiance does, which is why its filter has a choice between two evils (`IgiFilter`).

One pass, as in the paper, shows the window as squares, where what a set brings changes from one of its pixels to the
next. A second one, mirrored since windows of even width have no middle, makes a tent of it where a surface goes on: all
sets still count alike, and the light of each is interpolated between its pixels.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.igi.gbuffer import GBuffer, Places
from lightwell.igi_settings import IgiSettings

SAME_NORMAL = float(np.cos(np.radians(25)))
PLANE_TOLERANCE = 0.015
"""Of the depth."""
STRICT_NORMAL = float(np.cos(np.radians(8)))
"""Of shading normals, where irradiance is filtered strictly."""


class Reach(NamedTuple):
    """How many pixels a window reaches beyond its own."""

    left: int
    right: int
    up: int
    down: int

    def within(self, shape: tuple[int, ...]) -> tuple[slice, slice]:
        """Return where a rectangle ``(H, W, …)`` is without such margins."""
        return slice(self.up, shape[0] - self.down), slice(self.left, shape[1] - self.right)


def windows(settings: IgiSettings) -> list[Reach]:
    """Return the window of each pass of the filter; none where nothing is filtered."""
    if settings.filter == "none":
        return []
    width, height = (settings.window * side for side in settings.sets)
    first = Reach(width // 2, width - 1 - width // 2, height // 2, height - 1 - height // 2)
    mirrored = Reach(first.right, first.left, first.down, first.up)
    return [mirrored if index % 2 else first for index in range(settings.passes)]


def margins(settings: IgiSettings) -> Reach:
    """Return how many pixels around a tile its own depend on."""
    found = windows(settings)
    return Reach(*(sum(reach[side] for reach in found) for side in range(4)))


def filtered(values: NDArray[Any], pixels: GBuffer, reach: Reach, strict: bool = False) -> NDArray[Any]:
    """Return the means over the windows of pixels, ``(H', W', C)``: the rectangle without its margins.

    ``values (H, W, C)`` of ``pixels (H, W)``; zero where nothing is seen. ``strict``: see `STRICT_NORMAL`.
    """
    inner = reach.within(pixels.seen.shape)
    rows, columns = np.nonzero(pixels.seen[inner])
    places = rows + reach.up, columns + reach.left
    means, found = window_means(values, pixels, places, pixels, places, reach, strict)
    if not found.all():
        # The pixel itself may fail its own test by rounding.
        means[~found] = values[places][~found]
    shape = values[inner].shape
    if len(means) == shape[0] * shape[1]:
        return means.reshape(shape)
    out = np.zeros(shape, values.dtype)
    out[rows, columns] = means
    return out


def window_means(
    values: NDArray[Any],
    pixels: GBuffer,
    windows: Places,
    points: GBuffer,
    places: Places,
    reach: Reach,
    strict: bool = False,
) -> tuple[NDArray[Any], NDArray[np.bool_]]:
    """Return the means over windows of pixels, of those that are on the surfaces of given points.

    Parameters
    ----------
    values, pixels
        ``(H, W, C)``; ``(H, W)``: what is averaged, and what is seen there.
    windows
        Rows and columns of the windows' own pixels, ``(n,)`` each; windows must lie within the rectangle.
    points, places
        ``(H', W')``; ``(n,)`` each: rows and columns therein of the points whose surface it is, of each window.
    reach, strict
        The window; whether shading normals are to agree too.

    Returns
    -------
    means, found
        ``(n, C)``; ``(n,)`` whether any pixel of the window is on that surface; zero where none is.
    """
    means = np.zeros((len(windows[0]), values.shape[2]), values.dtype)
    counts = np.zeros(len(means), np.int64)
    _window_means(
        values,
        pixels.seen,
        pixels.place,
        pixels.geometric,
        pixels.shading,
        *windows,
        *places,
        points.place,
        points.geometric,
        points.shading,
        points.depth,
        reach,
        STRICT_NORMAL if strict else -2.0,
        means,
        counts,
    )
    return means, counts > 0


@njit(cache=True, nogil=True)
def same_surface(px, py, pz, nx, ny, nz, depth, place, geometric):  # type: ignore[no-untyped-def]
    """Say whether ``place`` and ``geometric``, ``(3,)`` each, are on the smooth surface of p, whose normal is n.

    ``depth``: of p, metres from the camera.
    """
    if nx * geometric[0] + ny * geometric[1] + nz * geometric[2] <= SAME_NORMAL:
        return False
    off = (place[0] - px) * nx + (place[1] - py) * ny + (place[2] - pz) * nz
    return abs(off) < PLANE_TOLERANCE * depth


@njit(cache=True, nogil=True)
def _window_means(  # type: ignore[no-untyped-def]
    values,
    seen,
    place,
    geometric,
    shading,
    rows,
    columns,
    point_rows,
    point_columns,
    point_place,
    point_geometric,
    point_shading,
    point_depth,
    reach,
    shading_test,
    means,
    counts,
):
    """Write means ``(n, C)`` and how many pixels they are of; ``shading_test`` below −1: none."""
    left, right, up, down = reach
    channels = values.shape[2]
    total = np.empty(channels, values.dtype)
    for k in range(len(rows)):
        i, j = point_rows[k], point_columns[k]
        px, py, pz = point_place[i, j, 0], point_place[i, j, 1], point_place[i, j, 2]
        nx, ny, nz = point_geometric[i, j, 0], point_geometric[i, j, 1], point_geometric[i, j, 2]
        sx, sy, sz = point_shading[i, j, 0], point_shading[i, j, 1], point_shading[i, j, 2]
        depth = point_depth[i, j]
        total[:] = 0
        count = 0
        for a in range(rows[k] - up, rows[k] + down + 1):
            for b in range(columns[k] - left, columns[k] + right + 1):
                if not seen[a, b]:
                    continue
                if not same_surface(px, py, pz, nx, ny, nz, depth, place[a, b], geometric[a, b]):
                    continue
                if shading_test > -1:
                    s = shading[a, b]
                    if s[0] * sx + s[1] * sy + s[2] * sz < shading_test:
                        continue
                count += 1
                v = values[a, b]
                for c in range(channels):
                    total[c] += v[c]
        counts[k] = count
        if count:
            for c in range(channels):
                means[k, c] = total[c] / count
