"""Light beside and between samples (MATHS §7.4, §7.8)."""

from __future__ import annotations

import itertools
from math import factorial
from typing import Any

import numpy as np
import pytest
from scipy.spatial import Delaunay

from lightwell.gradients.extrapolate import extrapolate
from lightwell.gradients.interpolate import Floats, SampleSet, nearest_on_facets
from lightwell.gradients.triangulation import Indices, triangulate

RNG = np.random.default_rng(5)


class _Quadratic:
    """A field of 4 coefficients that is quadratic in space, or linear."""

    def __init__(self, bend: float = 1.0) -> None:
        rng = np.random.default_rng(0)
        self.bend, self.slope = bend * rng.normal(size=(4, 3, 3, 3)), rng.normal(size=(4, 3, 3))
        self.bend = self.bend + np.swapaxes(self.bend, -1, -2)

    def __call__(self, x: Floats) -> Floats:
        change = np.einsum("ick,...k->...ic", self.slope, x)
        return np.asarray(50 + change + 0.5 * np.einsum("ickl,...k,...l->...ic", self.bend, x, x))

    def derivative(self, x: Floats) -> Floats:
        return np.asarray(self.slope + np.einsum("ickl,...l->...ick", self.bend, x))

    def samples(self, positions: Floats, gradients: bool = True) -> SampleSet:
        return SampleSet(positions, self(positions), self.derivative(positions) if gradients else None)

    def samples_of_which(self, positions: Floats, known: list[bool]) -> SampleSet:
        slopes = [one if has else None for one, has in zip(self.derivative(positions), known, strict=True)]
        return SampleSet(positions, self(positions), slopes)


def _inside(positions: Floats, count: int = 100) -> Floats:
    return np.asarray(np.random.default_rng(1).dirichlet(np.ones(len(positions)), count) @ positions)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 9, 40])
def test_quadratic_light_is_exact_in_the_hull(count: int) -> None:
    field, positions = _Quadratic(), RNG.uniform(-1, 1, (count, 3))
    points = _inside(positions)
    np.testing.assert_allclose(field.samples(positions).at(points), field(points), rtol=0, atol=1e-11)


@pytest.mark.parametrize("axes", [1, 2])
def test_samples_on_a_line_or_plane_are_exact_on_it_and_extrapolate_off_it(axes: int) -> None:
    field = _Quadratic()
    span = np.linalg.qr(RNG.normal(size=(3, 3)))[0]
    positions = RNG.uniform(-1, 1, (12, axes)) @ span[:axes]
    points = _inside(positions)
    ours = field.samples(positions)
    np.testing.assert_allclose(ours.at(points), field(points), rtol=0, atol=1e-11)
    linear = _Quadratic(0.0)
    off = points + 0.3 * span[2]
    np.testing.assert_allclose(linear.samples(positions).at(off), linear(off), rtol=0, atol=1e-11)
    # Across the plane the error is that of a Taylor series, not twice it: half a gradient would leave a slope.
    errors = [np.abs(ours.at(points + h * span[2]) - field(points + h * span[2])).max() for h in (0.02, 0.01)]
    assert errors[0] / errors[1] < 5


@pytest.mark.parametrize("count", [1, 2, 3, 4, 10])
def test_linear_light_is_exact_everywhere(count: int) -> None:
    field, positions = _Quadratic(0.0), RNG.uniform(-1, 1, (count, 3))
    points = RNG.uniform(-4, 4, (200, 3))
    for method in ("barycentric", "shepard"):
        ours = field.samples(positions).at(points, method)
        np.testing.assert_allclose(ours, field(points), rtol=0, atol=1e-10)
        np.testing.assert_allclose(field.samples(positions).at(positions, method), field(positions), atol=1e-10)


def test_without_gradients_it_is_linear_in_the_hull() -> None:
    field, positions = _Quadratic(0.0), RNG.uniform(-1, 1, (10, 3))
    points = _inside(positions)
    np.testing.assert_allclose(field.samples(positions, gradients=False).at(points), field(points), atol=1e-10)


