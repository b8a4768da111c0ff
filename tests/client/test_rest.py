"""The REST client against a real server."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from tests.support.proxies import set_dead_proxies
from tests.support.publisher import Publisher
from tests.support.server import running_server, wait_until

from lightwell_client import ConnectionLostError, Lightwell, ProblemError


@pytest.fixture
def lightwell(tmp_path: Path) -> Iterator[tuple[str, Lightwell]]:
    with running_server(tmp_path) as url, Lightwell(url) as client:
        yield url, client


def test_the_life_of_a_stream(lightwell: tuple[str, Lightwell]) -> None:
    url, client = lightwell
    assert client.streams() == []
    created = client.create("hall", {"source": "exr:x", "bands": 3, "enabled": False})
    assert (created.name, created.origin, created.state, created.settings["bands"]) == ("hall", "api", "stopped", 3)
    assert client.update("hall", {"filter": {"tau_seconds": 0.7}}).settings["filter"]["tau_seconds"] == 0.7
    assert client.update("hall", {"filter": None}).settings["filter"]["tau_seconds"] == 0.1
    assert [stream.name for stream in client.streams()] == ["hall"]
    assert client.stream("hall").worker is None
    with pytest.raises(ProblemError) as early:
        client.latest("hall")
    assert early.value.kind == "urn:lightwell:problem:no-frame-yet"
    with Publisher(url, "hall") as worker:
        worker.publish()
        wait_until(lambda: client.stream("hall").frames_received == 1)
        latest = client.latest("hall", convention="three", bands=2)
        assert latest.coefficients.shape == (4, 3)
        assert latest.coefficients.dtype == np.dtype(np.float32)
        assert (latest.convention, latest.mapping, latest.window) == ("three", "latlong", "none")
    client.delete("hall")
    assert client.streams() == []


def test_problems_are_raised_with_all_they_say(lightwell: tuple[str, Lightwell]) -> None:
    _, client = lightwell
    with pytest.raises(ProblemError, match="there is no stream 'nowhere'") as missing:
        client.latest("nowhere")
    assert missing.value.status == 404
    with pytest.raises(ProblemError) as invalid:
        client.create("hall", {"source": "exr:x", "bands": 99})
    assert (invalid.value.status, invalid.value.kind) == (422, "urn:lightwell:problem:invalid-input")
    assert invalid.value.errors == [{"field": "settings.bands", "message": "99: must be less than or equal to 8"}]


def test_no_proxy_stands_before_a_server_on_this_machine(
    lightwell: tuple[str, Lightwell], monkeypatch: pytest.MonkeyPatch
) -> None:
    set_dead_proxies(monkeypatch)
    with Lightwell(lightwell[0]) as client:
        assert client.is_alive()


def test_health(lightwell: tuple[str, Lightwell]) -> None:
    _, client = lightwell
    assert client.is_alive()
    assert client.readiness().ready
    client.create("hall", {"source": "exr:x"})
    readiness = client.readiness()
    assert not readiness.ready
    assert readiness.reasons == ["stream hall: no frame yet (stopped)"]


def test_no_answer_is_an_error_of_its_own() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with Lightwell(f"http://127.0.0.1:{port}") as client:
        assert not client.is_alive()
        with pytest.raises(ConnectionLostError, match="no answer from"):
            client.streams()


def test_a_server_of_another_kind_is_a_problem_without_a_document(tmp_path: Path) -> None:
    with running_server(tmp_path) as url, Lightwell(f"{url}/elsewhere/") as client:
        with pytest.raises(ProblemError) as problem:
            client.streams()
        assert problem.value.status == 404
