"""From the planes of a block of directions to the cells of a grid, and to their coefficients.

What a direction adds to a cell is the value that its plane has where the cell's ray passes, times the direction's SH
row: for a block of directions one matrix product, whose second factor would be larger than any cache. So it is made
piece by piece: one run of cells along u, one group of directions at a time, multiplied where it was made.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.field.plane import COLOURS, SPACING

GROUP = 8
"""Directions whose samples along a run of cells are made before they are multiplied: they stay in the first cache."""
TOGETHER = 32
"""Directions that are added to all layers of a tile before the next: what they read of their planes stays cached."""
LAYERS = 16
"""Layers of a tile. Tiles lean like the directions, so that all their layers read nearly the same part of a plane."""


class Planes(NamedTuple):
    """The planes of K directions of one layer axis, with slopes that are alike."""

    data: NDArray[np.float32]
    """All lattices as `plane.split` left them, flat: the k-th lies at ``starts[k]``."""
    starts: NDArray[np.int64]
    """``(K,)``."""
    nodes: NDArray[np.int64]
    """``(K, 2)``: nodes along V and U."""
    origins: NDArray[np.float64]
    """``(K, 2)``: (U, V) of the first node."""
    slopes: NDArray[np.float64]
    """``(K, 2)``."""
    middle: float
    """W/2."""


@njit(cache=True, nogil=True)
def _places(planes, layers):  # type: ignore[no-untyped-def]
    """Return where each plane's values for the first cell of each layer begin, and how they are weighted.

    Returns
    -------
    lefts, rights
        ``(K, W)`` int64 positions of the two nodes round the cell, along u, in ``planes.data``.
    weights
        ``(K, W, 4)`` float32 of these two nodes and the two above them. Within one layer all cells lie equally between
        their nodes.
    """
    count = planes.starts.size
    lefts, rights = np.empty((count, layers), np.int64), np.empty((count, layers), np.int64)
    weights = np.empty((count, layers, 4), np.float32)
    for k in range(count):
        half = planes.nodes[k, 1] // 2
        for layer in range(layers):
            shift = layer + 0.5 - planes.middle
            # The first cell's centre is at U = ½ − s·shift.
            at_u = (0.5 - planes.slopes[k, 0] * shift - planes.origins[k, 0]) / SPACING
            at_v = (0.5 - planes.slopes[k, 1] * shift - planes.origins[k, 1]) / SPACING
            node_u, node_v = math.floor(at_u), math.floor(at_v)
            low = planes.starts[k] + node_v * 2 * half * COLOURS
            # Node 2i + n of a row stands at n%2 · half + n//2 + i.
            lefts[k, layer] = low + ((node_u % 2) * half + node_u // 2) * COLOURS
            rights[k, layer] = low + (((node_u + 1) % 2) * half + (node_u + 1) // 2) * COLOURS
            fu, fv = at_u - node_u, at_v - node_v
            part = weights[k, layer]
            part[0], part[1] = (1 - fu) * (1 - fv), fu * (1 - fv)
            part[2], part[3] = (1 - fu) * fv, fu * fv
    return lefts, rights, weights


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _read_run(data, left, right, stride, weights, out):  # type: ignore[no-untyped-def]
    """Interpolate a plane at a run of cells along u: ``out`` ``(U · 3,)`` float32; ``stride`` leads to the next row."""
    w0, w1, w2, w3 = weights[0], weights[1], weights[2], weights[3]
    size = out.size
    a, b = data[left : left + size], data[right : right + size]
    c, d = data[left + stride : left + stride + size], data[right + stride : right + stride + size]
    for x in range(size):
        out[x] = w0 * a[x] + w1 * b[x] + w2 * c[x] + w3 * d[x]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _add_product(rows, first, values, sums):  # type: ignore[no-untyped-def]
    """Add ``rows[:, first : first + GROUP] @ values``, ``(C, …)`` times ``(GROUP, n)``, to ``sums`` ``(C, n)`` float32.

    Four rows times four directions fill the processor's registers; a count of coefficients is a multiple of four or one
    above. LLVM vectorises the innermost loop only where it checks for overlap just before it: were the loop over k
    outermost, or unrolled, it would check whole arrays, which do interleave, and take the scalar loop instead.
    """
    whole = sums.shape[0] // 4 * 4
    for i in range(0, whole, 4):
        p, q, r, s = sums[i], sums[i + 1], sums[i + 2], sums[i + 3]
        for k in range(0, values.shape[0], 4):
            a, b, c, d = values[k], values[k + 1], values[k + 2], values[k + 3]
            at = first + k
            p0, p1, p2, p3 = rows[i, at], rows[i, at + 1], rows[i, at + 2], rows[i, at + 3]
            q0, q1, q2, q3 = rows[i + 1, at], rows[i + 1, at + 1], rows[i + 1, at + 2], rows[i + 1, at + 3]
            r0, r1, r2, r3 = rows[i + 2, at], rows[i + 2, at + 1], rows[i + 2, at + 2], rows[i + 2, at + 3]
            s0, s1, s2, s3 = rows[i + 3, at], rows[i + 3, at + 1], rows[i + 3, at + 2], rows[i + 3, at + 3]
            for x in range(sums.shape[1]):
                ax, bx, cx, dx = a[x], b[x], c[x], d[x]
                p[x] += p0 * ax + p1 * bx + p2 * cx + p3 * dx
                q[x] += q0 * ax + q1 * bx + q2 * cx + q3 * dx
                r[x] += r0 * ax + r1 * bx + r2 * cx + r3 * dx
                s[x] += s0 * ax + s1 * bx + s2 * cx + s3 * dx
    for i in range(whole, sums.shape[0]):
        p = sums[i]
        for k in range(0, values.shape[0], 4):
            a, b, c, d = values[k], values[k + 1], values[k + 2], values[k + 3]
            at = first + k
            p0, p1, p2, p3 = rows[i, at], rows[i, at + 1], rows[i, at + 2], rows[i, at + 3]
            for x in range(sums.shape[1]):
                p[x] += p0 * a[x] + p1 * b[x] + p2 * c[x] + p3 * d[x]


@njit(cache=True, nogil=True)
def add_planes(planes, rows, sums):  # type: ignore[no-untyped-def]
    """Add K directions to the coefficients of all cells.

    ``rows`` ``(C, K')`` float32 with zeros from K to K', the next multiple of `GROUP`; ``sums`` ``(W, V, C, U · 3)``
    float32.
    """
    layers, height, width = sums.shape[0], sums.shape[1], sums.shape[3]
    count = planes.starts.size
    lean = planes.slopes[:, 1].mean()
    lefts, rights, weights = _places(planes, layers)
    values = np.zeros((GROUP, width), np.float32)
    for first_layer in range(0, layers, LAYERS):
        last_layer = min(first_layer + LAYERS, layers)
        at_first = math.floor(lean * (first_layer + 0.5 - planes.middle) + 0.5)
        at_last = math.floor(lean * (last_layer - 0.5 - planes.middle) + 0.5)
        for line in range(-max(at_first, at_last), height - min(at_first, at_last)):
            for start in range(0, count, TOGETHER):
                for layer in range(first_layer, last_layer):
                    row = line + math.floor(lean * (layer + 0.5 - planes.middle) + 0.5)
                    if row < 0 or row >= height:
                        continue
                    for first in range(start, min(start + TOGETHER, count), GROUP):
                        for k in range(first, first + GROUP):
                            if k < count:
                                stride = planes.nodes[k, 1] * COLOURS
                                left, right = lefts[k, layer] + 2 * row * stride, rights[k, layer] + 2 * row * stride
                                _read_run(planes.data, left, right, stride, weights[k, layer], values[k - first])
                            else:
                                values[k - first] = 0
                        _add_product(rows, first, values, sums[layer, row])


@njit(cache=True, nogil=True)
def fill_volume(planes, k, out):  # type: ignore[no-untyped-def]
    """Interpolate the k-th plane at all cells: ``out`` ``(W, V, U · 3)`` float32."""
    one = Planes(
        planes.data,
        planes.starts[k : k + 1],
        planes.nodes[k : k + 1],
        planes.origins[k : k + 1],
        planes.slopes[k : k + 1],
        planes.middle,
    )
    lefts, rights, weights = _places(one, out.shape[0])
    stride = planes.nodes[k, 1] * COLOURS
    for layer in range(out.shape[0]):
        for row in range(out.shape[1]):
            left, right = lefts[0, layer] + 2 * row * stride, rights[0, layer] + 2 * row * stride
            _read_run(planes.data, left, right, stride, weights[0, layer], out[layer, row])


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def add_coverage(planes, k, weight, coverage, samples):  # type: ignore[no-untyped-def]
    """Add the k-th direction's solid angle where it had samples, and the kernel weight gathered, times solid angle.

    ``coverage`` and ``samples`` ``(W, V, U)`` float32. A cell has what its nearest node has.
    """
    width = coverage.shape[2]
    count_v, half = planes.nodes[k, 0], planes.nodes[k, 1] // 2
    stride = 2 * half
    first = planes.starts[k] + count_v * stride * COLOURS
    for layer in range(coverage.shape[0]):
        shift = layer + 0.5 - planes.middle
        node_u = math.floor((0.5 - planes.slopes[k, 0] * shift - planes.origins[k, 0]) / SPACING + 0.5)
        node_v = math.floor((0.5 - planes.slopes[k, 1] * shift - planes.origins[k, 1]) / SPACING + 0.5)
        left = (node_u % 2) * half + node_u // 2
        for row in range(coverage.shape[1]):
            low = first + (2 * row + node_v) * stride + left
            found = planes.data[low : low + width]
            seen, gathered = coverage[layer, row], samples[layer, row]
            for x in range(width):
                seen[x] += weight if found[x] > 0 else np.float32(0)
                gathered[x] += weight * found[x]
