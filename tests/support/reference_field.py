"""The resampling of paper 000 in plain NumPy: what `lightwell.field` computes fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.field.plane import SPACING, make_plane
from lightwell.field.resample import Kernel
from lightwell.field.spec import GridSpec

Floats = NDArray[np.float64]


def regress(
    places: Floats, points: Floats, direction: Floats, radiance: Floats, kernel: Kernel
) -> tuple[Floats, Floats]:
    """Return ``Σ w L / Σ w`` ``(n, 3)`` and ``Σ w`` ``(n,)`` at ``places`` ``(n, 3)``, in cells; NaN without a sample.

    The distance is that of a place from the line through a sample point along the direction.
    """
    apart = places[:, None] - points[None]
    along = apart @ direction
    squared = np.maximum((apart**2).sum(axis=-1) - along**2, 0)
    weights = np.exp(-squared / (2 * kernel.sigma_cells**2)) * (squared <= (kernel.support_cells / 2) ** 2)
    weights = weights * np.isfinite(radiance).all(axis=1)
    total = weights.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return weights @ np.nan_to_num(radiance) / total[:, None], total


def field_of(spec: GridSpec, points: Floats, direction: Floats, radiance: Floats, kernel: Kernel) -> Floats:
    """Return the radiance of one direction at every cell ``(z, y, x, 3)``: linear between lattice nodes.

    ``points`` are in cells, ``direction`` is a unit vector in cells. NaN where a node that is read has no sample.
    """
    plane = make_plane(direction, spec.resolution)
    z, y, x = np.meshgrid(*(np.arange(size) + 0.5 for size in spec.shape), indexing="ij")
    u, v = plane.project(np.stack([x, y, z], axis=-1))
    at_u, at_v = (u - plane.origin[0]) / SPACING, (v - plane.origin[1]) / SPACING
    low_u, low_v = np.floor(at_u), np.floor(at_v)
    out = np.zeros((*spec.shape, 3))
    axes = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[plane.axis]
    for dv in (0, 1):
        for du in (0, 1):
            weight = (at_u - low_u if du else 1 - at_u + low_u) * (at_v - low_v if dv else 1 - at_v + low_v)
            node = np.full((*spec.shape, 3), plane.middle)
            node[..., axes[0]] = plane.origin[0] + (low_u + du) * SPACING
            node[..., axes[1]] = plane.origin[1] + (low_v + dv) * SPACING
            value = regress(node.reshape(-1, 3), points, direction, radiance, kernel)[0].reshape(out.shape)
            out += np.where(weight[..., None] > 1e-9, weight[..., None] * value, 0)
    return out
