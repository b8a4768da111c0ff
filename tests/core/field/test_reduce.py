"""Adaptive subsampling."""

from __future__ import annotations

import numpy as np

from lightwell.field.reduce import decide, difference


def _ramp(count: int) -> np.ndarray:
    return np.stack([np.full((8, 3), 1.005**index, np.float32) for index in range(count)])


def test_slow_drift_is_kept() -> None:
    """MATHS §6: 400 frames, +.5 % each, ε = 2 %: comparing with the last kept frame keeps one in five."""
    frames = _ramp(400)
    decisions = list(decide(iter(frames), np.zeros((400, 3)), np.ones(8), 0.02, 1.0))
    kept = [decision.index for decision in decisions if decision.kept]
    assert kept[0] == 0
    assert kept[-1] == 399
    assert 75 <= len(kept) <= 105
    assert max(decision.difference for decision in decisions if not decision.kept) < 0.02


def test_gaps_stay_short() -> None:
    positions = np.arange(50.0)[:, None] * [0.01, 0, 0]
    decisions = decide(iter(np.ones((50, 8, 3), np.float32)), positions, np.ones(8), 0.02, 0.05)
    kept = [decision.index for decision in decisions if decision.kept]
    assert max(np.diff(kept)) <= 5


def test_an_interrupted_run_goes_on_as_if_it_had_not_been() -> None:
    frames = _ramp(60)
    whole = list(decide(iter(frames), np.zeros((60, 3)), np.ones(8), 0.02, 1.0))
    kept = max(decision.index for decision in whole[:30] if decision.kept)
    rest = list(decide(iter(frames[30:]), np.zeros((60, 3)), np.ones(8), 0.02, 1.0, 30, (kept, frames[kept])))
    assert whole[30:] == rest


def test_difference_is_relative() -> None:
    one = np.ones((4, 3), np.float32)
    assert difference(one, 3 * one, np.ones(4)) == 1.0
    assert difference(0 * one, 0 * one, np.ones(4)) == 0.0
