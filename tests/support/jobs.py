"""Processes of the queue for tests: executors, servers, Dask clusters and Postgres, each real and each killable."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil

from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.jobs.job import Job
from lightwell_workers.jobs.queue import Queue

WAIT_SECONDS = 100.0
FINISHED = ("cancelled", "failed", "succeeded")


def make_capture(directory: Path, scene: str = "scene1", **rig: Any) -> Path:
    """Simulate a small capture."""
    directory.parent.mkdir(parents=True, exist_ok=True)
    settings: dict[str, Any] = {"probes": 40, "size": 24, "samples": 1} | rig
    simulate_capture(directory, PRESETS[scene], RigSettings(**settings))
    return directory


class Process:
    """A process that can be killed and started again."""

    def __init__(self, *arguments: str, environment: dict[str, str] | None = None, log: Path) -> None:
        self._arguments = arguments
        self._environment = os.environ | {"LIGHTWELL_LOG__LEVEL": "warning"} | (environment or {})
        self._log = log
        self.start()

    def start(self) -> None:
        """Start it."""
        with self._log.open("ab") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", *self._arguments],
                env=self._environment,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                start_new_session=True,
            )

    def kill(self) -> None:
        """Kill it as the kernel does when memory runs out."""
        self.process.kill()
        self.process.wait()

    def descendants(self) -> list[psutil.Process]:
        """Return the processes below it."""
        with contextlib.suppress(psutil.NoSuchProcess):
            return list(psutil.Process(self.process.pid).children(recursive=True))
        return []

    def stop(self) -> None:
        """End it, and whatever it left."""
        below = self.descendants()
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(8)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        for process in below:
            with contextlib.suppress(psutil.NoSuchProcess):
                process.kill()


@contextlib.contextmanager
def running(*arguments: str, log: Path, **environment: str) -> Iterator[Process]:
    """Run a Python module as a process."""
    process = Process(*arguments, environment=environment, log=log)
    try:
        yield process
    finally:
        process.stop()


def executor(data: Path, **environment: str) -> contextlib.AbstractContextManager[Process]:
    """Run an executor."""
    return running("lightwell_server.cli", "work", "--data", str(data), log=data / "executor.log", **environment)


def free_port() -> int:
    """Return a port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def wait_for(condition: Callable[[], Any], what: str, seconds: float = WAIT_SECONDS, pause: float = 0.05) -> Any:
    """Return the first true value of ``condition``, which is asked every ``pause`` seconds."""
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        value = condition()
        if value:
            return value
        time.sleep(pause)
    raise AssertionError(f"{what} did not happen within {seconds:.0f} s")


def wait_for_end(queue: Queue, job: str, seconds: float = WAIT_SECONDS) -> Job:
    """Return a job when it has ended."""

    def ended() -> Job | None:
        found = queue.get(job)
        return found if found.state in FINISHED else None

    result: Job = wait_for(ended, f"the end of {job}", seconds)
    return result


def digests(job: Job) -> dict[str, str]:
    """Return the SHA-256 of every artefact by path."""
    return {artifact.path: artifact.sha256 for artifact in job.artifacts}


@contextlib.contextmanager
def postgres(folder: Path) -> Iterator[str]:
    """Run a Postgres cluster of its own and give its URL."""
    binaries = max(Path("/usr/lib/postgresql").glob("*/bin"))
    port = free_port()
    as_user = ["runuser", "-u", "postgres", "--"] if os.geteuid() == 0 else []
    place = folder / "postgres"
    place.mkdir(parents=True)
    if as_user:
        shutil.chown(place, "postgres")
        for parent in place.parents:
            if parent.stat().st_mode & 0o001 == 0:
                parent.chmod(parent.stat().st_mode | 0o011)
    subprocess.run(
        [*as_user, str(binaries / "initdb"), "-D", str(place / "db"), "-A", "trust", "-U", "postgres", "--no-sync"],
        check=True,
        capture_output=True,
        cwd="/",
    )
    options = f"-p {port} -c listen_addresses=127.0.0.1 -c unix_socket_directories={place} -c fsync=off"
    control = [*as_user, str(binaries / "pg_ctl"), "-D", str(place / "db"), "-w"]
    subprocess.run(
        [*control, "-o", options, "-l", str(place / "log"), "start"], check=True, stdout=subprocess.DEVNULL, cwd="/"
    )
    try:
        subprocess.run(
            [str(binaries / "createdb"), "-h", "127.0.0.1", "-p", str(port), "-U", "postgres", "lightwell"],
            check=True,
            capture_output=True,
        )
        yield f"postgresql://postgres@127.0.0.1:{port}/lightwell"
    finally:
        subprocess.run([*control, "-m", "immediate", "stop"], check=False, capture_output=True, cwd="/")
