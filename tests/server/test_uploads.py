"""Uploads over HTTP: what is taken, what is refused and why, and what becomes of it."""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from tests.support.server import running_server
from tests.support.shapes import sphere

from lightwell.io.exr import read_rgb, write_rgb
from lightwell.io.glb import encode_glb
from lightwell_workers.inspect_upload import inspect

ADMIN, READ = "admin-token-of-this-test", "read-token-of-this-test"
BALL = encode_glb([sphere(6, 8)])


def obj(text: str) -> bytes:
    return ("v 0 0 0\nv 1 0 0\nv 0 1 0\n" + text).encode()


def glb(document: dict[str, Any], binary: bytes = b"") -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    binary += b"\0" * (-len(binary) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def triangle(**accessor: Any) -> dict[str, Any]:
    return {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"} | accessor],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36}],
    }


CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("data")


@pytest.fixture(scope="module")
def api(data: Path) -> Iterator[httpx.Client]:
    uploads = {"max_mb": 2, "max_triangles": 5000, "quota_mb": 6}
    with (
        running_server(data, uploads=uploads, jobs={"embedded": False}) as url,
        httpx.Client(base_url=f"{url}/api/v1", timeout=60, trust_env=False) as client,
    ):
        yield client


def send(api: httpx.Client, name: str, body: bytes, **options: Any) -> httpx.Response:
    return api.post("/uploads", params={"name": name}, content=body, **options)


def test_a_mesh_is_kept_once(api: httpx.Client, data: Path) -> None:
    first = send(api, "ball.glb", BALL)
    assert first.status_code == 201, first.text
    document = first.json()
    assert document["kind"] == "mesh"
    assert (document["name"], document["bytes"]) == ("ball.glb", len(BALL))
    assert (document["vertices"], document["triangles"], document["objects"]) == (42, 80, ["sphere"])
    assert document["source"] is None
    assert first.headers["Location"] == f"/api/v1/uploads/{document['id']}"
    again = send(api, "again.glb", BALL)
    assert (again.status_code, again.json()) == (200, document)
    assert api.get(f"/uploads/{document['id']}").json() == document
    assert api.get(f"/uploads/{document['id']}/file").content == BALL
    listing = api.get("/uploads").json()
    assert document in listing["uploads"]
    assert (listing["max_bytes"], listing["max_triangles"]) == (2 << 20, 5000)
    assert sorted(path.name for path in (data / "uploads" / document["id"]).iterdir()) == ["file.glb", "upload.json"]
    assert api.delete(f"/uploads/{document['id']}").status_code == 204
    assert api.get(f"/uploads/{document['id']}").status_code == 404
    assert not (data / "uploads" / document["id"]).exists()


@pytest.mark.parametrize(
    "name", ["shape.obj", "SHAPE.OBJ", "../../../etc/shape.obj", "C:\\temp\\shape.obj", "sh\x1bape.obj"]
)
def test_names_are_only_names(api: httpx.Client, data: Path, name: str) -> None:
    answer = send(api, name, obj("f 1 2 3\n"))
    assert answer.status_code in (200, 201), answer.text
    assert answer.json()["name"].lower() == "shape.obj"
    places = {path.relative_to(data).parts[0] for path in data.rglob("*.obj")}
    assert places == {"uploads"}


@pytest.mark.parametrize("name", ["shape.obj/", "", "..", ".", "\x00"])
def test_names_that_are_none(api: httpx.Client, name: str) -> None:
    assert send(api, name, obj("f 1 2 3\n")).status_code in (415, 422)


PLY = b"ply\nformat binary_little_endian 1.0\nelement vertex %d\nproperty float x\nproperty float y\nproperty float z\n"
FACES = b"element face %d\nproperty list uchar int vertex_indices\nend_header\n"


@pytest.mark.parametrize(
    ("name", "body", "status", "words"),
    [
        ("ball.stl", BALL, 415, r"type \.stl; meshes are taken as \.glb"),
        ("ball", BALL, 415, "type .none."),
        ("ball.glb", b"", 422, "is empty"),
        ("ball.glb", BALL[:200], 422, "cut short"),
        ("ball.glb", b"glTF" + b"\xff" * 60, 422, "version"),
        ("ball.glb", obj("f 1 2 3\n"), 422, "does not begin with glTF"),
        ("ball.ply", BALL, 422, "no PLY"),
        ("ball.obj", bytes(range(256)) * 8, 422, "ball.obj"),
        ("ball.obj", obj(""), 422, "no triangles"),
        ("ball.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nf 1 2 3\n", 422, "not finite|cannot be read"),
        ("t.glb", glb(triangle(), CORNERS[:12] + np.array([np.nan] * 6, "<f4").tobytes()), 422, "not finite"),
        ("t.glb", glb(triangle(count=10**12), CORNERS), 422, "shows 333333333333 triangles; at most 5000"),
        ("t.glb", glb(triangle(count=-1), CORNERS), 422, r"-1 items"),
        ("t.glb", glb(triangle(count=300), CORNERS), 422, "reaches to byte 3600 of a view of 36"),
        ("t.glb", glb(triangle(byteOffset=-12), CORNERS), 422, "reaches to byte|contradicts"),
        ("t.glb", glb(triangle() | {"meshes": [{"primitives": [{}]}]}, CORNERS), 422, "contradicts itself"),
        ("t.glb", glb(triangle() | {"nodes": [{"mesh": 0}] * 6000}, CORNERS), 422, "shows 6000 triangles"),
        ("t.glb", glb(triangle() | {"nodes": [{"children": [0]}]}, CORNERS), 422, "t.glb"),
        ("t.glb", glb(triangle() | {"extensionsRequired": ["KHR_draco_mesh_compression"]}, CORNERS), 422, "Draco"),
        ("t.gltf", json.dumps(triangle() | {"buffers": [{"uri": "t.bin", "byteLength": 36}]}).encode(), 422, "one GLB"),
        (
            "t.gltf",
            json.dumps(triangle() | {"buffers": [{"uri": "../../../etc/passwd", "byteLength": 36}]}).encode(),
            422,
            "one GLB",
        ),
        ("t.gltf", b"[" * 100_000, 422, "no JSON"),
        ("t.ply", PLY % 10**12 + FACES % 1, 422, "too large or cut short"),
        ("t.ply", PLY % 3 + FACES % 1 + CORNERS, 422, "no triangles|cut short"),
        ("big.glb", encode_glb([sphere(60, 60)]), 422, "shows 7080 triangles; at most 5000"),
        ("map.exr", b"\x76\x2f\x31\x01" + b"\0" * 40, 422, "map.exr"),
        ("map.hdr", b"#?RADIANCE\n", 422, "map.hdr"),
    ],
)
def test_what_is_refused(tmp_path: Path, name: str, body: bytes, status: int, words: str) -> None:
    place = tmp_path / ("map.exr" if name.endswith(".exr") else f"file{Path(name).suffix}")
    place.write_bytes(body)
    answer = inspect(place, name, 5000)
    assert answer.contents is None
    assert answer.refused is not None
    assert answer.refused.startswith(name)
    assert re.search(words, answer.refused), answer.refused
    assert str(tmp_path) not in answer.refused
    assert status in (415, 422)


@pytest.mark.parametrize(
    ("name", "body", "status", "kind"),
    [
        ("ball.stl", BALL, 415, "upload-type"),
        ("ball.glb", b"", 422, "bad-upload"),
        ("ball.glb", BALL[:200], 422, "bad-upload"),
        ("t.glb", glb(triangle(count=10**12), CORNERS), 422, "bad-upload"),
    ],
)
def test_refusals_are_problems(api: httpx.Client, data: Path, name: str, body: bytes, status: int, kind: str) -> None:
    answer = send(api, name, body)
    assert (answer.status_code, answer.json()["type"]) == (status, f"urn:lightwell:problem:{kind}")
    assert answer.headers["Content-Type"] == "application/problem+json"
    assert str(data) not in answer.json()["detail"]
    assert not list((data / "uploads").glob(".incoming-*"))


def test_too_much_is_refused_before_it_is_read(api: httpx.Client, data: Path) -> None:
    answer = send(api, "big.glb", b"\0" * (2 * 1024 * 1024 + 1))
    assert (answer.status_code, answer.json()["type"]) == (413, "urn:lightwell:problem:body-too-large")

    def unannounced() -> Iterator[bytes]:
        yield from [b"\0" * 65536] * 40

    unending = api.post("/uploads", params={"name": "big.glb"}, content=unannounced())
    assert unending.status_code == 413
    assert not list((data / "uploads").glob(".incoming-*"))
    assert api.post("/jobs", content=b" " * 300_000, headers={"Content-Type": "application/json"}).status_code == 413


def test_a_full_disk_is_said(tmp_path: Path) -> None:
    for section, words in (
        ({"server": {"min_free_mb": 10**9}}, "free space"),
        ({"uploads": {"quota_mb": 1}}, "quota"),
    ):
        sections: dict[str, Any] = section
        with running_server(tmp_path / words, **sections) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
            body = BALL if words == "free space" else b"\0" * (2 << 20)
            answer = send(api, "ball.glb", body)
            assert (answer.status_code, answer.json()["type"]) == (507, "urn:lightwell:problem:no-room")
            assert words in answer.json()["detail"]
            assert api.get("/uploads").json()["uploads"] == []


def test_tokens(tmp_path: Path) -> None:
    auth = {"admin_tokens": [ADMIN], "publish_tokens": ["publish-token"], "read_tokens": [READ]}
    with running_server(tmp_path, auth=auth) as url, httpx.Client(base_url=f"{url}/api/v1") as api:
        admin, read = ({"Authorization": f"Bearer {token}"} for token in (ADMIN, READ))
        assert send(api, "ball.glb", BALL).status_code == 401
        assert send(api, "ball.glb", BALL, headers=read).status_code == 403
        kept = send(api, "ball.glb", BALL, headers=admin)
        assert kept.status_code == 201
        upload = kept.json()["id"]
        for path in ("/uploads", f"/uploads/{upload}", f"/uploads/{upload}/file"):
            assert api.get(path).status_code == 401
            assert api.get(path, headers=read).status_code == 200
        assert api.delete(f"/uploads/{upload}", headers=read).status_code == 403
        assert api.delete(f"/uploads/{upload}", headers=admin).status_code == 204
        other = {"Origin": "http://evil.example"} | admin
        assert send(api, "ball.glb", BALL, headers=other).status_code == 403


def test_a_map_becomes_a_stream(api: httpx.Client, tmp_path: Path) -> None:
    pixels = np.full((16, 32, 3), 0.25, np.float32)
    pixels[2, 3] = 100_000
    write_rgb(tmp_path / "sky.exr", pixels)
    answer = send(api, "sky.exr", (tmp_path / "sky.exr").read_bytes())
    assert answer.status_code == 201, answer.text
    document = answer.json()
    assert (document["kind"], document["width"], document["height"]) == ("map", 32, 16)
    source = document["source"]
    assert source == f"upload:{document['id']}"  # no place on the server
    made = api.post("/streams", json={"name": "sky", "settings": {"source": source}})
    assert made.status_code == 201, made.text
    refused = api.delete(f"/uploads/{document['id']}")
    assert (refused.status_code, refused.json()["type"]) == (409, "urn:lightwell:problem:upload-in-use")
    assert api.delete("/streams/sky").status_code == 204
    assert api.delete(f"/uploads/{document['id']}").status_code == 204


def test_hdr_maps_become_exr_and_odd_ones_are_refused(api: httpx.Client, data: Path) -> None:
    pixels = np.full((16, 32, 3), (0.5, 1.0, 2.0), np.float32)  # blue, green, red
    body = cv2.imencode(".hdr", pixels)[1].tobytes()
    document = send(api, "room.hdr", body).json()
    place = data / "uploads" / document["id"] / "map.exr"
    np.testing.assert_allclose(read_rgb(place).pixels[0, 0], [2, 1, 0.5], rtol=0.01)
    odd = send(api, "odd.hdr", cv2.imencode(".hdr", pixels[:, :20])[1].tobytes())
    assert (odd.status_code, "20×16; a lat-long map is twice as wide" in odd.json()["detail"]) == (422, True)
    dark = send(api, "dark.hdr", cv2.imencode(".hdr", pixels * 0)[1].tobytes())
    assert (dark.status_code, "no light" in dark.json()["detail"]) == (422, True)


def test_wide_maps_are_made_smaller_and_keep_their_energy(api: httpx.Client, data: Path, tmp_path: Path) -> None:
    pixels = np.ones((2048, 4096, 3), np.float16)
    write_rgb(tmp_path / "wide.exr", pixels, "zip")
    document = send(api, "wide.exr", (tmp_path / "wide.exr").read_bytes()).json()
    assert (document["width"], document["height"]) == (4096, 2048)
    place = data / "uploads" / document["id"] / "map.exr"
    kept = read_rgb(place).pixels
    assert kept.shape == (1024, 2048, 3)
    np.testing.assert_allclose(kept, 1, rtol=1e-3)


def test_jobs_take_uploads_and_paths_below_the_roots(api: httpx.Client, data: Path) -> None:
    upload = send(api, "ball.glb", BALL).json()["id"]

    def dry(mesh: str) -> httpx.Response:
        body = {"kind": "prt-transfer", "settings": {"mesh": mesh}, "dry_run": True}
        return api.post("/jobs", json=body)

    assert dry(upload).json()["fits"]
    (data / "meshes").mkdir()
    (data / "meshes" / "ball.glb").write_bytes(BALL)
    assert dry("meshes/ball.glb").status_code == 200
    assert dry("meshes/none.glb").status_code == 422
    assert dry("../ball.glb").status_code == 403
    assert dry("/etc/passwd").status_code == 403
    assert dry("0" * 20).status_code == 404
    sky = send(api, "room.hdr", cv2.imencode(".hdr", np.ones((8, 16, 3), np.float32))[1].tobytes()).json()["id"]
    assert (dry(sky).status_code, "light map" in dry(sky).json()["detail"]) == (422, True)
    job = api.post("/jobs", json={"kind": "prt-transfer", "settings": {"mesh": upload}})
    assert job.status_code == 202, job.text
    assert job.json()["settings"]["mesh"] == upload
    assert str(data) not in api.get("/jobs").text
    refused = api.delete(f"/uploads/{upload}")
    assert (refused.status_code, job.json()["id"] in refused.json()["detail"]) == (409, True)
    api.post(f"/jobs/{job.json()['id']}/cancel")
    assert api.delete(f"/uploads/{upload}").status_code == 204
    kinds = {kind["name"]: kind for kind in api.get("/job-kinds").json()}
    assert kinds["prt-transfer"]["settings_schema"]["properties"]["directions"]["maximum"] == 65536
