"""Few samples that light a whole field."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.reference_gradients import finite_difference

from lightwell.field.grid import Grid
from lightwell.field.spec import Floats, GridSpec
from lightwell.gradients.placement import field_of_grid, field_of_probes, place_lattice, place_samples, sample_set
from lightwell.gradients.trust import grid_trust_radius
from lightwell.synthetic.scene import PRESETS

SPEC = GridSpec((-0.4, -0.3, -0.2), (0.4, 0.3, 0.2), (8, 6, 4))


def _grid(light: Floats, spec: GridSpec = SPEC) -> Grid:
    return Grid(spec, light.astype(np.float32), np.ones(spec.shape, np.float32))


@pytest.fixture(scope="module")
def cube() -> Grid:
    return _grid(PRESETS["cube"].coefficients(SPEC.centres(), 3))


def test_light_that_does_not_vary_needs_one_sample() -> None:
    field = field_of_grid(_grid(np.ones((*SPEC.shape, 4, 3))))
    assert len(place_samples(field, 0.01).indices) == 1
    assert len(place_samples(field, 0.01, gradients=False).indices) == 1


def test_linear_light_needs_one_with_a_gradient_and_corners_without() -> None:
    light = 10 + SPEC.centres() @ np.ones((3, 12)).reshape(3, 12)
    field = field_of_grid(_grid(light.reshape(*SPEC.shape, 4, 3)))
    assert len(place_samples(field, 0.001).indices) == 1
    assert 1 < len(place_samples(field, 0.001, gradients=False).indices) <= 8


def test_samples_light_the_field_within_the_tolerance(cube: Grid) -> None:
    field = field_of_grid(cube)
    placed = place_samples(field, 0.08)
    light = sample_set(field, placed.indices).at(field.positions)
    worst = np.sqrt(np.sum((light - field.coefficients) ** 2, axis=(1, 2)).max()) / field.scale
    assert worst == pytest.approx(placed.error, rel=1e-6)
    assert placed.error <= 0.08
    # The rule of the issue: many fewer than without gradients, and than a regular lattice.
    plain = place_samples(field, 0.08, gradients=False)
    assert 3 * len(placed.indices) <= len(plain.indices)
    lattice, plain_lattice = (place_lattice(cube, field, 0.08, gradients=slopes) for slopes in (True, False))
    assert len(placed.indices) < lattice.samples < plain_lattice.samples
    assert lattice.error <= 0.08


def test_gives_up_where_it_is_told_to(cube: Grid) -> None:
    seen = []
    placed = place_samples(field_of_grid(cube), 1e-6, most=5, report=lambda count, error: seen.append((count, error)))
    assert len(placed.indices) == 5
    assert placed.error > 1e-6
    assert [count for count, _ in seen] == [1, 2, 3, 4, 5]
    assert [error for _, error in seen] == list(placed.history)


def test_some_cells_of_a_large_grid_stand_for_all() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (16, 12, 14))
    field = field_of_grid(_grid(np.ones((*spec.shape, 1, 3)), spec), most=100)
    assert 100 <= len(field.positions) <= 108
    corners = spec.centres()[[0, -1]][:, [0, -1]][:, :, [0, -1]].reshape(-1, 3)
    assert all((field.positions == corner).all(axis=1).any() for corner in corners)


def test_one_layer_is_a_plane() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 0.1), (6, 5, 1))
    field = field_of_grid(_grid(PRESETS["cube"].coefficients(spec.centres() - 0.3, 2), spec))
    assert place_samples(field, 0.05).error <= 0.05


def test_bad_input(cube: Grid) -> None:
    with pytest.raises(ValueError, match="dark"):
        field_of_grid(_grid(np.zeros((*SPEC.shape, 1, 3))))
    with pytest.raises(ValueError, match="positive"):
        place_samples(field_of_grid(cube), 0.0)


def test_trust_radius_from_second_differences() -> None:
    """``c = 1 + x²``: the term ½·2·d² reaches a tenth of c at ``d = √(.1 c)``; a linear field is trusted everywhere."""
    x = SPEC.centres()[..., :1, None]
    radius = grid_trust_radius(np.broadcast_to(1 + x**2, (*SPEC.shape, 1, 3)), SPEC.voxel)
    np.testing.assert_allclose(radius[0, 0], np.sqrt(0.1 * (1 + x[0, 0, :, 0, 0] ** 2)), rtol=1e-9)
    np.testing.assert_array_equal(grid_trust_radius(np.ones((*SPEC.shape, 1, 3)), SPEC.voxel), np.inf)
    tilted = SPEC.centres()[..., 0, None, None] * SPEC.centres()[..., 1, None, None]
    assert np.isfinite(grid_trust_radius(1 + tilted, SPEC.voxel)).all()
    assert np.isinf(grid_trust_radius(np.ones((1, 2, 2, 4, 3)), SPEC.voxel)).all()


def test_gradients_of_scattered_probes() -> None:
    scene = PRESETS["cube"]
    positions = np.random.default_rng(0).uniform(-0.3, 0.3, (300, 3))
    field = field_of_probes(positions, scene.coefficients(positions, 3))
    inner = np.flatnonzero((np.abs(positions) < 0.2).all(axis=1))[:20]
    exact = np.array([finite_difference(lambda p: scene.coefficients(p, 3), positions[index]) for index in inner])
    assert np.linalg.norm(field.gradients[inner] - exact) < 0.05 * np.linalg.norm(exact)
    assert len(place_samples(field, 0.1).indices) < len(place_samples(field, 0.1, gradients=False).indices)
    # A camera that stood still for a while: forty probes at one place, one of them with somebody in the picture.
    light = scene.coefficients(positions, 3)
    stood = [*range(50, 300), *[7] * 40]
    twice = light[stood]
    twice[-1] *= 3
    merged = field_of_probes(positions[stood] + 1e-7, twice)
    assert merged.positions.shape == (251, 3)
    np.testing.assert_allclose(merged.coefficients[-1], 42 / 40 * light[7])
    assert place_samples(merged, 0.1).error <= 0.1
    few = field_of_probes(positions[:6], 1 + positions[:6, :1, None] * np.ones((1, 4, 3)))
    assert few.gradients.shape == (6, 4, 3, 3)
    with pytest.raises(ValueError, match="five are the least"):
        field_of_probes(positions[:4], np.ones((4, 4, 3)))
    with pytest.raises(ValueError, match="dark"):
        field_of_probes(positions[:9], np.zeros((9, 4, 3)))
