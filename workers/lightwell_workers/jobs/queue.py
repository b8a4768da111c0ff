"""The queue as the server sees it: submit, look, cancel, retry. It never runs a job's code."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import shutil
import time
import uuid
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, cast

from dbos import DBOSClient, DBOSPortableJSONSerializer, WorkflowStatus
from filelock import FileLock, Timeout
from sqlalchemy.exc import SQLAlchemyError

from lightwell.job_settings import DEFAULT_PRIORITY, JobKind, JobsSettings, JobState
from lightwell_workers.jobs.database import APPLICATION, QUEUE, database_url, migrate
from lightwell_workers.jobs.directory import JOB_ID, JobDirectory
from lightwell_workers.jobs.events import last_progress, read_events
from lightwell_workers.jobs.job import (
    FINISHED,
    CursorError,
    Job,
    JobNotFoundError,
    JobStateError,
    KeyConflictError,
    QueueError,
)
from lightwell_workers.jobs.kinds import KINDS

STATES: dict[JobState, list[str]] = {
    "queued": ["ENQUEUED", "DELAYED"],
    "running": ["PENDING"],
    "cancelling": ["CANCELLED"],
    "cancelled": ["CANCELLED"],
    "failed": ["ERROR", "MAX_RECOVERY_ATTEMPTS_EXCEEDED"],
    "succeeded": ["SUCCESS"],
}
MILLISECOND_NS = 1_000_000
DAY_NS = 86_400 * 10**9
ID_LENGTH = 20
LONGEST_STOP_SECONDS = 8.0
STOP_POLL_SECONDS = 0.05


class Queue:
    """Safe to use from several threads."""

    def __init__(self, settings: JobsSettings, data_dir: Path) -> None:
        """Connect; raises `QueueError` where the database cannot be used."""
        self.root = (data_dir / "jobs").absolute()
        url = database_url(settings.database_url, data_dir)
        migrate(url)
        self._client = DBOSClient(
            system_database_url=url,
            application_name=APPLICATION,
            serializer=DBOSPortableJSONSerializer(),
            retry_connection_errors=False,
        )

    def close(self) -> None:
        """Close the connections."""
        self._client.destroy()

    def submit(
        self, kind: JobKind, settings: dict[str, Any], *, priority: int = DEFAULT_PRIORITY, key: str | None = None
    ) -> tuple[Job, bool]:
        """Queue a job; return it, and whether it is new. The same ``key`` and body give the same job.

        Raises
        ------
        KeyConflictError
            Where the key stands for a job with another kind or other settings.
        """
        job = uuid.uuid4().hex[:ID_LENGTH] if key is None else _id_of_key(key)
        is_new = key is None or not self.knows(key)
        with _reported():
            if is_new:
                self._client.enqueue(
                    {"workflow_name": kind, "queue_name": QUEUE, "workflow_id": job, "priority": priority}, settings
                )
        made = self.get(job)
        if (made.kind, made.settings) != (kind, settings):
            raise KeyConflictError(f"the idempotency key {key!r} was used for another job ({job}); take a new key")
        return made, is_new

    def knows(self, key: str) -> bool:
        """Return whether there is a job of an idempotency key."""
        with _reported():
            return bool(self._client.list_workflows(workflow_ids=[_id_of_key(key)], load_input=False))

    def of_key(self, key: str) -> Job | None:
        """Return the job of an idempotency key, None where there is none."""
        return self.get(_id_of_key(key)) if self.knows(key) else None

    def get(self, job: str) -> Job:
        """Return a job; raises `JobNotFoundError`."""
        return self._view(self._find(job))

    def page(
        self,
        cursor: str | None = None,
        limit: int = 50,
        state: JobState | None = None,
        kind: JobKind | None = None,
    ) -> tuple[list[Job], str | None]:
        """Return jobs, newest first, and the cursor of those that follow.

        The order is by time of submission and id, so that jobs that come meanwhile change no page that follows.
        """
        after = _decode_cursor(cursor) if cursor is not None else None
        with _reported():
            found = self._older(after, state, kind, limit)
        chosen = found[:limit]
        more = len(found) > limit
        jobs = [job for job in map(self._view, chosen) if state is None or job.state == state]
        return jobs, _encode_cursor(_place(chosen[-1])) if more else None

    def _older(
        self, after: tuple[int, str] | None, state: JobState | None, kind: JobKind | None, limit: int
    ) -> list[WorkflowStatus]:
        """Return the jobs that follow a place, in order: at least ``limit`` + 1 of them, or all that there are.

        The database orders by time only. Jobs of one millisecond are fetched together, so that their ids decide.
        """
        end = None if after is None else datetime.fromtimestamp((after[0] + 1) / 1000, UTC).isoformat()
        found: list[WorkflowStatus] = []
        offset, wanted = 0, limit + 1
        while True:
            batch = self._client.list_workflows(
                name=kind or list(KINDS),
                status=STATES[state] if state is not None else None,
                end_time=end,
                limit=wanted,
                offset=offset,
                sort_desc=True,
            )
            offset += len(batch)
            found += [status for status in batch if after is None or _place(status) < after]
            found.sort(key=_place, reverse=True)
            if len(batch) < wanted:
                return found
            if len(found) > limit and _place(found[limit])[0] > (batch[-1].created_at or 0):
                return found

    def cancel(self, job: str) -> Job:
        """Cancel a job that is queued or runs; one that is already cancelled stays so. Raises `JobStateError`."""
        view = self.get(job)
        if view.state in ("failed", "succeeded"):
            raise JobStateError(f"job {job} has {view.state}; only a queued or running job can be cancelled")
        if view.state in ("queued", "running"):
            with _reported():
                self._client.cancel_workflow(job)
            directory = JobDirectory(self.root, job)
            if directory.path.is_dir():
                # Tasks see the marker between blocks, sooner than the executor hears of it.
                with contextlib.suppress(OSError):
                    directory.cancel.touch()
        return self.get(job)

    def retry(self, job: str) -> Job:
        """Queue a failed or cancelled job again; it goes on from its last checkpoint. Raises `JobStateError`."""
        status = self._find(job)
        state = self._state(status)
        directory = JobDirectory(self.root, job)
        with _reported():
            if status.status == "CANCELLED":
                # Resumed before it has stopped, the old body would go on beside the new one.
                deadline = time.monotonic() + LONGEST_STOP_SECONDS
                while self._is_locked(job):
                    if time.monotonic() > deadline:
                        raise JobStateError(f"job {job} has not stopped yet; retry it in a moment")
                    time.sleep(STOP_POLL_SECONDS)
                directory.cancel.unlink(missing_ok=True)
                self._client.resume_workflow(job, queue_name=QUEUE)
            elif state == "failed":
                directory.cancel.unlink(missing_ok=True)
                failed = [step["function_id"] for step in self._client.list_workflow_steps(job) if step["error"]]
                self._client.rewind_workflow(job, start_step=failed[0] if failed else 1, queue_name=QUEUE)
            else:
                raise JobStateError(f"job {job} is {state}; only a failed or cancelled job can be retried")
        return self.get(job)

    def delete(self, job: str) -> None:
        """Delete a finished job and its results. Raises `JobStateError`."""
        view = self.get(job)
        if view.state not in FINISHED:
            raise JobStateError(f"job {job} is {view.state}; cancel it before it can be deleted")
        # Without its manifest nothing that may be left of it is taken for results.
        JobDirectory(self.root, job).manifest.unlink(missing_ok=True)
        shutil.rmtree(self.root / job, ignore_errors=True)
        with _reported():
            self._client.delete_workflow(job)

    def sweep(self, retention_days: float, now_ns: int | None = None) -> list[str]:
        """Delete the jobs that ended more than ``retention_days`` ago; return their ids."""
        limit = (now_ns or time.time_ns()) - round(retention_days * DAY_NS)
        before = datetime.fromtimestamp(limit / 1e9, UTC).isoformat()
        with _reported():
            old = self._client.list_workflows(
                name=list(KINDS), completed_before=before, load_input=False, load_output=False
            )
        deleted = [status.workflow_id for status in old if self._state(status) in FINISHED]
        for job in deleted:
            with contextlib.suppress(JobNotFoundError, JobStateError):
                self.delete(job)
        return deleted

    def counts(self) -> dict[str, int]:
        """Return how many jobs wait, run, and so on, by state of the database (``cancelling`` counts as cancelled)."""
        with _reported():
            rows = self._client.list_workflows(name=list(KINDS), load_input=False, load_output=False)
        counts = dict.fromkeys(("queued", "running", "cancelled", "failed", "succeeded"), 0)
        for status in rows:
            counts[_plain_state(status.status)] += 1
        return counts

    def events(self, job: str, after: int = 0) -> list[tuple[int, dict[str, Any]]]:
        """Return (number, event) of what happened after event number ``after``."""
        return read_events(JobDirectory(self.root, job).events, after)

    def _find(self, job: str) -> WorkflowStatus:
        if not JOB_ID.match(job):
            raise JobNotFoundError(f"{job!r} is no job id")
        with _reported():
            found = self._client.list_workflows(workflow_ids=[job])
        if not found or found[0].name not in KINDS:
            raise JobNotFoundError(f"there is no job {job}; it may have been deleted")
        return found[0]

    def _state(self, status: WorkflowStatus) -> JobState:
        state = _plain_state(status.status)
        if state == "cancelled" and self._is_locked(status.workflow_id):
            return "cancelling"
        return state

    def _is_locked(self, job: str) -> bool:
        path = JobDirectory(self.root, job).lock
        if not path.exists():
            return False
        lock = FileLock(path)
        try:
            lock.acquire(timeout=0)
        except (Timeout, OSError):
            return True
        lock.release()
        return False

    def _view(self, status: WorkflowStatus) -> Job:
        directory = JobDirectory(self.root, status.workflow_id)
        state = self._state(status)
        settings = status.input["args"] if status.input is not None else ()
        return Job(
            id=status.workflow_id,
            kind=cast("JobKind", status.name),
            state=state,
            priority=status.priority or 0,
            settings=dict(settings[0]) if settings else {},
            attempts=status.recovery_attempts or 0,
            created=(status.created_at or 0) * MILLISECOND_NS,
            started=_nanoseconds(status.dequeued_at),
            finished=_nanoseconds(status.completed_at),
            progress=last_progress(directory.events),
            artifacts=directory.read_manifest() if state == "succeeded" else [],
            error=None if status.error is None else _error_text(status.error),
        )


@contextlib.contextmanager
def _reported() -> Iterator[None]:
    try:
        yield
    except SQLAlchemyError as error:
        reason = str(error).strip().splitlines()[0]
        raise QueueError(f"the queue's database does not answer: {reason}") from None


def _id_of_key(key: str) -> str:
    return hashlib.sha256(key.encode()).hexdigest()[:ID_LENGTH]


def _error_text(error: Exception) -> str:
    return str(getattr(error, "message", "") or error) or type(error).__name__


def _plain_state(status: str) -> JobState:
    return next(state for state, names in STATES.items() if status in names and state != "cancelling")


def _nanoseconds(milliseconds: int | None) -> int | None:
    return None if milliseconds is None else milliseconds * MILLISECOND_NS


def _place(status: WorkflowStatus) -> tuple[int, str]:
    return status.created_at or 0, status.workflow_id


def _encode_cursor(place: tuple[int, str]) -> str:
    return base64.urlsafe_b64encode(json.dumps(place).encode()).decode().rstrip("=")


def _decode_cursor(cursor: str) -> tuple[int, str]:
    try:
        created, job = json.loads(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
        datetime.fromtimestamp((int(created) + 1) / 1000, UTC)
        return int(created), str(job)
    except (ValueError, TypeError, OverflowError, OSError):
        raise CursorError(f"cursor: {cursor!r} is not one that a listing of jobs gave; leave it out") from None
