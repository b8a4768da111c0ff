"""Where light has to be sampled so that all in between follows: few samples with gradients do for many without (001).

Samples are added where the error is largest until it is within the tolerance everywhere, and those that turn out not to
be needed are taken away again. Not the least number there is, but near it, in seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.field.gradient import central_differences
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.gradients.freespace import project_gradients
from lightwell.gradients.interpolate import SampleSet

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

MOST_PLACES = 2000
"""Places of a field that are candidates, and at which the error is measured."""
MOST_SAMPLES = 128
"""Samples after which placing gives up."""
MOST_PRUNED = 96
"""Samples of which each is tried whether it can be left out."""
NEIGHBOURS = 30
"""Probes that a probe's gradient is fitted to."""
ONE_PLACE = 1e-4
"""Probes nearer to each other than this share of the extent of all share a place."""
FINEST_LATTICE = 12
"""Nodes along the longest axis after which a regular lattice gives up."""


@dataclass(frozen=True)
class Field:
    """Light at many places."""

    positions: Floats
    """``(n, 3)`` metres."""
    coefficients: Floats
    """``(n, bands², 3)``."""
    gradients: Floats
    """``(n, bands², 3, 3)`` per metre."""

    @cached_property
    def scale(self) -> float:
        """Rms coefficient vector: what errors are relative to."""
        return float(np.sqrt(np.mean(np.sum(self.coefficients**2, axis=(1, 2)))))

    def errors(self, found: Floats) -> Floats:
        """Return the error of coefficients ``(n, bands², 3)`` at each place, ``(n,)``, relative to `scale`."""
        return np.asarray(np.sqrt(np.sum((found - self.coefficients) ** 2, axis=(1, 2))) / self.scale)


class Placement(NamedTuple):
    """Samples that light a field."""

    indices: Indices
    """Which of the field's places."""
    error: float
    """Largest error at any place, relative to the rms coefficient vector."""
    history: tuple[float, ...]
    """Largest error with 1, 2, … samples on the way, before needless ones were taken away."""


class LatticeResult(NamedTuple):
    """A regular lattice of samples that lights a field."""

    nodes: tuple[int, int, int]
    """Samples along x, y and z."""
    error: float
    """As that of `Placement`."""

    @property
    def samples(self) -> int:
        """Number of nodes."""
        return self.nodes[0] * self.nodes[1] * self.nodes[2]


def field_of_grid(grid: Grid, most: int = MOST_PLACES) -> Field:
    """Return the light at some of a grid's cells, those at its corners among them; at all where there are few.

    Gradients are the grid's own, or its central differences.

    Raises
    ------
    ValueError
        Where the grid is dark.
    """
    cells = grid.spec.cells
    chosen = np.arange(cells)
    if cells > most:
        corners = np.ravel_multi_index(
            np.array([(k >> 2 & 1, k >> 1 & 1, k & 1) for k in range(8)]).T
            * np.array([[size - 1] for size in grid.spec.shape]),
            grid.spec.shape,
        )
        others = np.random.default_rng(0).choice(cells, most, replace=False)
        chosen = np.unique(np.concatenate([corners, others]))
    gradients = grid.gradients
    if gradients is None:
        gradients = central_differences(grid.coefficients, grid.spec.voxel)
    count = grid.coefficients.shape[3]
    field = Field(
        grid.spec.centres().reshape(-1, 3)[chosen],
        grid.coefficients.reshape(-1, count, 3)[chosen].astype(np.float64),
        gradients.reshape(-1, count, 3, 3)[chosen].astype(np.float64),
    )
    if field.scale == 0:
        raise ValueError("the grid is dark: there is nothing to place samples for")
    return field


