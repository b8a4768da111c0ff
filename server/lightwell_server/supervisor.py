"""One ingest process for each enabled stream, kept alive.

A process that ends is started again after a pause that doubles while it keeps failing. A process whose frames stop is
ended and started again; a new one has longer for its first frame, because its kernels are compiled then. A source that
came to its end is left alone, and so is a stream that a worker started elsewhere publishes.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import sys
import time
from collections import deque
from collections.abc import AsyncIterator, Coroutine, Iterable
from dataclasses import dataclass, field
from pathlib import Path

import structlog

from lightwell.settings import StreamSettings
from lightwell_server.config import LogSettings, SupervisorSettings
from lightwell_server.hub import RESTART_KEYS, Hub
from lightwell_server.masking import mask
from lightwell_server.session import WorkerState, follow
from lightwell_workers.ingest.log import resolve_format

log = structlog.get_logger("supervisor")

POLL_SECONDS = 0.25
TAIL_LINES = 20
LONGEST_LINE = 65536
_TELLS = re.compile(r"\[(debug|info) *\]")
"""What lines of a log for people have that do not complain."""
HEALTHY_SECONDS = 10.0
"""A process that has run this long with frames starts the pauses anew."""


@dataclass
class _Worker:
    """The embedded worker of one stream."""

    name: str
    settings: StreamSettings
    state: WorkerState = WorkerState.STOPPED
    pid: int | None = None
    restarts: int = 0
    last_error: str = ""
    tail: deque[str] = field(default_factory=lambda: deque(maxlen=TAIL_LINES))
    task: asyncio.Task[None] | None = None
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)
    """Held by the task whose process may run; it is free when that process has ended."""

    def become(self, state: WorkerState) -> None:
        """Go to another state; raises ``ValueError`` where it cannot follow this one."""
        self.state = follow(self.state, state)


@dataclass(frozen=True)
class WorkerReport:
    """What the API shows of an embedded worker."""

    state: WorkerState
    pid: int | None
    restarts: int
    last_error: str
    stderr_tail: tuple[str, ...]


class Supervisor:
    """Starts, watches and ends the embedded workers."""

    def __init__(
        self,
        hub: Hub,
        settings: SupervisorSettings,
        *,
        server_url: str,
        token: str,
        uploads: Path,
        log_settings: LogSettings,
    ) -> None:
        """Prepare; ``server_url`` is where workers find this server, ``uploads`` what it was sent.

        They write their logs as it does its own.
        """
        self._hub = hub
        self._settings = settings
        self._server_url = server_url
        self._token = token
        self._uploads = uploads
        self._log_options = ("--log-format", resolve_format(log_settings.format), "--log-level", log_settings.level)
        self._workers: dict[str, _Worker] = {}

    def report(self, name: str) -> WorkerReport | None:
        """Return how the embedded worker of a stream is, or None where it has none."""
        worker = self._workers.get(name)
        if worker is None:
            return None
        return WorkerReport(worker.state, worker.pid, worker.restarts, worker.last_error, tuple(worker.tail))

    def restarts(self) -> dict[str, int]:
        """Return how often each stream's worker has been started again."""
        return {name: worker.restarts for name, worker in self._workers.items()}

    def apply(self, name: str, settings: StreamSettings) -> None:
        """Start, restart or stop the worker of a stream as its settings want it.

        A running worker whose source, mapping and ``enabled`` stay the same is left alone: it is told of the rest
        through its socket.
        """
        if not self._settings.embedded:
            return
        worker = self._workers.setdefault(name, _Worker(name, settings))
        before = worker.settings
        same = all(getattr(before, key) == getattr(settings, key) for key in (*RESTART_KEYS, "enabled"))
        worker.settings = settings
        if worker.task is None or not same:
            if worker.task is not None:
                worker.task.cancel()
            worker.task = asyncio.create_task(self._run(worker), name=f"worker {name}")

    async def remove(self, name: str) -> None:
        """Stop the worker of a stream and forget it."""
        worker = self._workers.pop(name, None)
        if worker is not None:
            await _stop(worker)

    async def close(self) -> None:
        """Stop all workers, at the same time."""
        workers, self._workers = list(self._workers.values()), {}
        await asyncio.gather(*(_stop(worker) for worker in workers))

    async def _run(self, worker: _Worker) -> None:
        """Wait until the process of the task before has ended, then keep one alive."""
        async with worker.turn:
            try:
                if worker.settings.enabled:
                    await self._keep_alive(worker)
            finally:
                if worker.state is not WorkerState.ENDED:
                    worker.become(WorkerState.STOPPED)

    async def _keep_alive(self, worker: _Worker) -> None:
        """Run the process again and again; returns where its source has come to its end."""
        worker.become(WorkerState.STOPPED)
        failures = 0
        while True:
            while self._published_elsewhere(worker.name):
                worker.become(WorkerState.YIELDED)
                await asyncio.sleep(POLL_SECONDS)
            worker.become(WorkerState.STARTING)
            started = time.monotonic()
            try:
                async with self._process(worker) as process:
                    reason = await self._watch(worker, process, started)
            except OSError as error:
                reason = f"the ingest process cannot be started: {error}"
            if worker.state is WorkerState.ENDED:
                return
            if self._published_elsewhere(worker.name):
                continue
            worker.become(WorkerState.BACKING_OFF)
            worker.last_error = reason
            healthy = time.monotonic() - started > HEALTHY_SECONDS and self._frames_since(worker.name, started)
            failures = 1 if healthy else failures + 1
            pause_seconds = min(
                self._settings.backoff_first_seconds * 2.0 ** min(failures - 1, 16),
                self._settings.backoff_longest_seconds,
            )
            log.error("worker restarts", stream=worker.name, reason=reason, pause_seconds=pause_seconds)
            await asyncio.sleep(pause_seconds)
            worker.restarts += 1

    @contextlib.asynccontextmanager
    async def _process(self, worker: _Worker) -> AsyncIterator[asyncio.subprocess.Process]:
        """Run the ingest process; it has ended when this is left."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "lightwell_server.supervised",
            "ingest",
            "--stream",
            worker.name,
            "--server",
            self._server_url,
            *self._log_options,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env=os.environ
            | {
                "LIGHTWELL_STREAM_SETTINGS": worker.settings.model_dump_json(),
                "LIGHTWELL_TOKEN": self._token,
                "LIGHTWELL_UPLOADS": str(self._uploads),
            },
            start_new_session=True,  # Ctrl-C on a terminal goes to the server, which ends the workers itself
        )
        worker.pid = process.pid
        reading = asyncio.create_task(_read_stderr(process, worker.tail))
        log.info("worker started", stream=worker.name, pid=process.pid)
        try:
            yield process
        finally:
            if process.returncode is None:
                worker.become(WorkerState.STOPPING)
                await _to_the_end(self._end(process))
            worker.pid = None
            await reading

    async def _watch(self, worker: _Worker, process: asyncio.subprocess.Process, started: float) -> str:
        """Return why the process must be started again; its state becomes ENDED where it must not."""
        while True:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(POLL_SECONDS):
                    status = await process.wait()
                    channel = self._hub.get(worker.name)
                    if status == 0 and channel is not None and channel.state == "ended":
                        worker.become(WorkerState.ENDED)
                    return _describe_exit(status, worker.tail)
            if self._published_elsewhere(worker.name):
                return "a worker started elsewhere publishes this stream"
            if worker.state is WorkerState.STARTING and self._frames_since(worker.name, started):
                worker.become(WorkerState.RUNNING)
            if (silence := self._silence(worker, started)) is not None:
                return silence

    def _silence(self, worker: _Worker, started: float) -> str | None:
        """Return what the watchdog complains about, or None."""
        channel = self._hub.get(worker.name)
        if channel is None or channel.state == "ended":
            return None
        now = time.monotonic()
        if worker.state is WorkerState.RUNNING and channel.latest_at is not None:
            age, limit = now - channel.latest_at, channel.patience_seconds(self._settings.watchdog_seconds)
        else:
            age, limit = now - started, self._settings.startup_seconds
        if age <= limit:
            return None
        said = f": {channel.status.last_error}" if channel.status and channel.status.last_error else ""
        return f"no frame for {age:.0f} s{said}"

    def _frames_since(self, name: str, started: float) -> bool:
        channel = self._hub.get(name)
        return channel is not None and channel.latest_at is not None and channel.latest_at > started

    def _published_elsewhere(self, name: str) -> bool:
        channel = self._hub.get(name)
        return channel is not None and channel.publisher is not None and not channel.publisher.embedded

    async def _end(self, process: asyncio.subprocess.Process) -> None:
        """End the process: first in order, then at once."""
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(self._settings.stop_seconds):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()


async def _stop(worker: _Worker) -> None:
    """Cancel the worker's task and wait until its process, and any that it was to follow, has ended."""
    if worker.task is not None:
        worker.task.cancel()
    async with worker.turn:
        return


