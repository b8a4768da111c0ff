"""Light by place: grids, and grids that follow a live probe (MATHS §11d)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import nnls

from lightwell.field.adapt import adapt
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.render import DistantLight, FieldLight, SummedLight, modulate
from lightwell.render.nonnegative import PRIOR, nonnegative_gains
from lightwell.sh.basis import evaluate

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
    assert (np.asarray(modulate(FieldLight(grid), -live).fields[0].gain) == 0).all()
    off = modulate(FieldLight(grid), np.zeros((9, 3)))
    assert (off.residual, float(np.abs(off.at(POINTS)).max())) == (0, 0)


def room_of_lamps() -> tuple[FieldLight, ...]:
    """A grid for each of three point lamps, exact (MATHS §7.4): they overlap at every place, and differ in colour."""
    centres = SPEC.centres()
    lamps = [((-1.5, -1.0, 2.6), (4, 3, 2)), ((1.7, 2.4, 1.5), (2, 3, 4)), ((0.4, -3.0, 1.2), (3, 3, 3))]
    groups = []
    for place, colour in lamps:
        towards = np.array(place) - centres
        distance = np.linalg.norm(towards, axis=-1, keepdims=True)
        values = evaluate(towards / distance, 5) / distance**2
        coefficients = (values[..., None] * np.array(colour)).astype(np.float32)
        groups.append(FieldLight(Grid(SPEC, coefficients, np.ones(SPEC.shape, np.float32))))
    return tuple(groups)


def grid_of(coefficients: Any, spec: GridSpec = SPEC) -> FieldLight:
    return FieldLight(Grid(spec, np.asarray(coefficients, np.float32), np.ones(spec.shape, np.float32)))


LAMPS = room_of_lamps()
WHOLE = grid_of(sum(lamp.grid.coefficients for lamp in LAMPS))
PROBE = (0.2, -0.3, 1.1)
AT_PROBE = np.stack([lamp.at(np.array([PROBE]))[0] for lamp in LAMPS])


@pytest.mark.parametrize(
    "gains",
    [
        (1, 1, 1),  # ℓ = b
        (0.4, 0.4, 0.4),  # all dimmed
        (1, 0, 1),  # one off
        (3, 0.5, 1),
        (0, 0, 0),
        [(0.4, 1, 2), (0, 0, 1), (1.5, 1, 0.2)],  # each channel by itself
    ],
)
def test_mixes_of_known_lamps_are_exact_everywhere(gains: Any) -> None:
    """The table of MATHS §11d: method 4 has no error where methods 1 to 3 have."""
    factors = np.broadcast_to(np.array(gains, float).reshape(3, -1), (3, 3))
    live = np.einsum("gc,gkc->kc", factors, AT_PROBE)
    light = modulate(LAMPS, live, PROBE)
    truth = np.sum([lamp.at(POINTS) * factor for lamp, factor in zip(LAMPS, factors, strict=True)], axis=0)
    assert light.method == "groups"
    assert light.residual < 1e-6
    np.testing.assert_allclose(light.at(POINTS), truth, atol=1e-6 * np.abs(AT_PROBE).max())
    one = modulate(WHOLE, live, PROBE)
    alike = len(np.unique(factors)) == 1
    assert (np.abs(one.at(POINTS) - truth).max() < 1e-5 * np.abs(truth).max() + 1e-12) == alike


def test_an_unknown_lamp_gives_one_gain_and_a_rest() -> None:
    """New light, from afar or near, is no change of the lamps: method 2, with the sum of the groups."""
    far = 2.0 * evaluate(np.array([0.0, 0.6, -0.8]), 5)[:, None] * np.ones(3)
    light = modulate(LAMPS, AT_PROBE.sum(axis=0) + far, PROBE)
    assert light.method == "gain"
    assert light.residual > 0.05
    assert len({tuple(np.asarray(part.gain).tolist()) for part in light.fields}) == 1
    whole = modulate(WHOLE, AT_PROBE.sum(axis=0) + far, PROBE)
    np.testing.assert_allclose(light.at(POINTS), whole.at(POINTS), rtol=1e-4, atol=1e-5)
    # A little of it is within what calibration leaves: the gains stay, and the rest is added.
    little = modulate(LAMPS, AT_PROBE.sum(axis=0) + 0.02 * far, PROBE)
    assert (little.method, little.residual < 0.05) == ("groups", True)
    np.testing.assert_allclose(little.at(np.array([PROBE]))[0], AT_PROBE.sum(axis=0) + 0.02 * far, atol=1e-6)


def test_lamps_that_the_probe_cannot_tell_apart_or_see_stay_as_captured() -> None:
    twin = (LAMPS[0], LAMPS[0], LAMPS[1])
    light = modulate(twin, 2 * AT_PROBE[0] + AT_PROBE[1], PROBE)
    np.testing.assert_allclose([np.asarray(part.gain) for part in light.fields], np.ones((3, 3)), atol=1e-5)
    hidden = grid_of(np.zeros_like(LAMPS[0].grid.coefficients))
    light = modulate((LAMPS[0], hidden), 0.5 * AT_PROBE[0], PROBE)
    np.testing.assert_allclose([np.asarray(part.gain) for part in light.fields], [[0.5] * 3, [1.0] * 3], atol=1e-6)


def test_groups_may_differ_in_cells_and_bands_and_are_few() -> None:
    coarse = grid_of(np.ones((2, 2, 3, 9, 3)), GridSpec(SPEC.lower, SPEC.upper, (3, 2, 2)))
    parts = (LAMPS[0], coarse)
    base = [part.at(np.array([PROBE]))[0] for part in parts]
    live = 0.3 * base[0]
    live[:9] += 2 * base[1]
    light = modulate(parts, live, PROBE)
    np.testing.assert_allclose([np.asarray(part.gain)[0] for part in light.fields], [0.3, 2.0], atol=1e-6)
    assert SummedLight(parts).at(POINTS).shape == (40, 25, 3)
    for wrong in ((), (coarse,) * 5):
        with pytest.raises(ValueError, match=f"{len(wrong)} light groups"):
            modulate(wrong, live)


@given(st.integers(0, 2**32 - 1), st.integers(1, 4), st.booleans())
def test_gains_are_those_of_an_independent_solver(seed: int, count: int, twins: bool) -> None:
    rng = np.random.default_rng(seed)
    columns, target = rng.normal(size=(25, count)), rng.normal(size=25)
    if twins:
        columns[:, -1] = columns[:, 0] * (1 + 1e-3 * rng.normal())
    pull = np.sqrt(PRIOR * (columns**2).sum())
    expected, _ = nnls(np.vstack([columns, pull * np.eye(count)]), np.concatenate([target, np.full(count, pull)]))
    np.testing.assert_allclose(nonnegative_gains(columns, target), expected, atol=1e-6)


def test_distant_light_is_one_for_all_points() -> None:
    light = DistantLight(np.ones((4, 3)))
    assert light.at(POINTS).shape == (4, 3)
