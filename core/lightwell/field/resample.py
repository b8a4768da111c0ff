"""Resampling of direction buckets to a grid of SH coefficients (paper 000 §3; MATHS §6).

For every direction the samples of all probes are splatted onto the plane across it (`lightwell.field.plane`), holes are
repaired there, every cell of the grid reads the plane where the direction's ray passes it, and what it reads is added
to its coefficients. Blocks of directions are added as one matrix product.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.field.layers import GROUP, Planes, add_coverage, add_planes, fill_volume
from lightwell.field.plane import (
    AXES,
    CHANNELS,
    COLOURS,
    Plane,
    make_plane,
    normalise,
    read_ranges,
    splat,
    split,
)
from lightwell.field.repair import bilateral, mipmap, pull_push
from lightwell.field.slopes import MOMENTS, fit_slopes, splat_moments
from lightwell.field.spec import Floats, GridSpec
from lightwell.field.sums import FieldSums, layered
from lightwell.job_settings import RepairKind

Singles = NDArray[np.float32]

BLOCK = 96
"""Directions that are added to all cells before the next: each block reads and writes all coefficients once."""
BLOCK_VALUES = 1 << 25
"""Values in the planes of a block; 4 bytes each."""
VOLUME_REPAIRS: tuple[RepairKind, ...] = ("mipmap", "none")
"""Those that look at a direction's field in all cells."""


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
        """Prepare for probes at ``positions`` ``(P, 3)`` metres.

        Where the sums have gradients, these are gathered too, by local-linear regression (`lightwell.field.slopes`).

        Raises
        ------
        ValueError
            Where gradients are asked for together with a repair that does not work in the plane across a direction.
        """
        if sums.gradients is not None and repair in VOLUME_REPAIRS:
            raise ValueError(f"gradients by regression need repair pull-push or bilateral, not {repair}")
        self._sums = sums
        self._kernel = kernel
        self._repair = repair
        self._workspace = _Workspace()
        centres = sums.spec.to_cells(positions)
        # Samples that lie together in space lie together in every plane: the lattice stays in the cache.
        self._order = _space_order(centres)
        self._centres = centres[self._order]
        self._current: _AxisSums | None = None

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
        spec = self._sums.spec
        scaled = directions / spec.voxel
        scaled /= np.linalg.norm(scaled, axis=1, keepdims=True)
        for block in _blocks(scaled, spec, self._workspace, slopes=self._sums.gradients is not None):
            check()
            chosen = block.chosen
            for k, q in enumerate(chosen):
                offset = offsets[q] if offsets.ndim == 2 else offsets[q, self._order]
                points = self._centres + offset / spec.voxel
                if not block.splat(k, points, radiance[q], self._order, self._kernel, self._repair):
                    self._sums.dark += float(weights[q])
            sums = self._sums_of(block.axis)
            if self._repair in VOLUME_REPAIRS:
                sums.add_volumes(block, rows[chosen], weights[chosen], self._repair)
            else:
                sums.add(block, rows[chosen], weights[chosen])

    def finish(self) -> None:
        """Add what was gathered to the sums."""
        if self._current is not None:
            self._current.finish(self._sums)
            self._current = None

    def _sums_of(self, axis: int) -> _AxisSums:
        """Return the sums of a layer axis. Directions come axis after axis, so that only one has sums at a time."""
        if self._current is None or self._current.axis != axis:
            self.finish()
            self._current = _AxisSums(self._sums, axis)
        return self._current


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


def _blocks(directions: Floats, spec: GridSpec, workspace: _Workspace, *, slopes: bool) -> Iterator[_Block]:
    """Yield the directions ``(K, 3)`` in blocks of one layer axis whose slopes along v are alike."""
    planes = [make_plane(direction, spec.resolution) for direction in directions]
    order = sorted(range(len(planes)), key=lambda q: (planes[q].axis, planes[q].slope[1], planes[q].slope[0]))
    most = BLOCK_VALUES // (3 if slopes else 1)
    block: list[int] = []
    size = 0
    for q in order:
        full = len(block) == BLOCK or size + planes[q].size > most
        if block and (full or planes[q].axis != planes[block[0]].axis):
            yield _Block(spec, block, [planes[k] for k in block], workspace, slopes=slopes)
            block, size = [], 0
        block.append(q)
        size += planes[q].size
    if block:
        yield _Block(spec, block, [planes[k] for k in block], workspace, slopes=slopes)


