"""uvicorn's WebSocket protocol with a bound on what a client that does not read can hold.

Two things differ from uvicorn's own. The write buffer is small, so that "newest wins" begins after a few frames and not
after many kilobytes of old ones. And a connection that is closed while its peer does not read is aborted after a while,
where a plain close would wait for ever.

Of uvicorn's implementations this one costs least: with 300 subscribers at 30 frames a second (``bench/fanout.py``) the
server used 18 % of a core, and 21 % with the older one on the same library; latencies were the same.
"""

from __future__ import annotations

import asyncio
import socket
from asyncio.transports import BaseTransport

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol

ABORT_SECONDS = 2.0
"""Time a closing connection has to hand over what it has buffered."""


def bounded_protocol(write_buffer_bytes: int) -> type[WebSocketsSansIOProtocol]:
    """Return a protocol class for uvicorn's ``ws`` option whose connections buffer at most ``write_buffer_bytes``."""

    class BoundedProtocol(WebSocketsSansIOProtocol):
        abort_timer: asyncio.TimerHandle | None = None

        def connection_made(self, transport: BaseTransport) -> None:
            super().connection_made(transport)
            self.transport.set_write_buffer_limits(high=write_buffer_bytes)

        def on_task_complete(self, task: asyncio.Task[None]) -> None:
            super().on_task_complete(task)
            if not self.disconnected:
                self.abort_timer = self.loop.call_later(ABORT_SECONDS, self.transport.abort)

        def connection_lost(self, exc: Exception | None) -> None:
            super().connection_lost(exc)
            if self.abort_timer is not None:
                self.abort_timer.cancel()

    return BoundedProtocol


def listen(host: str, port: int, send_buffer_bytes: int) -> socket.socket:
    """Return a listening socket whose connections buffer about ``send_buffer_bytes`` in the kernel.

    Connections inherit the size. Raises ``OSError`` where the address cannot be bound.
    """
    family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
    listener = socket.socket(family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, send_buffer_bytes)
        listener.bind((host, port))
        listener.listen(1024)
    except BaseException:
        listener.close()
        raise
    return listener
