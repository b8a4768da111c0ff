"""The worker's end of the publish socket: an asyncio client in a thread of its own.

Nothing the server does can block capture: the pipeline leaves messages in an `Outbox`, and a lossless stream alone
waits for room in it. A connection that breaks is made again after a pause that starts short and doubles, with jitter,
up to `LONGEST_PAUSE_SECONDS`, so that a restarted server sees frames within seconds.
"""

from __future__ import annotations

import asyncio
import contextlib
import random
import threading
import time
from collections.abc import Callable
from urllib.parse import quote, urlsplit, urlunsplit

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus, NegotiationError
from websockets.typing import Subprotocol

from lightwell.errors import SourceError
from lightwell.loopback import is_loopback
from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_POLICY,
    CLOSE_REPLACED,
    CLOSE_UNAUTHORIZED,
    CLOSE_WRONG_PROTOCOL,
    SUBPROTOCOL,
    Announce,
    Backdrop,
    Configure,
    Frame,
    Refused,
    StreamStatus,
    Welcome,
    decode_publish_reply,
    encode,
)
from lightwell_workers.ingest.log import stage_logger
from lightwell_workers.ingest.outbox import Message, Outbox

FIRST_PAUSE_SECONDS = 0.05
LONGEST_PAUSE_SECONDS = 2.0
OPEN_TIMEOUT_SECONDS = 5.0
PING_SECONDS = 2.0
PING_TIMEOUT_SECONDS = 5.0
"""A server that answers no ping for this long is dead, whatever its socket says."""

FINAL_CLOSE_CODES = {
    CLOSE_WRONG_PROTOCOL: "the server speaks another protocol version",
    CLOSE_POLICY: "the server's policy forbids it",
    CLOSE_NOT_FOUND: "the server has no such stream",
    CLOSE_UNAUTHORIZED: "the token is missing or wrong",
    CLOSE_REPLACED: "another worker has taken over the stream",
}
"""Close codes after which trying again would not help."""

FINAL_HTTP_STATUSES = {
    400: f"the server does not speak {SUBPROTOCOL}",
    401: FINAL_CLOSE_CODES[CLOSE_UNAUTHORIZED],
    403: FINAL_CLOSE_CODES[CLOSE_UNAUTHORIZED],
}
"""Answers to the opening handshake after which trying again would not help."""

log = stage_logger("publish")


class _RefusedError(Exception):
    """The server will not take this worker; trying again would not help."""


def publish_url(server_url: str, stream: str) -> str:
    """Return the WebSocket URL on which ``stream`` is published to the server at ``server_url`` (``http://…``).

    Raises
    ------
    SourceError
        Where the URL is no HTTP or WebSocket URL.
    """
    parts = urlsplit(server_url)
    scheme = {"http": "ws", "https": "wss", "ws": "ws", "wss": "wss"}.get(parts.scheme)
    if scheme is None or not parts.netloc:
        raise SourceError(f"server {server_url!r} is no URL such as http://127.0.0.1:8400")
    path = f"{parts.path.rstrip('/')}/api/v1/streams/{quote(stream, safe='')}/publish"
    return urlunsplit((scheme, parts.netloc, path, "", ""))


def pause_seconds(failures: int, jitter: float) -> float:
    """Return how long to wait after ``failures`` failed attempts in a row; ``jitter`` is in 0 … 1."""
    longest = min(FIRST_PAUSE_SECONDS * 2.0 ** min(failures, 16), LONGEST_PAUSE_SECONDS)
    return longest * (0.5 + 0.5 * jitter)


