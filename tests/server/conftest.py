"""Fixtures: real servers on free ports."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from tests.support.server import running_server


@pytest.fixture(scope="module")
def shared_server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A server for the tests of one module that do not mind each other; each takes a stream name of its own."""
    page = tmp_path_factory.mktemp("page")
    with running_server(tmp_path_factory.mktemp("data"), page, hub={"heartbeat_seconds": 0.3}) as url:
        yield url


@pytest.fixture
def server(tmp_path: Path) -> Iterator[str]:
    """A server for one test."""
    with running_server(tmp_path / "data") as url:
        yield url


@pytest.fixture
def api(server: str) -> Iterator[httpx.Client]:
    """A client of the test's own server."""
    with httpx.Client(base_url=f"{server}/api/v1") as client:
        yield client
