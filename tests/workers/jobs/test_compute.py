"""Waiting for tasks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from distributed import TimeoutError as DaskTimeoutError

from lightwell_workers.jobs import compute
from lightwell_workers.jobs.compute import _wait
from lightwell_workers.jobs.context import JobCancelled, TaskCancelledError


class _Future:
    """Is done at every third look, and answers one thing after the other."""

    def __init__(self, *answers: Any) -> None:
        self._answers = list(answers)
        self.looks = 0

    def done(self) -> bool:
        self.looks += 1
        return self.looks % 3 == 0

    def result(self, timeout: float) -> Any:
        # What `distributed` does where a timeout hits it while it fetches a result.
        if self.looks % 3 or timeout < 1:
            raise UnboundLocalError("cannot access local variable 'result'")
        answer = self._answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compute, "POLL_SECONDS", 0.001)


def _cancelled_after(checks: int) -> Callable[[], None]:
    left = [checks]

    def check() -> None:
        left[0] -= 1
        if left[0] < 0:
            raise JobCancelled

    return check


def test_a_result_is_fetched_when_it_is_there() -> None:
    assert _wait(_Future(7), lambda: None) == 7


def test_a_result_that_died_with_its_worker_is_waited_for_again() -> None:
    future = _Future(DaskTimeoutError(), 8)
    assert _wait(future, lambda: None) == 8
    assert future.looks == 6


def test_a_job_that_is_to_stop_waits_no_longer() -> None:
    with pytest.raises(JobCancelled):
        _wait(_Future(9), _cancelled_after(2))


def test_a_task_that_has_stopped_is_the_jobs_cancellation() -> None:
    with pytest.raises(JobCancelled):
        _wait(_Future(TaskCancelledError()), _cancelled_after(3))
    with pytest.raises(TaskCancelledError):
        _wait(_Future(TaskCancelledError()), lambda: None)
    with pytest.raises(ValueError, match="bad frame"):
        _wait(_Future(ValueError("bad frame")), lambda: None)
