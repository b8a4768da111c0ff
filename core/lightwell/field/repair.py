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

ZERO, ONE = np.float32(0), np.float32(1)
NEAREST, SIDE, CORNER = np.float32(9 / 16), np.float32(3 / 16), np.float32(1 / 16)
"""Weights of the four coarse places round a fine one: bilinear."""


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _pull(fine, coarse):  # type: ignore[no-untyped-def]
    """Return whether every place of the coarse level has weight."""
    height, width = fine.shape[0], fine.shape[1]
    whole = True
    for row in range(coarse.shape[0]):
        # At the border a child that does not exist is its neighbour with no weight.
        upper, lower = fine[2 * row], fine[min(2 * row + 1, height - 1)]
        below = ONE if 2 * row + 1 < height else ZERO
        target = coarse[row]
        for column in range(coarse.shape[1]):
            x, next_x = 2 * column, min(2 * column + 1, width - 1)
            beside = ONE if 2 * column + 1 < width else ZERO
            a, b = min(upper[x, 3], ONE), min(upper[next_x, 3], ONE) * beside
            c, d = min(lower[x, 3], ONE) * below, min(lower[next_x, 3], ONE) * below * beside
            total = a + b + c + d
            inverse = ONE / total if total > 0 else ZERO
            for channel in range(3):
                high = a * upper[x, channel] + b * upper[next_x, channel]
                low = c * lower[x, channel] + d * lower[next_x, channel]
                target[column, channel] = (high + low) * inverse
            target[column, 3] = total
            if total <= 0:
                whole = False
    return whole


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _push(fine, coarse, firsts, lasts):  # type: ignore[no-untyped-def]
    """Fill the places ``firsts[y] … lasts[y] − 1`` of each row that have no weight."""
    for y in range(fine.shape[0]):
        nodes = fine[y]
        near = coarse[y // 2]
        far = coarse[min(max(y // 2 + (1 if y % 2 == 1 else -1), 0), coarse.shape[0] - 1)]
        for x in range(firsts[y], lasts[y]):
            if nodes[x, 3] > 0:
                continue
            near_x = x // 2
            far_x = min(max(near_x + (1 if x % 2 == 1 else -1), 0), coarse.shape[1] - 1)
            for channel in range(3):
                straight = NEAREST * near[near_x, channel] + SIDE * near[far_x, channel]
                nodes[x, channel] = straight + (SIDE * far[near_x, channel] + CORNER * far[far_x, channel])


@njit(cache=True, nogil=True)
def _pull_push(lattice, firsts, lasts):  # type: ignore[no-untyped-def]
    levels = [lattice]
    whole = False
    while not whole and max(levels[-1].shape[0], levels[-1].shape[1]) > 1:
        coarse = np.empty(((levels[-1].shape[0] + 1) // 2, (levels[-1].shape[1] + 1) // 2, 4), np.float32)
        whole = _pull(levels[-1], coarse)
        levels.append(coarse)
    top = levels[-1]
    known = False
    for y in range(top.shape[0]):
        for x in range(top.shape[1]):
            known = known or top[y, x, 3] > 0
    if known:
        for level in range(len(levels) - 2, -1, -1):
            fine = levels[level]
            if level > 0:
                firsts_here, lasts_here = np.zeros(fine.shape[0], np.int64), np.full(fine.shape[0], fine.shape[1])
            else:
                firsts_here, lasts_here = firsts, lasts
            _push(fine, levels[level + 1], firsts_here, lasts_here)
    return known


def pull_push(lattice: Singles, ranges: NDArray[np.int64] | None = None) -> bool:
    """Fill the places of a lattice ``(H, W, 4)`` float32 whose weight, the fourth channel, is 0: in place.

    Places with weight keep their value. With ``ranges`` ``(2, H)``, only the places ``ranges[0, y] … ranges[1, y] − 1``
    of a row are filled. Returns False, and changes nothing, where no place has weight.
    """
    height, width = lattice.shape[:2]
    if ranges is None:
        ranges = np.stack([np.zeros(height, np.int64), np.full(height, width)])
    return bool(_pull_push(lattice, ranges[0], ranges[1]))


WINDOW = 6
"""Nodes to each side that the bilateral filter looks at."""
DISTANCE_SIGMA = 2.5
"""Standard deviation of its weight in distance, nodes."""
RANGE_SIGMA = 0.25
"""Standard deviation of its weight in difference, as a share of the plane's own."""


@njit(cache=True, nogil=True)
def _filter(lattice, firsts, lasts, deviation):  # type: ignore[no-untyped-def]
    height, width = lattice.shape[0], lattice.shape[1]
    falloff = np.float32(0.5 / (RANGE_SIGMA * RANGE_SIGMA * deviation * deviation))
    total = np.empty(3, np.float32)
    for y in range(height):
        for x in range(firsts[y], lasts[y]):
            if lattice[y, x, 3] > 0:
                continue
            total[:] = 0
            weight = np.float32(0)
            for row in range(max(0, y - WINDOW), min(height, y + WINDOW + 1)):
                for column in range(max(0, x - WINDOW), min(width, x + WINDOW + 1)):
                    if lattice[row, column, 3] <= 0:
                        continue
                    apart = np.float32(0)
                    for channel in range(3):
                        change = lattice[row, column, channel] - lattice[y, x, channel]
                        apart += change * change
                    squared = np.float32((row - y) ** 2 + (column - x) ** 2)
                    w = np.exp(-squared / np.float32(2 * DISTANCE_SIGMA * DISTANCE_SIGMA) - falloff * apart)
                    weight += w
                    for channel in range(3):
                        total[channel] += w * lattice[row, column, channel]
            if weight > np.float32(1e-12):
                for channel in range(3):
                    lattice[y, x, channel] = total[channel] / weight


def bilateral(lattice: Singles, ranges: NDArray[np.int64] | None = None) -> bool:
    """Fill as `pull_push` does, then move each filled place towards the samples near it that resemble it."""
    height, width = lattice.shape[:2]
    if ranges is None:
        ranges = np.stack([np.zeros(height, np.int64), np.full(height, width)])
    if not pull_push(lattice, ranges):
        return False
    deviation = float(lattice[lattice[..., 3] > 0, :3].std(axis=0).mean())
    if deviation > 0:
        _filter(lattice, ranges[0], ranges[1], deviation)
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
