"""MATHS §8, rotation."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference

from lightwell.conventions import coefficient_index
from lightwell.sh.basis import evaluate
from lightwell.sh.rotation import rotate, rotation_matrix

BANDS = 11
seeds = st.integers(0, 2**32 - 1)


@given(seed=seeds)
@settings(max_examples=20, deadline=None)
def test_rotates_the_basis(seed: int) -> None:
    turn = reference.rotation(seed)
    matrix = rotation_matrix(turn, BANDS)
    ω = reference.directions(50, seed)
    np.testing.assert_allclose(evaluate(ω @ turn.T, BANDS), evaluate(ω, BANDS) @ matrix.T, rtol=0, atol=1e-13)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(BANDS**2), rtol=0, atol=5e-14)


@given(seed=seeds)
@settings(max_examples=5, deadline=None)
def test_agrees_with_least_squares_over_samples(seed: int) -> None:
    turn = reference.rotation(seed)
    np.testing.assert_allclose(rotation_matrix(turn, 6), reference.rotation_matrix(turn, 6), rtol=0, atol=1e-13)


@given(seed=seeds, bands=st.integers(1, BANDS))
@settings(max_examples=20, deadline=None)
def test_rotated_function_takes_its_values_along(seed: int, bands: int) -> None:
    turn = reference.rotation(seed)
    coefficients = np.random.default_rng(seed).normal(size=(bands**2, 3))
    ω = reference.directions(20, seed)
    np.testing.assert_allclose(
        evaluate(ω @ turn.T, bands) @ rotate(coefficients, turn),
        evaluate(ω, bands) @ coefficients,
        rtol=0,
        atol=2e-13,
    )


@given(first=seeds, second=seeds)
@settings(max_examples=20, deadline=None)
def test_composes_and_inverts(first: int, second: int) -> None:
    a, b = reference.rotation(first), reference.rotation(second)
    np.testing.assert_allclose(
        rotation_matrix(a @ b, BANDS), rotation_matrix(a, BANDS) @ rotation_matrix(b, BANDS), rtol=0, atol=1e-13
    )
    np.testing.assert_allclose(rotation_matrix(a.T, BANDS), rotation_matrix(a, BANDS).T, rtol=0, atol=1e-13)


def test_keeps_the_energy_of_every_degree() -> None:
    coefficients = np.random.default_rng(0).normal(size=BANDS**2)
    rotated = rotate(coefficients, reference.rotation(3))
    for degree in range(BANDS):
        block = slice(degree**2, (degree + 1) ** 2)
        assert np.linalg.norm(rotated[block]) == pytest.approx(np.linalg.norm(coefficients[block]), rel=1e-13)


def test_quarter_turn_about_z_takes_x_to_y() -> None:
    turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    coefficients = np.zeros(4)
    coefficients[coefficient_index(1, 1)] = 1
    expected = np.zeros(4)
    expected[coefficient_index(1, -1)] = 1
    np.testing.assert_allclose(rotate(coefficients, turn), expected, atol=1e-15)


def test_identity() -> None:
    np.testing.assert_allclose(rotation_matrix(np.eye(3), BANDS), np.eye(BANDS**2), rtol=0, atol=1e-14)


def test_accepts_a_float32_rotation() -> None:
    turn = reference.rotation(1).astype(np.float32)
    np.testing.assert_allclose(rotation_matrix(turn, 5), rotation_matrix(reference.rotation(1), 5), atol=2e-6)


@pytest.mark.parametrize(
    ("matrix", "reason"),
    [
        (np.eye(4), "shape"),
        (np.diag([1.0, 1.0, np.nan]), "NaN"),
        (2 * np.eye(3), "orthonormal"),
        (np.array([[1.0, 0.1, 0], [0, 1, 0], [0, 0, 1]]), "orthonormal"),
        (np.diag([1.0, 1.0, -1.0]), "reflection"),
        (-np.eye(3), "reflection"),
    ],
)
def test_says_why_a_matrix_is_no_rotation(matrix: np.ndarray, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        rotation_matrix(matrix, 3)


def test_refuses_bands_and_counts_out_of_range() -> None:
    with pytest.raises(ValueError, match="outside 1 … 11"):
        rotation_matrix(np.eye(3), 12)
    with pytest.raises(ValueError, match="whole number of bands"):
        rotate(np.zeros((5, 3)), np.eye(3))
