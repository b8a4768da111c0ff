"""Kernels over the bricks of an adaptive grid.

Arrays over bricks are ``(bricks, z, y, x, …)``, ``pages`` ``(z, y, x)`` says which brick covers a block, ``levels``
``(bricks,)`` how coarse it is, ``depths`` (x, y, z) from which level on one brick covers an axis
(`lightwell.field.bricks`). Places and steps are in the order x, y, z. While a grid is built every brick has
coefficients of its own, ``(bricks, z, y, x, bands², 3)``; in a finished one bricks share nodes.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lightwell.field.bricks import STEPS


@njit(cache=True, nogil=True)
def _locate(place, depths, pages, levels, shape, low, fraction, span):  # type: ignore[no-untyped-def]
    """Return the brick that covers ``place`` (in steps, within the grid), and where in it that lies.

    ``low`` and ``fraction`` become the node below and the distance from it in nodes, ``span`` the steps between nodes;
    ``shape`` is that of a brick.
    """
    block = np.empty(3, np.int64)
    for axis in range(3):
        block[axis] = min(int(place[axis] / STEPS), pages.shape[2 - axis] - 1)
    brick = pages[block[2], block[1], block[0]]
    for axis in range(3):
        span[axis] = 1 << min(levels[brick], depths[axis])
        local = place[axis] / span[axis] - block[axis] // span[axis] * STEPS
        low[axis] = min(int(local), max(shape[2 - axis] - 2, 0))
        fraction[axis] = local - low[axis]
    return brick


@njit(cache=True, nogil=True)
def _blend(brick, low, fraction, coefficients, out):  # type: ignore[no-untyped-def]
    """Interpolate ``out``, ``(bands², 3)`` or for coverage ``(1, 1)``, in a brick of ``coefficients``.

    Corners without weight may lie outside it.
    """
    out[:] = 0.0
    for corner in range(8):
        weight = 1.0
        for axis in range(3):
            weight *= fraction[axis] if (corner >> axis) & 1 else 1.0 - fraction[axis]
        if weight == 0.0:
            continue
        x, y, z = low[0] + (corner & 1), low[1] + ((corner >> 1) & 1), low[2] + ((corner >> 2) & 1)
        for k in range(out.shape[0]):
            for channel in range(out.shape[1]):
                out[k, channel] += weight * coefficients[brick, z, y, x, k, channel]


@njit(cache=True, nogil=True)
def _squared_distance(values, cell):  # type: ignore[no-untyped-def]
    total = 0.0
    for k in range(values.shape[0]):
        for channel in range(3):
            total += (values[k, channel] - cell[k, channel]) ** 2
    return total


@njit(cache=True, nogil=True)
def _coarsest(at, pages, levels):  # type: ignore[no-untyped-def]
    """Return the coarsest of the up to eight bricks that touch the node ``at`` (x, y, z in steps)."""
    found = -1
    for corner in range(8):
        z = _block(at[2], (corner >> 2) & 1, pages.shape[0])
        y = _block(at[1], (corner >> 1) & 1, pages.shape[1])
        x = _block(at[0], corner & 1, pages.shape[2])
        touching = pages[z, y, x]
        if found < 0 or levels[touching] > levels[found]:
            found = touching
    return found


@njit(cache=True, nogil=True)
def _block(step, before, blocks):  # type: ignore[no-untyped-def]
    """Return the block that begins at or holds a node; with ``before`` that which ends there, if one does."""
    block = step // STEPS
    if before and step % STEPS == 0:
        block -= 1
    return min(max(block, 0), blocks - 1)


@njit(cache=True, nogil=True)
def lattice_errors(cells, lattice, span, errors):  # type: ignore[no-untyped-def]
    """Find the largest squared error of each brick of one level, its faces included: ``errors`` ``(z, y, x)``.

    ``cells`` ``(z, y, x, bands², 3)`` is the regular grid, ``lattice`` all nodes of the level, ``span`` apart.
    """
    nodes = lattice.reshape((1, *lattice.shape))
    value = np.empty(cells.shape[3:])
    fraction = np.empty(3)
    at, low, first, last = (np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64))
    for z in range(cells.shape[0]):
        for y in range(cells.shape[1]):
            for x in range(cells.shape[2]):
                at[0], at[1], at[2] = x, y, z
                for axis in range(3):
                    low[axis] = at[axis] // span[axis]
                    fraction[axis] = at[axis] / span[axis] - low[axis]
                    last[axis] = min(low[axis] // STEPS, errors.shape[2 - axis] - 1)
                    shared = at[axis] == last[axis] * STEPS * span[axis]
                    first[axis] = max(last[axis] - 1, 0) if shared else last[axis]
                _blend(0, low, fraction, nodes, value)
                error = _squared_distance(value, cells[z, y, x])
                for w in range(first[2], last[2] + 1):
                    for v in range(first[1], last[1] + 1):
                        for u in range(first[0], last[0] + 1):
                            errors[w, v, u] = max(errors[w, v, u], error)


@njit(cache=True, nogil=True)
def leaf_errors(cells, depths, pages, levels, coefficients, errors):  # type: ignore[no-untyped-def]
    """Find the largest squared error of each leaf ``(bricks,)`` against the regular grid ``(z, y, x, bands², 3)``.

    The error of a cell that several leaves touch is that of the coarsest: the others take their values from it.
    """
    shape = coefficients.shape[1:4]
    value = np.empty(cells.shape[3:])
    place, fraction = np.empty(3), np.empty(3)
    at, low, span = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    for z in range(cells.shape[0]):
        for y in range(cells.shape[1]):
            for x in range(cells.shape[2]):
                at[0], at[1], at[2] = x, y, z
                place[0], place[1], place[2] = x, y, z
                brick = _locate(place, depths, pages, levels, shape, low, fraction, span)
                _blend(brick, low, fraction, coefficients, value)
                error = _squared_distance(value, cells[z, y, x])
                coarse = _coarsest(at, pages, levels)
                errors[coarse] = max(errors[coarse], error)


@njit(cache=True, nogil=True)
def join(corners, depths, pages, levels, coefficients, coverage):  # type: ignore[no-untyped-def]
    """Give nodes that touch a coarser leaf what that one says there.

    ``corners`` ``(bricks, 3)`` are the bricks' first blocks. Coarse bricks come first, so that they are finished when
    finer ones read them.
    """
    shape = coefficients.shape[1:4]
    value, covered = np.empty(coefficients.shape[4:]), np.empty((1, 1))
    shares = coverage.reshape((*coverage.shape, 1, 1))
    fraction = np.empty(3)
    low, at, index = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    for brick in range(levels.size):
        for node in range(shape[0] * shape[1] * shape[2]):
            index[0], index[1], index[2] = node % shape[2], node // shape[2] % shape[1], node // (shape[2] * shape[1])
            for axis in range(3):
                at[axis] = corners[brick, axis] * STEPS + (index[axis] << min(levels[brick], depths[axis]))
            coarse = _coarsest(at, pages, levels)
            if levels[coarse] <= levels[brick]:
                continue
            for axis in range(3):
                local = (at[axis] - corners[coarse, axis] * STEPS) / (1 << min(levels[coarse], depths[axis]))
                low[axis] = min(int(local), max(shape[2 - axis] - 2, 0))
                fraction[axis] = local - low[axis]
            _blend(coarse, low, fraction, coefficients, value)
            coefficients[brick, index[2], index[1], index[0]] = value
            _blend(coarse, low, fraction, shares, covered)
            coverage[brick, index[2], index[1], index[0]] = covered[0, 0]


@njit(cache=True, nogil=True)
def sample(  # type: ignore[no-untyped-def]
    places, sizes, voxel, depths, pages, levels, nodes, coefficients, coverage, values, covered, slopes
):
    """Sample at ``places`` ``(n, 3)`` in steps, clamped to the grid of ``sizes`` cells.

    ``nodes`` ``(bricks, z, y, x)`` are rows of ``coefficients`` ``(nodes, bands², 3)`` and ``coverage`` ``(nodes,)``.
    ``values`` ``(n, count, 3)`` and ``covered`` ``(n,)`` are filled, and where it is not empty ``slopes`` ``(n, count,
    3, 3)``, which must be 0 before, with the derivatives per metre.
    """
    count = values.shape[1]
    shape = nodes.shape[1:]
    place, fraction, inside, change = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    low, span, index = np.empty(3, np.int64), np.empty(3, np.int64), np.empty(3, np.int64)
    for i in range(places.shape[0]):
        for axis in range(3):
            place[axis] = min(max(places[i, axis], 0.0), sizes[axis] - 1.0)
            inside[axis] = 1.0 if place[axis] == places[i, axis] and sizes[axis] > 1 else 0.0
        brick = _locate(place, depths, pages, levels, shape, low, fraction, span)
        values[i] = 0.0
        covered[i] = 0.0
        for corner in range(8):
            weight = 1.0
            for axis in range(3):
                far = (corner >> axis) & 1
                # On an axis with one node the second corner is the first again, with weight 0.
                index[axis] = min(low[axis] + far, shape[2 - axis] - 1)
                weight *= fraction[axis] if far else 1.0 - fraction[axis]
            node = nodes[brick, index[2], index[1], index[0]]
            covered[i] += weight * coverage[node]
            for k in range(count):
                for channel in range(3):
                    values[i, k, channel] += weight * coefficients[node, k, channel]
            if slopes.shape[0] == 0:
                continue
            for axis in range(3):
                # The derivative of the trilinear weight along this axis.
                change[axis] = inside[axis] / (voxel[axis] * span[axis])
                for other in range(3):
                    far = (corner >> other) & 1
                    if other == axis:
                        change[axis] *= 1.0 if far else -1.0
                    else:
                        change[axis] *= fraction[other] if far else 1.0 - fraction[other]
            for k in range(count):
                for channel in range(3):
                    value = float(coefficients[node, k, channel])
                    for axis in range(3):
                        slopes[i, k, channel, axis] += change[axis] * value
