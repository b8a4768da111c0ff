"""Light by place: grids, and grids that follow a live probe (MATHS §11d)."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.field.adapt import adapt
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.render import DistantLight, FieldLight, modulate

SPEC = GridSpec((-1.0, -2.0, 0.0), (1.0, 2.0, 2.0), (9, 9, 9))
POINTS = np.random.default_rng(5).uniform([-1.2, -2, 0], [1, 2, 2], (40, 3))


def smooth_grid(bands: int = 3) -> Grid:
    x, y, z = np.moveaxis(SPEC.centres(), -1, 0)
    rng = np.random.default_rng(0)
    base, slope = rng.uniform(1, 2, (2, bands**2, 3))
    values = base + slope * (np.sin(x) + 0.3 * y * z)[..., None, None]
    return Grid(SPEC, values.astype(np.float32), np.ones(SPEC.shape, np.float32))


def test_a_grid_is_asked_at_each_point() -> None:
    grid = smooth_grid()
    light = FieldLight(grid, most_bands=2, gain=np.array([1.0, 2.0, 3.0]))
    assert light.bands == 2
    np.testing.assert_allclose(light.at(POINTS), grid.sample(POINTS).coefficients[:, :4] * [1, 2, 3])


def test_an_adaptive_grid_lights_as_its_regular_one() -> None:
    grid = smooth_grid()
    adaptive = adapt(grid, 0.02)
    difference = FieldLight(adaptive).at(POINTS) - FieldLight(grid).at(POINTS)
    assert np.abs(difference).max() < 0.1 * np.abs(grid.coefficients).max()


def test_the_live_light_of_the_field_changes_nothing() -> None:
    field = FieldLight(smooth_grid())
    place = (0.3, -0.4, 1.0)
    light = modulate(field, field.at(np.array([place]))[0], place)
    assert light.residual == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(light.at(POINTS), field.at(POINTS), rtol=1e-10)


def test_a_dimmer_scene_is_dimmer_everywhere_and_each_channel_by_itself() -> None:
    field = FieldLight(smooth_grid(), gain=2.0)
    factors = np.array([0.4, 1.0, 3.0])
    middle = np.array([[0.0, 0.0, 1.0]])
    light = modulate(field, field.at(middle)[0] * factors)
    np.testing.assert_allclose(light.at(POINTS), field.at(POINTS) * factors, rtol=1e-10)
    assert not light.rest.any()


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_new_light_is_exact_at_the_probe_and_the_same_elsewhere(bands: int) -> None:
    field = FieldLight(smooth_grid())
    live = np.random.default_rng(2).uniform(0, 3, (bands**2, 3))
    light = modulate(field, live)
    assert light.bands == max(3, bands)
    expected = np.zeros((light.bands**2, 3))
    expected[: len(live)] = live
    np.testing.assert_allclose(light.at(np.array([[0.0, 0.0, 1.0]]))[0], expected, atol=1e-12)
    assert light.residual > 0.01


def test_no_gain_is_negative_and_darkness_needs_none() -> None:
    grid = smooth_grid()
    dark = Grid(SPEC, np.zeros_like(grid.coefficients), grid.coverage)
    live = np.full((9, 3), 0.5)
    light = modulate(FieldLight(dark), live)
    np.testing.assert_allclose(light.at(POINTS), np.broadcast_to(live, (40, 9, 3)))
    assert (np.asarray(modulate(FieldLight(grid), -live).field.gain) == 0).all()
    off = modulate(FieldLight(grid), np.zeros((9, 3)))
    assert (off.residual, float(np.abs(off.at(POINTS)).max())) == (0, 0)


def test_distant_light_is_one_for_all_points() -> None:
    light = DistantLight(np.ones((4, 3)))
    assert light.at(POINTS).shape == (4, 3)