def field_of_probes(positions: Floats, coefficients: Floats) -> Field:
    """Return the light at scattered probes ``(n, 3)``, ``(n, bands², 3)``, with gradients by regression.

    The gradient of a probe is that of the polynomial through it which fits its nearest neighbours best, quadratic where
    there are enough, and is projected onto what light in empty space obeys. Probes that share a place are one, with
    their mean light: a camera that stood still for a while.

    Raises
    ------
    ValueError
        Where there are fewer than five places or all are dark.
    """
    positions, coefficients = _merged(positions, coefficients)
    if len(positions) < 5:
        raise ValueError(f"{len(positions)} places of probes say nothing of gradients; five are the least")
    quadratic = len(positions) > NEIGHBOURS
    count = min(NEIGHBOURS, len(positions) - 1)
    first, second = np.triu_indices(3)
    gradients = np.empty((*coefficients.shape, 3))
    for index, position in enumerate(positions):
        offsets = positions - position
        distance = np.linalg.norm(offsets, axis=1)
        near = np.argpartition(distance, count)[: count + 1]
        near = near[near != index]
        way, scale = offsets[near], float(distance[near].max())
        terms = np.concatenate([way, way[:, first] * way[:, second] / scale], axis=1) if quadratic else way
        weight = np.exp(-2 * (distance[near] / scale) ** 2)[:, None]
        change = (coefficients[near] - coefficients[index]).reshape(len(near), -1)
        slopes = np.linalg.lstsq(weight * terms, weight * change, rcond=1e-6)[0][:3]
        gradients[index] = np.moveaxis(slopes.reshape(3, *coefficients.shape[1:]), 0, -1)
    field = Field(positions, coefficients, project_gradients(gradients))
    if field.scale == 0:
        raise ValueError("all probes are dark: there is nothing to place samples for")
    return field


def _merged(positions: Floats, coefficients: Floats) -> tuple[Floats, Floats]:
    """Return the means of probes that share a place."""
    near = ONE_PLACE * float(np.ptp(positions, axis=0).max()) if len(positions) else 0.0
    left = np.ones(len(positions), np.bool_)
    groups = []
    for index, position in enumerate(positions):
        if left[index]:
            group = left & (np.linalg.norm(positions - position, axis=1) <= near)
            left &= ~group
            groups.append(group)
    if len(groups) == len(positions):
        return positions, coefficients
    return (
        np.array([positions[group].mean(axis=0) for group in groups]),
        np.array([coefficients[group].mean(axis=0) for group in groups]),
    )


def place_samples(
    field: Field,
    tolerance: float,
    *,
    gradients: bool = True,
    most: int = MOST_SAMPLES,
    report: Callable[[int, float], None] = lambda count, error: None,
) -> Placement:
    """Return few of a field's places whose interpolation (`SampleSet`) is within the tolerance at all places.

    Parameters
    ----------
    field
        The light that is known.
    tolerance
        Largest error, relative to the rms coefficient vector.
    gradients
        Whether samples have gradients.
    most
        Samples after which it gives up: the placement's error then exceeds the tolerance.
    report
        Called with the number of samples and the error after each one.

    Raises
    ------
    ValueError
        Where the tolerance is not positive.
    """
    if not tolerance > 0:
        raise ValueError(f"the tolerance must be positive, not {tolerance:g}")
    middle = (field.positions.min(axis=0) + field.positions.max(axis=0)) / 2
    chosen = [int(np.argmin(np.sum((field.positions - middle) ** 2, axis=1)))]
    history = []
    state: _State | None = None
    while True:
        state = _State(field, chosen, gradients, state)
        history.append(state.error)
        report(len(chosen), state.error)
        if state.error <= tolerance or len(chosen) >= min(most, len(field.positions)):
            break
        chosen = [*chosen, int(np.argmax(state.errors))]
    if state.error <= tolerance and len(chosen) <= MOST_PRUNED:
        for index in chosen:
            fewer = [other for other in state.chosen if other != index]
            if fewer and (trial := _State(field, fewer, gradients, state)).error <= tolerance:
                state = trial
    return Placement(np.array(state.chosen, np.intp), state.error, tuple(history))