@pytest.mark.parametrize("count", [2, 3, 4, 9, 40])
def test_one_sample_may_lack_its_gradient(count: int) -> None:
    """How light bends between it and the others is what their gradients say."""
    field, positions = _Quadratic(), RNG.uniform(-1, 1, (count, 3))
    points = _inside(positions)
    ours = field.samples_of_which(positions, [k != 1 for k in range(count)])
    np.testing.assert_allclose(ours.at(points), field(points), rtol=0, atol=1e-11)
    np.testing.assert_allclose(ours.at(positions), field(positions), rtol=0, atol=1e-11)


def test_some_gradients_do_not_tilt_light() -> None:
    positions = RNG.uniform(-1, 1, (12, 3))
    points, known = _inside(positions), [k % 3 == 0 for k in range(12)]
    linear, bent = _Quadratic(0.0), _Quadratic()
    np.testing.assert_allclose(linear.samples_of_which(positions, known).at(points), linear(points), atol=1e-10)
    errors = [
        np.abs(ours.at(points) - bent(points)).mean()
        for ours in (
            bent.samples(positions),
            bent.samples_of_which(positions, known),
            bent.samples(positions, gradients=False),
        )
    ]
    assert errors[0] < 1e-10
    assert errors[1] < 0.8 * errors[2]
    none = bent.samples_of_which(positions, [False] * 12)
    assert none.gradients is None
    np.testing.assert_array_equal(none.at(points), bent.samples(positions, gradients=False).at(points))
    path = np.linspace(-3, 3, 4001)[:, None] * np.array([0.6, 0.64, 0.48])
    steps = np.abs(np.diff(bent.samples_of_which(positions, known).at(path), axis=0)).max(axis=(1, 2))
    assert steps.max() < 30 * np.median(steps) + 1e-3


def test_leaving_the_hull_is_continuous() -> None:
    positions = RNG.uniform(-1, 1, (10, 3))
    ours = _Quadratic().samples(positions)
    path = np.linspace(-3, 3, 4001)[:, None] * np.array([0.6, 0.64, 0.48])
    steps = np.abs(np.diff(ours.at(path), axis=0)).max(axis=(1, 2))
    assert steps.max() < 30 * np.median(steps) + 1e-3


def test_one_sample_extrapolates() -> None:
    field, points = _Quadratic(), RNG.uniform(-9, 9, (20, 3))
    c, g = field(np.zeros(3)), field.derivative(np.zeros(3))
    np.testing.assert_allclose(SampleSet([[0, 0, 0]], [c], [g]).at(points), extrapolate(c, g, points), atol=1e-12)
    assert SampleSet([[0, 0, 0]], [c]).at([1, 2, 3]).shape == (4, 3)


def test_extrapolation_keeps_the_mean_positive() -> None:
    c = np.zeros((4, 3))
    c[0] = 1, 2, 0
    g = RNG.normal(size=(4, 3, 3))
    far = extrapolate(c, g, RNG.normal(size=(500, 3)) * 100)
    assert (far[:, 0, :2] >= 0.3 * c[0, :2] - 1e-12).all()
    assert (far[:, 0, :2] <= 1.7 * c[0, :2] + 1e-12).all()
    assert (far[..., 2] == 0).all()  # a colour without light stays so
    near = np.array([0.01, 0.02, -0.01])
    np.testing.assert_allclose(extrapolate(c, g, near)[:, :2], (c + g @ near)[:, :2])
    # The whole step is cut short, not the mean alone.
    one = extrapolate(c, g, np.array([100.0, 0, 0]))
    share = 0.7 / abs(100 * g[0, 0, 0])
    np.testing.assert_allclose(one[:, 0], c[:, 0] + share * 100 * g[:, 0, 0])


