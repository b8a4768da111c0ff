"""A real server in its own process, which a test can kill and start again."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from types import TracebackType

import pytest


class ServerProcess:
    """``lightwell serve`` in an empty folder; the port stays the same over restarts."""

    def __init__(self, directory: Path) -> None:
        self.directory = directory
        self.url = ""
        self._port = 0
        self._process: subprocess.Popen[str] | None = None

    def __enter__(self) -> ServerProcess:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()

    def start(self) -> None:
        """Start it and wait for the line that says where it serves."""
        command = [sys.executable, "-m", "lightwell_server.cli", "serve", "--port", str(self._port), "--data", "data"]
        with (self.directory / "server.log").open("a") as log:
            self._process = subprocess.Popen(command, cwd=self.directory, stdout=subprocess.PIPE, stderr=log, text=True)
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if "http://" not in line:
            self.kill()
            pytest.fail(f"the server did not start:\n{(self.directory / 'server.log').read_text()}")
        self.url = line[line.index("http://") :].split()[0]
        self._port = int(self.url.rpartition(":")[2])

    def kill(self) -> None:
        """End it at once, as ``kill -9`` does."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            assert self._process.stdout is not None
            self._process.stdout.close()
            self._process = None
