"""What a step of a job has to work with."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, Protocol

from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.events import EventLog


class JobCancelled(BaseException):
    """The job is to stop: no error, and nothing that a handler of errors should take."""


class Compute(Protocol):
    """Where tasks run."""

    processes: int

    def map(
        self, function: Callable[..., Any], items: Sequence[tuple[Any, ...]], check: Callable[[], None]
    ) -> Iterator[Any]:
        """Yield the results of ``function(*item)`` in order; ``check`` is called often and may raise."""


class JobContext:
    """One run of one job."""

    def __init__(
        self,
        directory: JobDirectory,
        events: EventLog,
        compute: Compute,
        stop: threading.Event,
        roots: Sequence[Path] | None = None,
    ) -> None:
        self.directory = directory
        self.id = directory.id
        self.work = directory.work
        self.results = directory.work / "results"
        """What becomes the artefacts when all steps are done."""
        self.roots = roots
        """Folders below which files must lie that a file of the settings names; None: anywhere."""
        self._events = events
        self._compute = compute
        self._stop = stop

    @property
    def processes(self) -> int:
        """How many tasks run at once."""
        return self._compute.processes

    def progress(self, stage: str, done: int, total: int) -> None:
        """Tell how far a stage is; raises `JobCancelled` where the job is to stop."""
        self._events.progress(stage, done, total)
        self.check()

    def log(self, message: str, *, level: str = "info", **fields: Any) -> None:  # noqa: ANN401
        """Write a line of the job's log."""
        self._events.append("log", level=level, message=message, **fields)

    def check(self) -> None:
        """Raise `JobCancelled` where the job is to stop."""
        if self._stop.is_set() or self.directory.cancel.exists():
            raise JobCancelled

    def map(self, function: Callable[..., Any], items: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        """Run ``function(cancel, *item)`` for every item, several at once, and yield the results in order.

        ``cancel`` is the path of the job's marker: a function that runs for long calls `stop_if_cancelled` with it
        between blocks. Functions are importable by name, items and results are small: data goes through files.
        """
        yield from self._compute.map(function, [(self.directory.cancel, *item) for item in items], self.check)


def stop_if_cancelled(cancel: Path) -> None:
    """Raise `TaskCancelledError` where the job of this task is to stop."""
    if cancel.exists():
        raise TaskCancelledError


class TaskCancelledError(Exception):
    """A task has stopped because its job is to stop."""
