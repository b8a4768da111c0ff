"""Resampling of direction buckets to a grid of SH coefficients (paper 000 §3; MATHS §6).

For every direction the samples of all probes are splatted onto the plane across it (`lightwell.field.plane`), holes are
repaired there, every cell of the grid reads the plane where the direction's ray passes it, and what it reads is added
to its coefficients. Blocks of directions are added as one matrix product.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.field.layers import add_coverage, fill_tile
from lightwell.field.plane import AXES, CHANNELS, Plane, gaussian_table, layer_axes, make_plane, normalise, splat, split
from lightwell.field.repair import bilateral, mipmap, pull_push
from lightwell.field.spec import Floats, GridSpec
from lightwell.field.sums import FieldSums, layered
from lightwell.job_settings import RepairKind

Singles = NDArray[np.float32]

BLOCK = 128
"""Directions in one matrix product."""
TILE_ROWS = 4
"""Rows of a tile; neighbouring layers read nearly the same part of a plane, so that tiles are deep, not tall."""
TILE_CELLS = 2048
"""Cells that are filled and multiplied at a time, so that they stay in the processor's cache."""


@dataclass(frozen=True)
class Kernel:
    """The Gaussian with which samples are spread; lengths in cells."""

    support_cells: float = 3.0
    """Diameter beyond which a sample has no weight."""
    sigma_cells: float = 0.5
    """Standard deviation."""


class Resampler:
    """Adds directions to a grid. What it has gathered is in the sums after `finish`.

    The same input in the same calls gives the same bytes.
    """

    def __init__(self, sums: FieldSums, positions: Floats, kernel: Kernel, repair: RepairKind = "pull-push") -> None:
        """Prepare for probes at ``positions`` ``(P, 3)`` metres."""
        self._sums = sums
        self._kernel = kernel
        self._repair = repair
        self._workspace = _Workspace()
        centres = sums.spec.to_cells(positions)
        # Samples that lie together in space lie together in every plane: the lattice stays in the cache.
        self._order = _space_order(centres)
        self._centres = centres[self._order]
        self._tiles: dict[int, _Tiles] = {}

    def add(
        self,
        directions: Floats,
        offsets: Floats,
        radiance: Singles,
        rows: Floats,
        weights: Floats,
        check: Callable[[], None] = lambda: None,
    ) -> None:
        """Add K directions.

        Parameters
        ----------
        directions
            ``(K, 3)`` unit vectors in world axes.
        offsets
            ``(K, 3)``, or ``(K, P, 3)`` where the probes are turned differently: from a probe's position to its ray.
        radiance
            ``(K, P, 3)`` float32; NaN where a probe has no sample in that direction.
        rows
            ``(K, bands²)``: what radiance 1 in the direction adds to each coefficient.
        weights
            ``(K,)`` solid angles, steradian.
        check
            Called now and then; may raise.
        """
        spec, order = self._sums.spec, self._order
        scaled = directions / spec.voxel
        scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
        layer_axis = layer_axes(scaled)
        for axis in range(3):
            of_axis = np.flatnonzero(layer_axis == axis)
            for first in range(0, of_axis.size, BLOCK):
                check()
                chosen = of_axis[first : first + BLOCK]
                block = _Block(spec, scaled[chosen], self._kernel, self._workspace)
                for k, q in enumerate(chosen):
                    offset = offsets[q] if offsets.ndim == 2 else offsets[q, order]
                    if not block.add(k, self._centres + offset / spec.voxel, radiance[q, order], self._repair):
                        self._sums.dark += float(weights[q])
                tiles = self._tiles_of(axis)
                if self._repair in ("mipmap", "none"):
                    tiles.add_volumes(block, rows[chosen], weights[chosen], self._repair)
                else:
                    tiles.add(block, rows[chosen], weights[chosen])

    def finish(self) -> None:
        """Add what was gathered to the sums."""
        for tiles in self._tiles.values():
            tiles.finish(self._sums)
        self._tiles = {}

    def _tiles_of(self, axis: int) -> _Tiles:
        if axis not in self._tiles:
            coefficients = self._sums.coefficients.shape[3]
            self._tiles[axis] = _Tiles(self._sums.spec, axis, coefficients, self._workspace)
        return self._tiles[axis]


