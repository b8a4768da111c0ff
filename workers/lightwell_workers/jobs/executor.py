"""The process that works on jobs."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import structlog
from dbos import DBOS, DBOSPortableJSONSerializer
from filelock import FileLock, Timeout

from lightwell.job_settings import JobKind, JobsSettings
from lightwell_workers.jobs.database import APPLICATION, QUEUE, VERSION, database_url, migrate, silence
from lightwell_workers.jobs.kinds import KINDS
from lightwell_workers.jobs.workflow import PREPARE, Runner, is_transient

log = structlog.get_logger("jobs")

POLL_SECONDS = 0.1
LOCK_POLL_SECONDS = 0.5
LONGEST_EXIT_SECONDS = 1.0


def run_executor(settings: JobsSettings, data_dir: Path, stop: threading.Event) -> None:
    """Work on jobs until ``stop`` is set; wait where another process of the same name does.

    A killed executor loses nothing: the next one of its name resumes its jobs from their last checkpoints.

    Raises
    ------
    QueueError
        Where the queue's database cannot be used.
    """
    url = database_url(settings.database_url, data_dir)
    root = (data_dir / "jobs").absolute()
    root.mkdir(parents=True, exist_ok=True)
    # DBOS would start a job twice if two processes had one name. The kernel drops this lock with the process.
    lock = FileLock(root / f".{settings.executor}.lock")
    while not stop.is_set():
        try:
            lock.acquire(timeout=LOCK_POLL_SECONDS)
            break
        except Timeout:
            continue
    else:
        return
    migrate(url)
    runner = Runner(settings, root)
    DBOS(
        config={
            "name": APPLICATION,
            "system_database_url": url,
            "executor_id": settings.executor,
            "application_version": VERSION,
            "serializer": DBOSPortableJSONSerializer(),
            "console_log_level": "ERROR",
        }
    )
    for kind in KINDS:
        _register(kind, runner)
    DBOS.launch()
    silence()
    DBOS.register_queue(QUEUE, worker_concurrency=settings.concurrency, polling_interval_sec=POLL_SECONDS)
    log.info("executor ready", executor=settings.executor, concurrency=settings.concurrency)
    stop.wait()
    runner.close()
    ending = threading.Thread(target=DBOS.destroy, kwargs={"workflow_completion_timeout_sec": 0}, daemon=True)
    ending.start()
    ending.join(LONGEST_EXIT_SECONDS)


def _register(kind: JobKind, runner: Runner) -> None:
    """Make the workflow of one kind; its name in the database is the kind's."""

    @DBOS.step(
        name=f"{kind}.step",
        preemptible=True,
        retries_allowed=True,
        interval_seconds=1.0,
        backoff_rate=2.0,
        max_attempts=6,
        should_retry=is_transient,
    )
    async def step(job: str, settings: dict[str, Any], index: int) -> int:
        return await runner.run_step(job, kind, settings, index)

    @DBOS.workflow(name=kind, max_recovery_attempts=1000)
    async def run(settings: dict[str, Any]) -> None:
        job = DBOS.workflow_id
        assert job is not None
        count = await step(job, settings, PREPARE)
        for index in range(count + 1):
            await step(job, settings, index)
