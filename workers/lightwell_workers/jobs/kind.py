"""What a kind of job is: how much it needs, and the steps that it is made of."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import msgspec

from lightwell.errors import LightwellError
from lightwell_workers.jobs.context import JobContext

SMALL_SECONDS = 1.5
"""A job that is estimated to take less is computed in the executor itself: it would end before a task has been sent."""


class JobError(LightwellError):
    """A job cannot be done: says why, and what would help."""


class Estimate(msgspec.Struct):
    """What a job is going to need."""

    seconds: float
    """Core time, seconds."""
    memory_bytes: int
    """In each compute process."""
    disk_bytes: int
    """Results and, while it runs, intermediate files."""


class Step(NamedTuple):
    """One checkpoint. It may run again after a kill: it writes the same files with the same bytes."""

    name: str
    run: Callable[[JobContext], None]


class Kind(Protocol):
    """A kind of job; ``settings`` below are of the type that `kinds.KINDS` names."""

    def estimate(self, settings: Any, roots: Sequence[Path] | None = None) -> Estimate:  # noqa: ANN401
        """Return what the job needs; raises `LightwellError` where it cannot work.

        ``roots``: folders below which files must lie that a file of the settings names; None: anywhere.
        """

    def prepare(self, settings: Any, context: JobContext) -> None:  # noqa: ANN401
        """Validate the input and write what `steps` needs into the job's folder."""

    def steps(self, settings: Any, context: JobContext) -> list[Step]:  # noqa: ANN401
        """Return the steps; they follow from the settings and from what `prepare` wrote, and from nothing else."""
