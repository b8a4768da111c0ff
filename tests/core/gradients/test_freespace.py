"""Free-space constraints (MATHS §7.6)."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.reference_gradients import finite_difference

from lightwell.gradients.freespace import free_space_constraints, free_space_residual, project_gradients
from lightwell.gradients.moments import direction_moments
from lightwell.sh.basis import evaluate
from lightwell.synthetic.scene import PRESETS


def test_moments_multiply_by_the_direction() -> None:
    directions = np.random.default_rng(0).normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    product = np.einsum("nk,ni->nki", directions, evaluate(directions, 8))
    ours = np.einsum("kij,nj->nki", direction_moments(8, 9), evaluate(directions, 9))
    np.testing.assert_allclose(ours, product, rtol=0, atol=1e-12)


@pytest.mark.parametrize("bands", [2, 3, 5, 8])
def test_there_are_as_many_constraints_as_coefficients_of_one_band_less(bands: int) -> None:
    constraints = free_space_constraints(bands).reshape((bands - 1) ** 2, -1)
    assert np.linalg.matrix_rank(constraints) == (bands - 1) ** 2


def test_the_first_is_a_divergence() -> None:
    first = free_space_constraints(3)[0]
    wanted = np.zeros((9, 3))
    wanted[3, 0] = wanted[1, 1] = wanted[2, 2] = 1 / np.sqrt(3)
    np.testing.assert_allclose(first, wanted, rtol=0, atol=1e-13)


def test_projection_removes_what_is_forbidden_and_nothing_else() -> None:
    scene = PRESETS["cube"]
    truth = finite_difference(lambda p: scene.coefficients(p, 5), np.array([0.1, 0.05, -0.1]))
    np.testing.assert_allclose(project_gradients(truth), truth, rtol=0, atol=1e-8)
    noise = np.random.default_rng(1).normal(size=(200, 25, 3, 3))
    kept = project_gradients(truth + noise)
    assert np.abs(free_space_residual(kept)).max() < 1e-12
    np.testing.assert_allclose(project_gradients(kept), kept, rtol=0, atol=1e-12)
    share = np.sqrt(np.mean((kept - truth) ** 2) / np.mean(noise**2))
    assert share == pytest.approx(0.889, abs=0.01)  # √(59/75): 16 of 75 directions are gone


def test_one_band_is_free() -> None:
    noise = np.ones((4, 1, 3, 3))
    np.testing.assert_array_equal(project_gradients(noise), noise)
    with pytest.raises(ValueError, match="two bands"):
        free_space_constraints(1)
