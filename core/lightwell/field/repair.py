"""Repair of places that no sample reached, by weighted pull–push (MATHS §6).

In the plane across a direction the field has two dimensions, and so do its holes. Each level halves the resolution:

    pull   W = Σ min(w, 1),  v = Σ min(w, 1) v / W      over the four children
    push   v_k = v_k where w_k > 0, else the linear interpolation of the next level
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Singles = NDArray[np.float32]


@njit(cache=True, nogil=True)
def _pull(values, weights, coarse, coarse_weights):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
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
def _push(values, weights, coarse):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
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