def accumulate(
    sums: FieldSums,
    positions: Floats,
    directions: Floats,
    offsets: Floats,
    radiance: Singles,
    rows: Floats,
    weights: Floats,
    kernel: Kernel,
    repair: RepairKind = "pull-push",
) -> None:
    """Add directions to sums in one call; arguments are those of `Resampler` and `Resampler.add`."""
    resampler = Resampler(sums, positions, kernel, repair)
    resampler.add(directions, offsets, radiance, rows, weights)
    resampler.finish()


def _space_order(points: Floats) -> NDArray[np.intp]:
    """Return an order of points ``(P, 3)`` along a space-filling curve (Morton's, 4 cells a step)."""
    steps = np.clip(np.floor(points / 4) + 512, 0, 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(10):
        for axis in range(3):
            code |= ((steps[:, axis] >> bit) & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


class _Workspace:
    """Memory that is used again: fresh pages for every block would cost as much as the work in them."""

    def __init__(self) -> None:
        self._arrays: dict[str, Singles] = {}

    def take(self, name: str, size: int) -> Singles:
        """Return a flat array of ``size`` with whatever it held before."""
        if name not in self._arrays or self._arrays[name].size < size:
            self._arrays[name] = np.empty(size, np.float32)
        return self._arrays[name][:size]


class _Block:
    """The planes of up to `BLOCK` directions of one layer axis."""

    def __init__(self, spec: GridSpec, directions: Floats, kernel: Kernel, workspace: _Workspace) -> None:
        self.planes: list[Plane] = [make_plane(direction, spec.resolution) for direction in directions]
        sizes = [CHANNELS * plane.nodes[0] * plane.nodes[1] for plane in self.planes]
        self.starts = np.concatenate([[0], np.cumsum(sizes)])[:-1].astype(np.int64)
        self.data = workspace.take("planes", sum(sizes))
        self.nodes = np.array([plane.nodes for plane in self.planes], np.int64)
        self.origins = np.array([plane.origin for plane in self.planes])
        self.slopes = np.array([plane.slope for plane in self.planes])
        self.middle = self.planes[0].middle
        self._workspace = workspace
        self._radius = kernel.support_cells / 2
        self._table = gaussian_table(kernel.support_cells, kernel.sigma_cells)
        u_axis, v_axis = AXES[self.planes[0].axis]
        self._spans = np.array([spec.resolution[u_axis], spec.resolution[v_axis]], np.int64)

    def add(self, k: int, points: Floats, radiance: Singles, repair: RepairKind) -> bool:
        """Make the k-th plane from samples at ``points`` ``(P, 3)`` in cells; return whether any reached it."""
        plane = self.planes[k]
        u, v = plane.project(points)
        size = CHANNELS * plane.nodes[0] * plane.nodes[1]
        lattice = self._workspace.take("lattice", size).reshape(*plane.nodes, CHANNELS)
        lattice.fill(0)
        origin, slope = np.array(plane.origin), np.array(plane.slope)
        splat(u, v, radiance, np.array(plane.metric), origin, self._radius, self._table, lattice)
        found, missing = normalise(lattice, origin, slope, self._spans, plane.middle - 0.5)
        if found and missing:
            # Also before a repair in three dimensions: cells at the edge of a hole read some nodes within it.
            fill = bilateral if repair == "bilateral" else pull_push
            fill(lattice[..., :3], np.ascontiguousarray(lattice[..., 3]))
        start = int(self.starts[k])
        split(lattice, self.data[start : start + size].reshape(CHANNELS, plane.nodes[0], 2, plane.nodes[1] // 2))
        return bool(found)


class _Tiles:
    """Sums over directions of one layer axis, tile by tile."""

    def __init__(self, spec: GridSpec, axis: int, coefficients: int, workspace: _Workspace) -> None:
        self.axis = axis
        shape = layered(np.empty(spec.shape, np.float32), axis).shape
        layers, height, width = shape
        tall = max(1, min(height, TILE_ROWS, TILE_CELLS // width))
        deep = max(1, min(layers, TILE_CELLS // (width * tall)))
        self.tiles = []
        for layer in range(0, layers, deep):
            for row in range(0, height, tall):
                part = (min(deep, layers - layer), min(tall, height - row), width)
                self.tiles.append(_Tile(layer, row, np.zeros((coefficients, 3, *part), np.float32)))
        self.coverage = np.zeros(shape, np.float32)
        self.samples = np.zeros(shape, np.float32)
        self._workspace = workspace

    def add(self, block: _Block, rows: Floats, weights: Floats) -> None:
        """Add the directions of a block."""
        geometry = (block.data, block.starts, block.nodes, block.origins, block.slopes, block.middle)
        add_coverage(*geometry, weights, self.coverage, self.samples)
        rows_t = np.ascontiguousarray(rows.T, np.float32)
        for tile in self.tiles:
            cells = tile.sums[0].size
            shape = (len(block.planes), *tile.sums.shape[1:])
            radiance = self._workspace.take("radiance", len(block.planes) * cells).reshape(shape)
            fill_tile(*geometry, tile.layer, tile.row, radiance)
            product = self._workspace.take("product", tile.sums.size).reshape(-1, cells)
            np.matmul(rows_t, radiance.reshape(-1, cells), out=product)
            sums = tile.sums.reshape(-1, cells)
            sums += product

    def add_volumes(self, block: _Block, rows: Floats, weights: Floats, repair: RepairKind) -> None:
        """Add the directions of a block one by one, each with its whole field: for repairs in three dimensions."""
        for k, row in enumerate(rows.astype(np.float32)):
            volume, seen = self._volume(block, k, float(weights[k]))
            if repair == "mipmap":
                mipmap(volume, seen)
            else:
                volume[~seen] = 0
            for tile in self.tiles:
                depth, count = tile.sums.shape[2:4]
                part = volume[tile.layer : tile.layer + depth, tile.row : tile.row + count]
                np.add(tile.sums, row[:, None, None, None, None] * part.transpose(3, 0, 1, 2), out=tile.sums)

    def _volume(self, block: _Block, k: int, weight: float) -> tuple[Singles, NDArray[np.bool_]]:
        """Return the field of one direction ``(W, V, U, 3)``, and where it had samples ``(W, V, U)``."""
        one = slice(k, k + 1)
        geometry = (block.data, block.starts[one], block.nodes[one], block.origins[one], block.slopes[one])
        field = np.empty((1, 3, *self.coverage.shape), np.float32)
        fill_tile(*geometry, block.middle, 0, 0, field)
        seen, gathered = np.zeros(self.coverage.shape, np.float32), np.zeros(self.coverage.shape, np.float32)
        add_coverage(*geometry, block.middle, np.array([weight]), seen, gathered)
        self.coverage += seen
        self.samples += gathered
        return np.ascontiguousarray(field[0].transpose(1, 2, 3, 0)), seen > 0

    def finish(self, sums: FieldSums) -> None:
        """Add what was gathered to the sums of the whole grid."""
        coefficients = layered(sums.coefficients, self.axis)
        for tile in self.tiles:
            depth, count = tile.sums.shape[2:4]
            part = coefficients[tile.layer : tile.layer + depth, tile.row : tile.row + count]
            part += tile.sums.transpose(2, 3, 4, 0, 1)
        layered(sums.coverage, self.axis)[...] += self.coverage
        layered(sums.samples, self.axis)[...] += self.samples


class _Tile(NamedTuple):
    """Some rows of some layers."""

    layer: int
    row: int
    sums: Singles
    """``(bands², 3, layers, rows, U)``."""
