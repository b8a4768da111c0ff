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


@njit(cache=True, nogil=True)
def filter_rows(  # type: ignore[no-untyped-def]
    values, seen, place, geometric, shading, depth, reach, normal_test, plane_test, shading_test, first, last, out
):
    """Write the mean over each pixel's window for rows ``first`` … ``last − 1`` of the inner rectangle.

    ``values`` (H, W, C); ``seen`` (H, W); ``place, geometric, shading`` (H, W, 3); ``depth`` (H, W); ``reach``: left,
    right, up, down. ``shading_test`` below −1: none. Out: ``out`` (H − up − down, W − left − right, C); zero where
    nothing is seen.
    """
    left, right, up, down = reach
    width = values.shape[1] - left - right
    channels = values.shape[2]
    total = np.empty(channels, values.dtype)
    for row in range(first, last):
        for column in range(width):
            i, j = row + up, column + left
            out[row, column] = 0
            if not seen[i, j]:
                continue
            nx, ny, nz = geometric[i, j, 0], geometric[i, j, 1], geometric[i, j, 2]
            px, py, pz = place[i, j, 0], place[i, j, 1], place[i, j, 2]
            nearest = plane_test * depth[i, j]
            total[:] = 0
            count = 0
            for a in range(i - up, i + down + 1):
                for b in range(j - left, j + right + 1):
                    if not seen[a, b]:
                        continue
                    g = geometric[a, b]
                    if nx * g[0] + ny * g[1] + nz * g[2] <= normal_test:
                        continue
                    p = place[a, b]
                    if abs((p[0] - px) * nx + (p[1] - py) * ny + (p[2] - pz) * nz) >= nearest:
                        continue
                    if shading_test > -1:
                        s, o = shading[a, b], shading[i, j]
                        if s[0] * o[0] + s[1] * o[1] + s[2] * o[2] < shading_test:
                            continue
                    count += 1
                    v = values[a, b]
                    for c in range(channels):
                        total[c] += v[c]
            # The pixel itself may fail its own test by rounding.
            if count == 0:
                for c in range(channels):
                    out[row, column, c] = values[i, j, c]
            else:
                for c in range(channels):
                    out[row, column, c] = total[c] / count


def filtered(
    values: NDArray[Any],
    seen: NDArray[np.bool_],
    place: NDArray[np.floating],
    geometric: NDArray[np.floating],
    shading: NDArray[np.floating],
    depth: NDArray[np.floating],
    reach: Reach,
    strict: bool = False,
) -> NDArray[Any]:
    """Return the means, ``(H', W', C)``: the rectangle without its margins. Arguments as in `filter_rows`."""
    left, right, up, down = reach
    shape = (values.shape[0] - up - down, values.shape[1] - left - right, values.shape[2])
    out = np.empty(shape, values.dtype)
    limit = STRICT_NORMAL if strict else -2.0
    filter_rows(
        values, seen, place, geometric, shading, depth, reach, SAME_NORMAL, PLANE_TOLERANCE, limit, 0, shape[0], out
    )
    return out
