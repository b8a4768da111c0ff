"""From a regular grid to an adaptive one (paper 000 §6).

Every level has a *lattice*: the nodes that its bricks would have if they covered everything, with the values whose
trilinear interpolation comes closest to the regular grid (least squares). Down the octree a brick becomes a leaf where
the lattice of its level predicts every cell of the regular grid in it within the tolerance. Nodes of a leaf that touch
a coarser one then take what that one says there. As both are trilinear, and the nodes of the one nest in those of the
other, equal nodes make equal faces, whatever the difference of levels: the field is continuous. Leaves that this moves
out of the tolerance are split, until there are none.

Least squares instead of every ``2^l``-th cell: larger leaves for the same tolerance (a quarter to a third fewer bricks
for the paper's first scene at 32³), and noise of the resampling averages out instead of being spread.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.brick_kernels import join, lattice_errors, leaf_errors
from lightwell.field.bricks import STEPS, Layout
from lightwell.field.grid import Grid, Singles
from lightwell.field.spec import Floats


class Difference(NamedTuple):
    """How far an adaptive grid is from the regular one, relative to its rms coefficient vector."""

    rms: float
    largest: float
    """Of any cell."""
    coverage: float
    """Largest difference of the coverage, absolute."""


class _Lattice(NamedTuple):
    """The nodes of one level."""

    coefficients: Singles
    """``(z, y, x, bands², 3)``."""
    coverage: Singles
    """``(z, y, x)``."""


def adapt(grid: Grid, tolerance: float, check: Callable[[], None] = lambda: None) -> AdaptiveGrid:
    """Return an adaptive grid that differs from ``grid`` by at most ``tolerance`` at the centre of every cell.

    The difference at a cell is that of its coefficient vector (the root of the sum of squares over coefficients and
    colours), relative to the root of the mean of its square over the grid. Coverage follows without a tolerance of
    its own, gradients are left out. ``check`` is called now and then and may raise. The same grid gives the same bytes.

    Raises
    ------
    ValueError
        Where the tolerance is not positive and finite, or some coefficients are not finite.
    """
    if not 0 < tolerance < np.inf:
        raise ValueError(f"tolerance {tolerance} must be positive and finite")
    if not np.isfinite(grid.coefficients).all():
        raise ValueError("some coefficients are not finite")
    layout = Layout(grid.spec.resolution)
    limit = tolerance**2 * mean_square(grid.coefficients)
    lattices: list[_Lattice] = []
    chosen = np.full(layout.page_shape, layout.top, np.uint8)
    for level in range(layout.top, -1, -1):
        check()
        lattice = _fit_lattice(layout, level, grid)
        lattices.insert(0, lattice)
        if level > 0:
            x, y, z = layout.bricks(level).tolist()
            errors = np.zeros((z, y, x))
            lattice_errors(grid.coefficients, lattice.coefficients, layout.spans(level), errors)
            _refine(layout, chosen, level, errors > limit)
    while True:
        check()
        bricks = _assemble(layout, chosen, lattices)
        leaf = np.zeros(len(bricks.levels))
        leaf_errors(grid.coefficients, layout.depths, bricks.pages, bricks.levels, bricks.coefficients, leaf)
        beyond = (leaf > limit) & (bricks.levels > 0)
        if not beyond.any():
            return _share(grid, bricks, tolerance)
        chosen[beyond[bricks.pages]] -= 1


def compare(grid: Grid, adaptive: AdaptiveGrid) -> Difference:
    """Return how far an adaptive grid is from the regular grid ``grid`` at the centres of its cells."""
    regular = adaptive.to_regular()
    squares = [
        np.square(found - exact, dtype=np.float64).sum(axis=(-1, -2))
        for found, exact in zip(regular.coefficients, grid.coefficients, strict=True)
    ]
    scale = mean_square(grid.coefficients) or 1.0
    coverage = float(np.abs(regular.coverage - grid.coverage).max())
    return Difference(float(np.sqrt(np.mean(squares) / scale)), float(np.sqrt(np.max(squares) / scale)), coverage)


def mean_square(coefficients: Singles) -> float:
    """Return the mean over cells of the squared length of coefficients ``(z, y, x, bands², 3)``."""
    total = sum(float(np.square(part, dtype=np.float64).sum()) for part in coefficients)
    return total / int(np.prod(coefficients.shape[:3]))


def _fit_lattice(layout: Layout, level: int, grid: Grid) -> _Lattice:
    coefficients, coverage = grid.coefficients, grid.coverage
    for axis in range(3):
        matrix = _fit(layout.resolution[axis], int(layout.nodes(level)[axis]), int(layout.spans(level)[axis]))
        coefficients = _along(matrix, coefficients, 2 - axis)
        coverage = _along(matrix, coverage, 2 - axis)
    return _Lattice(np.ascontiguousarray(coefficients), np.ascontiguousarray(np.clip(coverage, 0, 1)))


def _fit(size: int, nodes: int, span: int) -> Floats:
    """Return the matrix ``(nodes, size)`` from cells to the nodes, ``span`` steps apart, that predict them best.

    Nodes beyond the last cell that no cell depends on are copies of the last one that counts.
    """
    apart = np.arange(size)[:, None] / span - np.arange(nodes)
    weights = np.maximum(0.0, 1.0 - np.abs(apart))
    used = int(np.flatnonzero(weights.any(axis=0))[-1]) + 1
    solved = np.eye(size) if span == 1 else np.linalg.pinv(weights[:, :used])
    return np.concatenate([solved, np.repeat(solved[-1:], nodes - used, axis=0)])


def _along(matrix: Floats, values: Singles, axis: int) -> Singles:
    if matrix.shape[0] == matrix.shape[1]:  # as fine as the cells: exactly these
        return values
    product = np.tensordot(matrix.astype(np.float32), values, axes=(1, axis))
    return np.asarray(np.moveaxis(product, 0, axis), np.float32)


def _refine(layout: Layout, chosen: NDArray[np.uint8], level: int, where: NDArray[np.bool_]) -> None:
    """Lower the level of blocks that have this one, ``where`` ``(z, y, x)`` over its bricks says so."""
    for axis in range(3):
        where = np.repeat(where, layout.spans(level)[axis], axis=2 - axis)
    z, y, x = layout.page_shape
    chosen[(chosen == level) & where[:z, :y, :x]] -= 1


class _Bricks(NamedTuple):
    """Leaves with nodes of their own, coarse ones first, then by z, y, x."""

    corners: NDArray[np.int64]
    """``(bricks, 3)``: the first block of each, x, y, z."""
    pages: NDArray[np.int32]
    """``(z, y, x)``."""
    levels: NDArray[np.uint8]
    """``(bricks,)``."""
    coefficients: Singles
    """``(bricks, z, y, x, bands², 3)``."""
    coverage: Singles
    """``(bricks, z, y, x)``."""


def _assemble(layout: Layout, chosen: NDArray[np.uint8], lattices: list[_Lattice]) -> _Bricks:
    """Return the joined leaves where the blocks have the levels ``chosen`` ``(z, y, x)``."""
    blocks = np.moveaxis(np.indices(layout.page_shape)[::-1], 0, -1)
    spans = np.stack([layout.spans(level) for level in range(layout.top + 1)])[chosen]
    first = (blocks % spans == 0).all(axis=-1)
    order = np.argsort(-chosen[first].astype(np.int64), kind="stable")
    corners, levels = blocks[first][order], chosen[first][order]
    shape = layout.brick_shape
    pages = np.empty(layout.page_shape, np.int32)
    coefficients = np.empty((len(levels), *shape, *lattices[0].coefficients.shape[3:]), np.float32)
    coverage = np.empty((len(levels), *shape), np.float32)
    for brick, (corner, level) in enumerate(zip(corners, levels.tolist(), strict=True)):
        span = layout.spans(level)
        pages[_box(corner, span)] = brick
        nodes = _box(corner // span * STEPS, np.array(shape[::-1]))
        coefficients[brick] = lattices[level].coefficients[nodes]
        coverage[brick] = lattices[level].coverage[nodes]
    join(corners, layout.depths, pages, levels, coefficients, coverage)
    return _Bricks(corners, pages, levels, coefficients, coverage)


def _share(grid: Grid, bricks: _Bricks, tolerance: float) -> AdaptiveGrid:
    """Return the grid whose leaves share nodes: after joining, all nodes at one place have the same values."""
    layout = Layout(grid.spec.resolution)
    spans = np.stack([layout.spans(level) for level in bricks.levels.tolist()])
    within = np.moveaxis(np.indices(layout.brick_shape)[::-1], 0, -1)
    places = (bricks.corners * STEPS)[:, None, None, None] + within * spans[:, None, None, None]
    # Nodes that only fill up the last brick of an axis are never read: they need no memory of their own.
    last = -(-(np.array(grid.spec.resolution) - 1) // spans) * spans
    places = np.minimum(places, last[:, None, None, None])
    keys = np.ravel_multi_index(
        tuple(np.moveaxis(places[..., ::-1], -1, 0)), tuple(places.max(axis=(0, 1, 2, 3))[::-1] + 1)
    )
    _, kept, nodes = np.unique(keys, return_index=True, return_inverse=True)
    return AdaptiveGrid(
        grid.spec,
        bricks.pages,
        bricks.levels,
        nodes.reshape(keys.shape).astype(np.int32),
        bricks.coefficients.reshape(-1, *bricks.coefficients.shape[4:])[kept],
        bricks.coverage.reshape(-1)[kept],
        tolerance,
        grid.attributes,
    )


def _box(first: NDArray[np.int64], size: NDArray[np.int64]) -> tuple[slice, ...]:
    """Return the slices z, y, x of ``size`` (x, y, z) items from ``first`` on."""
    return tuple(slice(int(low), int(low + count)) for low, count in zip(first[::-1], size[::-1], strict=True))
