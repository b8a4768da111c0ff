"""Milliseconds per stage: of one frame, and as a moving average."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Literal

Stage = Literal["source", "merge", "map", "downsample", "project", "gradients", "window", "filter", "publish"]

AVERAGE_WEIGHT = 0.05
"""Weight of the newest frame in the moving average: it follows a change within about twenty frames."""


class StageTimes:
    """What each stage took, milliseconds."""

    def __init__(self) -> None:
        self.stage_ms: dict[str, float] = {}

    @contextmanager
    def measure(self, stage: Stage) -> Iterator[None]:
        """Time the body of a ``with`` statement."""
        started_ns = time.perf_counter_ns()
        yield
        self.stage_ms[stage] = (time.perf_counter_ns() - started_ns) / 1e6


class StageAverages:
    """Moving averages of the stages; each frame's times are added by one thread at a time."""

    def __init__(self) -> None:
        self._average_ms: dict[str, float] = {}

    def add(self, stage_ms: dict[str, float]) -> None:
        """Take in the times of one frame."""
        for stage, ms in stage_ms.items():
            average = self._average_ms.get(stage, ms)
            self._average_ms[stage] = average + AVERAGE_WEIGHT * (ms - average)

    def snapshot(self) -> dict[str, float]:
        """Return the averages, milliseconds with three decimals."""
        return {stage: round(ms, 3) for stage, ms in self._average_ms.copy().items()}
