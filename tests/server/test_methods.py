"""HTTP methods: HEAD beside GET, what a 405 allows, and WebSocket paths."""

from __future__ import annotations

from collections.abc import Iterator

import httpx
import pytest
from tests.support.server import problem, running_server


@pytest.fixture(scope="module", params=["with page", "without page"])
def site(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    folder = tmp_path_factory.mktemp("site")
    if request.param == "with page":
        (folder / "index.html").write_text("<!doctype html><title>page</title>")
    streams = {"hall": {"source": "exr:hall"}}
    with running_server(folder / "data", folder, streams=streams) as url:
        yield url


@pytest.mark.parametrize(
    "path",
    ["/", "/healthz", "/metrics", "/api/v1/healthz", "/api/v1/streams", "/api/v1/streams/hall", "/api/v1/openapi.json"],
)
def test_head_is_get_without_the_body(site: str, path: str) -> None:
    head, get = httpx.head(site + path), httpx.get(site + path)
    assert (head.status_code, head.content) == (200, b"")
    assert head.headers["content-type"] == get.headers["content-type"]


@pytest.mark.parametrize("name", ["healthz", "readyz", "metrics"])
def test_health_is_at_the_root_and_under_the_api(site: str, name: str) -> None:
    root, api = httpx.get(f"{site}/{name}"), httpx.get(f"{site}/api/v1/{name}")
    assert root.status_code == api.status_code
    assert root.headers["content-type"] == api.headers["content-type"]


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("PUT", "/api/v1/streams", "GET, HEAD, POST"),
        ("POST", "/api/v1/streams/hall", "GET, HEAD, PATCH, DELETE"),
        ("DELETE", "/api/v1/healthz", "GET, HEAD"),
        ("POST", "/healthz", "GET, HEAD"),
        ("POST", "/", "GET, HEAD"),
    ],
)
def test_a_wrong_method_learns_which_are_right(site: str, method: str, path: str, allowed: str) -> None:
    response = httpx.request(method, site + path)
    problem(response, 405, "method-not-allowed")
    assert response.headers["allow"] == allowed


@pytest.mark.parametrize("method", ["GET", "POST"])
@pytest.mark.parametrize("end", ["live", "publish"])
def test_a_websocket_asks_for_one(site: str, method: str, end: str) -> None:
    response = httpx.request(method, f"{site}/api/v1/streams/hall/{end}")
    assert "ws://" in problem(response, 426, "websocket-only")["detail"]
    assert response.headers["upgrade"] == "websocket"