def test_shepard_is_the_sample_at_a_sample_and_between_two_the_mean() -> None:
    ours = SampleSet([[0, 0, 0], [2, 0, 0]], np.array([np.ones((1, 3)), 3 * np.ones((1, 3))]))
    np.testing.assert_allclose(ours.at([[1, 5, 0], [2, 0, 0]], "shepard")[:, 0, 0], [2, 3])
    np.testing.assert_allclose(ours.at([[0.5, 0, 0]], "shepard", power=2)[0, 0, 0], 1 + 2 * 0.1)


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        (([], np.ones((0, 4, 3))), "n ≥ 1"),
        (([[0, 0]], np.ones((1, 4, 3))), "n ≥ 1"),
        (([[0, 0, 0]], np.ones((2, 4, 3))), r"\(1, bands², 3\)"),
        (([[0, 0, 0]], np.ones((1, 4, 3)), np.ones((1, 4, 3))), r"\(1, 4, 3, 3\)"),
        (([[0, 0, np.nan]], np.ones((1, 4, 3))), "positions must be finite"),
        (([[0, 0, 1e160]], np.ones((1, 4, 3))), "positions must be within 1e"),
        (([[0, 0, 0], [1, 0, 0], [1, 1e-9, 0]], np.ones((3, 4, 3))), "samples 1 and 2 share a place"),
    ],
)
def test_bad_input(arguments: tuple[Any, ...], match: str) -> None:
    with pytest.raises(ValueError, match=match):
        SampleSet(*arguments)


# Simplices


def _volume(points: Floats, simplices: Indices) -> float:
    edges = points[simplices[:, 1:]] - points[simplices[:, :1]]
    return float(np.abs(np.linalg.det(edges)).sum() / factorial(points.shape[1]))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [4, 9, 30, 64])
def test_simplices_are_qhulls(dimension: int, count: int) -> None:
    points = np.random.default_rng(count).normal(size=(count, dimension)) * 7 + 100
    theirs = Delaunay(points)
    ours = triangulate(points)
    assert {tuple(s) for s in ours.simplices} == {tuple(sorted(s)) for s in theirs.simplices}
    assert {tuple(s) for s in ours.hull} == {tuple(sorted(s)) for s in theirs.convex_hull}


@pytest.mark.parametrize("shape", [(2, 2), (5, 3), (2, 2, 2), (3, 3, 3), (4, 2, 5)])
def test_a_regular_grid_is_filled_once(shape: tuple[int, ...]) -> None:
    """Points on common spheres, where Delaunay simplices are not unique."""
    points = np.array(list(itertools.product(*map(range, shape))), float) * 0.3
    ours = triangulate(points)
    assert _volume(points, ours.simplices) == pytest.approx(0.3 ** len(shape) * np.prod(np.array(shape) - 1))
    hull = Delaunay(points).convex_hull
    assert len(np.unique(ours.hull)) == len(np.unique(hull)) or len(shape) == 3


def test_in_one_dimension_neighbours_are_joined() -> None:
    ours = triangulate(np.array([[3.0], [1.0], [2.0], [7.0]]))
    assert ours.simplices.tolist() == [[0, 2], [0, 3], [1, 2]]
    assert ours.hull.tolist() == [[1], [3]]


@pytest.mark.parametrize(
    "points", [np.zeros((5, 2)), np.ones((2, 3)), np.array([[0.0, 0], [1, 1], [2, 2]]), np.eye(4)[:, :3] * 0]
)
def test_points_that_span_too_little(points: Floats) -> None:
    with pytest.raises(ValueError, match="do not span"):
        triangulate(points)


def test_nearest_point_of_triangles() -> None:
    """Against the densest of many points on them."""
    facets = RNG.normal(size=(4, 3, 3))
    shares = RNG.dirichlet(np.ones(3) * 0.5, 20000)
    cloud = np.einsum("nk,fkd->nfd", shares, facets)
    points = RNG.normal(size=(20, 3)) * 2
    which, weights = nearest_on_facets(facets, points)
    feet = np.einsum("pk,pkd->pd", weights, facets[which])
    for point, foot in zip(points, feet, strict=True):
        best = np.sqrt(((cloud - point) ** 2).sum(axis=2).min())
        assert np.linalg.norm(point - foot) == pytest.approx(best, abs=0.01)
        assert np.linalg.norm(point - foot) <= best + 1e-12
