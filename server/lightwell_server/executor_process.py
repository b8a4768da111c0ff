"""The job executor that runs beside the server, as a process of its own, kept alive."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import time

import structlog

from lightwell.job_settings import JobsSettings
from lightwell_server.config import Config, SupervisorSettings
from lightwell_server.masking import mask
from lightwell_workers.ingest.log import resolve_format

log = structlog.get_logger("executor")

HEALTHY_SECONDS = 10.0
LONGEST_LINE = 65536


class ExecutorProcess:
    """Starts ``lightwell work`` when it is first needed, starts it again when it ends, ends it with the server."""

    def __init__(self, config: Config) -> None:
        self._jobs: JobsSettings = config.jobs
        self._supervisor: SupervisorSettings = config.supervisor
        self._command = (
            sys.executable,
            "-m",
            "lightwell_server.supervised",
            "work",
            "--data",
            str(config.server.data_dir),
            "--log-format",
            resolve_format(config.log.format),
            "--log-level",
            config.log.level,
        )
        self._task: asyncio.Task[None] | None = None
        self.pid: int | None = None
        self.restarts = 0
        self.trouble = ""
        """Why it does not run; empty where it does, or is not wanted."""

    def ensure(self) -> None:
        """Start it, if the settings want one and it does not run."""
        if self._jobs.embedded and (self._task is None or self._task.done()):
            self._task = asyncio.create_task(self._keep_alive(), name="executor")

    async def close(self) -> None:
        """End it; its jobs go on when the next one starts."""
        if self._task is not None:
            self._task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await self._task
            self._task = None

    async def _keep_alive(self) -> None:
        failures = 0
        while True:
            started = time.monotonic()
            try:
                status = await self._run()
                reason = f"the executor ended with status {status}"
            except OSError as error:
                reason = f"the executor cannot be started: {error}"
            failures = 1 if time.monotonic() - started > HEALTHY_SECONDS else failures + 1
            pause = min(
                self._supervisor.backoff_first_seconds * 2.0 ** min(failures - 1, 16),
                self._supervisor.backoff_longest_seconds,
            )
            self.trouble = reason
            log.error("executor restarts", reason=reason, pause_seconds=pause)
            await asyncio.sleep(pause)
            self.restarts += 1

    async def _run(self) -> int:
        """Run the process once; it has ended when this returns or is cancelled."""
        process = await asyncio.create_subprocess_exec(
            *self._command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.DEVNULL,
            stderr=asyncio.subprocess.PIPE,
            env=os.environ | {"LIGHTWELL_JOBS_SETTINGS": self._jobs.model_dump_json()},
            start_new_session=True,  # Ctrl-C on a terminal goes to the server, which ends the executor itself
            limit=LONGEST_LINE,
        )
        self.pid, self.trouble = process.pid, ""
        log.info("executor started", pid=process.pid)
        reading = asyncio.create_task(_pass_on(process))
        try:
            return await process.wait()
        finally:
            if process.returncode is None:
                await asyncio.shield(self._end(process))
            self.pid = None
            await reading

    async def _end(self, process: asyncio.subprocess.Process) -> None:
        with contextlib.suppress(ProcessLookupError):
            process.terminate()
        try:
            async with asyncio.timeout(self._supervisor.stop_seconds):
                await process.wait()
        except TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()


async def _pass_on(process: asyncio.subprocess.Process) -> None:
    """Pass the process's log on, without credentials."""
    assert process.stderr is not None
    while data := await process.stderr.read(LONGEST_LINE):
        sys.stderr.write(mask(data.decode(errors="replace")))
