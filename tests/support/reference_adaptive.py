"""Looking up an adaptive grid in plain NumPy: what `lightwell.field.brick_kernels` computes fast."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AdaptiveGrid

Floats = NDArray[np.float64]


def adaptive_light(grid: AdaptiveGrid, point: Floats) -> tuple[Floats, float]:
    """Return coefficients ``(bands², 3)`` and coverage at one point, metres: look through all leaves for the one there.

    Every node of the leaf has its hat function; all but the eight round the point are 0 there.
    """
    last = np.array(grid.spec.resolution) - 1
    place = np.clip(grid.spec.to_cells(point) - 0.5, 0, last)
    for brick, level in enumerate(grid.levels):
        z, y, x = (axis.min() for axis in np.nonzero(grid.pages == brick))
        sizes = [2 ** min(int(level), int(depth)) for depth in grid.layout.depths]
        first = np.array([x, y, z]) * 4
        if ((place >= first) & (place <= first + 4 * np.array(sizes))).all():
            hats = [
                np.maximum(0, 1 - np.abs((place[axis] - first[axis]) / sizes[axis] - np.arange(nodes)))
                for axis, nodes in enumerate(grid.nodes.shape[:0:-1])
            ]
            weights = np.einsum("z,y,x->zyx", *hats[::-1])
            nodes = grid.nodes[brick]
            return np.einsum("zyx,zyxkc->kc", weights, grid.coefficients[nodes]), float(
                (weights * grid.coverage[nodes]).sum()
            )
    raise AssertionError("no leaf covers the point")
