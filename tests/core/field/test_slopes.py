"""Gradients by local-linear regression."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.reference_field import slopes_of

from lightwell.field.gather import gathered_buckets
from lightwell.field.plane import AXES, SPACING, make_plane
from lightwell.field.resample import Kernel, Resampler, accumulate
from lightwell.field.slopes import MOMENTS, RIDGE, fit_slopes, splat_moments
from lightwell.field.spec import GridSpec
from lightwell.field.sums import FieldSums


@settings(deadline=None, max_examples=30)
@given(
    seed=st.integers(0, 10**6),
    probes=st.sampled_from([1, 2, 30, 200]),
    kernel=st.sampled_from([Kernel(), Kernel(2.0, 0.3), Kernel(4.0, 1.0)]),
)
def test_agrees_with_the_plain_form(seed: int, probes: int, kernel: Kernel) -> None:
    generator = np.random.default_rng(seed)
    direction = generator.normal(size=3)
    direction /= np.linalg.norm(direction)
    plane = make_plane(direction, (5, 4, 6))
    points = generator.uniform((0, 0, 0), (5, 4, 6), (probes, 3))
    radiance = generator.lognormal(size=(probes, 3)).astype(np.float32)
    radiance[generator.random(probes) < 0.1] = np.nan
    moments = np.zeros((*plane.nodes, MOMENTS), np.float32)
    order = generator.permutation(probes)
    axes = (*AXES[plane.axis], plane.axis)
    geometry = (axes, plane.slope, plane.middle, plane.metric, plane.origin)
    splat_moments(points[order], radiance, order, *geometry, kernel.support_cells / 2, kernel.sigma_cells, moments)
    lattice = generator.random((*plane.nodes, 4)).astype(np.float32)
    ranges = np.stack([np.zeros(plane.nodes[0], np.int64), np.full(plane.nodes[0], plane.nodes[1])])
    along_u, along_v = np.zeros_like(lattice), np.zeros_like(lattice)
    fit_slopes(moments, lattice, ranges, kernel.sigma_cells, along_u, along_v)
    rows, columns = generator.integers(1, plane.nodes[0] - 1, 40), generator.integers(1, plane.nodes[1] - 1, 40)
    prior = np.stack(
        [
            lattice[rows, columns + 1, :3] - lattice[rows, columns - 1, :3],
            lattice[rows + 1, columns, :3] - lattice[rows - 1, columns, :3],
        ],
        axis=-1,
    ).astype(np.float64) / (2 * SPACING)
    places = np.empty((40, 3))
    places[:, axes[0]] = plane.origin[0] + columns * SPACING
    places[:, axes[1]] = plane.origin[1] + rows * SPACING
    places[:, axes[2]] = plane.middle
    expected = slopes_of(places, points, direction, radiance.astype(np.float64), kernel, prior, RIDGE)
    found = np.stack([along_u[rows, columns, :3], along_v[rows, columns, :3]], axis=-1)
    np.testing.assert_allclose(found, expected, rtol=2e-3, atol=2e-3 * np.abs(expected).max())
    np.testing.assert_array_equal(along_u[..., 3], lattice[..., 3])


def _sums(radiance_of, spec: GridSpec, probes: int = 3000) -> FieldSums:  # type: ignore[no-untyped-def]
    buckets = gathered_buckets(96, 3)
    positions = np.random.default_rng(0).uniform(np.array(spec.lower) - 0.2, np.array(spec.upper) + 0.2, (probes, 3))
    radiance = radiance_of(buckets.directions[:, None], positions[None]).astype(np.float32)
    sums = FieldSums(spec, 3, gradients=True)
    accumulate(
        sums,
        positions,
        buckets.directions,
        buckets.offsets,
        np.broadcast_to(radiance[..., None], (96, probes, 3)),
        buckets.rows,
        buckets.weights,
        Kernel(),
    )
    return sums


def test_fields_that_are_linear_across_each_direction_have_exact_gradients() -> None:
    """Also where voxels are no cubes: per metre, in world axes."""
    spec = GridSpec((0, 0, 0), (1, 1.5, 0.6), (6, 7, 5))
    lean = np.array([0.7, -0.4, 1.1])

    def across(directions: np.ndarray) -> np.ndarray:
        return np.asarray(lean - (directions @ lean)[..., None] * directions)

    sums = _sums(lambda directions, points: 5 + (across(directions) * points).sum(axis=-1), spec)
    buckets = gathered_buckets(96, 3)
    exact = buckets.rows.T @ across(buckets.directions)
    assert sums.gradients is not None
    np.testing.assert_allclose(
        sums.gradients,
        np.broadcast_to(exact[:, None], sums.gradients.shape),
        atol=0.03 * np.abs(exact).max(),
    )


def test_constant_light_has_no_gradient() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (4, 4, 4))
    sums = _sums(lambda directions, points: np.ones((len(directions), points.shape[1])), spec)
    assert sums.gradients is not None
    assert np.abs(sums.gradients).max() < 1e-4


def test_sums_with_gradients_add_up_and_restore() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (3, 4, 5))
    one = _sums(lambda directions, points: 2 + points[..., 0] + 0 * directions[..., 0], spec, 40)
    again = FieldSums.restore(one.spec, 3, {name: array.copy() for name, array in one.arrays().items()})
    again.add(one)
    assert one.gradients is not None
    assert again.gradients is not None
    np.testing.assert_allclose(again.gradients, 2 * one.gradients)


def test_repairs_in_three_dimensions_are_refused() -> None:
    sums = FieldSums(GridSpec((0, 0, 0), (1, 1, 1), (2, 2, 2)), 1, gradients=True)
    with pytest.raises(ValueError, match="pull-push or bilateral, not mipmap"):
        Resampler(sums, np.zeros((1, 3)), Kernel(), "mipmap")
