"""Where tasks run: in this process, on processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import contextlib
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import TimeoutError as FutureTimeoutError
from typing import TYPE_CHECKING, Any

import structlog

from lightwell_workers.jobs.context import TaskCancelledError

if TYPE_CHECKING:
    from distributed import Client

log = structlog.get_logger("jobs")

POLL_SECONDS = 0.05
FETCH_SECONDS = 5.0
STOP_SECONDS = 1.5
"""Time that tasks have to notice that their job is to stop."""
CONNECT_SECONDS = 20


class ComputeLostError(Exception):
    """The cluster cannot be reached or started; it may be later."""


class InlineCompute:
    """Runs tasks on threads of this process; for jobs that are over before a process has been reached."""

    processes = 1

    def map(
        self, function: Callable[..., Any], items: Sequence[tuple[Any, ...]], check: Callable[[], None]
    ) -> Iterator[Any]:
        """Yield the results in order, one after the other."""
        for item in items:
            check()
            try:
                yield function(*item)
            except TaskCancelledError:
                check()
                raise


class DaskCompute:
    """Runs tasks on a Dask cluster, which is started or joined when the first task comes."""

    def __init__(self, scheduler: str, processes: int) -> None:
        self._scheduler = scheduler
        self.processes = processes or os.cpu_count() or 1
        self._client: Client | None = None
        self._lock = threading.Lock()

    def map(
        self, function: Callable[..., Any], items: Sequence[tuple[Any, ...]], check: Callable[[], None]
    ) -> Iterator[Any]:
        """Yield the results in order; a worker that dies is replaced and its tasks run again."""
        try:
            client = self._connect()
            futures = [client.submit(function, *item, pure=False, retries=2) for item in items]
        except Exception as error:
            # A process that dies while the cluster starts shows as any of a dozen errors.
            raise ComputeLostError(f"{type(error).__name__}: {error}") from error
        try:
            for future in futures:
                yield _wait(future, check)
                future.release()
        finally:
            unfinished = [future for future in futures if future.status == "pending"]
            if unfinished:
                with contextlib.suppress(Exception):
                    client.cancel(unfinished, force=True)

    def _connect(self) -> Client:
        from distributed import Client, LocalCluster

        with self._lock:
            if self._client is not None and self._client.status == "running":
                return self._client
            self._discard()
            if self._scheduler:
                self._client = Client(self._scheduler, timeout=CONNECT_SECONDS)
            else:
                cluster = LocalCluster(
                    n_workers=self.processes,
                    threads_per_worker=1,
                    host="127.0.0.1",
                    dashboard_address=None,
                    silence_logs=50,
                )
                self._client = Client(cluster, timeout=CONNECT_SECONDS)
            log.info("compute ready", scheduler=self._client.scheduler_info()["address"], processes=self.processes)
            return self._client

    def _discard(self) -> None:
        if self._client is None:
            return
        with contextlib.suppress(Exception):
            self._client.close(timeout=2)
        if self._client.cluster is not None:
            with contextlib.suppress(Exception):
                self._client.cluster.close(timeout=2)
        self._client = None

    def close(self) -> None:
        """End the processes that were started here."""
        with self._lock:
            self._discard()


def _wait(future: Any, check: Callable[[], None]) -> Any:  # noqa: ANN401
    """Return a future's result; ``check`` is called often and may raise.

    The result is asked for when it is there, and not with a short timeout over and over: on a busy machine such a
    timeout can hit `distributed` while it fetches the result, which then raises ``UnboundLocalError`` (2026.8,
    ``utils.sync``).
    """
    from distributed import TimeoutError as DaskTimeoutError

    while True:
        check()
        if not future.done():
            time.sleep(POLL_SECONDS)
            continue
        try:
            return future.result(timeout=FETCH_SECONDS)
        except TaskCancelledError:
            check()
            raise
        except (DaskTimeoutError, FutureTimeoutError):
            continue  # the worker that had it died; it is computed again
