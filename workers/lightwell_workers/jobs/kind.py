"""What a kind of job is: how much it needs, and the steps that it is made of."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import msgspec

from lightwell.errors import LightwellError
from lightwell.job_settings import JobKind
from lightwell.settings import Settings
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
    """A kind of job; ``settings`` below is an instance of its ``settings_type``."""

    @property
    def name(self) -> JobKind:
        """Its name in the API."""

    @property
    def description(self) -> str:
        """What it does, in one line."""

    @property
    def settings_type(self) -> type[Settings]:
        """Model of its settings."""

    def estimate(self, settings: Any) -> Estimate:  # noqa: ANN401
        """Return what the job needs; raises `LightwellError` where it cannot work."""

    def prepare(self, settings: Any, context: JobContext) -> None:  # noqa: ANN401
        """Validate the input and write what `steps` needs into the job's folder."""

    def steps(self, settings: Any, context: JobContext) -> list[Step]:  # noqa: ANN401
        """Return the steps; they follow from the settings and from what `prepare` wrote, and from nothing else."""
