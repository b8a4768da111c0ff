"""MATHS §1."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import sphericart
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.special import sph_harm_y
from tests.support import reference_sh as reference

from lightwell.conventions import coefficient_index
from lightwell.sh.basis import basis_at, basis_at_float32, evaluate, evaluate_with_gradient, legendre_at

BANDS = 11
POLES_AND_AXES = np.vstack([np.eye(3), -np.eye(3)])
SAMPLE = np.vstack([reference.directions(2000), POLES_AND_AXES])


def test_matches_the_definition() -> None:
    np.testing.assert_allclose(evaluate(SAMPLE, BANDS), reference.basis(SAMPLE, BANDS), rtol=0, atol=3e-14)


def test_matches_sphericart() -> None:
    theirs = sphericart.SphericalHarmonics(BANDS - 1).compute(SAMPLE)
    np.testing.assert_allclose(evaluate(SAMPLE, BANDS), theirs, rtol=0, atol=4e-14)


def test_matches_scipy_without_its_phase() -> None:
    ours = evaluate(SAMPLE, BANDS)
    polar, azimuth = np.arccos(np.clip(SAMPLE[:, 2], -1, 1)), np.arctan2(SAMPLE[:, 1], SAMPLE[:, 0])
    for degree in range(BANDS):
        for order in range(degree + 1):
            theirs = sph_harm_y(degree, order, polar, azimuth)
            factor = 1.0 if order == 0 else np.sqrt(2) * (-1) ** order
            plus, minus = coefficient_index(degree, order), coefficient_index(degree, -order)
            np.testing.assert_allclose(ours[:, plus], factor * theirs.real, rtol=0, atol=3e-14)
            if order:
                np.testing.assert_allclose(ours[:, minus], factor * theirs.imag, rtol=0, atol=3e-14)


def test_first_nine_constants() -> None:
    x, y, z = 2 / 7, -3 / 7, 6 / 7
    expected = [
        0.28209479,
        0.48860251 * y,
        0.48860251 * z,
        0.48860251 * x,
        1.09254843 * x * y,
        1.09254843 * y * z,
        0.31539157 * (3 * z * z - 1),
        1.09254843 * x * z,
        0.54627422 * (x * x - y * y),
    ]
    np.testing.assert_allclose(evaluate([x, y, z], 3), expected, rtol=0, atol=1e-8)


def test_is_orthonormal() -> None:
    points, weights = reference.sphere_quadrature(2 * (BANDS - 1))
    values = evaluate(points, BANDS)
    np.testing.assert_allclose(values.T @ (weights[:, np.newaxis] * values), np.eye(BANDS**2), rtol=0, atol=2e-14)


def test_addition_theorem() -> None:
    squares = evaluate(SAMPLE, BANDS) ** 2
    for degree in range(BANDS):
        total = squares[:, degree**2 : (degree + 1) ** 2].sum(axis=1)
        np.testing.assert_allclose(total, (2 * degree + 1) / (4 * np.pi), rtol=0, atol=5e-14)


def test_float32_stays_within_its_bound_also_at_the_poles() -> None:
    single = evaluate(SAMPLE.astype(np.float32), BANDS, np.float32)
    exact = evaluate(SAMPLE.astype(np.float32).astype(np.float64), BANDS)
    assert single.dtype == np.float32
    assert np.isfinite(single).all()
    assert np.abs(single - exact).max() < 2.9e-6


def test_constant_light() -> None:
    points, weights = reference.sphere_quadrature(8)
    coefficients = weights @ evaluate(points, 5)
    expected = np.zeros(25)
    expected[0] = 3.5449077018110318
    np.testing.assert_allclose(coefficients, expected, rtol=0, atol=2e-14)


def test_half_space_light() -> None:
    # L = 1 for z > 0, integrated over the upper hemisphere alone.
    z, weights = np.polynomial.legendre.leggauss(20)
    z, weights = (z + 1) / 2, weights / 2
    ring = np.stack([np.sqrt(1 - z * z), np.zeros_like(z), z], axis=1)
    zonal = 2 * np.pi * weights @ evaluate(ring, 6)[:, [0, 2, 6, 12, 20, 30]]
    expected = [1.7724538509, 1.5349900619, 0, -0.5861840125, 0, 0.3674102739]
    np.testing.assert_allclose(zonal, expected, rtol=0, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1), bands=st.integers(1, BANDS))
@settings(max_examples=30, deadline=None)
def test_gradient_agrees_with_differences_and_is_tangential(seed: int, bands: int) -> None:
    ω = reference.directions(1, seed)[0]
    values, gradient = evaluate_with_gradient(ω, bands)
    np.testing.assert_allclose(values, evaluate(ω, bands), rtol=0, atol=1e-14)
    np.testing.assert_allclose(gradient @ ω, 0, atol=1e-13)
    tangent = np.cross(ω, reference.directions(1, seed + 1)[0])
    tangent /= np.linalg.norm(tangent)
    h = 1e-5
    ahead, behind = np.cos(h) * ω + np.sin(h) * tangent, np.cos(h) * ω - np.sin(h) * tangent
    difference = (evaluate(ahead, bands) - evaluate(behind, bands)) / (2 * h)
    np.testing.assert_allclose(gradient @ tangent, difference, rtol=0, atol=1e-7)


def test_gradient_agrees_with_sphericart() -> None:
    _, theirs = sphericart.SphericalHarmonics(BANDS - 1).compute_with_gradients(SAMPLE)
    values, ours = evaluate_with_gradient(SAMPLE, BANDS)
    # sphericart's gradient is that of the homogeneous extension of degree 0, which is tangential as well.
    np.testing.assert_allclose(ours, np.moveaxis(theirs, 1, 2), rtol=0, atol=1e-12)
    assert values.shape == (len(SAMPLE), BANDS**2)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("shape", [(3,), (1, 3), (4, 5, 3), (0, 3), (2, 0, 3)])
def test_shapes(shape: tuple[int, ...], dtype: Any) -> None:
    ω = np.zeros(shape)
    ω[..., 2] = 1
    values = evaluate(ω, 4, dtype)
    assert values.shape == (*shape[:-1], 16)
    assert values.dtype == dtype
    values, gradients = evaluate_with_gradient(ω, 4)
    assert values.shape == (*shape[:-1], 16)
    assert gradients.shape == (*shape[:-1], 16, 3)


def test_accepts_strided_and_integer_input() -> None:
    ω = np.asfortranarray(SAMPLE[:10])
    np.testing.assert_array_equal(evaluate(ω, 5), evaluate(ω.copy(), 5))
    np.testing.assert_array_equal(evaluate([0, 0, 1], 5), evaluate([0.0, 0.0, 1.0], 5))


def test_building_blocks_work_in_other_kernels() -> None:
    @njit
    def kernel(ω: np.ndarray, out64: np.ndarray, out32: np.ndarray, q: np.ndarray) -> None:
        basis_at(ω[0], ω[1], ω[2], 5, out64)
        basis_at_float32(np.float32(ω[0]), np.float32(ω[1]), np.float32(ω[2]), 5, out32)
        legendre_at(ω[2], 5, q)

    ω = SAMPLE[0]
    out64, out32, q = np.empty(25), np.empty(25, np.float32), np.zeros((5, 5))
    kernel(ω, out64, out32, q)
    np.testing.assert_array_equal(out64, evaluate(ω, 5))
    np.testing.assert_allclose(out32, out64, rtol=0, atol=3e-6)
    azimuth, sine = np.arctan2(ω[1], ω[0]), np.hypot(ω[0], ω[1])
    for degree in range(5):
        for order in range(degree + 1):
            expected = q[degree, order] * sine**order * np.cos(order * azimuth)
            assert out64[coefficient_index(degree, order)] == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize("bands", [0, -1, 12])
def test_refuses_bands_out_of_range(bands: int) -> None:
    with pytest.raises(ValueError, match="outside 1 … 11"):
        evaluate([0, 0, 1], bands)


@pytest.mark.parametrize("shape", [(), (2,), (3, 2)])
def test_refuses_other_shapes(shape: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="x, y, z"):
        evaluate(np.zeros(shape), 3)


def test_refuses_other_precisions() -> None:
    with pytest.raises(ValueError, match="float16"):
        evaluate([0, 0, 1], 3, np.float16)
