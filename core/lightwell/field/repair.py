"""Repair of places that no sample reached.

In the plane across a direction the field has two dimensions, and so do its holes. *Pull–push* (MATHS §6) halves the
resolution from level to level:

    pull   W = Σ min(w, 1),  v = Σ min(w, 1) v / W      over the four children
    push   v_k = v_k where w_k > 0, else the linear interpolation of the next level

The *joint bilateral* filter (future work of paper 000) weights the samples round a hole by distance, and by how much
they resemble what pull–push guesses there, so that less leaks across the edges of shadows. The *mip-map* is the
paper's own repair (§3.3), in three dimensions: an empty cell takes the mix of the finest level that has a valid cell
near it.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Singles = NDArray[np.float32]


@njit(cache=True, nogil=True)
def _pull(values, weights, coarse, coarse_weights):  # type: ignore[no-untyped-def]
    channels = values.shape[2]
    for row in range(coarse.shape[0]):
        for column in range(coarse.shape[1]):
            total = np.float32(0)
            for channel in range(channels):
                coarse[row, column, channel] = 0
            for dy in range(2):
                for dx in range(2):
                    y, x = 2 * row + dy, 2 * column + dx
                    if y < values.shape[0] and x < values.shape[1] and weights[y, x] > 0:
                        weight = min(weights[y, x], np.float32(1))
                        total += weight
                        for channel in range(channels):
                            coarse[row, column, channel] += weight * values[y, x, channel]
            coarse_weights[row, column] = total
            if total > 0:
                for channel in range(channels):
                    coarse[row, column, channel] /= total


@njit(cache=True, nogil=True)
def _push(values, weights, coarse):  # type: ignore[no-untyped-def]
    channels = values.shape[2]
    for y in range(values.shape[0]):
        near_y = y // 2
        far_y = min(max(near_y + (1 if y % 2 == 1 else -1), 0), coarse.shape[0] - 1)
        for x in range(values.shape[1]):
            if weights[y, x] > 0:
                continue
            near_x = x // 2
            far_x = min(max(near_x + (1 if x % 2 == 1 else -1), 0), coarse.shape[1] - 1)
            for channel in range(channels):
                values[y, x, channel] = np.float32(0.0625) * (
                    9 * coarse[near_y, near_x, channel]
                    + 3 * (coarse[near_y, far_x, channel] + coarse[far_y, near_x, channel])
                    + coarse[far_y, far_x, channel]
                )


def pull_push(values: Singles, weights: Singles) -> bool:
    """Fill the places of ``values`` ``(H, W, C)`` float32 where ``weights`` ``(H, W)`` float32 is 0, in place.

    Places with weight keep their value. Returns False, and changes nothing, where no place has weight.
    """
    levels = [(values, weights)]
    while max(levels[-1][1].shape) > 1:
        height, width = ((size + 1) // 2 for size in levels[-1][1].shape)
        coarse = np.empty((height, width, values.shape[2]), np.float32)
        coarse_weights = np.empty((height, width), np.float32)
        _pull(*levels[-1], coarse, coarse_weights)
        levels.append((coarse, coarse_weights))
        if (coarse_weights > 0).all():
            break
    if not (levels[-1][1] > 0).any():
        return False
    for fine, coarse_level in zip(levels[-2::-1], levels[:0:-1], strict=True):
        _push(*fine, coarse_level[0])
    return True


WINDOW = 6
"""Nodes to each side that the bilateral filter looks at."""
DISTANCE_SIGMA = 2.5
"""Standard deviation of its weight in distance, nodes."""
RANGE_SIGMA = 0.25
"""Standard deviation of its weight in difference, as a share of the plane's own."""


