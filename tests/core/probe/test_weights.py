"""Quadrature weights of lat-long rows: the tables of MATHS §2.1."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from tests.support.reference_probe import latlong_directions

from lightwell.probe.weights import row_weights
from lightwell.sh.basis import evaluate

# H: (P) relative error of the mean, (P) of z², (S) of z²; all printed to two digits.
TABLE = {
    25: (6.6e-4, 2.0e-3, 1.3e-3),
    50: (1.6e-4, 4.9e-4, 3.3e-4),
    101: (4.0e-5, 1.2e-4, 8.1e-5),
    203: (1.0e-5, 3.0e-5, 2.0e-5),
    407: (2.5e-6, 7.4e-6, 5.0e-6),
    814: (6.2e-7, 1.9e-6, 1.2e-6),
}


def moments(height: int, weights: Any) -> tuple[float, float]:
    """Return the relative errors of ∫1 and ∫z²."""
    width = 2 * height
    w = row_weights(height, width, weights) * width
    z = np.cos(math.pi * (np.arange(height) + 0.5) / height)
    return w.sum() / (4 * math.pi) - 1, (w * z * z).sum() / (4 * math.pi / 3) - 1


@pytest.mark.parametrize("height", TABLE)
def test_errors_of_mean_and_second_moment(height: int) -> None:
    paper_mean, paper_second, solid_second = TABLE[height]
    x = math.pi / (2 * height)
    mean, second = moments(height, "paper")
    assert mean == pytest.approx(paper_mean, rel=0.04)
    assert mean == pytest.approx(x * x / 6, rel=2e-3)
    assert mean == pytest.approx(math.pi**2 / (24 * height**2), rel=2e-3)
    assert abs(second) == pytest.approx(paper_second, rel=0.04)
    assert abs(second) == pytest.approx(x * x / 2, rel=5e-3)
    mean, second = moments(height, "solid-angle")
    assert abs(mean) < 1e-13
    assert abs(second) == pytest.approx(solid_second, rel=0.05)
    assert abs(second) == pytest.approx(x * x / 3, rel=5e-3)
    mean, second = moments(height, "fejer")
    assert abs(mean) < 1e-13
    assert abs(second) < 1e-13


@pytest.mark.parametrize("height", [8, 25, 64])
def test_paper_over_solid_angle_is_a_constant(height: int) -> None:
    x = math.pi / (2 * height)
    ratio = row_weights(height, 10, "paper") / row_weights(height, 10, "solid-angle")
    assert ratio == pytest.approx(np.full(height, x / math.sin(x)), rel=1e-13)


@pytest.mark.parametrize("half", [4, 13, 32])
def test_fejer_is_driscoll_and_healy_between_the_pixels(half: bool) -> None:
    height = 2 * half
    theta = math.pi * (np.arange(height) + 0.5) / height
    odd = 2 * np.arange(half) + 1
    driscoll_healy = 2 / half * np.sin(theta) * (np.sin(odd * theta[:, None]) / odd).sum(axis=1)
    weights = row_weights(height, 2 * height, "fejer")
    # Their weights sum to 2·… over the rows; ours are steradians.
    assert weights == pytest.approx(driscoll_healy * (2 * math.pi / (2 * height)), rel=1e-12)
    assert (weights > 0).all()


def operator_error(height: int, width: int, light_degree: int, degree: int, weights: Any) -> float:
    """Return the largest deviation from the identity of projecting point-sampled harmonics."""
    directions = latlong_directions(height, width)
    basis = evaluate(directions, light_degree + 1)
    weighted = basis[..., : (degree + 1) ** 2] * row_weights(height, width, weights)[:, None, None]
    gram = np.einsum("ijk,ijl->kl", weighted, basis)
    return float(np.abs(gram - np.eye(*gram.shape)).max())


@pytest.mark.parametrize(
    ("height", "width", "light_degree", "degree"), [(16, 32, 10, 4), (16, 32, 10, 5), (24, 20, 10, 4), (33, 40, 6, 6)]
)
def test_fejer_is_exact_for_band_limited_light(height: int, width: int, light_degree: int, degree: int) -> None:
    assert operator_error(height, width, light_degree, degree, "fejer") < 1e-13
    assert operator_error(height, width, light_degree, degree, "solid-angle") > 1e-4


def test_fejer_fails_just_outside_its_domain() -> None:
    assert operator_error(14, 32, 10, 4, "fejer") > 1e-4, "14 + 1 > H"
    assert operator_error(32, 14, 10, 4, "fejer") > 0.5, "14 > W − 1: columns alias"


@pytest.mark.parametrize(("height", "paper"), [(25, 6.1e-3), (50, 1.5e-3), (101, 3.6e-4), (203, 9.0e-5)])
def test_operator_error_of_degree_four(height: int, paper: float) -> None:
    width = 2 * height
    assert operator_error(height, width, 4, 4, "paper") == pytest.approx(paper, rel=0.05)
    assert operator_error(height, width, 4, 4, "solid-angle") < paper
    assert operator_error(height, width, 4, 4, "fejer") < 3e-13
