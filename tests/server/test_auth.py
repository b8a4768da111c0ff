"""Tokens, scopes and origins, on real sockets."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest
from starlette.requests import HTTPConnection
from tests.support.publisher import Publisher
from tests.support.server import problem, receive, running_server, subscribe

from lightwell.loopback import is_loopback_host
from lightwell.wire import CLOSE_UNAUTHORIZED, Hello, Refused
from lightwell_client import Field, RefusedError
from lightwell_server.auth import Auth, Scope
from lightwell_server.config import AuthSettings, ServerSettings
from lightwell_server.problems import Problem

TOKENS = {"read_tokens": ["r1", "r2"], "publish_tokens": ["p"], "admin_tokens": ["a"]}
STREAM = {"name": "hall", "settings": {"source": "exr:x"}}


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_server(tmp_path_factory.mktemp("data"), auth=TOKENS) as url:
        yield url


def bearer(token: str) -> dict[str, str]:
    return {"Authorization": f"Bearer {token}"}


@pytest.mark.parametrize("token", ["r1", "r2", "p", "a"])
def test_every_scope_may_read(guarded: str, token: str) -> None:
    assert httpx.get(f"{guarded}/api/v1/streams", headers=bearer(token)).status_code == 200
    assert httpx.get(f"{guarded}/api/v1/streams", params={"token": token}).status_code == 200


def test_without_a_token_or_with_a_wrong_one_there_is_a_problem(guarded: str) -> None:
    response = httpx.get(f"{guarded}/api/v1/streams")
    document = problem(response, 401, "unauthorized")
    assert "send Authorization: Bearer TOKEN" in document["detail"]
    assert response.headers["www-authenticate"] == "Bearer"
    document = problem(httpx.get(f"{guarded}/api/v1/streams", headers=bearer("wrong")), 401, "unauthorized")
    assert "wrong" not in document["detail"]


def test_reading_is_not_changing(guarded: str) -> None:
    for token in ("r1", "p"):
        response = httpx.post(f"{guarded}/api/v1/streams", json=STREAM, headers=bearer(token))
        assert "this needs admin" in problem(response, 403, "forbidden")["detail"]
    created = httpx.post(f"{guarded}/api/v1/streams", json=STREAM, headers=bearer("a"))
    assert created.status_code == 201
    assert "r1" not in created.text


def test_fields_have_the_scopes_of_streams(guarded: str) -> None:
    with Publisher(guarded, "lit", token="p") as worker:
        worker.publish(position=(0.0, 0.0, 1.0))
        body = {"name": "stage", "streams": ["lit"]}
        url = f"{guarded}/api/v1/fields"
        problem(httpx.get(url), 401, "unauthorized")
        for token in ("r1", "p"):
            problem(httpx.post(url, json=body, headers=bearer(token)), 403, "forbidden")
        assert httpx.post(url, json=body, headers=bearer("a")).status_code == 201
        assert httpx.get(f"{url}/stage", headers=bearer("r1")).json()["name"] == "stage"
        for change in (httpx.patch(f"{url}/stage", json={}, headers=bearer("p")), httpx.delete(f"{url}/stage")):
            assert change.status_code in (401, 403)
        with pytest.raises(RefusedError, match="token"), Field("stage", guarded, timeout=20) as field:
            field.next()
        with Field("stage", guarded, timeout=20, token="r1") as field:
            assert list(field.next().frames) == ["lit"]


def test_health_needs_no_token(guarded: str) -> None:
    assert httpx.get(f"{guarded}/healthz").status_code == 200
    assert httpx.get(f"{guarded}/metrics").status_code == 200


def test_sockets_say_why_they_refuse(guarded: str) -> None:
    for query in ("", "token=wrong"):
        light = subscribe(guarded, "hall", query)
        refusal = receive(light)
        assert isinstance(refusal, Refused)
        assert "token" in refusal.reason
        light.recv_events_thread.join()
        assert light.close_code == CLOSE_UNAUTHORIZED
    worker = Publisher(guarded, "hall", token="r1")
    assert isinstance(worker.first_reply, Refused)
    worker.close()
    with Publisher(guarded, "hall", token="p") as worker:
        assert worker.welcome
        for query in ("token=r1", "token=p"):
            light = subscribe(guarded, "hall", query)
            assert isinstance(receive(light), Hello)
            light.close()


@pytest.mark.parametrize(
    ("origin", "allowed"),
    [
        ("http://localhost:5173", True),
        ("http://127.0.0.1:9", True),
        ("https://stage.example", True),
        ("https://evil.example", False),
        ("http://localhost.evil.example", False),
        ("null", False),
    ],
)
def test_pages_of_other_sites_are_refused(tmp_path: Path, origin: str, allowed: bool) -> None:
    with running_server(tmp_path, server={"allowed_origins": ["https://stage.example"]}) as url, Publisher(url):
        response = httpx.get(f"{url}/api/v1/streams", headers={"Origin": origin})
        assert (response.status_code == 200) is allowed
        assert (response.headers.get("access-control-allow-origin") == origin) is allowed
        light = subscribe(url, origin=origin)
        assert isinstance(receive(light), Hello if allowed else Refused)
        light.close()


def connection(
    peer: str, token: str | None = None, origin: str | None = None, host: str = "lights.example"
) -> HTTPConnection:
    """Return a connection as the server sees it from ``peer``."""
    headers = [(b"host", host.encode())]
    headers += [(b"authorization", f"Bearer {token}".encode())] if token else []
    headers += [(b"origin", origin.encode())] if origin else []
    scope: dict[str, Any] = {"type": "http", "headers": headers, "query_string": b"", "client": (peer, 1)}
    return HTTPConnection(scope)


@pytest.mark.parametrize(
    ("peer", "origin", "scope", "allowed"),
    [
        ("127.0.0.1", None, Scope.ADMIN, True),
        ("::1", None, Scope.ADMIN, True),
        ("::ffff:127.0.0.1", None, Scope.PUBLISH, True),
        ("10.0.0.7", None, Scope.READ, True),
        ("10.0.0.7", None, Scope.PUBLISH, False),
        ("10.0.0.7", None, Scope.ADMIN, False),
        ("127.0.0.1", "http://localhost:8400", Scope.ADMIN, True),
        # A name that points to 127.0.0.1 makes a page same-origin; it gets what a stranger gets.
        ("127.0.0.1", "http://lights.example", Scope.ADMIN, False),
        ("127.0.0.1", "http://lights.example", Scope.READ, True),
    ],
)
def test_without_tokens_only_this_machine_may_publish_and_change(
    peer: str, origin: str | None, scope: Scope, allowed: bool
) -> None:
    auth = Auth(AuthSettings(), ServerSettings(host="0.0.0.0"))
    if allowed:
        auth.require(connection(peer, origin=origin), scope)
    else:
        with pytest.raises(Problem) as refused:
            auth.require(connection(peer, origin=origin), scope)
        assert refused.value.status == 401


@pytest.mark.parametrize(
    ("guarded_scopes", "here", "elsewhere"),
    [
        ("", Scope.ADMIN, Scope.READ),
        ("read", Scope.ADMIN, Scope.NONE),
        ("publish", Scope.ADMIN, Scope.READ),
        ("read publish", Scope.ADMIN, Scope.NONE),
        ("admin", Scope.PUBLISH, Scope.READ),
        ("read admin", Scope.PUBLISH, Scope.NONE),
        ("publish admin", Scope.READ, Scope.READ),
        ("read publish admin", Scope.NONE, Scope.NONE),
    ],
)
def test_each_scope_is_open_until_it_has_tokens(guarded_scopes: str, here: Scope, elsewhere: Scope) -> None:
    tokens = {f"{name}_tokens": ["t"] for name in guarded_scopes.split()}
    auth = Auth(AuthSettings.model_validate(tokens), ServerSettings(host="0.0.0.0"))

    def granted(peer: str) -> Scope:
        scope = Scope.NONE
        for wanted in (Scope.READ, Scope.PUBLISH, Scope.ADMIN):
            with contextlib.suppress(Problem):
                auth.require(connection(peer), wanted)
                scope = wanted
        return scope

    assert (granted("127.0.0.1"), granted("10.0.0.7")) == (here, elsewhere)


def test_a_wrong_token_is_refused_even_where_none_is_needed() -> None:
    auth = Auth(AuthSettings(), ServerSettings())
    with pytest.raises(Problem, match="not one of this server's"):
        auth.require(connection("127.0.0.1", token="wrong"), Scope.READ)


def test_the_embedded_workers_token_publishes_and_no_more() -> None:
    auth = Auth(AuthSettings.model_validate(TOKENS), ServerSettings())
    worker = connection("127.0.0.1", token=auth.worker_token)
    auth.require(worker, Scope.PUBLISH)
    assert auth.is_embedded(worker)
    assert not auth.is_embedded(connection("127.0.0.1", token="p"))
    with pytest.raises(Problem):
        auth.require(worker, Scope.ADMIN)


def test_listening_on_the_network_without_tokens_is_warned_of() -> None:
    auth = Auth(AuthSettings(), ServerSettings())
    assert auth.warnings("127.0.0.1") == []
    assert len(auth.warnings("0.0.0.0")) == 3
    guarded = Auth(AuthSettings.model_validate(TOKENS), ServerSettings())
    assert guarded.warnings("0.0.0.0") == []


@pytest.mark.parametrize(
    ("host", "loopback"),
    [("localhost", True), ("a.localhost", True), ("127.9.9.9", True), ("::1", True), ("10.0.0.1", False), ("x", False)],
)
def test_is_loopback(host: str, loopback: bool) -> None:
    assert is_loopback_host(host) is loopback