@njit(cache=True, nogil=True)
def _filter(values, weights, deviation):  # type: ignore[no-untyped-def]
    height, width, channels = values.shape
    falloff = np.float32(0.5 / (RANGE_SIGMA * RANGE_SIGMA * deviation * deviation))
    total = np.empty(channels, np.float32)
    for y in range(height):
        for x in range(width):
            if weights[y, x] > 0:
                continue
            total[:] = 0
            weight = np.float32(0)
            for row in range(max(0, y - WINDOW), min(height, y + WINDOW + 1)):
                for column in range(max(0, x - WINDOW), min(width, x + WINDOW + 1)):
                    if weights[row, column] <= 0:
                        continue
                    apart = np.float32(0)
                    for channel in range(channels):
                        change = values[row, column, channel] - values[y, x, channel]
                        apart += change * change
                    squared = np.float32((row - y) ** 2 + (column - x) ** 2)
                    w = np.exp(-squared / np.float32(2 * DISTANCE_SIGMA * DISTANCE_SIGMA) - falloff * apart)
                    weight += w
                    for channel in range(channels):
                        total[channel] += w * values[row, column, channel]
            if weight > np.float32(1e-12):
                for channel in range(channels):
                    values[y, x, channel] = total[channel] / weight


def bilateral(values: Singles, weights: Singles) -> bool:
    """Fill as `pull_push` does, then move each filled place towards the samples near it that resemble it."""
    if not pull_push(values, weights):
        return False
    known = weights > 0
    deviation = float(values[known].std(axis=0).mean())
    if deviation > 0:
        _filter(values, weights, deviation)
    return True


@njit(cache=True, nogil=True)
def _coarsen(values, valid, coarse, coarse_valid):  # type: ignore[no-untyped-def]
    for z in range(coarse.shape[0]):
        for y in range(coarse.shape[1]):
            for x in range(coarse.shape[2]):
                coarse[z, y, x] = 0
                count = 0
                for child in range(8):
                    k, j, i = 2 * z + (child >> 2), 2 * y + ((child >> 1) & 1), 2 * x + (child & 1)
                    if k < values.shape[0] and j < values.shape[1] and i < values.shape[2] and valid[k, j, i]:
                        count += 1
                        coarse[z, y, x] += values[k, j, i]
                coarse_valid[z, y, x] = count > 0
                if count > 0:
                    coarse[z, y, x] /= np.float32(count)


@njit(cache=True, nogil=True)
def _fill_from(values, missing, coarse, coarse_valid, level):  # type: ignore[no-untyped-def]
    """Fill the cells that a level has something near for; return how many are left."""
    left = 0
    size = 1 << level
    mixed = np.empty(values.shape[3], np.float32)
    for z in range(values.shape[0]):
        for y in range(values.shape[1]):
            for x in range(values.shape[2]):
                if not missing[z, y, x]:
                    continue
                mixed[:] = 0
                weight = np.float32(0)
                for corner in range(8):
                    w = np.float32(1)
                    place = np.empty(3, np.int64)
                    for axis in range(3):
                        at = ((z, y, x)[axis] + 0.5) / size - 0.5
                        low = int(np.floor(at))
                        far = (corner >> axis) & 1
                        w *= np.float32(at - low if far else 1 - (at - low))
                        place[axis] = min(max(low + far, 0), coarse.shape[axis] - 1)
                    if w > 0 and coarse_valid[place[0], place[1], place[2]]:
                        weight += w
                        mixed += w * coarse[place[0], place[1], place[2]]
                if weight > 0:
                    values[z, y, x] = mixed / weight
                    missing[z, y, x] = False
                else:
                    left += 1
    return left


def mipmap(values: Singles, valid: NDArray[np.bool_]) -> bool:
    """Fill the cells of ``values`` ``(Z, Y, X, C)`` float32 that are not ``valid`` ``(Z, Y, X)``, in place.

    Returns False, and changes nothing, where no cell is valid.
    """
    if not valid.any():
        return False
    missing = ~valid
    fine, fine_valid = values.copy(), valid
    level = 0
    while missing.any():
        level += 1
        shape = tuple((size + 1) // 2 for size in fine_valid.shape)
        coarse = np.zeros((*shape, values.shape[3]), np.float32)
        coarse_valid = np.zeros(shape, np.bool_)
        _coarsen(fine, fine_valid, coarse, coarse_valid)
        _fill_from(values, missing, coarse, coarse_valid, level)
        fine, fine_valid = coarse, coarse_valid
    return True
