"""MATHS §4: windows."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.special import roots_legendre
from tests.support import reference_sh as reference

from lightwell.conventions import degree_of_index
from lightwell.settings import WindowKind, WindowSettings
from lightwell.sh import window
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.minimum import minimum
from lightwell.sh.shading import irradiance
from lightwell.sh.window import WindowStage, apply_window, fixed_window, laplacian_window, weakest_strength

Z = np.array([0.0, 0.0, 1.0])
U = np.linspace(-1, 1, 20001)
seeds = st.integers(0, 2**32 - 1)
FIXED: list[WindowKind] = ["none", "hann", "lanczos", "nonneg"]
TARGETS: list[window.Target] = ["irradiance", "radiance"]


def series(zonal: Any) -> np.ndarray:
    """A zonal lobe along u = cos θ."""
    return np.polynomial.legendre.legval(U, np.asarray(zonal) * (2 * np.arange(len(zonal)) + 1) / (4 * np.pi))


def irradiance_kernel(weights: Any) -> np.ndarray:
    return series(np.asarray(weights) * lambert_zonal(len(weights)))


def relative_error(kernel: np.ndarray) -> float:
    cosine = np.maximum(U, 0)
    return float(np.sqrt(np.trapezoid((kernel - cosine) ** 2, U) / np.trapezoid(cosine**2, U)))


def probe(seed: int, bands: int, lights: int | None = None) -> np.ndarray:
    """Non-negative light: RGB directional lights over ambient light, projected."""
    generator = np.random.default_rng(seed)
    count = lights or 1 + seed % 5
    sources = generator.uniform(0, 1, (count, 3)) ** 3
    coefficients = evaluate(reference.directions(count, seed), bands).T @ sources
    coefficients[0] += generator.uniform(0, 0.2, 3)
    return coefficients


def least_irradiance(coefficients: np.ndarray, count: int | None = None) -> np.ndarray:
    """Least irradiance over the sphere of each channel, from the first ``count`` coefficients."""
    bands = int(np.sqrt(len(coefficients)))
    scaled = apply_window(coefficients, lambert_zonal(bands))[:count]
    return np.array([minimum(channel)[0] for channel in scaled.T])


# Fixed windows -------------------------------------------------------------------------------------------------------


def test_named_windows_of_three_bands() -> None:
    np.testing.assert_array_equal(fixed_window("none", 3), [1, 1, 1])
    np.testing.assert_allclose(fixed_window("hann", 3), [1, 0.75, 0.25], rtol=1e-15)
    np.testing.assert_allclose(fixed_window("lanczos", 3), [1, 0.827, 0.413], atol=5e-4)


def test_width() -> None:
    np.testing.assert_allclose(fixed_window("hann", 5, width=2), [1, 0.5, 0, 0, 0], atol=1e-16)
    np.testing.assert_allclose(fixed_window("lanczos", 5, width=2)[2:], 0, atol=1e-16)
    for kind in ("hann", "lanczos"):
        np.testing.assert_array_equal(fixed_window(kind, 5, width=np.inf), np.ones(5))
        np.testing.assert_array_equal(fixed_window(kind, 5), fixed_window(kind, 5, width=5))


def test_directional_light_without_window() -> None:
    kernel = irradiance_kernel(np.ones(3))
    np.testing.assert_allclose(kernel, (15 * U**2 + 16 * U + 3) / 32, rtol=0, atol=1e-15)
    assert kernel.min() == pytest.approx(-19 / 480, abs=1e-9)
    assert kernel[-1] == pytest.approx(17 / 16, rel=1e-14)
    assert relative_error(kernel) == pytest.approx(0.088, abs=5e-4)


@pytest.mark.parametrize(("bands", "plain", "hann"), [(3, -0.2, -0.0667), (4, -0.25, -0.0463), (5, -0.1517, -0.0381)])
def test_hann_does_not_remove_negative_radiance(bands: int, plain: float, hann: float) -> None:
    for weights, expected in ((np.ones(bands), plain), (fixed_window("hann", bands), hann)):
        kernel = series(weights)
        assert kernel.min() / kernel[-1] == pytest.approx(expected, abs=6e-5)


@pytest.mark.parametrize(("width", "least"), [(3, -0.0469), (4, -0.0224), (6, -0.0219)])
def test_hann_of_irradiance(width: float, least: float) -> None:
    kernel = irradiance_kernel(fixed_window("hann", 3, width=width))
    assert kernel.min() == pytest.approx(least, abs=5e-5)


def test_hann_of_irradiance_is_worse_than_nothing() -> None:
    kernel = irradiance_kernel(fixed_window("hann", 3))
    assert kernel[0] == kernel.min() < irradiance_kernel(np.ones(3)).min()
    assert relative_error(kernel) == pytest.approx(0.324, abs=5e-4)


def test_widest_windows_that_keep_irradiance_positive() -> None:
    # Up to w = 2 only h_1 is left, and ¼ + ½ h_1 u is non-negative up to h_1 = ½: w = 2 for Hanning, sinc(1/w) = ½ for
    # Lanczos. Beyond, the least irradiance falls below zero.
    lanczos = brentq(lambda w: np.sinc(1 / w) - 0.5, 1.1, 2)
    assert lanczos == pytest.approx(1.657, abs=5e-4)
    widths: dict[WindowKind, float] = {"hann": 2.0, "lanczos": lanczos}
    for kind, widest in widths.items():
        assert irradiance_kernel(fixed_window(kind, 3, width=widest)).min() == pytest.approx(0, abs=1e-15)
        for width in np.linspace(1.05, widest, 20):
            assert irradiance_kernel(fixed_window(kind, 3, width=width)).min() >= -1e-15
        for width in np.linspace(widest + 0.01, 8, 20):
            assert irradiance_kernel(fixed_window(kind, 3, width=width)).min() < 0


def test_kernel_a_of_maths_is_a_perfect_square() -> None:
    weights = [1, np.sqrt(3) / 2, 4 / 5]
    np.testing.assert_allclose(irradiance_kernel(weights), 3 / 8 * (U + 1 / np.sqrt(3)) ** 2, rtol=0, atol=1e-15)
    light = apply_window(evaluate(Z, 3), weights)
    mu = -1 / np.sqrt(3)
    assert irradiance(light, [np.sqrt(1 - mu * mu), 0, mu]) == pytest.approx(0, abs=1e-16)
    np.testing.assert_allclose(lambert_zonal(3) * weights, [np.pi, np.pi / np.sqrt(3), np.pi / 5], rtol=1e-15)
    assert irradiance(light, Z) == pytest.approx(0.933, abs=5e-4)
    assert relative_error(irradiance_kernel(weights)) == pytest.approx(0.147, abs=5e-4)


def test_kernel_b_is_the_least_squares_optimum() -> None:
    weights = fixed_window("nonneg", 3)
    np.testing.assert_allclose(weights, [1, 0.8579, 0.9094], atol=5e-5)
    kernel = irradiance_kernel(weights)
    assert kernel.min() >= -1e-15
    assert kernel[-1] == pytest.approx(0.963, abs=5e-4)
    assert relative_error(kernel) == pytest.approx(0.137, abs=5e-4)

    def squared_error(shift: float) -> float:
        mean = shift**2 + 1 / 3
        off = np.array([shift / mean, 8 / (15 * mean)]) - 1
        return np.sum((off * lambert_zonal(3)[1:]) ** 2 * [3, 5])

    a = window._NONNEG_SHIFT
    assert a == pytest.approx(0.50313, abs=5e-6)
    h = 1e-6
    assert (squared_error(a + h) - squared_error(a - h)) / (2 * h) == pytest.approx(0, abs=1e-8)
    assert squared_error(a) < min(squared_error(a - 0.01), squared_error(a + 0.01))


def test_two_bands_of_irradiance() -> None:
    np.testing.assert_array_equal(fixed_window("nonneg", 2), [1, 0.5])
    assert irradiance_kernel([1, 0.5]).min() == pytest.approx(0, abs=1e-16)


@pytest.mark.parametrize(
    ("bands", "expected"),
    [
        (1, [1]),
        (2, [1, 1 / 3]),
        (3, [1, 1 / np.sqrt(3), 1 / 5]),
        (4, [1, 0.689898, 0.344949, 0.093579]),
        (5, [1, 0.774597, 0.485714, 0.221313, 0.063492]),
        (6, [1, 0.822824, 0.576114, 0.326164, 0.140393, 0.035681]),
        (7, [1, 0.861136, 0.655408, 0.428389, 0.235438, 0.098352, 0.026356]),
    ],
)
def test_kernels_c_of_maths(bands: int, expected: Any) -> None:
    np.testing.assert_allclose(fixed_window("nonneg", bands, target="radiance"), expected, rtol=0, atol=5.1e-7)


@pytest.mark.parametrize("bands", range(1, 12))
def test_kernels_c_are_never_negative(bands: int) -> None:
    assert series(fixed_window("nonneg", bands, target="radiance")).min() >= -1e-14


@pytest.mark.parametrize("bands", [3, 5, 7, 9, 11])
def test_kernels_c_have_the_largest_linear_weight(bands: int) -> None:
    largest_root = roots_legendre((bands - 1) // 2 + 1)[0].max()
    assert fixed_window("nonneg", bands, target="radiance")[1] == pytest.approx(largest_root, rel=1e-13)


@given(seed=seeds, bands=st.integers(1, 8))
@settings(max_examples=30, deadline=None)
def test_nonneg_windows_leave_nothing_negative(seed: int, bands: int) -> None:
    coefficients = probe(seed, bands)
    scale = coefficients[0].max()
    for_diffuse = apply_window(coefficients, fixed_window("nonneg", bands))
    assert (least_irradiance(for_diffuse) >= -1e-14 * scale).all()
    assert (least_irradiance(for_diffuse, min(bands**2, 9)) >= -1e-14 * scale).all()
    for_glossy = apply_window(coefficients, fixed_window("nonneg", bands, target="radiance"))
    assert min(minimum(channel)[0] for channel in for_glossy.T) >= -1e-13 * scale


def test_constant_light_passes_every_window() -> None:
    coefficients = np.zeros((25, 3))
    coefficients[0] = [1, 2, 3]
    for kind in FIXED:
        for target in TARGETS:
            np.testing.assert_array_equal(
                apply_window(coefficients, fixed_window(kind, 5, target=target)), coefficients
            )
    for target in TARGETS:
        assert weakest_strength(coefficients, target) == 0


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [(("auto", 3), "no fixed window"), (("hann", 3, 0.0), "width"), (("none", 0), "outside 1 … 11")],
)
def test_refuses_bad_windows(arguments: tuple[Any, ...], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        fixed_window(*arguments)


# Automatic window ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("bands", "strength"), [(3, 0.1777), (4, 0.1777), (5, 0.1804)])
def test_strength_for_a_directional_light(bands: int, strength: float) -> None:
    coefficients = evaluate(reference.directions(1)[0], bands)[:, np.newaxis]
    assert weakest_strength(coefficients) == pytest.approx(strength, abs=5.1e-5)
    peak = irradiance_kernel(laplacian_window(strength, bands))[-1]
    assert peak == pytest.approx(0.58, abs=0.005)


def test_two_bands() -> None:
    coefficients = evaluate(Z, 2)[:, np.newaxis]
    # ¼ + ½ h_1 u is non-negative up to h_1 = ½: λ = ¼.
    assert weakest_strength(coefficients) == pytest.approx(0.25, abs=1e-5)


@given(seed=seeds, bands=st.integers(1, 8), target=st.sampled_from(["irradiance", "radiance"]))
@settings(max_examples=30, deadline=None)
def test_automatic_window_is_feasible_and_weakest(seed: int, bands: int, target: window.Target) -> None:
    coefficients = probe(seed, bands)
    scale = coefficients[0].max()
    strength = weakest_strength(coefficients, target)

    def least(λ: float) -> float:
        windowed = apply_window(coefficients, laplacian_window(λ, bands))
        if target == "radiance":
            return min(minimum(channel)[0] for channel in windowed.T)
        return float(min(least_irradiance(windowed).min(), least_irradiance(windowed, min(bands**2, 9)).min()))

    assert least(strength) >= -1e-11 * scale
    if strength > 0:
        weaker = strength - 1e-5 * (1 + strength) ** 2
        assert weaker <= 0 or least(weaker) < 0


def test_one_window_for_all_channels() -> None:
    coefficients = np.outer(evaluate(Z, 3), [1.0, 1.0, 1.0])
    coefficients[0, 1:] += 10
    assert weakest_strength(coefficients) == pytest.approx(weakest_strength(coefficients[:, :1]), rel=1e-12)


def test_channels_without_positive_mean_are_left_out() -> None:
    coefficients = np.outer(evaluate(Z, 3), [0.0, 0.0, 0.0])
    assert weakest_strength(coefficients) == 0
    coefficients[0] = [1, -1, 0]
    assert weakest_strength(coefficients) == 0


def test_hopeless_light_gets_the_strongest_window() -> None:
    coefficients = np.zeros((9, 1))
    coefficients[0], coefficients[2] = 1e-12, 1.0
    assert weakest_strength(coefficients) == pytest.approx(window.MAX_STRENGTH, rel=1e-6)


# Windows in time -----------------------------------------------------------------------------------------------------


def stage(bands: int = 3, **settings: Any) -> WindowStage:
    return WindowStage(WindowSettings(kind="auto", **settings), bands)


SUN = np.outer(evaluate(Z, 3), np.ones(3))
OVERCAST = np.outer(np.eye(9)[0], np.ones(3)) + 0.05 * SUN
SECOND = 1_000_000_000


def test_a_stronger_window_is_applied_at_once() -> None:
    windows = stage(smoothing_seconds=10)
    assert windows.update(OVERCAST, 0)[2] == 0
    windowed, weights, strength = windows.update(SUN, SECOND // 30)
    assert strength == pytest.approx(0.1777, abs=1e-4)
    np.testing.assert_array_equal(weights, laplacian_window(strength, 3))
    np.testing.assert_array_equal(windowed, apply_window(SUN, weights))


@pytest.mark.parametrize("fps", [25, 30, 60])
def test_a_weaker_window_is_approached_with_the_time_constant(fps: int) -> None:
    windows = stage(smoothing_seconds=0.5)
    first = windows.update(SUN, 0)[2]
    for frame in range(1, fps + 1):
        strength = windows.update(OVERCAST, frame * SECOND // fps)[2]
    bounded = strength / (1 + strength) / (first / (1 + first))
    assert bounded == pytest.approx(np.exp(-2), rel=1e-6)
    for frame in range(10 * fps):
        strength = windows.update(OVERCAST, 2 * SECOND + frame * SECOND // fps)[2]
    assert strength == 0


@given(seed=seeds, bands=st.integers(2, 6), target=st.sampled_from(["irradiance", "radiance"]))
@settings(max_examples=10, deadline=None)
def test_smoothing_never_shows_negative_light(seed: int, bands: int, target: window.Target) -> None:
    windows = stage(bands, target=target, smoothing_seconds=0.2)
    for frame in range(20):
        coefficients = probe(seed + frame // 4, bands)
        windowed, weights, strength = windows.update(coefficients, frame * SECOND // 30)
        assert weights[0] == 1
        assert strength >= 0
        if target == "irradiance":
            least = min(least_irradiance(windowed).min(), least_irradiance(windowed, min(bands**2, 9)).min())
        else:
            least = min(minimum(channel)[0] for channel in windowed.T)
        assert least >= -1e-11 * coefficients[0].max()


def test_a_relaxing_strength_that_would_not_do_is_raised() -> None:
    # E = ¼ + 0.35 u + 0.1 P_2(u) is zero at u = −1. A weak window takes more off P_2, which holds it up there.
    light = apply_window(SUN[:, :1], [1, 0.7, 0.32])
    assert weakest_strength(light) == 0
    assert least_irradiance(apply_window(light, laplacian_window(0.01, 3)))[0] < -0.01
    raised = 0
    windows = stage(smoothing_seconds=1)
    windows.update(SUN[:, :1], 0)
    for frame in range(1, 600):
        windowed, _, strength = windows.update(light, frame * SECOND // 30)
        assert least_irradiance(windowed)[0] >= -1e-12
        raised += 0.05 < strength < 0.08
    assert raised > 30
    assert strength == 0


def test_time_running_backwards_and_reset_start_anew() -> None:
    for again in ("backwards", "reset"):
        windows = stage(smoothing_seconds=10)
        windows.update(SUN, SECOND)
        if again == "reset":
            windows.reset()
        assert windows.update(OVERCAST, 0 if again == "backwards" else 2 * SECOND)[2] == 0


def test_no_smoothing() -> None:
    windows = stage(smoothing_seconds=0)
    windows.update(SUN, 0)
    assert windows.update(OVERCAST, SECOND // 30)[2] == 0


def test_fixed_windows_in_the_stage() -> None:
    windows = WindowStage(WindowSettings(kind="hann", width=4), 3)
    windowed, weights, strength = windows.update(SUN, 0)
    np.testing.assert_array_equal(weights, fixed_window("hann", 3, width=4))
    np.testing.assert_array_equal(windowed, apply_window(SUN, weights))
    assert strength == 0


def test_apply_window_keeps_shapes() -> None:
    coefficients = np.random.default_rng(0).normal(size=(9, 3, 3))
    weights = np.array([1, 0.5, 0.25])
    np.testing.assert_array_equal(
        apply_window(coefficients, weights), coefficients * weights[degree_of_index(3)][:, np.newaxis, np.newaxis]
    )
    np.testing.assert_array_equal(
        apply_window(coefficients[:, 0, 0], weights), coefficients[:, 0, 0] * weights[degree_of_index(3)]
    )
