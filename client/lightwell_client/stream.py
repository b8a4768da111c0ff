"""Follow a stream with asyncio."""

from __future__ import annotations

import asyncio
import contextlib
import random
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote, urlencode, urlsplit, urlunsplit

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.typing import Subprotocol

from lightwell.conventions import Convention
from lightwell.loopback import is_loopback
from lightwell.wire import (
    CLOSE_NOT_FOUND,
    HEARTBEAT_SECONDS,
    SUBPROTOCOL,
    Backdrop,
    Frame,
    Hello,
    Missed,
    Refused,
    StreamInfo,
    StreamStatus,
    Subscribe,
    decode_live,
    encode,
)
from lightwell_client.backdrop import BackdropPicture
from lightwell_client.errors import ConnectionLostError, LightTimeoutError, RefusedError
from lightwell_client.frames import LightFrame
from lightwell_client.inbox import Inbox

DEFAULT_SERVER = "http://127.0.0.1:8400"
PASSING_STATUSES = frozenset({408, 425, 429})
"""HTTP statuses below 500 after which the same request may succeed later."""
FIRST_PAUSE_SECONDS = 0.1
LONGEST_PAUSE_SECONDS = 2.0
OPEN_TIMEOUT_SECONDS = 5.0
SILENT_HEARTBEATS = 3
"""A server that has been silent for so many heartbeats is taken for dead."""


