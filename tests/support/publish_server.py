"""A small server of the publish protocol, on a real socket, that keeps what workers send."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable
from types import TracebackType
from typing import Self

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from lightwell.wire import (
    SUBPROTOCOL,
    Announce,
    Backdrop,
    Configure,
    Frame,
    Refused,
    StreamStatus,
    Welcome,
    decode_worker,
    encode,
)


class PublishServer:
    """Runs on a thread of its own; a context manager. Read what arrived from any thread, or `wait_for` it."""

    def __init__(
        self,
        *,
        port: int = 0,
        token: str | None = None,
        welcome_settings: dict[str, object] | None = None,
        refuse: str | None = None,
        close_code: int = 1008,
        subprotocol: str = SUBPROTOCOL,
    ) -> None:
        self.port = port
        self.token = token
        self.welcome_settings = welcome_settings
        self.refuse = refuse
        self.close_code = close_code
        self.subprotocol = subprotocol
        self.announces: list[Announce] = []
        self.frames: list[Frame] = []
        self.backdrops: list[Backdrop] = []
        self.statuses: list[StreamStatus] = []
        self.paths: list[str] = []
        self._changed = threading.Condition()
        self._connections: set[ServerConnection] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="publish-server", daemon=True)
        self._server: Server | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def __enter__(self) -> Self:
        self._thread.start()
        self._call(self._start())
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def stop(self) -> None:
        """Cut every connection and stop listening, as a server that is killed."""
        if self._thread.is_alive():
            self._call(self._stop())
            self._loop.call_soon_threadsafe(self._loop.stop)
            self._thread.join()
            self._loop.close()

    def configure(self, settings: dict[str, object]) -> None:
        """Send a Configure to every worker."""
        self._call(self._send_all(encode(Configure(settings=settings))))

    def close_all(self, code: int, reason: str) -> None:
        """Close every connection in the orderly way."""
        self._call(self._close_all(code, reason))

    def pause_reading(self) -> None:
        """Take nothing from the sockets, as a server that hangs."""
        for connection in self._connections:
            self._loop.call_soon_threadsafe(connection.transport.pause_reading)

    def resume_reading(self) -> None:
        """Go on."""
        for connection in self._connections:
            self._loop.call_soon_threadsafe(connection.transport.resume_reading)

    def wait_for(self, condition: Callable[[PublishServer], bool], timeout: float = 20.0) -> None:
        """Wait until ``condition(self)`` holds; it is looked at after each message."""
        with self._changed:
            if not self._changed.wait_for(lambda: condition(self), timeout):
                raise AssertionError(
                    f"not reached: {len(self.frames)} frames, {len(self.backdrops)} backdrops, "
                    f"last status {self.statuses[-1:]}"
                )

    def _call(self, coroutine: object) -> None:
        asyncio.run_coroutine_threadsafe(coroutine, self._loop).result(10)  # type: ignore[arg-type]

    async def _start(self) -> None:
        self._server = await serve(
            self._handle, "127.0.0.1", self.port, subprotocols=[Subprotocol(self.subprotocol)], compression=None
        )
        self.port = self._server.sockets[0].getsockname()[1]

    async def _stop(self) -> None:
        assert self._server is not None
        for connection in list(self._connections):
            connection.transport.abort()
        self._server.close()
        await self._server.wait_closed()

    async def _close_all(self, code: int, reason: str) -> None:
        for connection in list(self._connections):
            await connection.close(code, reason)

    async def _send_all(self, data: bytes) -> None:
        for connection in self._connections:
            await connection.send(data)

    async def _handle(self, connection: ServerConnection) -> None:
        assert connection.request is not None
        with self._changed:
            self.paths.append(connection.request.path)
            self._changed.notify_all()
        reason = self.refuse
        if self.token is not None and connection.request.headers.get("Authorization") != f"Bearer {self.token}":
            reason = "the token is wrong"
        if reason is not None:
            await connection.send(encode(Refused(reason=reason)))
            await connection.close(self.close_code, reason)
            return
        self._connections.add(connection)
        try:
            async for data in connection:
                assert isinstance(data, bytes)
                await self._take(connection, data)
        except ConnectionClosed:
            pass
        finally:
            self._connections.discard(connection)

    async def _take(self, connection: ServerConnection, data: bytes) -> None:
        message = decode_worker(data)
        if isinstance(message, Announce):
            settings = self.welcome_settings or message.settings
            await connection.send(encode(Welcome(settings=settings, server_session="test")))
        with self._changed:
            for kind, kept in (
                (Announce, self.announces),
                (Frame, self.frames),
                (Backdrop, self.backdrops),
                (StreamStatus, self.statuses),
            ):
                if isinstance(message, kind):
                    kept.append(message)  # type: ignore[arg-type]
            self._changed.notify_all()
