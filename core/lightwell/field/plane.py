"""The plane of one direction: where the grid's layers lie in it, and the kernel regression on its lattice.

In free space radiance is constant along a ray, so that the field of one direction is a function of two coordinates
(paper 000 §3; MATHS §6). We take them in a plane of the grid's own axes: with w the axis that the direction follows
most, a point (u, v, w) in cell units has

    U = u − s_u (w − W/2),   V = v − s_v (w − W/2),   s = ω_uv / ω_w,   |s| ≤ 1,

so that each layer of the grid sees the same plane, shifted. The squared distance between two rays that are (dU, dV)
apart is ``A dU² + 2B dU dV + C dV²`` with ``A = 1 − ω_u², B = −ω_u ω_v, C = 1 − ω_v²``.

The regression ``Σ w L / Σ w`` is evaluated on a lattice of half a cell and is linear between its nodes. That is finer
than the kernel (σ is half a cell), and makes the field continuous, which the truncated kernel by itself is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.field.spec import Floats

Singles = NDArray[np.float32]

SPACING = 0.5
"""Distance between lattice nodes, cells."""

TABLE = 4096
"""Entries of the kernel's table."""

CHANNELS = 4
"""Red, green, blue and the kernel weight that a node gathered."""

AXES = ((1, 2), (0, 2), (0, 1))
"""In-plane axes (u, v) of the layer axes w = x, y, z: u is the one of the two that runs faster in memory."""


@dataclass(frozen=True)
class Plane:
    """The plane of one direction."""

    axis: int
    """Layer axis w: 0, 1, 2 for x, y, z."""
    slope: tuple[float, float]
    """(s_u, s_v): how far the plane shifts from layer to layer, cells."""
    metric: tuple[float, float, float]
    """(A, B, C)."""
    origin: tuple[float, float]
    """(U, V) of the first lattice node."""
    nodes: tuple[int, int]
    """Lattice nodes along V and U; those along U are even in number."""
    middle: float
    """W/2."""

    def project(self, points: Floats) -> tuple[Floats, Floats]:
        """Return U and V ``(…)`` of points ``(…, 3)`` in cell units."""
        u_axis, v_axis = AXES[self.axis]
        along = points[..., self.axis] - self.middle
        return points[..., u_axis] - self.slope[0] * along, points[..., v_axis] - self.slope[1] * along


def layer_axes(directions: Floats) -> NDArray[np.intp]:
    """Return the axis that each direction ``(…, 3)`` follows most; the first one of those that tie to rounding."""
    lengths = np.abs(directions)
    return np.asarray(np.argmax(lengths >= (1 - 1e-9) * lengths.max(axis=-1, keepdims=True), axis=-1))


def make_plane(direction: Floats, resolution: tuple[int, int, int]) -> Plane:
    """Return the plane of a unit direction in cell units, with a lattice that holds every cell of the grid."""
    axis = int(layer_axes(direction))
    u_axis, v_axis = AXES[axis]
    u, v, w = (float(direction[i]) for i in (u_axis, v_axis, axis))
    slope = (u / w, v / w)
    middle = resolution[axis] / 2
    spans = [
        (0.5 - abs(s) * (middle - 0.5), count - 0.5 + abs(s) * (middle - 0.5))
        for s, count in zip(slope, (resolution[u_axis], resolution[v_axis]), strict=True)
    ]
    # One node more than the linear interpolation reads, so that rounding cannot step outside.
    count_u, count_v = (math.ceil((high - low) / SPACING) + 3 for low, high in spans)
    origin = (spans[0][0] - SPACING / 2, spans[1][0] - SPACING / 2)
    return Plane(axis, slope, (1 - u * u, -u * v, 1 - v * v), origin, (count_v, count_u + count_u % 2), middle)


def gaussian_table(support: float, sigma: float) -> Singles:
    """Return ``exp(−d²/2σ²)`` at equal steps of d² from 0 to the squared radius, ``(TABLE + 2,)`` float32.

    Read linearly, it is exact to 1e-7 where the radius is 3σ.
    """
    squared = np.arange(TABLE + 2) / TABLE * (support / 2) ** 2
    return np.exp(-squared / (2 * sigma * sigma)).astype(np.float32)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"})
