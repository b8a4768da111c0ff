"""Runs the application on uvicorn: the listening socket, the options that matter, the order of shutting down."""

from __future__ import annotations

import asyncio
import errno
import socket
from pathlib import Path

import uvicorn

from lightwell.errors import LightwellError
from lightwell_server.app import create_app
from lightwell_server.config import Config
from lightwell_server.sockets import bounded_protocol, listen

KILOBYTE = 1024
GRACEFUL_SECONDS = 3


class ServeError(LightwellError):
    """The server cannot start: names the address and the remedy."""


class Server:
    """One server: bound when it is made, so that its URL is known before it runs."""

    def __init__(self, config: Config, page_directory: Path | None = None) -> None:
        """Bind the address; raises `ServeError` where that is not possible."""
        self._listener = _bind(config)
        host, self.port = config.server.host, int(self._listener.getsockname()[1])
        reachable = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}.get(host, host)  # noqa: S104, a comparison
        if ":" in reachable and not reachable.startswith("["):
            reachable = f"[{reachable}]"
        self.url = f"http://{reachable}:{self.port}"
        hub = config.hub
        self._uvicorn = uvicorn.Server(
            uvicorn.Config(
                create_app(config, self.url, page_directory),
                ws=bounded_protocol(hub.write_buffer_kb * KILOBYTE),
                ws_per_message_deflate=False,  # compressing costs more than it saves: frames are small, pictures JPEG
                ws_max_size=hub.max_message_kb * KILOBYTE,
                log_config=None,
                log_level="warning",
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=GRACEFUL_SECONDS,
                lifespan="on",
            )
        )

    @property
    def started(self) -> bool:
        """Whether the server answers."""
        return self._uvicorn.started

    def stop(self) -> None:
        """Ask the server to shut down; safe to call from any thread."""
        self._uvicorn.should_exit = True

    def run(self) -> None:
        """Serve until `stop` is called or a signal comes; raises `ServeError` where start-up fails."""
        try:
            with asyncio.Runner(loop_factory=self._uvicorn.config.get_loop_factory()) as runner:
                runner.run(self._uvicorn.serve([self._listener]))
        finally:
            self._listener.close()
        if not self._uvicorn.started:
            raise ServeError("the server did not start; the lines above say why")


def _bind(config: Config) -> socket.socket:
    host, port = config.server.host, config.server.port
    try:
        return listen(host, port, config.hub.socket_buffer_kb * KILOBYTE)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise ServeError(f"port {port} of {host} is in use: stop what uses it, or give another --port") from None
        raise ServeError(f"cannot listen on {host}:{port}: {error.strerror or error}") from None
