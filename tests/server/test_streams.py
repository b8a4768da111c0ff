"""The REST routes of streams, through real sockets."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from tests.support.publisher import Publisher
from tests.support.server import problem, running_server

from lightwell.sh.engines import convert
from lightwell.wire import Configure, unpack_coefficients
from lightwell_server.routes.schema import Latest, StreamDescription, StreamList

HALL = {"source": "exr:/data/hall?fps=30", "bands": 4}


def create(api: httpx.Client, name: str = "hall", **settings: Any) -> dict[str, Any]:
    response = api.post("/streams", json={"name": name, "settings": HALL | settings})
    assert response.status_code == 201, response.text
    described: dict[str, Any] = response.json()
    return described


def test_create_describe_list_delete(api: httpx.Client) -> None:
    response = api.post("/streams", json={"name": "hall", "settings": HALL})
    assert response.status_code == 201
    assert response.headers["location"] == "/api/v1/streams/hall"
    created = StreamDescription.model_validate(response.json())
    assert (created.name, created.origin, created.settings.bands, created.state) == ("hall", "api", 4, "stopped")
    create(api, "attic")
    listed = StreamList.model_validate(api.get("/streams").json())
    assert [stream.name for stream in listed.streams] == ["attic", "hall"]
    assert api.delete("/streams/hall").status_code == 204
    assert problem(api.get("/streams/hall"), 404, "no-such-stream")["detail"] == (
        "there is no stream 'hall'; there are: attic"
    )
    problem(api.delete("/streams/hall"), 404, "no-such-stream")


def test_a_name_that_is_taken_is_a_conflict(api: httpx.Client) -> None:
    create(api)
    document = problem(api.post("/streams", json={"name": "hall", "settings": HALL}), 409, "stream-exists")
    assert document["instance"] == "/api/v1/streams"


@pytest.mark.parametrize(
    ("body", "field", "message"),
    [
        ({"name": "Hall", "settings": HALL}, "name", "'Hall' is no stream name"),
        ({"name": "hall"}, "settings", "is missing: it has no default"),
        ({"name": "hall", "settings": {}}, "settings.source", "is missing: it has no default"),
        ({"name": "hall", "settings": HALL | {"bands": 12}}, "settings.bands", "12: must be less than or equal to 8"),
        ({"name": "hall", "settings": HALL | {"band": 2}}, "settings.band", "is no option: check its spelling"),
        (
            {"name": "hall", "settings": HALL | {"mapping": {"kind": "ball"}}},
            "settings.mapping.kind",
            "'ball': must be 'latlong', 'mirror-sphere'",
        ),
        ({"name": "hall", "settings": HALL, "more": 1}, "more", "is no option: check its spelling"),
    ],
)
def test_bad_settings_are_named_with_value_and_remedy(
    api: httpx.Client, body: dict[str, Any], field: str, message: str
) -> None:
    document = problem(api.post("/streams", json=body), 422, "invalid-input")
    (error,) = document["errors"]
    assert error["field"] == field
    assert message in error["message"]
    assert field in document["detail"]


@pytest.mark.parametrize(
    ("body", "detail"),
    [
        (b"", "body: is missing: it has no default"),
        (b"[]", "body: []: must be an object, a table of keys and values"),
    ],
)
def test_a_body_that_is_no_object_is_named(api: httpx.Client, body: bytes, detail: str) -> None:
    headers = {"Content-Type": "application/json"}
    create(api)
    for response in (
        api.post("/streams", content=body, headers=headers),
        api.patch("/streams/hall", content=body, headers=headers),
    ):
        document = problem(response, 422, "invalid-input")
        assert document["detail"] == detail
        assert document["errors"][0]["field"] == "body"


@pytest.mark.parametrize("headers", [{}, {"Content-Type": "text/plain"}])
def test_a_body_of_another_type_is_refused(api: httpx.Client, headers: dict[str, str]) -> None:
    create(api)
    for response in (
        api.post("/streams", content=b'{"name": "x"}', headers=headers),
        api.patch("/streams/hall", content=b"{}", headers=headers),
    ):
        assert "send Content-Type: application/json" in problem(response, 415, "not-json")["detail"]
    merge = {"Content-Type": "application/merge-patch+json"}
    assert api.patch("/streams/hall", content=b'{"bands": 2}', headers=merge).json()["settings"]["bands"] == 2


def test_a_merge_patch_changes_what_it_names_and_null_restores_a_default(api: httpx.Client) -> None:
    create(api, filter={"kind": "tau", "tau_seconds": 0.5})
    patched = api.patch("/streams/hall", json={"bands": 3, "filter": {"cut_threshold": 0.2}}).json()["settings"]
    assert (patched["bands"], patched["filter"]["tau_seconds"], patched["filter"]["cut_threshold"]) == (3, 0.5, 0.2)
    patched = api.patch("/streams/hall", json={"filter": {"tau_seconds": None}}).json()["settings"]
    assert (patched["filter"]["tau_seconds"], patched["filter"]["cut_threshold"]) == (0.1, 0.2)
    patched = api.patch("/streams/hall", json={"filter": None}).json()["settings"]
    assert patched["filter"]["cut_threshold"] == 0.0


def test_a_patch_that_is_not_valid_changes_nothing(api: httpx.Client) -> None:
    before = create(api)
    document = problem(api.patch("/streams/hall", json={"bands": 3, "gain": -1}), 422, "invalid-input")
    assert document["errors"] == [{"field": "gain", "message": "-1: must be greater than 0"}]
    problem(api.patch("/streams/hall", json={"source": None}), 422, "invalid-input")
    problem(api.patch("/streams/hall", json=[1]), 422, "invalid-input")
    assert api.get("/streams/hall").json() == before
    problem(api.patch("/streams/hallo", json={}), 404, "no-such-stream")


def test_an_etag_guards_against_overwriting(api: httpx.Client) -> None:
    create(api)
    etag = api.get("/streams/hall").headers["etag"]
    changed = api.patch("/streams/hall", json={"bands": 3}, headers={"If-Match": etag})
    assert changed.status_code == 200
    assert changed.headers["etag"] != etag
    problem(api.patch("/streams/hall", json={"bands": 2}, headers={"If-Match": etag}), 412, "changed-meanwhile")
    assert api.get("/streams/hall").json()["settings"]["bands"] == 3


def test_an_etag_names_the_settings_not_their_history(api: httpx.Client) -> None:
    create(api)
    first = api.get("/streams/hall").headers["etag"]
    other = api.patch("/streams/hall", json={"bands": 3}).headers["etag"]
    back = api.patch("/streams/hall", json={"bands": 4}, headers={"If-Match": f'"x", {other}'})
    assert back.headers["etag"] == first
    problem(api.delete("/streams/hall", headers={"If-Match": f'{other}, "x"'}), 412, "changed-meanwhile")
    problem(api.delete("/streams/hall", headers={"If-Match": f"W/{first}"}), 412, "changed-meanwhile")
    assert api.delete("/streams/hall", headers={"If-Match": first}).status_code == 204
    recreated = api.post("/streams", json={"name": "hall", "settings": HALL | {"bands": 2}})
    assert recreated.headers["etag"] not in (first, other)
    assert api.patch("/streams/hall", json={}, headers={"If-Match": "*"}).status_code == 200


def test_credentials_never_leave_and_survive_a_round_trip(api: httpx.Client, server: str) -> None:
    secret = "video:rtsp://anna:hush@camera/live"
    create(api, source=secret, enabled=False)
    described = api.get("/streams/hall")
    assert "hush" not in described.text + api.get("/streams").text
    masked = described.json()["settings"]
    patched = api.patch("/streams/hall", json=masked | {"bands": 2})
    assert patched.status_code == 200
    with Publisher(server, "hall", settings={"source": secret}) as worker:
        assert worker.welcome.settings["source"] == secret
        assert worker.welcome.settings["bands"] == 2


def test_streams_survive_a_restart(tmp_path: Path) -> None:
    with running_server(tmp_path) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
        create(api)
        create(api, "attic")
        api.patch("/streams/hall", json={"bands": 2}).raise_for_status()
        api.delete("/streams/attic").raise_for_status()
    with running_server(tmp_path) as url:
        (stream,) = httpx.get(f"{url}/api/v1/streams").json()["streams"]
        assert (stream["name"], stream["origin"], stream["settings"]["bands"], stream["revision"]) == (
            "hall",
            "api",
            2,
            2,
        )


def test_the_api_wins_over_the_file_until_it_is_deleted(tmp_path: Path) -> None:
    streams = {"hall": HALL}
    with running_server(tmp_path, streams=streams) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
        assert api.get("/streams/hall").json()["origin"] == "file"
        document = problem(api.delete("/streams/hall"), 409, "stream-in-file")
        assert "remove it there" in document["detail"]
        problem(api.post("/streams", json={"name": "hall", "settings": HALL}), 409, "stream-exists")
        api.patch("/streams/hall", json={"bands": 2}).raise_for_status()
    with running_server(tmp_path, streams=streams) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
        stream = api.get("/streams/hall").json()
        assert (stream["origin"], stream["settings"]["bands"]) == ("api", 2)
        restored = api.delete("/streams/hall")
        assert restored.status_code == 200
        assert (restored.json()["origin"], restored.json()["settings"]["bands"]) == ("file", 4)


def test_a_stored_stream_that_is_no_longer_valid_does_not_stop_the_server(tmp_path: Path) -> None:
    import sqlite3

    with running_server(tmp_path) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
        create(api)
    connection = sqlite3.connect(tmp_path / "lightwell.sqlite")
    connection.execute("UPDATE streams SET settings = '{\"bands\": 99}'")
    connection.commit()
    connection.close()
    with running_server(tmp_path) as url:
        assert httpx.get(f"{url}/api/v1/streams").json() == {"streams": []}


def test_a_patch_reaches_the_worker(api: httpx.Client, server: str) -> None:
    create(api)
    with Publisher(server, "hall", settings={"source": "exr:/mine"}) as worker:
        assert worker.welcome.settings["bands"] == 4
        assert worker.welcome.settings["source"] == "exr:/mine"
        api.patch("/streams/hall", json={"filter": {"tau_seconds": 0.7}}).raise_for_status()
        configured = worker.receive()
        assert isinstance(configured, Configure)
        assert configured.settings["filter"]["tau_seconds"] == 0.7


def test_latest_is_what_watch_prints(api: httpx.Client, server: str) -> None:
    create(api, bands=3)
    document = problem(api.get("/streams/hall/latest"), 404, "no-frame-yet")
    assert "stopped" in document["detail"]
    with Publisher(server, "hall") as worker:
        published = worker.publish()
        while (response := api.get("/streams/hall/latest")).status_code == 404:
            pass
        body = Latest.model_validate(response.json())
        packed = unpack_coefficients(published.coefficients)
        np.testing.assert_array_equal(np.array(body.coefficients, np.float32), packed)
        assert (body.seq, body.mapping, body.window, body.missed) == (0, "latlong", "none", 0)
        three = api.get("/streams/hall/latest", params={"convention": "three", "bands": 2}).json()
        np.testing.assert_allclose(three["coefficients"], convert(packed[:4], "three"), rtol=1e-6)
        assert (three["convention"], three["bands"]) == ("three", 2)
    for query in ({"convention": "maya"}, {"bands": 9}, {"bands": "x"}):
        document = problem(api.get("/streams/hall/latest", params=query), 422, "invalid-input")
        assert document["errors"][0]["field"] == next(iter(query))


def test_a_worker_may_bring_a_stream_that_nobody_configured(api: httpx.Client, server: str) -> None:
    with Publisher(server, "roof", settings={"bands": 2}):
        stream = api.get("/streams/roof").json()
        assert (stream["origin"], stream["settings"]["bands"], stream["settings"]["enabled"]) == ("worker", 2, False)
    assert api.delete("/streams/roof").status_code == 204


def test_every_error_is_a_problem_document(api: httpx.Client, server: str) -> None:
    problem(api.get("/nothing"), 404, "not-found")
    problem(httpx.get(f"{server}/nothing.html"), 404, "not-found")
    document = problem(api.put("/streams", json={}), 405, "method-not-allowed")
    assert "allowed: GET, HEAD, POST" in document["detail"]
    bad = api.post("/streams", content=b"{", headers={"Content-Type": "application/json"})
    assert "no valid JSON" in problem(bad, 400, "invalid-json")["detail"]
    large = {"name": "x", "settings": {"source": "y" * 300_000}}
    problem(api.post("/streams", json=large), 413, "body-too-large")

    def pieces() -> Any:
        for _ in range(40):
            yield b" " * 10_000

    problem(api.post("/streams", content=pieces()), 413, "body-too-large")


def test_openapi_describes_every_route(api: httpx.Client) -> None:
    document = api.get("/openapi.json").json()
    methods = {(path, method) for path, item in document["paths"].items() for method in item}
    assert methods == {
        ("/api/v1/healthz", "get"),
        ("/api/v1/readyz", "get"),
        ("/api/v1/metrics", "get"),
        ("/api/v1/streams", "get"),
        ("/api/v1/streams", "post"),
        ("/api/v1/streams/{name}", "get"),
        ("/api/v1/streams/{name}", "patch"),
        ("/api/v1/streams/{name}", "delete"),
        ("/api/v1/streams/{name}/latest", "get"),
        ("/api/v1/fields", "get"),
        ("/api/v1/fields", "post"),
        ("/api/v1/fields/{name}", "get"),
        ("/api/v1/fields/{name}", "patch"),
        ("/api/v1/fields/{name}", "delete"),
        ("/api/v1/fields/{name}/sample", "get"),
        ("/api/v1/job-kinds", "get"),
        ("/api/v1/jobs", "get"),
        ("/api/v1/jobs", "post"),
        ("/api/v1/jobs/{job}", "get"),
        ("/api/v1/jobs/{job}", "delete"),
        ("/api/v1/jobs/{job}/cancel", "post"),
        ("/api/v1/jobs/{job}/retry", "post"),
        ("/api/v1/jobs/{job}/log", "get"),
        ("/api/v1/jobs/{job}/events", "get"),
        ("/api/v1/jobs/{job}/preview", "get"),
        ("/api/v1/captures", "get"),
        ("/api/v1/captures", "post"),
        ("/api/v1/captures/{capture}", "get"),
        ("/api/v1/captures/{capture}", "delete"),
        ("/api/v1/captures/{capture}/plot", "get"),
        ("/api/v1/artifacts/{artifact}", "get"),
        ("/api/v1/artifacts/{artifact}/{path}", "get"),
        ("/api/v1/grids", "get"),
        ("/api/v1/grids/{grid}", "get"),
        ("/api/v1/grids/{grid}/sample", "get"),
        ("/api/v1/grids/{grid}/preview", "get"),
        ("/api/v1/grids/{grid}/plot", "get"),
        ("/api/v1/uploads", "get"),
        ("/api/v1/uploads", "post"),
        ("/api/v1/uploads/{upload}", "get"),
        ("/api/v1/uploads/{upload}", "delete"),
        ("/api/v1/uploads/{upload}/file", "get"),
    }
    bounds = document["components"]["schemas"]["StreamSettings"]["properties"]["bands"]
    assert (bounds["minimum"], bounds["maximum"]) == (1, 8)
    problems = document["paths"]["/api/v1/streams"]["post"]["responses"]
    assert "application/problem+json" in problems["409"]["content"]
    assert "application/problem+json" in problems["422"]["content"]
