"""The fast resampling against the plain one, and against what must be true of any."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.reference_field import field_of, regress

from lightwell.field.gather import gathered_buckets
from lightwell.field.resample import Kernel, accumulate
from lightwell.field.spec import GridSpec
from lightwell.field.sums import FieldSums
from lightwell.job_settings import RepairKind
from lightwell.sh.basis import evaluate

REPAIRS: tuple[RepairKind, ...] = ("pull-push", "bilateral", "mipmap")
AXES = [(0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 1.0), (-1.0, 0.5, 0.0), (0.2, -0.3, -0.9)]


def _one(
    spec: GridSpec,
    positions: np.ndarray,
    direction: np.ndarray,
    radiance: np.ndarray,
    repair: RepairKind = "pull-push",
    offset: np.ndarray | None = None,
) -> FieldSums:
    """Resample one direction; the coefficient of degree 0 is then its radiance."""
    sums = FieldSums(spec, 1)
    offsets = np.zeros((1, 3)) if offset is None else offset[None]
    accumulate(
        sums,
        positions,
        direction[None],
        offsets,
        radiance[None].astype(np.float32),
        np.ones((1, 1)),
        np.ones(1),
        Kernel(),
        repair,
    )
    return sums


@settings(deadline=None, max_examples=40)
@given(
    seed=st.integers(0, 10**6),
    resolution=st.tuples(*[st.integers(1, 9)] * 3),
    size=st.tuples(*[st.floats(0.3, 3)] * 3),
    axis=st.sampled_from([*AXES, None]),
    turned=st.booleans(),
)
def test_agrees_with_the_plain_form(
    seed: int,
    resolution: tuple[int, int, int],
    size: tuple[float, float, float],
    axis: tuple[float, float, float] | None,
    turned: bool,
) -> None:
    generator = np.random.default_rng(seed)
    spec = GridSpec((-0.5, 0.1, 2.0), (-0.5 + size[0], 0.1 + size[1], 2.0 + size[2]), resolution)
    direction = generator.normal(size=3) if axis is None else np.array(axis)
    direction = direction / np.linalg.norm(direction)
    positions = generator.uniform(spec.lower, spec.upper, (150, 3))
    radiance = generator.lognormal(size=(150, 3))
    radiance[generator.random(150) < 0.1] = np.nan
    offset = generator.normal(scale=0.05, size=3)
    if turned:
        sums = FieldSums(spec, 1)
        spread = np.broadcast_to(offset, (1, 150, 3))
        accumulate(
            sums,
            positions,
            direction[None],
            spread,
            radiance[None].astype(np.float32),
            np.ones((1, 1)),
            np.ones(1),
            Kernel(),
        )
    else:
        sums = _one(spec, positions, direction, radiance, offset=offset)
    scaled = direction / spec.voxel
    expected = field_of(spec, spec.to_cells(positions + offset), scaled / np.linalg.norm(scaled), radiance, Kernel())
    known = np.isfinite(expected).all(axis=-1)
    np.testing.assert_allclose(sums.coefficients[..., 0, :][known], expected[known], rtol=2e-4, atol=1e-5)


def test_between_nodes_the_field_stays_close_to_the_kernel_regression() -> None:
    generator = np.random.default_rng(1)
    spec = GridSpec((0, 0, 0), (1, 1, 1), (16, 16, 16))
    positions = generator.random((2000, 3))
    direction = np.array([0.36, 0.48, 0.8])
    radiance = 2 + np.sin(7 * positions @ np.array([[1, 0.2, 0], [0, 1, 0.3], [0.5, 0, 1]])) * [1, 0.5, 1.5]
    found = _one(spec, positions, direction, radiance).coefficients[..., 0, :].reshape(-1, 3)
    places = spec.to_cells(spec.centres()).reshape(-1, 3)
    exact, _ = regress(places, spec.to_cells(positions), direction, radiance, Kernel())
    known = np.isfinite(exact).all(axis=1)
    deviation = np.sqrt(np.mean((found[known] - exact[known]) ** 2) / np.mean(exact[known] ** 2))
    assert deviation < 0.02


@pytest.mark.parametrize("repair", REPAIRS)
def test_a_constant_field_is_exact(repair: RepairKind) -> None:
    buckets = gathered_buckets(128, 5)
    spec = GridSpec((0, 0, 0), (1, 1.5, 0.7), (9, 7, 5))
    positions = np.random.default_rng(0).uniform(0, 0.6, (40, 3))
    sums = FieldSums(spec, 5)
    ones = np.full((128, 40, 3), 3.0, np.float32)
    accumulate(
        sums, positions, buckets.directions, buckets.offsets, ones, buckets.rows, buckets.weights, Kernel(), repair
    )
    np.testing.assert_allclose(
        sums.coefficients, np.broadcast_to(3 * buckets.rows.sum(0)[:, None], (*spec.shape, 25, 3)), atol=3e-5
    )
    assert 0 < sums.covered().mean() < 1


def test_without_repair_places_without_samples_stay_dark() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (8, 8, 8))
    sums = _one(spec, np.array([[0.5, 0.5, 0.5]]), np.array([0.0, 0.0, 1.0]), np.ones((1, 3)), "none")
    lit = sums.coefficients[..., 0, 0] > 0
    np.testing.assert_array_equal(lit, sums.coverage > 0)


def test_one_ray_lights_a_tube() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (20, 20, 20))
    direction = np.array([0.6, 0.0, 0.8])
    point = np.array([0.52, 0.5, 0.51])
    sums = _one(spec, point[None], direction, np.ones((1, 3)), "none")
    apart = spec.to_cells(spec.centres()) - spec.to_cells(point)
    distance = np.linalg.norm(np.cross(apart, direction), axis=-1)
    assert (sums.coverage[distance < 1.5 - 0.5] > 0).all()
    assert (sums.coverage[distance > 1.5 + 0.5] == 0).all()


@pytest.mark.parametrize("repair", REPAIRS)
def test_distant_light_does_not_vary(repair: RepairKind) -> None:
    buckets = gathered_buckets(64, 3)
    spec = GridSpec((0, 0, 0), (1, 1, 1), (6, 5, 4))
    generator = np.random.default_rng(3)
    radiance = np.broadcast_to(generator.lognormal(size=(64, 1, 3)), (64, 30, 3)).astype(np.float32)
    sums = FieldSums(spec, 3)
    accumulate(
        sums,
        generator.random((30, 3)),
        buckets.directions,
        buckets.offsets,
        radiance,
        buckets.rows,
        buckets.weights,
        Kernel(),
        repair,
    )
    expected = buckets.rows.T @ radiance[:, 0]
    np.testing.assert_allclose(sums.coefficients, np.broadcast_to(expected, sums.coefficients.shape), atol=2e-5)


def test_the_same_input_gives_the_same_bytes_in_any_split_of_directions() -> None:
    generator = np.random.default_rng(5)
    directions = generator.normal(size=(200, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    rows, weights = evaluate(directions, 4), np.ones(200)
    positions = generator.random((60, 3))
    radiance = generator.random((200, 60, 3)).astype(np.float32)
    spec = GridSpec((0, 0, 0), (1, 1, 1), (7, 6, 5))

    def run(*ranges: slice) -> FieldSums:
        sums = FieldSums(spec, 4)
        for part in ranges:
            accumulate(
                sums,
                positions,
                directions[part],
                np.zeros((200, 3))[part],
                radiance[part],
                rows[part],
                weights[part],
                Kernel(),
            )
        return sums

    one, again = run(slice(0, 200)), run(slice(0, 200))
    assert one.coefficients.tobytes() == again.coefficients.tobytes()
    split = run(slice(0, 130), slice(130, 200))
    np.testing.assert_allclose(split.coefficients, one.coefficients, rtol=1e-4, atol=1e-4)


def test_directions_without_any_sample_are_counted() -> None:
    spec = GridSpec((0, 0, 0), (1, 1, 1), (4, 4, 4))
    sums = _one(spec, np.zeros((3, 3)) + 0.5, np.array([0.0, 0.0, 1.0]), np.full((3, 3), np.nan))
    assert sums.dark == 1
    assert not sums.coefficients.any()
