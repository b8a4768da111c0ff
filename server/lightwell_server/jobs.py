"""The queue of the server: opened when it is first used, so that those who run no jobs pay nothing."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import structlog

from lightwell.errors import LightwellError
from lightwell_server.config import Config
from lightwell_server.executor_process import ExecutorProcess

if TYPE_CHECKING:
    from lightwell_workers.jobs.queue import Queue

log = structlog.get_logger("jobs")

Result = TypeVar("Result")
RETENTION_PAUSE_SECONDS = 600.0


class Jobs:
    """The queue, and the executor beside the server."""

    def __init__(self, config: Config) -> None:
        self.settings = config.jobs
        self.executor = ExecutorProcess(config)
        self._data_dir = config.server.data_dir
        self.root = (self._data_dir / "jobs").absolute()
        self._queue: Queue | None = None
        self._opening = threading.Lock()
        self._retention: asyncio.Task[None] | None = None

    def start(self) -> None:
        """Go on with the jobs of an earlier run, where there was one."""
        if self.exists:
            self.executor.ensure()
        self._retention = asyncio.create_task(self._sweep())

    @property
    def exists(self) -> bool:
        """Whether there is a queue, of this run or an earlier one."""
        return self.in_use or bool(self.settings.database_url) or (self._data_dir / "jobs.sqlite").exists()

    async def close(self) -> None:
        """Close the connections and end the executor."""
        if self._retention is not None:
            self._retention.cancel()
        await self.executor.close()
        if self._queue is not None:
            await asyncio.to_thread(self._queue.close)

    async def call(self, use: Callable[[Queue], Result]) -> Result:
        """Return ``use(queue)``, called on a thread; raises what it raises, `QueueError` where there is no queue."""
        return await asyncio.to_thread(lambda: use(self._open()))

    @property
    def in_use(self) -> bool:
        """Whether this server has opened its queue."""
        return self._queue is not None

    def _open(self) -> Queue:
        with self._opening:
            if self._queue is None:
                from lightwell_workers.jobs.queue import Queue

                self._queue = Queue(self.settings, self._data_dir)
            return self._queue

    async def _sweep(self) -> None:
        """Delete what is older than the retention, now and then."""
        while True:
            if self.exists:
                with contextlib.suppress(LightwellError):
                    deleted = await self.call(lambda queue: queue.sweep(self.settings.retention_days))
                    if deleted:
                        log.info("old jobs deleted", count=len(deleted))
            await asyncio.sleep(RETENTION_PAUSE_SECONDS)
