"""Looking up an adaptive grid in plain NumPy: what `lightwell.field.brick_kernels` computes fast. Fields for tests."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec

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


def make_bumpy(resolution: tuple[int, int, int], seed: int = 0, sharp: float = 40.0, noise: float = 0.0) -> Grid:
    """Return a smooth field with a bump that is sharp enough for small leaves round it."""
    spec = GridSpec((-1, 0, 2), (1, 3, 4), resolution)
    generator = np.random.default_rng(seed)
    places = (spec.centres() - np.array(spec.lower)) / (np.array(spec.upper) - np.array(spec.lower))
    slope, bump = generator.normal(size=(2, 4, 3))
    centre = generator.random(3)
    shape = np.exp(-sharp * ((places - centre) ** 2).sum(axis=-1))
    field = 1 + places[..., 0, None, None] * slope + shape[..., None, None] * 5 * bump
    field += noise * generator.normal(size=field.shape)
    return Grid(spec, field.astype(np.float32), np.clip(shape, 0, 1).astype(np.float32))
