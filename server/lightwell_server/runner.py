"""Runs the application on uvicorn: the listening socket, the options that matter, the order of shutting down."""

from __future__ import annotations

import asyncio
import errno
import socket
from collections.abc import Awaitable, Callable
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


class _Uvicorn(uvicorn.Server):
    """Ends what runs in the application before its connections: workers say goodbye, subscribers learn why."""

    def __init__(self, config: uvicorn.Config, wind_down: Callable[[], Awaitable[None]]) -> None:
        super().__init__(config)
        self._wind_down = wind_down

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Wind the application down, then close what is open."""
        await self._wind_down()
        await super().shutdown(sockets)


class Server:
    """One server: bound when it is made, so that its URL is known before it runs."""

    def __init__(self, config: Config, page_directory: Path | None = None) -> None:
        """Bind the address and open the data; raises `ServeError` or `ConfigError` where that is not possible."""
        self._listener = _bind(config)
        host, self.port = config.server.host, int(self._listener.getsockname()[1])
        reachable = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}.get(host, host)  # noqa: S104, a comparison
        if ":" in reachable and not reachable.startswith("["):
            reachable = f"[{reachable}]"
        self.url = f"http://{reachable}:{self.port}"
        try:
            app = create_app(config, self.url, page_directory)
        except BaseException:
            self._listener.close()
            raise
        hub = config.hub
        self._uvicorn = _Uvicorn(
            uvicorn.Config(
                app,
                ws=bounded_protocol(hub.write_buffer_kb * KILOBYTE),
                ws_per_message_deflate=False,  # compressing costs more than it saves: frames are small, pictures JPEG
                ws_max_size=hub.max_message_kb * KILOBYTE,
                log_config=None,
                log_level="warning",
                access_log=False,
                server_header=False,
                timeout_graceful_shutdown=GRACEFUL_SECONDS,
                lifespan="on",
            ),
            wind_down=lambda: app.state.services.wind_down(),
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
