"""A job as the queue shows it, and what can be wrong with asking for one; imports no database."""

from __future__ import annotations

from typing import Any

import msgspec

from lightwell.errors import LightwellError
from lightwell.job_settings import JobKind, JobState
from lightwell_workers.jobs.directory import Artifact
from lightwell_workers.jobs.events import Progress

FINISHED: tuple[JobState, ...] = ("cancelled", "failed", "succeeded")


class QueueError(LightwellError):
    """The queue's database cannot be used."""


class JobNotFoundError(LightwellError):
    """There is no such job."""


class JobStateError(LightwellError):
    """The job's state does not allow it: says which state it is."""


class KeyConflictError(LightwellError):
    """The idempotency key was used for another job."""


class CursorError(LightwellError):
    """The cursor is not one that a listing gave."""


class Job(msgspec.Struct):
    """One job. Times are nanoseconds since the Unix epoch."""

    id: str
    kind: JobKind
    state: JobState
    priority: int
    settings: dict[str, Any]
    attempts: int
    created: int
    started: int | None
    finished: int | None
    progress: Progress | None
    artifacts: list[Artifact]
    error: str | None = None
