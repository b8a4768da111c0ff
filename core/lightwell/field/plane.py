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

from lightwell.field.node import add_weighted
from lightwell.field.spec import Floats

Singles = NDArray[np.float32]

SPACING = 0.5
"""Distance between lattice nodes, cells."""

COLOURS = 3
"""Red, green and blue."""

CHANNELS = 4
"""Colours and the kernel weight that a node gathered."""

VECTOR = 16
"""Footprints are padded to this many nodes."""

FAR = np.float32(1e6)
"""Offset of padding, nodes: beyond any kernel."""

ONE, HALF, SIXTH = np.float32(1), np.float32(1 / 2), np.float32(1 / 6)
P4, P5, P6 = np.float32(1 / 24), np.float32(1 / 120), np.float32(1 / 720)

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

    @property
    def size(self) -> int:
        """Values of the lattice, all channels."""
        return CHANNELS * self.nodes[0] * self.nodes[1]


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


@njit(cache=True, nogil=True)
def footprint(metric, radius):  # type: ignore[no-untyped-def]
    """Return the offsets (U, V) ``(n,)`` float32, in nodes, of all nodes that a sample may reach from its nearest node.

    Their number is padded to whole vectors with nodes that are out of reach.
    """
    a, b, c = metric
    cross = a * c - b * b
    nearest = 0.5 * SPACING * math.sqrt(a + c + 2 * abs(b))  # how far a sample may lie from its nearest node
    reach_u = math.ceil((radius + nearest) * math.sqrt(c / cross) / SPACING)
    reach_v = math.ceil((radius + nearest) * math.sqrt(a / cross) / SPACING)
    most = (2 * reach_u + 1) * (2 * reach_v + 1)
    u = np.full((most + VECTOR - 1) // VECTOR * VECTOR, FAR, np.float32)
    v = np.zeros(u.size, np.float32)
    count = 0
    for j in range(-reach_v, reach_v + 1):
        for i in range(-reach_u, reach_u + 1):
            if SPACING * math.sqrt(a * i * i + 2 * b * i * j + c * j * j) <= radius + nearest:
                u[count] = i
                v[count] = j
                count += 1
    size = (count + VECTOR - 1) // VECTOR * VECTOR
    return u[:size], v[:size], count


@njit(cache=True, nogil=True)
def form_of(metric, radius, sigma):  # type: ignore[no-untyped-def]
    """Return the kernel's exponent ``a du² + b du dv + c dv²``, its largest value, and n of `weigh`; (du, dv) in nodes.

    Together they are the form that `weigh` takes: (a, b, c, edge, n).
    """
    scale = SPACING * SPACING / (2 * sigma * sigma)
    edge = radius * radius / (2 * sigma * sigma)
    halvings = max(4, math.ceil(math.log2(edge / 0.3)))
    a, b, c = metric
    return np.float32(a * scale), np.float32(2 * b * scale), np.float32(c * scale), np.float32(edge), halvings


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz", "arcp"})
def weigh(far_u, far_v, rest_u, rest_v, form, weights):  # type: ignore[no-untyped-def]
    """Compute the kernel's weights of a footprint's nodes, as vectors, exact to 2e-6.

    ``exp(−x) = exp(−x/2ⁿ)^2ⁿ`` with a polynomial for the inner one; 0 beyond the kernel's edge. (rest_u, rest_v) is the
    sample's place from its nearest node, in nodes.
    """
    a, b, c, edge, halvings = form
    inner = np.float32(-(0.5**halvings))
    for i in range(weights.size):
        du, dv = far_u[i] - rest_u, far_v[i] - rest_v
        x = a * du * du + b * du * dv + c * dv * dv
        y = x * inner
        w = ONE + y * (ONE + y * (HALF + y * (SIXTH + y * (P4 + y * (P5 + y * P6)))))
        w *= w
        w *= w
        w *= w
        w *= w
        weights[i] = w if x <= edge else np.float32(0)
    for _ in range(4, halvings):
        for i in range(weights.size):
            weights[i] *= weights[i]


@njit(cache=True, nogil=True)
def splat(points, radiance, order, axes, slope, middle, metric, origin, radius, sigma, out):  # type: ignore[no-untyped-def]
    """Add samples to a lattice ``out`` ``(V, U, 4)`` float32: ``Σ w L`` in three channels and ``Σ w`` in the fourth.

    ``points`` ``(P, 3)`` float64 are the samples' places in cells; sample p has the ``radiance`` ``(P, 3)`` float32 of
    row ``order[p]``, NaN for none. ``axes`` are the plane's (u, v, w). Returns the number of samples that reached the
    lattice.
    """
    height, width = out.shape[0], out.shape[1]
    flat = out.reshape(-1)
    far_u, far_v, count = footprint(metric, radius)
    reach_u, reach_v = 0, 0
    steps = np.empty(count, np.int64)
    for i in range(count):
        reach_u, reach_v = max(reach_u, int(far_u[i])), max(reach_v, int(far_v[i]))
        steps[i] = CHANNELS * (int(far_v[i]) * width + int(far_u[i]))
    form = form_of(metric, radius, sigma)
    weights = np.empty(far_u.size, np.float32)
    reached = 0
    for p in range(points.shape[0]):
        red, green, blue = radiance[order[p], 0], radiance[order[p], 1], radiance[order[p], 2]
        if not (math.isfinite(red) and math.isfinite(green) and math.isfinite(blue)):
            continue
        along = points[p, axes[2]] - middle
        u = (points[p, axes[0]] - slope[0] * along - origin[0]) / SPACING
        v = (points[p, axes[1]] - slope[1] * along - origin[1]) / SPACING
        node_u, node_v = math.floor(u + 0.5), math.floor(v + 0.5)
        if not (-reach_u <= node_u < width + reach_u and -reach_v <= node_v < height + reach_v):
            continue
        reached += 1
        weigh(far_u, far_v, np.float32(u - node_u), np.float32(v - node_v), form, weights)
        if reach_u <= node_u < width - reach_u and reach_v <= node_v < height - reach_v:
            start = CHANNELS * (node_v * width + node_u)
            for i in range(count):
                add_weighted(flat, start + steps[i], weights[i], red, green, blue)
        else:
            for i in range(count):
                row, node = node_v + int(far_v[i]), node_u + int(far_u[i])
                if 0 <= row < height and 0 <= node < width:
                    add_weighted(flat, CHANNELS * (row * width + node), weights[i], red, green, blue)
    return reached


@njit(cache=True, nogil=True)
def read_ranges(nodes, origin, slope, spans, reach):  # type: ignore[no-untyped-def]
    """Return the nodes ``[0, row] … [1, row] − 1`` of each row that some cell of some layer reads, ``(2, V)`` int64.

    A layer at the height t, ``|t| ≤ reach``, reads the nodes at (U, V) + s t from half a cell (and one node) inside the
    grid. ``spans`` are the numbers of cells along u and v, ``reach`` is (W − 1)/2.
    """
    ranges = np.zeros((2, nodes[0]), np.int64)
    for row in range(nodes[0]):
        low, high = -reach, reach
        v = origin[1] + row * SPACING
        first, last = 0.5 - SPACING - v, spans[1] - 0.5 + SPACING - v
        if abs(slope[1]) * reach < 1e-9:
            if first > 0 or last < 0:
                continue
        elif slope[1] > 0:
            low, high = max(low, first / slope[1]), min(high, last / slope[1])
        else:
            low, high = max(low, last / slope[1]), min(high, first / slope[1])
        if low > high:
            continue
        at_low, at_high = slope[0] * low, slope[0] * high
        left = 0.5 - SPACING - max(at_low, at_high) - origin[0]
        right = spans[0] - 0.5 + SPACING - min(at_low, at_high) - origin[0]
        ranges[0, row] = max(0, math.ceil(left / SPACING))
        ranges[1, row] = min(nodes[1], math.floor(right / SPACING) + 1)
    return ranges


@njit(cache=True, nogil=True)
def normalise(lattice, ranges):  # type: ignore[no-untyped-def]
    """Divide the sums of a lattice ``(V, U, 4)`` by their weight, in place; return how many in range have none."""
    missing = 0
    for row in range(lattice.shape[0]):
        nodes = lattice[row]
        for node in range(nodes.shape[0]):
            weight = nodes[node, 3]
            if weight > 0:
                inverse = np.float32(1) / weight
                nodes[node, 0] *= inverse
                nodes[node, 1] *= inverse
                nodes[node, 2] *= inverse
        for node in range(ranges[0, row], ranges[1, row]):
            missing += nodes[node, 3] <= 0
    return missing


@njit(cache=True, nogil=True)
def split(lattice, colours, weights):  # type: ignore[no-untyped-def]
    """Copy a lattice ``(V, U, 4)`` to ``colours`` ``(V, 2, U/2, 3)`` and ``weights`` ``(V, 2, U/2)``: even nodes first.

    A layer reads every second node, so that neighbours in the grid become neighbours in memory.
    """
    for row in range(lattice.shape[0]):
        nodes = lattice[row]
        for odd in range(2):
            some_colours, some_weights = colours[row, odd], weights[row, odd]
            for pair in range(some_weights.size):
                node = 2 * pair + odd
                some_colours[pair, 0] = nodes[node, 0]
                some_colours[pair, 1] = nodes[node, 1]
                some_colours[pair, 2] = nodes[node, 2]
                some_weights[pair] = nodes[node, 3]
