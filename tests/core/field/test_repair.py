"""Repair of holes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lightwell.field.repair import bilateral, mipmap, pull_push


@settings(deadline=None, max_examples=50)
@given(st.integers(1, 40), st.integers(1, 40), st.floats(0, 1), st.integers(0, 10**6))
def test_a_constant_is_exact_and_known_places_stay(height: int, width: int, share: float, seed: int) -> None:
    generator = np.random.default_rng(seed)
    weights = (generator.random((height, width)) < share).astype(np.float32)
    weights[generator.integers(height), generator.integers(width)] = 1
    for fill in (pull_push, bilateral):
        values = np.where(weights[..., None] > 0, np.float32(7.5), np.float32(-1)).repeat(3, axis=2)
        assert fill(values, weights)
        np.testing.assert_allclose(values, 7.5, rtol=1e-6)
    noise = generator.random((height, width, 3)).astype(np.float32)
    kept = noise.copy()
    pull_push(noise, weights)
    np.testing.assert_array_equal(noise[weights > 0], kept[weights > 0])
    assert noise.min() >= kept[weights > 0].min() - 1e-6
    assert noise.max() <= kept[weights > 0].max() + 1e-6


def test_nothing_known_changes_nothing() -> None:
    values = np.ones((4, 5, 3), np.float32)
    assert not pull_push(values, np.zeros((4, 5), np.float32))
    assert not bilateral(values, np.zeros((4, 5), np.float32))
    assert not mipmap(np.ones((2, 3, 4, 3), np.float32), np.zeros((2, 3, 4), np.bool_))
    assert (values == 1).all()


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_mipmap_is_exact_for_constants(share: float) -> None:
    generator = np.random.default_rng(0)
    valid = generator.random((9, 7, 11)) < share
    valid[4, 3, 2] = True
    values = np.where(valid[..., None], np.float32(2.5), np.float32(0)).repeat(3, axis=3)
    assert mipmap(values, valid)
    np.testing.assert_allclose(values, 2.5, rtol=1e-6)


def test_ramps_are_filled_to_a_fraction_of_a_cell() -> None:
    """MATHS §6: half known, rms .23 (pull–push) and .25 (mip-map) of one cell's slope."""
    generator = np.random.default_rng(2)
    ramp = np.broadcast_to(np.arange(64, dtype=np.float32)[None, :, None], (64, 64, 3)).copy()
    weights = (generator.random((64, 64)) < 0.5).astype(np.float32)
    values = np.where(weights[..., None] > 0, ramp, 0).astype(np.float32)
    pull_push(values, weights)
    assert np.sqrt(np.mean((values - ramp) ** 2)) < 0.6
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
        values = np.where(weights[..., None] > 0, truth, 0).astype(np.float32)
        fill(values, weights)
        errors.append(float(np.abs(values - truth).mean()))
    assert errors[1] < 0.8 * errors[0]
