"""From the planes of a block of directions to the cells of one tile of layers."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lightwell.field.plane import CHANNELS, SPACING


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def fill_tile(  # type: ignore[no-untyped-def]
    planes,
    starts,
    nodes,
    origins,
    slopes,
    middle,
    first_layer,
    first_row,
    out,
):
    """Interpolate K planes at the cells of a tile: ``out`` ``(K, 3, layers, rows, U)`` float32.

    ``planes`` is flat; direction k's lies at ``starts[k]`` with the shape ``(4, V, 2, U/2)`` of `split`. Within one
    layer all cells lie equally between their nodes, so that the four weights are constants.
    """
    layers, rows, width = out.shape[2], out.shape[3], out.shape[4]
    for k in range(out.shape[0]):
        count_v, half = nodes[k, 0], nodes[k, 1] // 2
        row_stride = 2 * half
        for layer in range(layers):
            shift = first_layer + layer + 0.5 - middle
            # The first cell's centre is at U = ½ − s·shift.
            at_u = (0.5 - slopes[k, 0] * shift - origins[k, 0]) / SPACING
            at_v = (0.5 - slopes[k, 1] * shift - origins[k, 1]) / SPACING
            node_u, node_v = math.floor(at_u), math.floor(at_v)
            fu, fv = np.float32(at_u - node_u), np.float32(at_v - node_v)
            w00, w01 = (1 - fu) * (1 - fv), fu * (1 - fv)
            w10, w11 = (1 - fu) * fv, fu * fv
            # Node 2i + n of a row stands at n%2 · half + n//2 + i.
            left = (node_u % 2) * half + node_u // 2
            right = ((node_u + 1) % 2) * half + (node_u + 1) // 2
            for channel in range(3):
                base = starts[k] + channel * count_v * row_stride
                for row in range(rows):
                    low = base + (2 * (first_row + row) + node_v) * row_stride
                    a = planes[low + left : low + left + width]
                    b = planes[low + right : low + right + width]
                    c = planes[low + row_stride + left : low + row_stride + left + width]
                    d = planes[low + row_stride + right : low + row_stride + right + width]
                    target = out[k, channel, layer, row]
                    for x in range(width):
                        target[x] = w00 * a[x] + w01 * b[x] + w10 * c[x] + w11 * d[x]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def add_coverage(  # type: ignore[no-untyped-def]
    planes,
    starts,
    nodes,
    origins,
    slopes,
    middle,
    weights,
    coverage,
    samples,
):
    """Add each direction's solid angle where it had samples, and the kernel weight gathered, times solid angle.

    ``coverage`` and ``samples`` ``(W, V, U)`` float32. A cell has what its nearest node has.
    """
    width = coverage.shape[2]
    for k in range(starts.shape[0]):
        count_v, half = nodes[k, 0], nodes[k, 1] // 2
        row_stride = 2 * half
        weight = np.float32(weights[k])
        base = starts[k] + (CHANNELS - 1) * count_v * row_stride
        for layer in range(coverage.shape[0]):
            shift = layer + 0.5 - middle
            node_u = math.floor((0.5 - slopes[k, 0] * shift - origins[k, 0]) / SPACING + 0.5)
            node_v = math.floor((0.5 - slopes[k, 1] * shift - origins[k, 1]) / SPACING + 0.5)
            left = (node_u % 2) * half + node_u // 2
            for row in range(coverage.shape[1]):
                low = base + (2 * row + node_v) * row_stride + left
                found = planes[low : low + width]
                seen, gathered = coverage[layer, row], samples[layer, row]
                for x in range(width):
                    seen[x] += weight if found[x] > 0 else np.float32(0)
                    gathered[x] += weight * found[x]
