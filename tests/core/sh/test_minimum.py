"""MATHS §4.2: the least value over the sphere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.conventions import degree_of_index
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.minimum import _derivatives_at, is_at_least, minimum
from lightwell.sh.rotation import rotate

seeds = st.integers(0, 2**32 - 1)


def lights(seed: int, bands: int) -> np.ndarray:
    """A few directional lights over ambient light, or plain noise."""
    generator = np.random.default_rng(seed)
    if seed % 2:
        return generator.normal(size=bands**2)
    directions = reference.directions(1 + seed % 3, seed)
    coefficients: np.ndarray = generator.uniform(0.1, 1, len(directions)) @ evaluate(directions, bands)
    coefficients[0] += generator.uniform(0, 1)
    return coefficients


def test_directional_light_seen_by_a_diffuse_surface() -> None:
    for direction in reference.directions(20):
        coefficients = evaluate(direction, 3) * lambert_zonal(3)[degree_of_index(3)]
        value, where = minimum(coefficients)
        assert value == pytest.approx(-19 / 480, abs=1e-15)
        assert where @ direction == pytest.approx(-8 / 15, abs=1e-7)


@pytest.mark.parametrize(("bands", "share"), [(3, -0.2), (4, -0.25), (5, -0.1517)])
def test_radiance_of_a_directional_light(bands: int, share: float) -> None:
    direction = reference.directions(1)[0]
    coefficients = evaluate(direction, bands)
    peak = coefficients @ coefficients
    assert minimum(coefficients)[0] / peak == pytest.approx(share, abs=5e-5)


@given(seed=seeds, bands=st.integers(1, 3))
@settings(max_examples=15, deadline=None)
def test_exact_minimum_up_to_three_bands(seed: int, bands: int) -> None:
    coefficients = lights(seed, bands)
    value, where = minimum(coefficients)
    assert np.linalg.norm(where) == pytest.approx(1, abs=1e-14)
    assert evaluate(where, bands) @ coefficients == pytest.approx(value, abs=1e-13)
    assert value <= reference.sphere_minimum(coefficients) + 1e-13


@pytest.mark.parametrize("bands", [4, 5, 8])
def test_search_misses_nothing(bands: int) -> None:
    for seed in range(12):
        coefficients = lights(seed, bands)
        value, where = minimum(coefficients)
        assert evaluate(where, bands) @ coefficients == pytest.approx(value, abs=1e-12)
        assert value <= reference.sphere_minimum(coefficients) + 1e-12, (bands, seed)


@given(seed=seeds, bands=st.integers(1, 8))
@settings(max_examples=40, deadline=None)
def test_turning_the_light_does_not_change_the_minimum(seed: int, bands: int) -> None:
    coefficients = lights(seed, bands)
    turned = rotate(coefficients, reference.rotation(seed))
    scale = np.abs(coefficients).max()
    assert minimum(turned)[0] == pytest.approx(minimum(coefficients)[0], abs=1e-11 * scale)


def degenerate() -> dict[str, np.ndarray]:
    def coefficients(**entries: float) -> np.ndarray:
        array = np.zeros(9)
        for name, value in entries.items():
            array[int(name[1:])] = value
        return array

    return {
        "black": coefficients(),
        "constant": coefficients(c0=2),
        "linear": coefficients(c0=1, c1=0.3, c2=-0.4, c3=0.5),
        "hard case: the minimum is a pair": coefficients(c0=1, c2=0.05, c6=1),
        "hard case: the minimum is a ring": coefficients(c0=1, c6=1),
        "no linear part": coefficients(c0=1, c4=0.5, c8=-0.3),
        "pair along z": coefficients(c0=1, c6=-1),
        "along the lowest axis": coefficients(c0=1, c2=0.7, c6=-1),
        "nearly hard": coefficients(c0=1, c2=1e-14, c6=-1, c3=1e-13),
        "tiny": coefficients(c0=1e-200, c2=-1e-200, c6=1e-200),
        "huge": coefficients(c0=1e100, c2=-1e100, c6=1e100),
    }


@pytest.mark.parametrize("name", degenerate())
def test_degenerate_quadratics(name: str) -> None:
    coefficients = degenerate()[name]
    scale = max(np.abs(coefficients).max(), 1e-300)
    value, where = minimum(coefficients)
    assert np.linalg.norm(where) == pytest.approx(1, abs=1e-14)
    assert evaluate(where, 3) @ coefficients == pytest.approx(value, abs=1e-14 * scale)
    turned = evaluate(reference.directions(3000), 3) @ (coefficients / scale)
    assert value / scale <= turned.min() + 1e-14


def test_constant_of_many_bands() -> None:
    coefficients = np.zeros(25)
    coefficients[0] = 1
    assert minimum(coefficients)[0] == pytest.approx(evaluate([0, 0, 1], 1)[0], rel=1e-14)


@given(seed=seeds, bands=st.integers(2, 8))
@settings(max_examples=20, deadline=None)
def test_derivatives_agree_with_differences(seed: int, bands: int) -> None:
    coefficients = np.random.default_rng(seed).normal(size=bands**2)
    n = reference.directions(1, seed)[0]
    gradient, hessian, ahead, behind, unused = np.empty(3), np.empty((3, 3)), np.empty(3), np.empty(3), np.empty((3, 3))
    _derivatives_at(coefficients, bands, n[0], n[1], n[2], gradient, hessian)
    h = 1e-5
    for axis in np.eye(3):
        values = evaluate(np.stack([n + h * axis, n - h * axis]), bands) @ coefficients
        assert gradient @ axis == pytest.approx((values[0] - values[1]) / (2 * h), abs=1e-6)
        for (x, y, z), out in ((n + h * axis, ahead), (n - h * axis, behind)):
            _derivatives_at(coefficients, bands, x, y, z, out, unused)
        np.testing.assert_allclose(hessian @ axis, (ahead - behind) / (2 * h), rtol=0, atol=1e-5)


@given(seed=seeds, bands=st.integers(1, 8))
@settings(max_examples=30, deadline=None)
def test_is_at_least_agrees_with_the_minimum(seed: int, bands: int) -> None:
    coefficients = lights(seed, bands)
    value = minimum(coefficients)[0]
    assert is_at_least(coefficients, value - 1e-9)
    assert not is_at_least(coefficients, value + 1e-9)


def test_refuses_more_than_one_channel() -> None:
    with pytest.raises(ValueError, match="one channel"):
        minimum(np.zeros((9, 3)))
