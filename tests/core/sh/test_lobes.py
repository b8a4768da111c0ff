"""MATHS §8, lobes; §2.3, the blind cone."""

from __future__ import annotations

from math import factorial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.sh.lobes import cone_zonal, lambert_zonal, phong_zonal, zonal_to_coefficients
from lightwell.sh.rotation import rotate

BANDS = 11
NODES, WEIGHTS = np.polynomial.legendre.leggauss(120)


def zonal_harmonics(zonal: np.ndarray) -> np.ndarray:
    """``z_l`` of MATHS from the convolution factors."""
    return np.asarray(np.sqrt((2 * np.arange(len(zonal)) + 1) / (4 * np.pi)) * zonal)


def test_lambert_values() -> None:
    expected = np.pi * np.array([1, 2 / 3, 1 / 4, 0, -1 / 24, 0, 1 / 64, 0, -1 / 128])
    np.testing.assert_allclose(lambert_zonal(9), expected, rtol=1e-15, atol=1e-16)


def test_lambert_closed_form_of_even_degrees() -> None:
    for degree in range(2, BANDS, 2):
        half = degree // 2
        closed = (
            2
            * np.pi
            * (-1) ** (half - 1)
            * factorial(degree)
            / ((degree + 2) * (degree - 1) * 2**degree * factorial(half) ** 2)
        )
        assert lambert_zonal(BANDS)[degree] == pytest.approx(closed, rel=1e-14)


