"""Sampling a grid."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.field.gradient import central_differences
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec

SPEC = GridSpec((0, 0, 0), (1, 2, 1.5), (8, 6, 5))


def _quadratic(seed: int = 0) -> tuple[Grid, np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    curve, slope = generator.normal(size=(3, 3)), generator.normal(size=3)
    curve = curve + curve.T
    centres = SPEC.centres()
    values = np.einsum("...i,ij,...j", centres, curve, centres) + centres @ slope
    gradient = 2 * centres @ curve + slope
    coefficients = np.broadcast_to(values[..., None, None], (*SPEC.shape, 4, 3)).astype(np.float64)
    gradients = np.broadcast_to(gradient[..., None, None, :], (*SPEC.shape, 4, 3, 3)).astype(np.float64)
    grid = Grid(SPEC, coefficients, np.ones(SPEC.shape, np.float32), None, gradients)  # type: ignore[arg-type]
    return grid, curve, slope


def test_half_gradients_make_quadratics_exact() -> None:
    """MATHS §7.8."""
    grid, curve, slope = _quadratic()
    points = np.random.default_rng(1).uniform((0.1, 0.2, 0.2), (0.9, 1.8, 1.3), (100, 3))
    exact = np.einsum("...i,ij,...j", points, curve, points) + points @ slope
    samples = grid.sample(points, gradients=True)
    np.testing.assert_allclose(samples.coefficients[:, 2, 1], exact, atol=1e-14)
    assert samples.gradients is not None
    np.testing.assert_allclose(samples.gradients[:, 0, 0], 2 * points @ curve + slope, atol=1e-12)


def test_without_gradients_it_is_trilinear_with_the_slope_of_that() -> None:
    grid = Grid(SPEC, np.random.default_rng(2).random((*SPEC.shape, 4, 3)), np.ones(SPEC.shape, np.float32))  # type: ignore[arg-type]
    centres = SPEC.centres().reshape(-1, 3)
    np.testing.assert_allclose(grid.sample(centres).coefficients, grid.coefficients.reshape(-1, 4, 3), atol=1e-12)
    points = np.random.default_rng(3).uniform((0.1, 0.2, 0.2), (0.9, 1.8, 1.3), (50, 3))
    slopes = grid.sample(points, gradients=True).gradients
    assert slopes is not None
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        change = (grid.sample(points + step).coefficients - grid.sample(points - step).coefficients) / 2e-6
        assert np.median(np.abs(change - slopes[..., axis])) < 1e-8


def test_outside() -> None:
    grid, _, _ = _quadratic()
    far = np.array([[5.0, 0.1, 0.1], [0.5, 0.5, 0.5]])
    assert np.isfinite(grid.sample(far).coefficients).all()
    assert np.isnan(grid.sample(far, outside="nan").coefficients[0]).all()
    with pytest.raises(ValueError, match=r"\(5, 0.1, 0.1\) lies outside"):
        grid.sample(far, outside="error")
    with pytest.raises(ValueError, match="finite"):
        grid.sample([[np.nan, 0, 0]])
    with pytest.raises(ValueError, match="2 bands, not 3"):
        grid.sample(far, bands=3)


def test_one_cell_is_constant() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (1, 1, 1))
    grid = Grid(spec, np.full((1, 1, 1, 4, 3), 2.0, np.float32), np.ones((1, 1, 1), np.float32))
    samples = grid.sample([[0.2, 0.9, 0.4]], gradients=True)
    assert (samples.coefficients == 2).all()
    assert samples.gradients is not None
    assert (samples.gradients == 0).all()


def test_central_differences_are_exact_for_linear_fields() -> None:
    values = SPEC.centres() @ np.array([1.0, -2.0, 0.5])
    coefficients = np.broadcast_to(values[..., None, None], (*SPEC.shape, 1, 3)).astype(np.float32)
    np.testing.assert_allclose(
        central_differences(coefficients, SPEC.voxel),
        np.broadcast_to([1.0, -2.0, 0.5], (*SPEC.shape, 1, 3, 3)),
        atol=1e-4,
    )
