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
    axes = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[plane.axis]
    along = (x, y, z)[plane.axis] - plane.middle
    u, v = ((x, y, z)[axis] - slope * along for axis, slope in zip(axes, plane.slope, strict=True))
    at_u, at_v = (u - plane.origin[0]) / SPACING, (v - plane.origin[1]) / SPACING
    low_u, low_v = np.floor(at_u), np.floor(at_v)
    out = np.zeros((*spec.shape, 3))
    for dv in (0, 1):
        for du in (0, 1):
            weight = (at_u - low_u if du else 1 - at_u + low_u) * (at_v - low_v if dv else 1 - at_v + low_v)
            node = np.full((*spec.shape, 3), plane.middle)
            node[..., axes[0]] = plane.origin[0] + (low_u + du) * SPACING
            node[..., axes[1]] = plane.origin[1] + (low_v + dv) * SPACING
            value = regress(node.reshape(-1, 3), points, direction, radiance, kernel)[0].reshape(out.shape)
            out += np.where(weight[..., None] > 1e-9, weight[..., None] * value, 0)
    return out


def fill_by_mipmap(values: Floats, valid: NDArray[np.bool_]) -> Floats:
    """Return ``values`` ``(Z, Y, X, C)`` with the cells filled that are not ``valid`` (paper 000 §3.3; MATHS §6).

    The cells of a level are the means of the valid ones among the eight below. An empty cell takes the trilinear mix,
    over what is valid, of the finest level that has any valid cell next to its centre.
    """
    level = [np.where(valid[..., None], values, np.nan)]
    while max(level[-1].shape[:3]) > 1:
        below = level[-1]
        above = np.full((*(-(-size // 2) for size in below.shape[:3]), below.shape[3]), np.nan)
        for z, y, x in np.ndindex(above.shape[:3]):
            children = below[2 * z : 2 * z + 2, 2 * y : 2 * y + 2, 2 * x : 2 * x + 2].reshape(-1, below.shape[3])
            known = children[~np.isnan(children[:, 0])]
            if len(known):
                above[z, y, x] = known.mean(axis=0)
        level.append(above)
    out = values.astype(np.float64)
    for cell in np.argwhere(~valid):
        for height, cells in enumerate(level[1:], 1):
            # Cell i of level k covers the cells i 2^k … (i + 1) 2^k − 1, so that its centre is (i + ½) 2^k.
            at = np.clip((cell + 0.5) / 2**height - 0.5, 0, np.array(cells.shape[:3]) - 1)
            total, weight = np.zeros(values.shape[3]), 0.0
            for corner in np.ndindex(2, 2, 2):
                place = np.floor(at).astype(int) + corner
                w = float(np.prod(1 - np.abs(at - place)))
                if w > 0 and not np.isnan(cells[tuple(place)][0]):
                    total, weight = total + w * cells[tuple(place)], weight + w
            if weight > 0:
                out[tuple(cell)] = total / weight
                break
    return out


def slopes_of(
    places: Floats, points: Floats, direction: Floats, radiance: Floats, kernel: Kernel, prior: Floats, ridge: float
) -> Floats:
    """Return the slopes ``(n, 3, 2)`` per cell of ridge regression towards ``prior`` at ``places`` ``(n, 3)`` in cells.

    Minimises ``Σ w (L − α − β·d)² + λ |β − β₀|²`` with ``λ = ridge σ² (1 + Σ w)``; d is a sample's place in the plane's
    coordinates (U, V) from the node. ``prior`` β₀ is ``(n, 3, 2)``.
    """
    axis = int(np.abs(direction).argmax())
    u_axis, v_axis = {0: (1, 2), 1: (0, 2), 2: (0, 1)}[axis]
    out = prior.copy()
    for i, place in enumerate(places):
        apart = points - place
        squared = (apart**2).sum(axis=1) - (apart @ direction) ** 2
        near = (squared <= (kernel.support_cells / 2) ** 2) & np.isfinite(radiance).all(axis=1)
        if not near.any():
            continue
        weights = np.exp(-squared[near] / (2 * kernel.sigma_cells**2))
        along = apart[near, axis] / direction[axis]
        d = np.stack([apart[near, u_axis] - direction[u_axis] * along, apart[near, v_axis] - direction[v_axis] * along])
        design = np.concatenate([np.ones((1, d.shape[1])), d])
        pull = np.diag([0, 1, 1]) * ridge * kernel.sigma_cells**2 * (1 + weights.sum())
        for channel in range(3):
            target = design @ (weights * radiance[near, channel]) + pull @ np.array([0, *prior[i, channel]])
            out[i, channel] = np.linalg.solve((design * weights) @ design.T + pull, target)[1:]
    return out
