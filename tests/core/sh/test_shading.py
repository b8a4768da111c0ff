"""Radiance, irradiance and Phong shading (MATHS §1, §4, §8)."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import phong_zonal, zonal_to_coefficients
from lightwell.sh.shading import convolve, irradiance, phong, radiance

Z = np.array([0.0, 0.0, 1.0])


def constant(value: Any, bands: int) -> np.ndarray:
    coefficients = np.zeros((bands**2, 3))
    coefficients[0] = np.sqrt(4 * np.pi) * np.asarray(value)
    return coefficients


@pytest.mark.parametrize("bands", [1, 3, 5])
def test_constant_light(bands: int) -> None:
    normals = reference.directions(10)
    light = constant([1, 2, 3], bands)
    np.testing.assert_allclose(radiance(light, normals), np.tile([1, 2, 3], (10, 1)), rtol=1e-14)
    np.testing.assert_allclose(irradiance(light, normals), np.pi * np.tile([1, 2, 3], (10, 1)), rtol=1e-14)
    np.testing.assert_allclose(phong(light, normals, 6.0), np.tile([1, 2, 3], (10, 1)), rtol=1e-14)


@pytest.mark.parametrize(
    ("bands", "factor"), [(1, 0.25), (2, 0.75), (3, 1.0625), (4, 1.0625), (5, 0.96875), (6, 0.96875)]
)
def test_frontal_irradiance_of_a_truncated_directional_light(bands: int, factor: float) -> None:
    direction = reference.directions(1)[0]
    assert irradiance(evaluate(direction, bands), direction) == pytest.approx(factor, rel=1e-14)


def test_irradiance_of_a_directional_light_is_the_known_quadratic() -> None:
    mu = np.linspace(-1, 1, 101)
    normals = np.stack([np.sqrt(1 - mu * mu), np.zeros_like(mu), mu], axis=1)
    expected = (15 * mu**2 + 16 * mu + 3) / 32
    np.testing.assert_allclose(irradiance(evaluate(Z, 3), normals), expected, rtol=0, atol=1e-15)


def test_irradiance_of_half_space_light() -> None:
    light = np.zeros(4)
    light[0], light[2] = 1.7724538509055159, 1.5349900619197328
    normals = reference.directions(50)
    np.testing.assert_allclose(irradiance(light, normals), np.pi * (1 + normals[:, 2]) / 2, rtol=0, atol=1e-14)


@given(seed=st.integers(0, 2**32 - 1), exponent=st.sampled_from([0.0, 1.0, 2.0, 6.0, 15.0]))
@settings(max_examples=10, deadline=None)
def test_blur_then_evaluate_is_the_integral_with_the_lobe(seed: int, exponent: float) -> None:
    bands = 5
    coefficients = np.random.default_rng(seed).normal(size=(bands**2, 3))
    axis = reference.directions(1, seed)[0]
    lobe = zonal_to_coefficients(phong_zonal(exponent, bands), axis)
    np.testing.assert_allclose(phong(coefficients, axis, exponent), lobe @ coefficients, rtol=0, atol=1e-13)


def test_unnormalised_phong_of_exponent_one_is_irradiance() -> None:
    coefficients = np.random.default_rng(1).normal(size=(25, 3))
    normals = reference.directions(7)
    np.testing.assert_array_equal(
        phong(coefficients, normals, 1.0, normalised=False), irradiance(coefficients, normals)
    )


def test_shapes_and_a_single_channel() -> None:
    coefficients = np.random.default_rng(1).normal(size=(9, 3))
    normals = reference.directions(6).reshape(2, 3, 3)
    assert radiance(coefficients, normals).shape == (2, 3, 3)
    assert radiance(coefficients[:, 0], normals).shape == (2, 3)
    assert radiance(coefficients, np.empty((0, 3))).shape == (0, 3)
    np.testing.assert_array_equal(radiance(coefficients[:, 0], normals), radiance(coefficients[:, :1], normals)[..., 0])


def test_refuses_a_count_that_is_no_square() -> None:
    with pytest.raises(ValueError, match="whole number of bands"):
        convolve(np.zeros((8, 3)), np.ones(3))


def test_refuses_factors_of_other_bands() -> None:
    with pytest.raises(ValueError, match="3 bands need as many factors"):
        convolve(np.zeros((9, 3)), np.ones(4))
