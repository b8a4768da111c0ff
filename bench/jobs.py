"""Running jobs for benches: an executor of their own, and waiting for a job's end."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from lightwell.job_settings import JobsSettings
from lightwell_workers.jobs.queue import Queue


@contextmanager
def job_queue() -> Iterator[tuple[Queue, Path, int]]:
    """Yield a queue in a new data folder, the folder, and the process id of the executor that works on it."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "lightwell_server.cli", "work", "--data", folder, "--log-level", "error"]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL) as executor:
            try:
                queue = Queue(JobsSettings(), Path(folder))
                yield queue, Path(folder), executor.pid
                queue.close()
            finally:
                executor.terminate()


def wait_for(queue: Queue, job: str, poll_seconds: float = 0.2) -> Path:
    """Wait for the end of a job and return the folder of its artefacts; raises ``RuntimeError`` where it failed."""
    while queue.get(job).state not in ("succeeded", "failed"):
        time.sleep(poll_seconds)
    if (error := queue.get(job).error) is not None:
        raise RuntimeError(error)
    return queue.root / job / "artifacts"
