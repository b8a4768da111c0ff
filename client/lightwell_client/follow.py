"""Keep a connection to a live socket: make it, notice when it is dead, make it again."""

from __future__ import annotations

import asyncio
import contextlib
import random
from abc import ABC, abstractmethod
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote, urlencode, urlsplit, urlunsplit

import msgspec
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.typing import Subprotocol

from lightwell.loopback import is_loopback
from lightwell.wire import CLOSE_NOT_FOUND, HEARTBEAT_SECONDS, SUBPROTOCOL
from lightwell_client.errors import ConnectionLostError, RefusedError

DEFAULT_SERVER = "http://127.0.0.1:8400"
PASSING_STATUSES = frozenset({408, 425, 429})
"""HTTP statuses below 500 after which the same request may succeed later."""
FIRST_PAUSE_SECONDS = 0.1
LONGEST_PAUSE_SECONDS = 2.0
OPEN_TIMEOUT_SECONDS = 5.0
SILENT_HEARTBEATS = 3
"""A server that has been silent for so many heartbeats is taken for dead."""


class Follower(ABC):
    """Follows one socket on a task of its own, as long as it is entered; what comes is a subclass's affair.

    Parameters
    ----------
    name
        What is followed.
    url
        Of the socket, without a query.
    wishes
        The query; None values are left out. Changes count from the next connection on.
    reconnect, token, on_connection
        As in `AsyncLightStream`.
    """

    def __init__(
        self,
        name: str,
        url: str,
        wishes: dict[str, Any],
        *,
        reconnect: bool,
        token: str | None,
        on_connection: Callable[[bool], object] | None,
    ) -> None:
        self._name = name
        self._wishes = wishes
        self._url = url
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}
        self._reconnect = reconnect
        self._on_connection = on_connection
        self._arrived = asyncio.Event()
        """Set when there may be something new to take, or following has ended."""
        self._following: asyncio.Task[None] | None = None
        self._connection: ClientConnection | None = None
        self._welcomed = False
        self._silence_seconds = HEARTBEAT_SECONDS * SILENT_HEARTBEATS
        self.reconnects = 0
        """Connections after the first."""
        self.last_error = ""
        """Why the last connection ended."""

    @property
    def connected(self) -> bool:
        """Whether there is a connection now."""
        return self._connection is not None

    async def __aenter__(self) -> Self:
        self._following = asyncio.create_task(self._follow(), name=f"follow {self._name}")
        self._following.add_done_callback(lambda _: self._arrived.set())
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._following is not None
        self._following.cancel()
        await asyncio.gather(self._following, return_exceptions=True)

    @abstractmethod
    async def _receive(self, connection: ClientConnection, data: bytes) -> None:
        """Take one message; calls `_greeted` and `_end_refused` where it is one of those."""

    @abstractmethod
    async def _wait_for_room(self) -> None:
        """Wait until another message can be taken."""

    def _require_entered(self) -> None:
        if self._following is None:
            kind = type(self).__name__
            raise RuntimeError(f"use it as a context manager: async with {kind}(…) as light")

    def _raise_failure(self) -> None:
        if self._following is not None and self._following.done():
            self._following.result()

    async def _send(self, data: bytes) -> None:
        """Send while there is a connection."""
        if self._connection is not None:
            with contextlib.suppress(ConnectionClosed):
                await self._connection.send(data)

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
            self._silence_seconds = HEARTBEAT_SECONDS * SILENT_HEARTBEATS
            while True:
                await self._wait_for_room()
                async with asyncio.timeout(self._silence_seconds):
                    data = await connection.recv()
                await self._receive(connection, data if isinstance(data, bytes) else data.encode())

    def _greeted(self, connection: ClientConnection, heartbeat_seconds: float) -> None:
        """Note that the server has said hello."""
        self._silence_seconds = heartbeat_seconds * SILENT_HEARTBEATS
        self.reconnects += self._welcomed
        self._welcomed = True
        self._connection = connection
        self.last_error = ""
        self._tell(self._on_connection, True)

    async def _end_refused(self, connection: ClientConnection, reason: str) -> None:
        """Tell a refusal for good from one that may pass: what was there may come back."""
        try:
            await connection.recv()
        except ConnectionClosed as closed:
            code = closed.rcvd.code if closed.rcvd else None
            passing = self._connection is not None or (code == CLOSE_NOT_FOUND and self._welcomed)
            if not passing:
                raise RefusedError(f"{self._name}: {reason}") from None
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
                f"{self._name}: {self._url} answers HTTP {status} {phrase}: check name and address"
            ) from None

    def _tell(self, callback: Callable[[Any], object] | None, value: object) -> None:
        if callback is not None:
            callback(value)


def socket_url(server: str, kind: str, name: str) -> str:
    """Return the URL of the live socket of a stream or field; raises ``ValueError`` where ``server`` is no URL.

    ``kind`` is ``streams`` or ``fields``.
    """
    parts = urlsplit(server)
    scheme = {"http": "ws", "https": "wss", "ws": "ws", "wss": "wss"}.get(parts.scheme)
    if scheme is None or not parts.netloc:
        raise ValueError(f"server {server!r} is no URL such as {DEFAULT_SERVER}")
    path = f"{parts.path.rstrip('/')}/api/v1/{kind}/{quote(name, safe='')}/live"
    return urlunsplit((scheme, parts.netloc, path, "", ""))
