"""Asynchronous followers from ordinary, blocking code: a thread of their own runs them."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Coroutine
from types import TracebackType
from typing import Any, Self, TypeVar

from lightwell_client.follow import Follower

Result = TypeVar("Result")


class Blocking:
    """A context manager that runs a follower; subclasses call it."""

    def __init__(self, follower: Follower, name: str) -> None:
        self.__follower = follower
        self.__name = name
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self.__follower.connected

    @property
    def reconnects(self) -> int:
        """Connections after the first."""
        return self.__follower.reconnects

    @property
    def last_error(self) -> str:
        """Why the last connection ended; empty while there is one."""
        return self.__follower.last_error

    def __enter__(self) -> Self:
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name=f"light {self.__name}", daemon=True)
        self._thread.start()
        self._call(self.__follower.__aenter__())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._loop is not None
        assert self._thread is not None
        self._call(self.__follower.__aexit__(None, None, None))
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()
        self._loop = None

    def _call(self, coroutine: Coroutine[Any, Any, Result]) -> Result:
        if self._loop is None:
            coroutine.close()
            raise RuntimeError(f"use it as a context manager: with {type(self).__name__}(…) as light")
        future = asyncio.run_coroutine_threadsafe(coroutine, self._loop)
        try:
            return future.result()
        except KeyboardInterrupt:
            future.cancel()
            raise
