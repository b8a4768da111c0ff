"""Follow a stream with asyncio."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Self

from websockets.asyncio.client import ClientConnection

from lightwell.conventions import Convention
from lightwell.wire import (
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
from lightwell_client.errors import LightTimeoutError
from lightwell_client.follow import DEFAULT_SERVER, Follower, socket_url
from lightwell_client.frames import LightFrame
from lightwell_client.inbox import Inbox


class AsyncLightStream(Follower):
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
    gradients
        True: frames say how their light changes beside the probe, where the stream measures that (`LightFrame.at`).
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
        gradients: bool = False,
        newest: bool = True,
        reconnect: bool = True,
        timeout: float | None = None,
        token: str | None = None,
        on_missed: Callable[[int], object] | None = None,
        on_status: Callable[[StreamStatus], object] | None = None,
        on_backdrop: Callable[[BackdropPicture], object] | None = None,
        on_connection: Callable[[bool], object] | None = None,
    ) -> None:
        wishes = {
            "bands": bands,
            "convention": convention,
            "max_fps": max_fps,
            "gradients": gradients or None,
            "backdrop": on_backdrop is not None,
        }
        super().__init__(
            stream, live_url(server, stream), wishes, reconnect=reconnect, token=token, on_connection=on_connection
        )
        self.stream = stream
        self._timeout = timeout
        self._on_missed = on_missed
        self._on_status = on_status
        self._on_backdrop = on_backdrop
        self._inbox = Inbox(newest=newest)
        self._taken = asyncio.Event()
        self._latest: LightFrame | None = None
        self.info: StreamInfo | None = None
        """Description of the stream, from the last hello."""
        self.status: StreamStatus | None = None
        """The source's last status."""

    @property
    def missed(self) -> int:
        """Frames that this program did not get so far, overtaken at the server or here."""
        return self._inbox.missed

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
        self,
        *,
        bands: int | None = None,
        convention: Convention | None = None,
        max_fps: float | None = None,
        gradients: bool | None = None,
    ) -> None:
        """Ask for something else without reconnecting; what is left out stays. It also holds after a reconnect."""
        wishes = {"bands": bands, "convention": convention, "max_fps": max_fps, "gradients": gradients}
        self._wishes |= {key: value for key, value in wishes.items() if value is not None}
        await self._send(encode(Subscribe(bands=bands, convention=convention, max_fps=max_fps, gradients=gradients)))

    def _take(self) -> LightFrame | None:
        self._require_entered()
        frame = self._inbox.take(self.info.mapping if self.info else "")
        self._taken.set()
        return frame

    async def _wait_for_room(self) -> None:
        while self._inbox.full:
            self._taken.clear()
            await self._taken.wait()

    async def _receive(self, connection: ClientConnection, data: bytes) -> None:
        match message := decode_live(data):
            case Frame():
                self._put(message)
            case Missed():
                self._inbox.put_missed(message.count)
                self._tell(self._on_missed, message.count)
            case Hello():
                self.info = message.stream
                self._greeted(connection, message.heartbeat_seconds)
                if message.latest is not None:
                    self._put(message.latest, from_hello=True)
            case StreamStatus():
                self.status = message
                self._tell(self._on_status, message)
            case Backdrop():
                self._tell(self._on_backdrop, BackdropPicture.from_wire(message))
            case Refused():
                await self._end_refused(connection, message.reason)

    def _put(self, frame: Frame, *, from_hello: bool = False) -> None:
        self._inbox.put(frame, time.time_ns(), from_hello=from_hello)
        self._arrived.set()


def live_url(server: str, stream: str) -> str:
    """Return the WebSocket URL on which ``stream`` is followed; raises ``ValueError`` where ``server`` is no URL."""
    return socket_url(server, "streams", stream)
