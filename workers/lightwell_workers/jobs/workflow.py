"""One job as a DBOS workflow: prepare, then step by step, then publish. Each is a checkpoint.

A step may run again after a kill, and so writes the same files with the same bytes. The job's lock makes sure that no
two bodies of one job run at once, whatever was cancelled, resumed or taken over meanwhile.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import shutil
import threading
import time
from pathlib import Path
from typing import Any

import msgspec
import structlog
from filelock import FileLock, Timeout
from threadpoolctl import threadpool_limits

from lightwell.errors import LightwellError
from lightwell.io.files import write_atomically
from lightwell.job_settings import JobKind, JobsSettings
from lightwell_workers.jobs.compute import ComputeLostError, DaskCompute, InlineCompute
from lightwell_workers.jobs.context import Compute, JobCancelled, JobContext
from lightwell_workers.jobs.directory import JOB_ID, JobDirectory
from lightwell_workers.jobs.events import EventLog, last_state
from lightwell_workers.jobs.kind import SMALL_SECONDS, Estimate, JobError
from lightwell_workers.jobs.kinds import KINDS, load_kind
from lightwell_workers.jobs.roots import data_roots

log = structlog.get_logger("jobs")

MEGABYTE = 1 << 20
STALE_MARKER_SECONDS = 3.0
LOCK_POLL_SECONDS = 0.2
PREPARE = -1
TRANSIENT = ("KilledWorker", "CommClosedError", "FutureCancelledError", "CancelledError", "FutureLostError")


class TransientError(Exception):
    """Something outside the job failed that may work when tried again."""


def is_transient(error: BaseException) -> bool:
    """Return whether a step that failed with ``error`` is to be tried again."""
    return isinstance(error, TransientError)


class Runner:
    """Runs steps of jobs; one an executor."""

    def __init__(self, settings: JobsSettings, root: Path) -> None:
        self._settings = settings
        self._root = root
        self.roots = data_roots(settings, root.parent)
        """Folders below which inputs of jobs may lie."""
        self._dask = DaskCompute(settings.scheduler, settings.processes)
        self._inline = InlineCompute()
        self._stops: set[threading.Event] = set()
        self._is_closing = False
        threadpool_limits(1)  # jobs and tasks are what runs in parallel

    def close(self) -> None:
        """Stop what runs; the jobs are resumed by the next executor."""
        self._is_closing = True
        for stop in list(self._stops):
            stop.set()
        self._dask.close()

    async def run_step(self, job: str, kind: JobKind, settings: dict[str, Any], index: int) -> int:
        """Run one step and return the number of steps, which `PREPARE` finds out."""
        while True:
            stop = threading.Event()
            self._stops.add(stop)
            body = asyncio.get_running_loop().run_in_executor(None, self._run, job, kind, settings, index, stop)
            try:
                return await asyncio.shield(body)
            except asyncio.CancelledError:
                stop.set()
                with contextlib.suppress(BaseException):
                    await body
                raise
            except JobCancelled:
                # The database has not cancelled this meanwhile: the marker is stale.
                JobDirectory(self._root, job).cancel.unlink(missing_ok=True)
            finally:
                self._stops.discard(stop)

    def _run(self, job: str, kind: JobKind, settings: dict[str, Any], index: int, stop: threading.Event) -> int:
        directory = JobDirectory(self._root, job)
        try:
            directory.path.mkdir(parents=True, exist_ok=True)
            with _locked(directory, stop):
                events = EventLog(directory.events)
                try:
                    return self._run_locked(directory, kind, settings, index, stop, events)
                except JobCancelled:
                    if self._is_closing and not directory.cancel.exists():
                        events.append("log", level="info", message="interrupted: goes on with the next executor")
                    else:
                        events.append("state", state="cancelled")
                    # The marker is faster than the database, which ends this body within a second. Until then the lock
                    # is kept: a retry that came first would leave this body alive beside its own.
                    stop.wait(STALE_MARKER_SECONDS)
                    raise
                except Exception as error:
                    failure = _explain(error, directory)
                    if not is_transient(failure):
                        events.append("state", state="failed", error=str(failure))
                        log.info("job failed", job=job, error=str(failure))
                    raise failure from error
        except OSError as error:
            raise _explain(error, directory) from error

    def _run_locked(
        self,
        directory: JobDirectory,
        name: JobKind,
        document: dict[str, Any],
        index: int,
        stop: threading.Event,
        events: EventLog,
    ) -> int:
        if directory.manifest.is_file():
            # This was killed between publishing and its checkpoint, or a cancellation has missed it.
            shutil.rmtree(directory.work, ignore_errors=True)
            if last_state(directory.events) != "succeeded":
                events.append("state", state="succeeded")
            return max(index, 0)
        kind = load_kind(name)
        settings = KINDS[name].settings_type.model_validate(document)
        # What has been prepared needs its input no more, which may be gone or another one by now.
        estimate = None if index == PREPARE else _read_estimate(directory)
        estimate = estimate or kind.estimate(settings, self.roots)
        compute: Compute = self._inline if estimate.seconds < SMALL_SECONDS else self._dask
        context = JobContext(directory, events, compute, stop, self.roots)
        context.check()
        if index == PREPARE or last_state(directory.events) in ("cancelled", "failed"):
            events.append("state", state="running")
        if index == PREPARE:
            reason = space_problem(self._settings, self._root, estimate.disk_bytes, directory.id) or memory_problem(
                self._settings, estimate.memory_bytes
            )
            if reason is not None:
                raise JobError(reason)
            context.results.mkdir(parents=True, exist_ok=True)
            kind.prepare(settings, context)
            write_atomically(_estimate_path(directory), msgspec.json.encode(estimate))
            return len(kind.steps(settings, context))
        steps = kind.steps(settings, context)
        if index == len(steps):
            directory.publish(context.results)
            events.append("state", state="succeeded")
            log.info("job succeeded", job=directory.id, kind=name)
            return len(steps)
        started = time.monotonic()
        steps[index].run(context)
        context.log("step done", step=steps[index].name, seconds=round(time.monotonic() - started, 3))
        return len(steps)


def _estimate_path(directory: JobDirectory) -> Path:
    return directory.work / "estimate.json"


def _read_estimate(directory: JobDirectory) -> Estimate | None:
    try:
        return msgspec.json.decode(_estimate_path(directory).read_bytes(), type=Estimate)
    except (OSError, msgspec.MsgspecError):
        return None


def space_problem(settings: JobsSettings, root: Path, wanted: int, job: str | None = None) -> str | None:
    """Return why a job that needs ``wanted`` bytes of disk cannot start, or None; what ``job`` has already counts."""
    existing = next(path for path in (root, *root.parents) if path.exists())
    free = shutil.disk_usage(existing).free
    more = wanted if job is None else max(0, wanted - _tree_bytes(root / job))
    if free - more < settings.min_free_mb * MEGABYTE:
        return (
            f"the disk has {free // MEGABYTE} MB free, the job needs {more // MEGABYTE + 1} MB and must leave "
            f"{settings.min_free_mb} MB ([jobs] min_free_mb): free space, or ask for less"
        )
    used = used_bytes(root, job)
    if used + wanted > settings.quota_mb * MEGABYTE:
        return (
            f"jobs use {used // MEGABYTE} MB of {settings.quota_mb} MB ([jobs] quota_mb) and this one needs "
            f"{wanted // MEGABYTE + 1} MB: delete finished jobs, or raise the quota"
        )
    return None


def memory_problem(settings: JobsSettings, wanted: int) -> str | None:
    """Return why this machine cannot hold ``wanted`` bytes, or None; the machines of a scheduler are not known."""
    there = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    if settings.scheduler or wanted <= there:
        return None
    return (
        f"the job needs {wanted // MEGABYTE + 1} MB of memory, this machine has {there // MEGABYTE} MB: ask for less,"
        " or name the scheduler of larger ones ([jobs] scheduler)"
    )


def used_bytes(root: Path, but: str | None = None) -> int:
    """Return the size of all results, from their manifests, and of the files of jobs that have not succeeded."""
    if not root.is_dir():
        return 0
    folders = [path for path in root.iterdir() if path.name != but and JOB_ID.match(path.name)]
    results = (artifact.bytes for path in folders for artifact in JobDirectory(root, path.name).read_manifest())
    return sum(results) + sum(_tree_bytes(path / "work") for path in folders)


def _tree_bytes(folder: Path) -> int:
    """Return the size of the files below a folder; those that vanish meanwhile count nothing."""
    size = 0
    for place, _, names in os.walk(folder):
        for name in names:
            with contextlib.suppress(OSError):
                size += (Path(place) / name).lstat().st_size
    return size


@contextlib.contextmanager
def _locked(directory: JobDirectory, stop: threading.Event) -> Any:  # noqa: ANN401
    """Hold the job's lock; an earlier body of the same job has ended when this is entered."""
    lock = FileLock(directory.lock, thread_local=False)
    while True:
        try:
            lock.acquire(timeout=LOCK_POLL_SECONDS)
            break
        except Timeout:
            if stop.is_set():
                raise JobCancelled from None
    try:
        yield
    finally:
        lock.release()


def _explain(error: BaseException, directory: JobDirectory) -> Exception:
    """Return an error whose text a user can act on, or a `TransientError`."""
    if isinstance(error, LightwellError):
        return error
    if type(error).__name__ in TRANSIENT or isinstance(error, ComputeLostError | ConnectionError | TimeoutError):
        return TransientError(f"{type(error).__name__}: {error}")
    if isinstance(error, OSError):
        where = error.filename or directory.path
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return JobError(f"{where}: the disk is full: free space, then retry the job")
        return JobError(
            f"{where}: {error.strerror or error}: see to the folder and its permissions, then retry the job"
        )
    if isinstance(error, MemoryError):
        return JobError("memory ran out: lower memory_mb or the resolution, then submit the job again")
    if isinstance(error, Exception):
        log.error("unexpected error", job=directory.id, exc_info=error)
        return JobError(f"an error in Lightwell: {type(error).__name__}: {error}")
    raise error