class _State:
    """Some samples, and the error at all places with them.

    A place's light changes only where the simplex round it does: the errors of the others are those of ``before``.
    """

    def __init__(self, field: Field, chosen: list[int], gradients: bool, before: _State | None) -> None:
        self.chosen = chosen
        samples = sample_set(field, chosen, gradients=gradients)
        self.dimension = samples.places.dimension
        names = np.array(chosen)
        self.simplices = {
            tuple(row): k for k, row in enumerate(np.sort(names[samples.places.simplices], axis=1).tolist())
        }
        self.hull = {tuple(row) for row in np.sort(names[samples.places.hull], axis=1).tolist()}
        stale = np.ones(len(field.positions), np.bool_)
        self.errors, self.owners = np.empty(len(stale)), np.empty(len(stale), np.intp)
        if before is not None and before.dimension == self.dimension > 0:
            # The last entry is that of places outside the hull.
            now = np.array(
                [self.simplices.get(key, -2) for key in before.simplices] + [-1 if self.hull == before.hull else -2]
            )
            self.owners = now[before.owners]
            stale = self.owners == -2
            self.errors = before.errors.copy()
        places = field.positions[stale]
        self.owners[stale] = samples.places.owners(places)
        found = samples.at(places) - field.coefficients[stale]
        self.errors[stale] = np.sqrt(np.sum(found**2, axis=(1, 2))) / field.scale
        self.errors[chosen] = 0
        self.error = float(self.errors.max())


def sample_set(field: Field, indices: Indices | list[int], *, gradients: bool = True) -> SampleSet:
    """Return the samples of a field at some of its places."""
    slopes = field.gradients[indices] if gradients else None
    return SampleSet(field.positions[indices], field.coefficients[indices], slopes)


def place_lattice(grid: Grid, field: Field, tolerance: float, *, gradients: bool) -> LatticeResult:
    """Return the coarsest regular lattice whose trilinear interpolation lights a field within the tolerance.

    With ``gradients`` by the half-gradient rule (MATHS §7.8). The finest that is tried has `FINEST_LATTICE` nodes along
    the longest axis, or as many as the grid: its error may exceed the tolerance.
    """
    low, high = grid.spec.centres()[0, 0, 0], grid.spec.centres()[-1, -1, -1]
    extent = high - low
    slopes = grid.gradients if grid.gradients is not None else central_differences(grid.coefficients, grid.spec.voxel)
    known = Grid(grid.spec, grid.coefficients, grid.coverage, None, slopes)
    finest = min(FINEST_LATTICE, max(grid.spec.resolution))
    result = LatticeResult((1, 1, 1), np.inf)
    for count in range(1, finest + 1):
        spacing = extent.max() / max(count - 1, 1)
        nodes = tuple(
            1 if count == 1 or size == 0 else max(2, int(np.ceil(size / spacing - 1e-9)) + 1) for size in extent
        )
        assert len(nodes) == 3
        # Cells round the nodes; an axis of one node stands in the middle.
        half = (
            np.array([size / (n - 1) if n > 1 else max(size, 1e-6) for size, n in zip(extent, nodes, strict=True)]) / 2
        )
        single = np.array(nodes) == 1
        lower, upper = np.where(single, low, low - half), np.where(single, low + 2 * half, high + half)
        spec = GridSpec(_triple(lower), _triple(upper), nodes)
        light = known.sample(spec.centres(), gradients=True)
        assert light.gradients is not None
        lattice = Grid(
            spec,
            light.coefficients.astype(np.float32),
            light.coverage.astype(np.float32),
            None,
            light.gradients.astype(np.float32) if gradients else None,
        )
        error = float(field.errors(lattice.sample(field.positions).coefficients).max())
        result = LatticeResult(nodes, error)
        if error <= tolerance:
            break
    return result


def _triple(values: Floats) -> tuple[float, float, float]:
    return float(values[0]), float(values[1]), float(values[2])
