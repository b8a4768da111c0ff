"""Real servers on free ports: one in a thread of the test process, one as a process of its own."""

from __future__ import annotations

import contextlib
import logging
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import structlog
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from lightwell.wire import SUBPROTOCOL, LiveMessage, decode_live
from lightwell_server.config import Config
from lightwell_server.runner import Server

WAIT_SECONDS = 60.0
"""Longest wait for anything; only a failing test waits so long."""


def make_config(data_dir: Path, **sections: Any) -> Config:
    """Return a configuration on a free port, without embedded workers unless asked for."""
    server = {"port": 0, "data_dir": data_dir} | sections.pop("server", {})
    supervisor = {"embedded": False} | sections.pop("supervisor", {})
    return Config(server=server, supervisor=supervisor, **sections)


@contextlib.contextmanager
def running_server(data_dir: Path, page: Path | None = None, **sections: Any) -> Iterator[str]:
    """Run a server in a thread and give its URL; it keeps its log to itself."""
    logging_before = structlog.get_config()
    structlog.configure(wrapper_class=structlog.make_filtering_bound_logger(logging.CRITICAL))
    server = Server(make_config(data_dir, **sections), page)
    thread = threading.Thread(target=server.run, name="server")
    thread.start()
    try:
        wait_until(lambda: server.started or not thread.is_alive())
        assert server.started
        yield server.url
    finally:
        server.stop()
        thread.join()
        structlog.configure(**logging_before)


@contextlib.contextmanager
def server_process(data_dir: Path, port: int = 0, **environment: str) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Run ``lightwell serve`` as a process and give its URL; it is killed at the end, if it still runs."""
    command = [sys.executable, "-m", "lightwell_server.cli", "serve", "--port", str(port), "--data", str(data_dir)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=os.environ | environment, cwd=data_dir
    ) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("Lightwell serves "), line
            yield line.split()[-1], process
        finally:
            process.kill()


def wait_until(condition: Callable[[], object]) -> None:
    """Wait until the condition holds."""
    deadline = time.monotonic() + WAIT_SECONDS
    while not condition():
        assert time.monotonic() < deadline, "waited too long"
        time.sleep(0.01)


def subscribe(server_url: str, stream: str = "probe", query: str = "", **options: Any) -> ClientConnection:
    """Return a live socket."""
    options = {"subprotocols": [Subprotocol(SUBPROTOCOL)], "compression": None, "legacy": True} | options
    url = f"{server_url.replace('http', 'ws', 1)}/api/v1/streams/{stream}/live?{query}"
    connection: ClientConnection = connect(url, **options)
    return connection


def receive(socket: ClientConnection, timeout: float = WAIT_SECONDS) -> LiveMessage:
    """Return the next message of a live socket."""
    data = socket.recv(timeout)
    assert isinstance(data, bytes)
    return decode_live(data)


def receive_of(socket: ClientConnection, kind: type[Any]) -> Any:
    """Return the next message of one kind; others are passed over."""
    while not isinstance(message := receive(socket), kind):
        pass
    return message


def problem(response: httpx.Response, status: int, kind: str) -> dict[str, Any]:
    """Return the problem document of a response, after checking what all of them have."""
    assert response.status_code == status, response.text
    assert response.headers["content-type"] == "application/problem+json"
    document: dict[str, Any] = response.json()
    assert document["type"] == f"urn:lightwell:problem:{kind}"
    assert document["status"] == status
    assert document["title"]
    assert document["detail"]
    return document