class AsyncLightStream:
    """The light of one stream, as it comes.

    An asynchronous context manager and iterator over `LightFrame`::

        async with AsyncLightStream("probe", bands=3, convention="three", on_status=print) as light:
            async for frame in light:
                relight(frame.coefficients)                # (9, 3) float32
                if frame.missed:
                    print(f"{frame.missed} frames were overtaken")

    Parameters
    ----------
    stream
        Name of the stream.
    server
        URL of the server, ``http://…`` or ``https://…``. Proxies that the environment names are used, but not for a
        server on this machine.
    bands, convention, max_fps
        What the server shall send: at most this many bands, in this convention, at most so often.
    newest
        True: a program that is slower than the stream gets the newest frame and is told how many it missed.
        False: it gets every frame that the server sends, in order.
    reconnect
        True: a lost connection is made again, for as long as it takes, and the iterator only waits. False: it raises
        `ConnectionLostError`.
    timeout
        Seconds to wait for a frame before `LightTimeoutError` is raised; None waits for ever.
    token
        For servers that ask for one.
    on_missed, on_status, on_backdrop, on_connection
        Called with a count, a `StreamStatus`, a `BackdropPicture`, and True or False as the connection comes and
        goes. They must return at once. Backdrops are asked for only where ``on_backdrop`` is given.

    Raises
    ------
    RefusedError
        Where the server refuses: a wrong name, token or parameter. Not for a stream that vanishes later: it may
        come back.
    """

    def __init__(
        self,
        stream: str,
        server: str = DEFAULT_SERVER,
        *,
        bands: int | None = None,
        convention: Convention = "lightwell",
        max_fps: float | None = None,
        newest: bool = True,
        reconnect: bool = True,
        timeout: float | None = None,
        token: str | None = None,
        on_missed: Callable[[int], object] | None = None,
        on_status: Callable[[StreamStatus], object] | None = None,
        on_backdrop: Callable[[BackdropPicture], object] | None = None,
        on_connection: Callable[[bool], object] | None = None,
    ) -> None:
        self.stream = stream
        self._wishes: dict[str, Any] = {"bands": bands, "convention": convention, "max_fps": max_fps}
        self._wishes["backdrop"] = on_backdrop is not None
        self._url = live_url(server, stream)
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._reconnect = reconnect
        self._timeout = timeout
        self._on_missed = on_missed
        self._on_status = on_status
        self._on_backdrop = on_backdrop
        self._on_connection = on_connection
        self._inbox = Inbox(newest=newest)
        self._arrived = asyncio.Event()
        self._taken = asyncio.Event()
        self._following: asyncio.Task[None] | None = None
        self._connection: ClientConnection | None = None
        self._welcomed = False
        self._latest: LightFrame | None = None
        self.info: StreamInfo | None = None
        """Description of the stream, from the last hello."""
        self.status: StreamStatus | None = None
        """The source's last status."""
        self.reconnects = 0
        """Connections after the first."""
        self.last_error = ""
        """Why the last connection ended."""

    @property
    def missed(self) -> int:
        """Frames that this program did not get so far, overtaken at the server or here."""
        return self._inbox.missed

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self._connection is not None

    async def __aenter__(self) -> Self:
        self._following = asyncio.create_task(self._follow(), name=f"follow {self.stream}")
        self._following.add_done_callback(lambda _: self._arrived.set())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._following is not None
        self._following.cancel()
        await asyncio.gather(self._following, return_exceptions=True)

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> LightFrame:
        return await self.next()

    async def next(self, within_seconds: float | None = None) -> LightFrame:
        """Return the next frame; ``within_seconds`` comes before the stream's own ``timeout``.

        Raises
        ------
        LightTimeoutError
            Where none came in time.
        RefusedError, ConnectionLostError
            As the class says.
        """
        seconds = self._timeout if within_seconds is None else within_seconds
        try:
            async with asyncio.timeout(seconds):
                while (frame := self._take()) is None:
                    self._raise_failure()
                    self._arrived.clear()
                    await self._arrived.wait()
                self._latest = frame
                return frame
        except TimeoutError:
            reason = f" ({self.last_error})" if self.last_error else ""
            raise LightTimeoutError(f"no frame of {self.stream!r} within {seconds:g} s{reason}") from None

    def latest(self) -> LightFrame | None:
        """Return the newest frame at once, for loops that draw at their own rate; None before the first.

        Raises as `next`, but for the time-out.
        """
        while (frame := self._take()) is not None:
            self._latest = frame
        self._raise_failure()
        return self._latest

    async def change(
        self, *, bands: int | None = None, convention: Convention | None = None, max_fps: float | None = None
    ) -> None:
        """Ask for something else without reconnecting; what is left out stays. It also holds after a reconnect."""
        wishes = {"bands": bands, "convention": convention, "max_fps": max_fps}
        self._wishes |= {key: value for key, value in wishes.items() if value is not None}
        if self._connection is not None:
            with contextlib.suppress(ConnectionClosed):
                await self._connection.send(encode(Subscribe(bands=bands, convention=convention, max_fps=max_fps)))

    def _take(self) -> LightFrame | None:
        if self._following is None:
            raise RuntimeError("use the stream as a context manager: async with AsyncLightStream(…) as light")
        frame = self._inbox.take(self.info.mapping if self.info else "")
        self._taken.set()
        return frame

    def _raise_failure(self) -> None:
        if self._following is not None and self._following.done():
            self._following.result()

    async def _follow(self) -> None:
        """Keep a connection; returns never, raises where the server refuses or no reconnection is wanted."""
        failures = 0
        while True:
            try:
                await self._serve_connection()
            except InvalidStatus as error:
                self._require_passing(error)
                self.last_error = str(error)
            except (OSError, TimeoutError, ConnectionClosed, InvalidHandshake, msgspec.MsgspecError) as error:
                self.last_error = str(error) or type(error).__name__
            finally:
                if self._connection is not None:
                    self._connection = None
                    failures = 0
                    self._tell(self._on_connection, False)
            if not self._reconnect:
                raise ConnectionLostError(f"no connection to {self._url}: {self.last_error}")
            longest = min(FIRST_PAUSE_SECONDS * 2.0**failures, LONGEST_PAUSE_SECONDS)
            failures = min(failures + 1, 16)
            await asyncio.sleep(longest * random.uniform(0.5, 1.0))  # noqa: S311, not a secret

    async def _serve_connection(self) -> None:
        wishes = {
            key: str(value).lower() if isinstance(value, bool) else value
            for key, value in self._wishes.items()
            if value is not None
        }
        async with connect(
            f"{self._url}?{urlencode(wishes)}",
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            additional_headers=self._headers,
            proxy=None if is_loopback(self._url) else True,
            compression=None,
            open_timeout=OPEN_TIMEOUT_SECONDS,
            close_timeout=1.0,
            ping_interval=None,  # the server's heartbeats prove that the connection lives
            max_size=None,
            max_queue=16,
        ) as connection:
            silence_seconds = HEARTBEAT_SECONDS * SILENT_HEARTBEATS
            while True:
                while self._inbox.full:
                    self._taken.clear()
                    await self._taken.wait()
                async with asyncio.timeout(silence_seconds):
                    data = await connection.recv()
                message = decode_live(data if isinstance(data, bytes) else data.encode())
                match message:
                    case Frame():
                        self._put(message)
                    case Missed():
                        self._inbox.put_missed(message.count)
                        self._tell(self._on_missed, message.count)
                    case Hello():
                        silence_seconds = message.heartbeat_seconds * SILENT_HEARTBEATS
                        self._greet(connection, message)
                    case StreamStatus():
                        self.status = message
                        self._tell(self._on_status, message)
                    case Backdrop():
                        self._tell(self._on_backdrop, BackdropPicture.from_wire(message))
                    case Refused():
                        await self._end_refused(connection, message.reason)

    def _greet(self, connection: ClientConnection, hello: Hello) -> None:
        self.info = hello.stream
        self.reconnects += self._welcomed
        self._welcomed = True
        self._connection = connection
        self.last_error = ""
        self._tell(self._on_connection, True)
        if hello.latest is not None:
            self._put(hello.latest, from_hello=True)

    def _put(self, frame: Frame, *, from_hello: bool = False) -> None:
        self._inbox.put(frame, time.time_ns(), from_hello=from_hello)
        self._arrived.set()

    async def _end_refused(self, connection: ClientConnection, reason: str) -> None:
        """Tell a refusal for good from one that may pass: a stream that was there may come back."""
        try:
            await connection.recv()
        except ConnectionClosed as closed:
            code = closed.rcvd.code if closed.rcvd else None
            passing = self._connection is not None or (code == CLOSE_NOT_FOUND and self._welcomed)
            if not passing:
                raise RefusedError(f"{self.stream}: {reason}") from None
            self.last_error = reason
            raise

    def _require_passing(self, error: InvalidStatus) -> None:
        """Raise `RefusedError` where an HTTP status says that the server has no such socket for us.

        Not where it was there before: a proxy may answer for a server that starts again.
        """
        status = error.response.status_code
        if 400 <= status < 500 and status not in PASSING_STATUSES and not self._welcomed:
            phrase = error.response.reason_phrase
            raise RefusedError(
                f"{self.stream}: {self._url} answers HTTP {status} {phrase}: check name and address"
            ) from None

    def _tell(self, callback: Callable[[Any], object] | None, value: object) -> None:
        if callback is not None:
            callback(value)


def live_url(server: str, stream: str) -> str:
    """Return the WebSocket URL on which ``stream`` is followed; raises ``ValueError`` where ``server`` is no URL."""
    parts = urlsplit(server)
    scheme = {"http": "ws", "https": "wss", "ws": "ws", "wss": "wss"}.get(parts.scheme)
    if scheme is None or not parts.netloc:
        raise ValueError(f"server {server!r} is no URL such as {DEFAULT_SERVER}")
    path = f"{parts.path.rstrip('/')}/api/v1/streams/{quote(stream, safe='')}/live"
    return urlunsplit((scheme, parts.netloc, path, "", ""))
