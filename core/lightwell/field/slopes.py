"""Slopes of the field of one direction by local-linear kernel regression in its plane (MATHS §7.6).

At each node of the lattice (`lightwell.field.plane`) the samples within the kernel are fitted by ``α + β·d``, d being a
sample's place from the node. With the moments ``S = Σ w, m = Σ w d, M = Σ w d dᵀ, t = Σ w L, q = Σ w L d``, the slope
solves ``C β = r`` with ``C = M − m mᵀ / S`` and ``r = q − m t / S``.

Where few samples, or samples on a line, do not determine it, it keeps what the repaired lattice itself says: the fit is
ridge regression towards the lattice's central difference β₀, ``β = β₀ + (C + λ I)⁻¹ (r − C β₀)``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lightwell.field.plane import SPACING, footprint, form_of, weigh

MOMENTS = 15
"""S, m (2), M (3), then t, q (2) of each colour."""

RIDGE = 0.02
"""λ as a share of σ² (1 + S): as if some more samples followed the lattice."""


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def splat_moments(  # type: ignore[no-untyped-def]
    points, radiance, order, axes, slope, middle, metric, origin, radius, sigma, out
):
    """Add samples to ``out`` ``(V, U, MOMENTS)`` float32; arguments as in `plane.splat`. Distances are in cells."""
    height, width = out.shape[0], out.shape[1]
    far_u, far_v, count = footprint(metric, radius)
    form = form_of(metric, radius, sigma)
    weights = np.empty(far_u.size, np.float32)
    spacing = np.float32(SPACING)
    for p in range(points.shape[0]):
        sample = radiance[order[p]]
        if not (math.isfinite(sample[0]) and math.isfinite(sample[1]) and math.isfinite(sample[2])):
            continue
        along = points[p, axes[2]] - middle
        u = (points[p, axes[0]] - slope[0] * along - origin[0]) / SPACING
        v = (points[p, axes[1]] - slope[1] * along - origin[1]) / SPACING
        node_u, node_v = math.floor(u + 0.5), math.floor(v + 0.5)
        rest_u, rest_v = np.float32(u - node_u), np.float32(v - node_v)
        weigh(far_u, far_v, rest_u, rest_v, form, weights)
        for i in range(count):
            row, node, w = node_v + int(far_v[i]), node_u + int(far_u[i]), weights[i]
            if w == 0 or not (0 <= row < height and 0 <= node < width):
                continue
            du, dv = (rest_u - far_u[i]) * spacing, (rest_v - far_v[i]) * spacing
            moments = out[row, node]
            moments[0] += w
            moments[1] += w * du
            moments[2] += w * dv
            moments[3] += w * du * du
            moments[4] += w * du * dv
            moments[5] += w * dv * dv
            for channel in range(3):
                value = w * sample[channel]
                moments[6 + 3 * channel] += value
                moments[7 + 3 * channel] += value * du
                moments[8 + 3 * channel] += value * dv


@njit(cache=True, nogil=True)
def fit_slopes(moments, lattice, ranges, sigma, along_u, along_v):  # type: ignore[no-untyped-def]
    """Write the slopes per cell along U and V of the nodes in ranges to ``along_u``, ``along_v`` ``(V, U, 4)`` float32.

    ``lattice`` ``(V, U, 4)`` holds the repaired values; the fourth channel, a node's kernel weight, is copied.
    """
    height = lattice.shape[0]
    ridge = RIDGE * sigma * sigma
    for row in range(height):
        first, last = ranges[0, row], ranges[1, row]
        for node in range(first, last):
            left, right = max(node - 1, first), min(node + 1, last - 1)
            below = row - 1 if row > 0 and ranges[0, row - 1] <= node < ranges[1, row - 1] else row
            above = row + 1 if row + 1 < height and ranges[0, row + 1] <= node < ranges[1, row + 1] else row
            along_u[row, node, 3] = along_v[row, node, 3] = lattice[row, node, 3]
            moment = moments[row, node]
            weight = float(moment[0])
            inverse = 1 / weight if weight > 0 else 0.0
            mean_u, mean_v = moment[1] * inverse, moment[2] * inverse
            uu = moment[3] - moment[1] * mean_u
            uv = moment[4] - moment[1] * mean_v
            vv = moment[5] - moment[2] * mean_v
            extra = ridge * (1 + weight)
            determinant = (uu + extra) * (vv + extra) - uv * uv
            for channel in range(3):
                prior_u, prior_v = 0.0, 0.0
                if right > left:
                    prior_u = (lattice[row, right, channel] - lattice[row, left, channel]) / ((right - left) * SPACING)
                if above > below:
                    prior_v = (lattice[above, node, channel] - lattice[below, node, channel]) / (
                        (above - below) * SPACING
                    )
                total = moment[6 + 3 * channel]
                rest_u = moment[7 + 3 * channel] - mean_u * total - uu * prior_u - uv * prior_v
                rest_v = moment[8 + 3 * channel] - mean_v * total - uv * prior_u - vv * prior_v
                along_u[row, node, channel] = prior_u + ((vv + extra) * rest_u - uv * rest_v) / determinant
                along_v[row, node, channel] = prior_v + ((uu + extra) * rest_v - uv * rest_u) / determinant
