"""MATHS §11a: dominant light and ambient light."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.sh.basis import evaluate
from lightwell.sh.dominant import compose, remainder, split_dominant
from lightwell.sh.rotation import rotate
from lightwell.sh.shading import irradiance

seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds, bands=st.integers(2, 8))
@settings(max_examples=40, deadline=None)
def test_recovers_one_light_over_ambient(seed: int, bands: int) -> None:
    generator = np.random.default_rng(seed)
    direction, sun, ambient = reference.directions(1, seed)[0], generator.uniform(0, 5, 3), generator.uniform(0, 1, 3)
    coefficients = evaluate(direction, bands)[:, np.newaxis] * sun
    coefficients[0] += ambient * np.sqrt(4 * np.pi)
    split = split_dominant(coefficients)
    np.testing.assert_allclose(split.direction, direction, rtol=0, atol=1e-14)
    np.testing.assert_allclose(split.irradiance, sun, rtol=0, atol=1e-13)
    np.testing.assert_allclose(split.ambient, ambient, rtol=0, atol=1e-13)
    np.testing.assert_allclose(remainder(coefficients, split), 0, atol=1e-13)


def test_two_lights_give_their_centroid() -> None:
    sources = np.array([[1.0, 0, 0], [0, 1.0, 0]])
    coefficients = np.outer(np.array([3.0, 1.0]) @ evaluate(sources, 3), np.ones(3))
    split = split_dominant(coefficients)
    assert np.degrees(np.arccos(split.direction[0])) == pytest.approx(18.43, abs=0.01)
    assert np.arctan2(split.direction[1], split.direction[0]) == pytest.approx(np.arctan(1 / 3), abs=1e-14)


def test_the_usual_constant_matches_frontal_irradiance() -> None:
    # A directional light of irradiance s reads 17/16 s in three bands: 16π/17 is what makes it read π.
    coefficients = np.outer(evaluate([0, 0, 1], 3), np.full(3, 16 * np.pi / 17))
    np.testing.assert_allclose(irradiance(coefficients, [0, 0, 1]), np.pi, rtol=1e-14)


@given(seed=seeds, bands=st.integers(1, 8))
@settings(max_examples=40, deadline=None)
def test_parts_sum_to_the_whole(seed: int, bands: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=(bands**2, 3))
    split = split_dominant(coefficients)
    rest = remainder(coefficients, split)
    np.testing.assert_allclose(compose(split, bands) + rest, coefficients, rtol=0, atol=1e-14)
    np.testing.assert_allclose(rest[0], 0, atol=1e-14)
    assert np.linalg.norm(split.direction) == pytest.approx(1, abs=1e-14)
    assert (split.irradiance >= 0).all()
    assert (split.ambient[coefficients[0] >= 0] >= -1e-15).all()


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_turns_with_the_light(seed: int) -> None:
    coefficients = np.abs(np.random.default_rng(seed).normal(size=(6, 1, 3)))
    coefficients = np.sum(evaluate(reference.directions(6, seed), 5)[..., np.newaxis] * coefficients, axis=0)
    turn = reference.rotation(seed)
    before, after = split_dominant(coefficients), split_dominant(rotate(coefficients, turn))
    np.testing.assert_allclose(after.direction, turn @ before.direction, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.irradiance, before.irradiance, rtol=0, atol=1e-12)
    np.testing.assert_allclose(after.ambient, before.ambient, rtol=0, atol=1e-12)


@pytest.mark.parametrize("bands", [1, 2, 3, 5])
def test_black_light(bands: int) -> None:
    split = split_dominant(np.zeros((bands**2, 3)))
    np.testing.assert_array_equal(split.direction, [0, 0, 1])
    np.testing.assert_array_equal(split.irradiance, 0)
    np.testing.assert_array_equal(split.ambient, 0)


def test_a_single_band_is_all_ambient() -> None:
    split = split_dominant(np.full((1, 3), np.sqrt(4 * np.pi)))
    np.testing.assert_array_equal(split.direction, [0, 0, 1])
    np.testing.assert_array_equal(split.irradiance, 0)
    np.testing.assert_allclose(split.ambient, 1, rtol=1e-15)


def test_the_light_takes_no_more_than_there_is() -> None:
    # More linear light than mean light: no non-negative light is like this, noise is.
    coefficients = np.zeros((4, 3))
    coefficients[0], coefficients[2] = 0.1, 1.0
    split = split_dominant(coefficients)
    np.testing.assert_allclose(split.irradiance, 0.1 * np.sqrt(4 * np.pi), rtol=1e-14)
    np.testing.assert_allclose(split.ambient, 0, atol=1e-16)


def test_a_channel_without_light_stays_without() -> None:
    coefficients = np.outer(evaluate([0, 1, 0], 4), [1.0, 2.0, 0.0])
    split = split_dominant(coefficients)
    np.testing.assert_allclose(split.irradiance, [1, 2, 0], rtol=1e-14)


@pytest.mark.parametrize("shape", [(9,), (9, 4), (8, 3)])
def test_refuses_other_shapes(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match=r"bands²|whole number of bands"):
        split_dominant(np.zeros(shape))