async def _to_the_end(work: Coroutine[None, None, None]) -> None:
    """Do all of ``work``, however often the caller is cancelled meanwhile; the cancellation is raised afterwards."""
    task = asyncio.ensure_future(work)
    cancelled: asyncio.CancelledError | None = None
    while not task.done():
        try:
            await asyncio.wait({task})
        except asyncio.CancelledError as error:
            cancelled = error
    task.result()
    if cancelled is not None:
        raise cancelled


async def _read_stderr(process: asyncio.subprocess.Process, tail: deque[str]) -> None:
    """Pass the process's log on line by line, without credentials, and keep its last lines."""
    assert process.stderr is not None
    rest = b""
    while data := await process.stderr.read(LONGEST_LINE):
        *lines, rest = (rest + data).split(b"\n")
        if len(rest) > LONGEST_LINE:
            lines, rest = [*lines, rest], b""
        for line in lines:
            text = mask(line.decode(errors="replace"))
            sys.stderr.write(f"{text}\n")
            if text.strip():
                tail.append(text)


def _describe_exit(status: int, tail: Iterable[str]) -> str:
    """Return how the process ended and why: the newest line that complains, or that is no line of the log."""
    how = f"was killed by signal {-status}" if status < 0 else f"ended with status {status}"
    said = next((reason for line in reversed(list(tail)) if (reason := _complaint(line))), "")
    return f"the ingest process {how}{said and ': '}{said}"


def _complaint(line: str) -> str:
    """Return what a line of a worker's log complains about; empty where it only tells what goes on."""
    try:
        entry = json.loads(line)
    except ValueError:
        return "" if _TELLS.search(line) else line
    if not isinstance(entry, dict):
        return line
    return str(entry.get("reason") or entry.get("event", "")) if entry.get("level") in ("warning", "error") else ""