def splat(u, v, radiance, metric, origin, radius, table, out):  # type: ignore[no-untyped-def]
    """Add samples to a lattice ``out`` ``(V, U, 4)`` float32: ``Σ w L`` in three channels and ``Σ w`` in the fourth.

    ``u``, ``v`` ``(P,)`` float64 are the samples' plane coordinates, ``radiance`` ``(P, 3)`` float32 with NaN for no
    sample, ``table`` is a `gaussian_table` of the kernel.
    """
    a, b, c = metric[0], metric[1], metric[2]
    across = c - b * b / a
    half_height = radius / math.sqrt(across)
    step = np.float32(SPACING)
    to_table = np.float32((table.shape[0] - 2) / (radius * radius))
    for p in range(u.shape[0]):
        red, green, blue = radiance[p, 0], radiance[p, 1], radiance[p, 2]
        if not (math.isfinite(red) and math.isfinite(green) and math.isfinite(blue)):
            continue
        first = max(0, math.ceil((v[p] - half_height - origin[1]) / SPACING))
        last = min(out.shape[0] - 1, math.floor((v[p] + half_height - origin[1]) / SPACING))
        for row in range(first, last + 1):
            dv = origin[1] + row * SPACING - v[p]
            beyond = dv * dv * across
            squared = (radius * radius - beyond) / a
            if squared < 0.0:
                continue
            half_width = math.sqrt(squared)
            centre = u[p] - b * dv / a - origin[0]
            left = max(0, math.ceil((centre - half_width) / SPACING))
            right = min(out.shape[1] - 1, math.floor((centre + half_width) / SPACING))
            du = np.float32(left * SPACING - centre)
            scale, start = to_table * np.float32(a), to_table * np.float32(beyond)
            for node in range(left, right + 1):
                place = start + scale * du * du
                entry = np.int32(place)
                w = table[entry] + (place - np.float32(entry)) * (table[entry + 1] - table[entry])
                out[row, node, 0] += w * red
                out[row, node, 1] += w * green
                out[row, node, 2] += w * blue
                out[row, node, 3] += w
                du += step


@njit(cache=True, nogil=True)
def normalise(lattice, origin, slope, spans, reach):  # type: ignore[no-untyped-def]
    """Divide the sums of a lattice ``(V, U, 4)`` by their weight, in place.

    ``spans`` are the numbers of cells along u and v, ``reach`` is (W − 1)/2. Returns how many nodes have weight, and
    how many have none although some cell of some layer reads them: the rest of the lattice is of no consequence.
    """
    found, missing = 0, 0
    for row in range(lattice.shape[0]):
        v = origin[1] + row * SPACING
        for node in range(lattice.shape[1]):
            weight = lattice[row, node, 3]
            if weight > 0:
                found += 1
                inverse = np.float32(1) / weight
                lattice[row, node, 0] *= inverse
                lattice[row, node, 1] *= inverse
                lattice[row, node, 2] *= inverse
                continue
            # A layer at the height t reads U + s t from half a cell (and one node) inside the grid.
            low, high = -reach, reach
            u = origin[0] + node * SPACING
            for position, s, count in ((u, slope[0], spans[0]), (v, slope[1], spans[1])):
                first, last = 0.5 - SPACING - position, count - 0.5 + SPACING - position
                if abs(s) * reach < 1e-9:
                    if first > 0 or last < 0:
                        low = np.inf
                elif s > 0:
                    low, high = max(low, first / s), min(high, last / s)
                else:
                    low, high = max(low, last / s), min(high, first / s)
            if low <= high:
                missing += 1
    return found, missing


@njit(cache=True, nogil=True)
def split(lattice, out):  # type: ignore[no-untyped-def]
    """Copy a lattice ``(V, U, C)`` to planes ``out`` ``(C, V, 2, U/2)``: even nodes apart from odd ones.

    A layer reads every second node, so that neighbours in the grid become neighbours in memory.
    """
    for row in range(lattice.shape[0]):
        for pair in range(lattice.shape[1] // 2):
            for channel in range(lattice.shape[2]):
                out[channel, row, 0, pair] = lattice[row, 2 * pair, channel]
                out[channel, row, 1, pair] = lattice[row, 2 * pair + 1, channel]