class _Block:
    """The planes of some directions."""

    def __init__(
        self, spec: GridSpec, chosen: list[int], planes: list[Plane], workspace: _Workspace, *, slopes: bool
    ) -> None:
        self.chosen = chosen
        self.axis = planes[0].axis
        sizes = [plane.size for plane in planes]
        self.planes = Planes(
            workspace.take("planes", sum(sizes)),
            np.concatenate([[0], np.cumsum(sizes)])[:-1].astype(np.int64),
            np.array([plane.nodes for plane in planes], np.int64),
            np.array([plane.origin for plane in planes]),
            np.array([plane.slope for plane in planes]),
            planes[0].middle,
        )
        self.slopes: list[Planes] = []
        """Derivatives along U and along V, per cell."""
        if slopes:
            self.slopes = [self.planes._replace(data=workspace.take(name, sum(sizes))) for name in ("by U", "by V")]
        self._each = planes
        self._workspace = workspace
        u_axis, v_axis = AXES[self.axis]
        self._spans = (spec.resolution[u_axis], spec.resolution[v_axis])

    def splat(
        self, k: int, points: Floats, radiance: Singles, order: NDArray[np.intp], kernel: Kernel, repair: RepairKind
    ) -> bool:
        """Make the k-th plane from samples at ``points`` ``(P, 3)`` in cells; return whether any reached it.

        The p-th point's sample is ``radiance[order[p]]``.
        """
        plane = self._each[k]
        lattice = self._zeros("lattice", plane, CHANNELS)
        axes = (*AXES[plane.axis], plane.axis)
        geometry = (axes, plane.slope, plane.middle, plane.metric, plane.origin)
        spread = (kernel.support_cells / 2, kernel.sigma_cells)
        found = bool(splat(points, radiance, order, *geometry, *spread, lattice))
        ranges = read_ranges(plane.nodes, plane.origin, plane.slope, self._spans, plane.middle - 0.5)
        if found and normalise(lattice, ranges):
            # Also before a repair in three dimensions: cells at the edge of a hole read some nodes within it.
            found = bilateral(lattice, ranges) if repair == "bilateral" else pull_push(lattice, ranges)
        self._keep(k, self.planes, lattice)
        if self.slopes:
            moments = self._zeros("moments", plane, MOMENTS)
            splat_moments(points, radiance, order, *geometry, *spread, moments)
            derivatives = [self._zeros(name, plane, CHANNELS) for name in ("along U", "along V")]
            fit_slopes(moments, lattice, ranges, kernel.sigma_cells, *derivatives)
            for planes, derivative in zip(self.slopes, derivatives, strict=True):
                self._keep(k, planes, derivative)
        return found

    def _zeros(self, name: str, plane: Plane, channels: int) -> Singles:
        lattice = self._workspace.take(name, plane.nodes[0] * plane.nodes[1] * channels)
        lattice.fill(0)
        return lattice.reshape(*plane.nodes, channels)

    def _keep(self, k: int, planes: Planes, lattice: Singles) -> None:
        plane = self._each[k]
        start = int(planes.starts[k])
        colours, weights = np.split(planes.data[start : start + plane.size], [plane.size // CHANNELS * COLOURS])
        parts = (plane.nodes[0], 2, plane.nodes[1] // 2)
        split(lattice, colours.reshape(*parts, COLOURS), weights.reshape(parts))


class _AxisSums:
    """Sums over the directions of one layer axis."""

    def __init__(self, sums: FieldSums, axis: int) -> None:
        self.axis = axis
        shape = layered(sums.coverage, axis).shape
        self.coefficients = np.zeros((*shape[:2], sums.coefficients.shape[3], shape[2] * COLOURS), np.float32)
        """``(W, V, bands², U · 3)``."""
        self.gradients: list[Singles] = []
        """Derivatives along u, v and w, per cell, of the same shape; or none."""
        if sums.gradients is not None:
            self.gradients = [np.zeros_like(self.coefficients) for _ in range(3)]
        self.coverage = np.zeros(shape, np.float32)
        self.samples = np.zeros(shape, np.float32)

    def add(self, block: _Block, rows: Floats, weights: Floats) -> None:
        """Add the directions of a block."""
        for k, weight in enumerate(weights):
            add_coverage(block.planes, k, np.float32(weight), self.coverage, self.samples)
        add_planes(block.planes, _padded(rows), self.coefficients)
        # U = u − s_u w and V = v − s_v w: the derivative along w follows from the other two.
        for axis, slopes in enumerate(block.slopes):
            add_planes(slopes, _padded(rows), self.gradients[axis])
            add_planes(slopes, _padded(-rows * slopes.slopes[:, axis, None]), self.gradients[2])

    def add_volumes(self, block: _Block, rows: Floats, weights: Floats, repair: RepairKind) -> None:
        """Add the directions of a block one by one, each with its whole field: for repairs in three dimensions."""
        volume = np.empty((*self.coverage.shape, COLOURS), np.float32)
        runs = volume.reshape(*volume.shape[:2], -1)
        for k, row in enumerate(rows.astype(np.float32)):
            fill_volume(block.planes, k, runs)
            seen, gathered = np.zeros_like(self.coverage), np.zeros_like(self.coverage)
            add_coverage(block.planes, k, np.float32(weights[k]), seen, gathered)
            self.coverage += seen
            self.samples += gathered
            if repair == "mipmap":
                mipmap(volume, seen > 0)
            else:
                volume[seen == 0] = 0
            self.coefficients += row[:, None] * runs[:, :, None]

    def finish(self, sums: FieldSums) -> None:
        """Add what was gathered to the sums of the whole grid."""
        layers, height, count, width = self.coefficients.shape
        gathered = self.coefficients.reshape(layers, height, count, width // COLOURS, COLOURS)
        layered(sums.coefficients, self.axis)[...] += gathered.transpose(0, 1, 3, 2, 4)
        for axis, gradient in zip((*AXES[self.axis], self.axis), self.gradients, strict=False):
            assert sums.gradients is not None
            per_metre = gradient.reshape(gathered.shape) / np.float32(sums.spec.voxel[axis])
            layered(sums.gradients, self.axis)[..., axis] += per_metre.transpose(0, 1, 3, 2, 4)
        layered(sums.coverage, self.axis)[...] += self.coverage
        layered(sums.samples, self.axis)[...] += self.samples


def _padded(rows: Floats) -> Singles:
    """Return rows ``(K, C)`` as `add_planes` takes them."""
    padded = np.zeros((rows.shape[1], math.ceil(len(rows) / GROUP) * GROUP), np.float32)
    padded[:, : len(rows)] = rows.T
    return padded
