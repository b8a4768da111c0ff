"""Temporal filters that follow a moving probe by its gradients (MATHS §5, "Moving probe")."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.settings import FilterKind, FilterSettings
from lightwell.sh.basis import basis_gradients, evaluate
from lightwell.sh.rotation import rotate, rotate_gradients
from lightwell.sh.temporal import Place, TemporalFilter, make_filter

SECOND = 1_000_000_000
START = 1_790_000_000 * SECOND
LAMP = np.array([0.3, 0.9, 0.4])
KINDS: list[FilterKind] = ["alpha", "tau", "one-euro", "kalman"]


def point_light(place: np.ndarray, bands: int = 5) -> tuple[np.ndarray, np.ndarray]:
    """Return coefficients and exact gradients of a point light (MATHS §7.4)."""
    offset = LAMP - place
    distance = float(np.linalg.norm(offset))
    towards = offset / distance
    basis = evaluate(towards, bands)
    slope = (2 * basis[:, None] * towards - basis_gradients(towards, bands)) / distance**3
    colour = np.array([1.0, 0.7, 0.4])
    return basis[:, None] * colour / distance**2, slope[:, None, :] * colour[:, None]


def walk(smooth: TemporalFilter, *, predict: bool, frames: int = 60, fps: int = 30) -> tuple[float, np.ndarray]:
    """Move .5 m/s past the lamp; return the last relative error, and the gradients then."""
    for index in range(frames):
        place = np.array([-0.5 + 0.5 * index / fps, 0.0, 0.0])
        light, slope = point_light(place)
        here = Place(slope if predict else None, place)
        output = smooth.update(light, START + index * SECOND // fps, place=here)
        assert smooth.cut == (index == 0)
    error = float(np.linalg.norm(output - light) / np.linalg.norm(light))
    return error, np.zeros(0) if smooth.gradients is None else smooth.gradients


def make(kind: FilterKind, **options: object) -> TemporalFilter:
    return make_filter(FilterSettings.model_validate({"kind": kind, "tau_seconds": 0.3, "alpha": 9.0} | options))


def test_a_point_light_lags_by_what_maths_says_without_prediction_alone() -> None:
    lag, _ = walk(make("tau"), predict=False)
    assert 0.1 < lag < 0.4
    predicted, slope = walk(make("tau"), predict=True)
    assert predicted < 2e-4  # .308 without, 1.3e-4 with
    assert slope.shape == (25, 3, 3)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("hold", ["zero", "first"])
def test_every_kind_predicts(kind: FilterKind, hold: str) -> None:
    options = {"hold": hold, "min_cutoff_hz": 0.2, "beta": 0.0}
    lag, _ = walk(make(kind, **options), predict=False)
    predicted, _ = walk(make(kind, **options), predict=True)
    assert predicted < 0.02 * lag


@pytest.mark.parametrize("kind", ["none", *KINDS])
def test_gradients_have_the_gain_of_the_coefficients(kind: FilterKind) -> None:
    """At one place, gradients that are a fixed multiple of the coefficients remain so."""
    rng = np.random.default_rng(1)
    smooth = make(kind)
    factors = rng.normal(size=3)
    for index in range(20):
        light = rng.uniform(0.5, 1, (9, 3))
        here = Place(light[..., None] * factors, np.zeros(3))
        output = smooth.update(light, START + index * SECOND // 25, place=here)
        assert smooth.gradients is not None
        np.testing.assert_allclose(smooth.gradients, output[..., None] * factors, rtol=1e-12, atol=1e-12)


def test_a_jump_beyond_the_reach_starts_anew_and_a_step_within_is_no_cut() -> None:
    smooth = make("tau", cut_threshold=0.05)
    for index, (x, cut) in enumerate([(0.0, True), (0.1, False), (0.2, False), (0.6, True), (0.65, False)]):
        light, slope = point_light(np.array([x, 0.0, 0.0]))
        output = smooth.update(light, START + index * SECOND // 25, place=Place(slope, np.array([x, 0, 0]), 0.15))
        assert smooth.cut == cut, x
        np.testing.assert_allclose(output, light, rtol=0, atol=0.02 * np.abs(light).max())
    without = make("tau", cut_threshold=0.05)
    cuts = 0
    for index, x in enumerate([0.0, 0.1, 0.2]):
        without.update(point_light(np.array([x, 0.0, 0.0]))[0], START + index * SECOND // 25)
        cuts += without.cut
    assert cuts == 3


def test_a_camera_that_turns_while_it_moves() -> None:
    """Coefficients and gradients come in the camera's axes, positions in the world's."""
    smooth = make("tau")
    for index in range(40):
        angle = 0.2 * index
        world = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]])
        place = np.array([0.0, -0.4 + 0.02 * index, 0.1])
        light, slope = point_light(place)
        here = Place(rotate_gradients(slope, world.T), place)
        output = smooth.update(rotate(light, world.T), START + index * SECOND // 30, world, here)
    assert smooth.gradients is not None
    np.testing.assert_allclose(output, light, atol=2e-3 * np.abs(light).max())


def test_gradients_may_come_and_go() -> None:
    smooth = make("tau")
    light, slope = point_light(np.zeros(3))
    smooth.update(light, START, place=Place(slope, np.zeros(3)))
    smooth.update(light, START + SECOND // 30, place=Place(None, np.zeros(3)))
    assert smooth.gradients is None
    smooth.update(light, START + SECOND // 15, place=Place(slope, np.zeros(3)))
    np.testing.assert_array_equal(smooth.gradients, slope)
    smooth.update(light[:9], START + SECOND // 10, place=Place(slope[:9], np.ones(3)))
    assert smooth.cut
    with pytest.raises(ValueError, match="NaN or Inf"):
        smooth.update(light, START + SECOND, place=Place(np.full_like(slope, np.nan)))