class Publisher:
    """Sends what the outbox holds to the server, for as long as it takes."""

    def __init__(
        self,
        url: str,
        token: str | None,
        announce: Callable[[], Announce],
        on_settings: Callable[[dict[str, object]], None],
        on_sent: Callable[[Frame], None],
        *,
        lossless: bool,
    ) -> None:
        """Prepare; nothing is sent before `start`.

        ``on_settings`` gets the settings of each Welcome and Configure, ``on_sent`` each frame that has been given to
        the socket. Both are called on threads of the publisher.
        """
        self._url = url
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._announce = announce
        self._on_settings = on_settings
        self._on_sent = on_sent
        self._outbox = Outbox(lossless=lossless)
        self._loop = asyncio.new_event_loop()
        self._something = asyncio.Event()
        self._draining = False
        self._published = 0
        self._connections = 0
        self._refused = ""
        self._error = ""
        self.finished = threading.Event()
        """Set when the publisher has ended: all is delivered, the server refused the worker, or it failed."""
        self._connecting = self._loop.create_task(self._keep_connected())
        self._thread = threading.Thread(target=self._run, name="publish", daemon=True)

    @property
    def overtaken(self) -> int:
        """Frames that a newer one replaced before they were sent."""
        return self._outbox.overtaken

    @property
    def published(self) -> int:
        """Frames given to the socket."""
        return self._published

    @property
    def reconnects(self) -> int:
        """Connections made after the first."""
        return max(self._connections - 1, 0)

    @property
    def refused(self) -> str:
        """Why no more can be published: the server will not have this worker, or it fails; empty while it may try."""
        return self._refused

    @property
    def error(self) -> str:
        """Why the last attempt to connect failed; empty while connected."""
        return self._error

    def start(self) -> None:
        """Start to connect and to send."""
        self._thread.start()

    def publish(self, frame: Frame) -> None:
        """Send a frame; its ``seq`` and ``publish_time_ns`` are set when it is given to the socket."""
        frame.publish_time_ns = time.time_ns()
        self._outbox.put_frame(frame)
        self._wake()

    def report(self, status: StreamStatus) -> None:
        """Send a status."""
        self._outbox.put_status(status)
        self._wake()

    def show(self, backdrop: Backdrop) -> None:
        """Send a backdrop."""
        self._outbox.put_backdrop(backdrop)
        self._wake()

    def drain(self) -> None:
        """Send what waits, then end; `finished` is set when that is done."""
        self._draining = True
        self._wake()

    def stop_waiting(self) -> None:
        """Let a lossless `publish` that waits for room return: the worker is to stop."""
        self._outbox.close()

    def close(self) -> bool:
        """End now; return True where everything had been delivered."""
        delivered = self.finished.is_set() and self._outbox.empty and not self._refused
        self._on_loop(self._connecting.cancel)
        self._thread.join()
        return delivered

    def _wake(self) -> None:
        self._on_loop(self._something.set)

    def _on_loop(self, function: Callable[[], object]) -> None:
        with contextlib.suppress(RuntimeError):  # the loop has ended: the server refused us
            self._loop.call_soon_threadsafe(function)

    def _run(self) -> None:
        try:
            self._loop.run_until_complete(self._connecting)
        except _RefusedError as refused:
            self._refused = str(refused)
            log.error("refused", reason=self._refused)
        except asyncio.CancelledError:
            log.warning("gave up", reason=self._error)
        except Exception as error:  # a live worker without a publisher would run on for nobody
            self._refused = str(error) or type(error).__name__
            log.error("failed", reason=self._refused, exc_info=error)
        finally:
            self._loop.close()
            self.finished.set()
            self._outbox.close()

    async def _keep_connected(self) -> None:
        failures = 0
        while True:
            connections = self._connections
            try:
                await self._serve_connection()
                return
            except (OSError, ConnectionClosed, TimeoutError, InvalidHandshake) as error:
                _raise_if_final(error)
                failures = 0 if self._connections > connections else failures + 1
                if failures <= 1:
                    log.warning("connection lost" if self._connections else "no connection", reason=str(error))
                self._error = f"server: {error}"
            if self._draining and self._outbox.empty:
                return
            await asyncio.sleep(pause_seconds(failures, random.random()))  # noqa: S311, not a secret

    async def _serve_connection(self) -> None:
        """Serve one connection; return where everything is sent and nothing more will come."""
        async with connect(
            self._url,
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            additional_headers=self._headers,
            proxy=None if is_loopback(self._url) else True,
            compression=None,
            open_timeout=OPEN_TIMEOUT_SECONDS,
            close_timeout=OPEN_TIMEOUT_SECONDS,
            ping_interval=PING_SECONDS,
            ping_timeout=PING_TIMEOUT_SECONDS,
            max_queue=16,
        ) as connection:
            if connection.subprotocol != SUBPROTOCOL:
                raise _RefusedError(f"{self._url} does not speak {SUBPROTOCOL}")
            await connection.send(encode(self._announce()))
            async with asyncio.timeout(OPEN_TIMEOUT_SECONDS):
                await self._take_reply(await connection.recv(), welcomed=False)
            self._connections += 1
            self._error = ""
            log.info("connected", url=self._url, reconnects=self.reconnects)
            receiving = asyncio.create_task(self._receive(connection))
            sending = asyncio.create_task(self._send(connection))
            try:
                done, _ = await asyncio.wait({receiving, sending}, return_when=asyncio.FIRST_COMPLETED)
                for task in done:
                    task.result()
            finally:
                for task in (receiving, sending):
                    task.cancel()
                await asyncio.gather(receiving, sending, return_exceptions=True)

    async def _receive(self, connection: ClientConnection) -> None:
        while True:
            await self._take_reply(await connection.recv(), welcomed=True)

    async def _take_reply(self, data: str | bytes, *, welcomed: bool) -> None:
        try:
            reply = decode_publish_reply(data if isinstance(data, bytes) else data.encode())
        except msgspec.MsgspecError as error:
            if not welcomed:
                raise _RefusedError(f"{self._url} answered with no message of {SUBPROTOCOL}: {error}") from error
            log.warning("message not understood", reason=str(error))
            return
        if isinstance(reply, Refused):
            if not welcomed:
                raise _RefusedError(reply.reason)
            self._error = f"server: {reply.reason}"
            log.warning("message refused", reason=reply.reason)
        elif isinstance(reply, Welcome | Configure):
            await asyncio.to_thread(self._on_settings, reply.settings)

    async def _send(self, connection: ClientConnection) -> None:
        while True:
            self._something.clear()
            while (message := self._outbox.take()) is not None:
                try:
                    await self._send_message(connection, message)
                except (ConnectionClosed, asyncio.CancelledError):  # it goes with the next connection
                    self._outbox.put_back(message)
                    raise
            if self._draining:
                return
            await self._something.wait()

    async def _send_message(self, connection: ClientConnection, message: Message) -> None:
        if not isinstance(message, Frame):
            await connection.send(encode(message))
            return
        queued_ns = message.publish_time_ns
        message.seq = self._published
        message.publish_time_ns = time.time_ns()
        message.quality.stage_ms["publish"] = (message.publish_time_ns - queued_ns) / 1e6
        await connection.send(encode(message))
        self._published += 1
        self._on_sent(message)


def _raise_if_final(error: Exception) -> None:
    if isinstance(error, ConnectionClosed) and error.rcvd is not None and error.rcvd.code in FINAL_CLOSE_CODES:
        raise _RefusedError(error.rcvd.reason or FINAL_CLOSE_CODES[error.rcvd.code]) from error
    if isinstance(error, InvalidStatus) and error.response.status_code in FINAL_HTTP_STATUSES:
        status = error.response.status_code
        raise _RefusedError(f"HTTP {status}: {FINAL_HTTP_STATUSES[status]}") from error
    if isinstance(error, NegotiationError):
        raise _RefusedError(str(error)) from error
