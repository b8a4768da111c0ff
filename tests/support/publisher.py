"""A worker that publishes what a test says, and nothing else."""

from __future__ import annotations

import contextlib
import time
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from lightwell.wire import (
    SUBPROTOCOL,
    Announce,
    Backdrop,
    Frame,
    Message,
    PublishReply,
    Quality,
    StreamStatus,
    Welcome,
    WindowUsed,
    decode_publish_reply,
    encode,
    pack_coefficients,
)

JPEG = b"\xff\xd8\xff\xe0 a picture"


def make_frame(seq: int = 0, *, stream: str = "probe", session: str = "s1", bands: int = 3, **changes: Any) -> Frame:
    """Return a valid frame whose first coefficient is ``seq``."""
    coefficients: ArrayLike = np.linspace(-1, 1, bands * bands * 3, dtype=np.float32).reshape(-1, 3)
    array = np.array(coefficients)
    array[0] = seq
    now = time.time_ns()
    values: dict[str, Any] = {
        "stream": stream,
        "session": session,
        "seq": seq,
        "capture_time_ns": now,
        "ingest_time_ns": now,
        "publish_time_ns": now,
        "bands": bands,
        "coefficients": pack_coefficients(array),
        "window": WindowUsed(kind="none", weights=[1.0] * bands),
        "quality": Quality(),
    }
    return Frame(**values | changes)


def make_status(state: str = "running", *, stream: str = "probe", session: str = "s1", **counters: Any) -> StreamStatus:
    """Return a status."""
    return StreamStatus(stream=stream, session=session, state=state, **counters)  # type: ignore[arg-type]


def make_backdrop(seq: int = 0, *, stream: str = "probe", session: str = "s1", jpeg: bytes = JPEG) -> Backdrop:
    """Return a backdrop."""
    return Backdrop(
        stream=stream,
        session=session,
        seq=seq,
        capture_time_ns=time.time_ns(),
        width=16,
        height=8,
        k=200.0,
        cap=512.0,
        jpeg=jpeg,
    )


class Publisher:
    """A publish socket, announced and welcomed."""

    def __init__(
        self,
        server_url: str,
        stream: str = "probe",
        session: str = "s1",
        settings: dict[str, Any] | None = None,
        token: str | None = None,
    ) -> None:
        self.stream = stream
        self.session = session
        self.sent = 0
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        self.socket: ClientConnection = connect(
            f"{server_url.replace('http', 'ws', 1)}/api/v1/streams/{stream}/publish",
            subprotocols=[Subprotocol(SUBPROTOCOL)],
            additional_headers=headers,
            compression=None,
            legacy=True,
        )
        announced = {"source": "exr:/pictures", "bands": 3} | (settings or {})
        with contextlib.suppress(ConnectionClosed):  # refused already; the reason is there to be read
            self.send(Announce(stream=stream, session=session, worker_version="0", settings=announced))
        self.first_reply = self.receive()

    @property
    def welcome(self) -> Welcome:
        """The server's answer to the announcement."""
        assert isinstance(self.first_reply, Welcome), self.first_reply
        return self.first_reply

    def send(self, message: Message) -> None:
        """Send any message."""
        self.socket.send(encode(message))

    def receive(self, timeout: float = 10.0) -> PublishReply:
        """Return the server's next message."""
        data = self.socket.recv(timeout)
        assert isinstance(data, bytes)
        return decode_publish_reply(data)

    def publish(self, **changes: Any) -> Frame:
        """Send the next frame and return it."""
        frame = make_frame(self.sent, stream=self.stream, session=self.session, **changes)
        self.send(frame)
        self.sent += 1
        return frame

    def close(self) -> None:
        """Leave."""
        self.socket.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