@given(halves=st.integers(0, 200), bands=st.integers(1, BANDS))
@settings(max_examples=40, deadline=None)
def test_phong_agrees_with_quadrature(halves: int, bands: int) -> None:
    # In v = √u the integrand of a half-integer exponent is a polynomial.
    v = (NODES + 1) / 2
    expected = 2 * np.pi * (WEIGHTS * v ** (halves + 1)) @ np.polynomial.legendre.legvander(v * v, bands - 1)
    np.testing.assert_allclose(phong_zonal(halves / 2, bands, normalised=False), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize("s", [0.5, 1.0, 3.7, 6.0, 30.0])
def test_phong_moments_in_closed_form(s: float) -> None:
    moments = phong_zonal(s, BANDS, normalised=False) / (2 * np.pi)
    for degree in range(BANDS):
        parity = degree % 2
        numerator = np.prod([s - parity - k for k in range(0, degree - 1, 2)])
        denominator = np.prod([s + 1 + parity + k for k in range(0, degree + 1 - parity, 2)])
        assert moments[degree] == pytest.approx(numerator / denominator, rel=1e-13, abs=1e-17)


def test_the_gaussian_approximation_is_poor() -> None:
    assert phong_zonal(6, 5)[4] == pytest.approx(0.242, abs=5e-4)
    assert np.exp(-16 / 12) == pytest.approx(0.264, abs=5e-4)
    assert phong_zonal(2, 5)[4] == 0
    assert np.exp(-16 / 4) == pytest.approx(0.018, abs=5e-4)


@pytest.mark.parametrize("n", [0.0, 1.0, 4.0, 7.5])
def test_paper_004_lobes_as_repaired(n: float) -> None:
    # ρ̂_l of paper 004 §3.3 is the zonal harmonic of the normalised lobe (k_s = 1) and of k_d/π max(0, cos).
    lambert = [np.sqrt(np.pi) / 2 / np.pi, np.sqrt(np.pi / 3) / np.pi]
    for degree in range(2, BANDS):
        half = degree // 2
        even = (
            2
            * np.sqrt((2 * degree + 1) / (4 * np.pi))
            * (-1) ** (half - 1)
            * factorial(degree)
            / ((degree + 2) * (degree - 1) * 2**degree * factorial(half) ** 2)
        )
        lambert.append(0.0 if degree % 2 else even)
    expected = zonal_harmonics(lambert_zonal(BANDS)) / np.pi
    np.testing.assert_allclose(lambert, expected, rtol=0, atol=1e-13)

    phong = []
    for degree in range(BANDS):
        if degree % 2:
            top = np.prod([n + 1 - k for k in range(0, degree, 2)])
            bottom = np.prod([n + degree + 1 - k for k in range(0, degree, 2)])
        else:
            top = np.prod([n - k for k in range(0, degree - 1, 2)])
            bottom = np.prod([n + degree + 1 - k for k in range(0, degree - 1, 2)])
        phong.append(np.sqrt((2 * degree + 1) / (4 * np.pi)) * top / bottom)
    np.testing.assert_allclose(phong, zonal_harmonics(phong_zonal(n, BANDS)), rtol=0, atol=3e-13)


def test_normalised_lobe_keeps_constant_light() -> None:
    for exponent in (0.0, 1.0, 6.0, 50.5):
        assert phong_zonal(exponent, 3)[0] == pytest.approx(1, rel=1e-15)


def test_unnormalised_exponent_one_is_lambert() -> None:
    np.testing.assert_array_equal(phong_zonal(1, BANDS, normalised=False), lambert_zonal(BANDS))


@pytest.mark.parametrize(
    ("exponent", "degree", "error", "peak", "least"),
    [(6, 2, 0.52, 0.50, -0.07), (6, 4, 0.14, 0.87, -0.03), (6, 6, 0.011, 0.99, -0.003)],
)
def test_truncated_lobe(exponent: float, degree: int, error: float, peak: float, least: float) -> None:
    measured_error, measured_peak, measured_least = _truncation(exponent, degree)
    assert measured_error == pytest.approx(error, abs=0.005)
    assert measured_peak == pytest.approx(peak, abs=0.005)
    assert measured_least == pytest.approx(least, abs=0.005)


@pytest.mark.parametrize(("exponent", "error", "peak"), [(10, 0.31, 0.70), (20, 0.55, 0.46)])
def test_truncated_narrow_lobe(exponent: float, error: float, peak: float) -> None:
    measured_error, measured_peak, _ = _truncation(exponent, 4)
    assert measured_error == pytest.approx(error, abs=0.005)
    assert measured_peak == pytest.approx(peak, abs=0.005)


def _truncation(exponent: float, degree: int) -> tuple[float, float, float]:
    zonal = phong_zonal(exponent, degree + 1, normalised=False)
    u = np.linspace(-1, 1, 20001)
    series = np.polynomial.legendre.legval(u, zonal * (2 * np.arange(degree + 1) + 1) / (4 * np.pi))
    lobe = np.maximum(u, 0) ** exponent
    error = np.sqrt(np.trapezoid((series - lobe) ** 2, u) / np.trapezoid(lobe**2, u))
    return float(error), float(series[-1]), float(series.min())


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_lobe_about_an_axis_is_the_rotated_lobe(seed: int) -> None:
    turn = reference.rotation(seed)
    zonal = phong_zonal(6, 7)
    about_z = zonal_to_coefficients(zonal, [0, 0, 1])
    np.testing.assert_allclose(
        zonal_to_coefficients(zonal, turn @ [0, 0, 1]), rotate(about_z, turn), rtol=0, atol=5e-14
    )
    # On its own axis the lobe has only m = 0, with the value √((2l+1)/4π) k_l.
    zonal_index = np.arange(7) * (np.arange(7) + 1)
    np.testing.assert_allclose(about_z[zonal_index], zonal_harmonics(zonal), rtol=0, atol=2e-15)
    assert np.abs(np.delete(about_z, zonal_index)).max() == 0


def test_many_axes_at_once() -> None:
    axes = reference.directions(12).reshape(3, 4, 3)
    assert zonal_to_coefficients(lambert_zonal(3), axes).shape == (3, 4, 9)


@pytest.mark.parametrize("half_angle", [0.0, 0.0366, 0.5, np.pi / 2, 3.0, np.pi])
def test_cone_agrees_with_quadrature(half_angle: float) -> None:
    edge = np.cos(half_angle)
    expected = reference.zonal_factors(lambda u: np.where(u > edge, 1.0, 0.0), 8, breaks=(-1.0, edge, 1.0))
    np.testing.assert_allclose(cone_zonal(half_angle, 8), expected, rtol=0, atol=1e-13)


@pytest.mark.parametrize(
    ("degrees", "share"),
    [
        (4.2, (0.00134, 0.00232, 0.00299, 0.00352, 0.00397)),
        (2.1, (0.00034, 0.00058, 0.00075, 0.00089, 0.00100)),
    ],
)
def test_what_the_blind_cone_takes_from_constant_light(degrees: float, share: tuple[float, ...]) -> None:
    lost = zonal_harmonics(cone_zonal(np.radians(degrees), 5))
    np.testing.assert_allclose(lost / np.sqrt(4 * np.pi), share, rtol=0, atol=5.1e-6)


def test_a_whole_cone_is_constant_light() -> None:
    np.testing.assert_allclose(cone_zonal(np.pi, 4), [4 * np.pi, 0, 0, 0], atol=1e-14)


@pytest.mark.parametrize("exponent", [-0.1, np.nan, np.inf])
def test_refuses_bad_exponents(exponent: float) -> None:
    with pytest.raises(ValueError, match="exponent"):
        phong_zonal(exponent, 3)


def test_refuses_bad_angles_and_bands() -> None:
    with pytest.raises(ValueError, match="half-angle"):
        cone_zonal(4.0, 3)
    with pytest.raises(ValueError, match="outside 1 … 11"):
        lambert_zonal(0)
    with pytest.raises(ValueError, match="outside 1 … 11"):
        cone_zonal(1.0, 12)
