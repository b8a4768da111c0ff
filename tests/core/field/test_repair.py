"""Repair of holes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from tests.support.reference_field import fill_by_mipmap

from lightwell.field.repair import bilateral, mipmap, pull_push


def _lattice(values: NDArray[np.floating[Any]], weights: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return values ``(H, W, 3)`` where they have weight, as a lattice ``(H, W, 4)``."""
    return np.concatenate([np.where(weights[..., None] > 0, values, -1), weights[..., None]], axis=2, dtype=np.float32)


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 40), st.integers(1, 40), st.floats(0, 1), st.integers(0, 10**6))
def test_a_constant_is_exact_and_known_places_stay(height: int, width: int, share: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    weights = (generator.random((height, width)) < share).astype(np.float32)
    weights[generator.integers(height), generator.integers(width)] = 1
    for fill in (pull_push, bilateral):
        lattice = _lattice(np.full((height, width, 3), 7.5), weights)
        assert fill(lattice)
        np.testing.assert_allclose(lattice[..., :3], 7.5, rtol=1e-6)
        np.testing.assert_array_equal(lattice[..., 3], weights)
    noise = generator.random((height, width, 3)).astype(np.float32)
    lattice = _lattice(noise, weights)
    pull_push(lattice)
    known, filled = noise[weights > 0], lattice[..., :3]
    np.testing.assert_array_equal(filled[weights > 0], known)
    assert filled.min() >= known.min() - 1e-6
    assert filled.max() <= known.max() + 1e-6


def test_only_the_places_in_the_ranges_are_filled() -> None:
    generator = np.random.default_rng(1)
    weights = (generator.random((9, 8)) < 0.3).astype(np.float32)
    ranges = np.stack([np.arange(9) % 3, 8 - np.arange(9) % 4])
    asked = (np.arange(8) >= ranges[0][:, None]) & (np.arange(8) < ranges[1][:, None])
    for fill in (pull_push, bilateral):
        whole = _lattice(generator.random((9, 8, 3)), weights)
        some = whole.copy()
        fill(whole)
        before = some.copy()
        fill(some, ranges)
        np.testing.assert_array_equal(some[asked], whole[asked])
        np.testing.assert_array_equal(some[~asked], before[~asked])


def test_nothing_known_changes_nothing() -> None:
    for fill in (pull_push, bilateral):
        lattice = np.ones((4, 5, 4), np.float32) * np.array([1, 1, 1, 0], np.float32)
        assert not fill(lattice)
        assert (lattice[..., :3] == 1).all()
    assert not mipmap(np.ones((2, 3, 4, 3), np.float32), np.zeros((2, 3, 4), np.bool_))


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_mipmap_is_exact_for_constants(share: float) -> None:
    generator = np.random.default_rng(0)
    valid = generator.random((9, 7, 11)) < share
    valid[4, 3, 2] = True
    values = np.where(valid[..., None], np.float32(2.5), np.float32(0)).repeat(3, axis=3)
    assert mipmap(values, valid)
    np.testing.assert_allclose(values, 2.5, rtol=1e-6)


@settings(deadline=None, max_examples=60)
@given(st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9)), st.floats(0, 1), st.integers(0, 10**6))
def test_mipmap_is_what_the_reference_is(shape: tuple[int, int, int], share: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    valid = generator.random(shape) < share
    valid[tuple(generator.integers(size) for size in shape)] = True
    values = np.where(valid[..., None], generator.normal(size=(*shape, 3)), 0).astype(np.float32)
    expected = fill_by_mipmap(values.astype(np.float64), valid)
    assert mipmap(values, valid)
    np.testing.assert_allclose(values, expected, rtol=1e-5, atol=1e-5)


def test_ramps_are_filled_to_a_fraction_of_a_cell() -> None:
    """MATHS §6: half known, rms .23 (pull–push) and .25 (mip-map) of one cell's slope."""
    generator = np.random.default_rng(2)
    ramp = np.broadcast_to(np.arange(64, dtype=np.float32)[None, :, None], (64, 64, 3)).copy()
    weights = (generator.random((64, 64)) < 0.5).astype(np.float32)
    lattice = _lattice(ramp, weights)
    pull_push(lattice)
    assert np.sqrt(np.mean((lattice[..., :3] - ramp) ** 2)) < 0.6
    ramp3 = np.broadcast_to(np.arange(24, dtype=np.float32)[None, None, :, None], (24, 24, 24, 3)).copy()
    valid = generator.random((24, 24, 24)) < 0.5
    filled = np.where(valid[..., None], ramp3, 0).astype(np.float32)
    mipmap(filled, valid)
    assert np.sqrt(np.mean((filled - ramp3) ** 2)) < 0.6


def test_bilateral_leaks_less_across_a_shadow() -> None:
    generator = np.random.default_rng(3)
    truth = np.zeros((48, 48, 3), np.float32)
    truth[:, 24:] = 10
    weights = (generator.random((48, 48)) < 0.3).astype(np.float32)
    errors = []
    for fill in (pull_push, bilateral):
        lattice = _lattice(truth, weights)
        fill(lattice)
        errors.append(float(np.abs(lattice[..., :3] - truth).mean()))
    assert errors[1] < 0.8 * errors[0]
