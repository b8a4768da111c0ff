"""``igi-render`` over HTTP and from the terminal: scenes, maps and streams that a server knows."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import httpx
import numpy as np
import pytest
from tests.support.jobs import wait_for
from tests.support.publisher import Publisher
from tests.support.server import running_server
from tests.support.shapes import sphere

from lightwell.io.exr import write_rgb
from lightwell.io.glb import encode_glb
from lightwell.wire import pack_coefficients
from lightwell_client import Lightwell

pytestmark = pytest.mark.timeout(200)

SCENE = """
method = "igi"
[camera]
position = [0.0, -4.0, 1.0]
[igi]
sets = "2x2"
vpls = 16
[light]
stream = "hall"
[[objects]]
shape = "sphere"
"""
AT = {"position": [0, -4, 1], "target": [0, 0, 0]}
TINY = {"width": 24, "height": 16, "igi": {"sets": "2x2", "vpls": 16}}


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    (folder / "scenes").mkdir()
    (folder / "scenes" / "ball.toml").write_text(SCENE)
    write_rgb(folder / "scenes" / "sky.exr", np.full((8, 16, 3), 2.0, np.float32))
    return folder


@pytest.fixture(scope="module")
def url(data: Path) -> Iterator[str]:
    with running_server(data) as address:
        yield address


@pytest.fixture(scope="module")
def api(url: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{url}/api/v1", timeout=60.0, trust_env=False) as api:
        yield api


def submit(api: httpx.Client, settings: dict[str, Any], **more: Any) -> httpx.Response:
    headers = {"Idempotency-Key": more.pop("key")} if "key" in more else {}
    return api.post("/jobs", json={"kind": "igi-render", "settings": settings} | more, headers=headers)


def coefficients(radiance: float) -> bytes:
    return pack_coefficients(np.array([[radiance * np.sqrt(4 * np.pi)] * 3, *[[0.0] * 3] * 8]))


def test_a_stream_is_taken_as_it_is_when_the_job_is_submitted(api: httpx.Client, url: str, data: Path) -> None:
    settings = {"scene": "scenes/ball.toml", "width": 24, "height": 16, "igi": {"seed": 4}}
    missing = submit(api, settings)
    assert (missing.status_code, "hall" in missing.json()["detail"]) == (404, True), missing.text
    with Publisher(url, "hall") as hall:
        early = submit(api, settings)
        assert (early.status_code, "no frame yet" in early.json()["detail"]) == (422, True), early.text
        hall.publish(coefficients=coefficients(2.0), position=(1.0, 0.0, 0.5))
        first = wait_for(lambda: (found := submit(api, settings, key="one")).status_code == 202 and found, "a frame")
        hall.publish(coefficients=coefficients(5.0))
        again = submit(api, settings, key="one")
        assert (again.status_code, again.json()["id"]) == (200, first.json()["id"]), again.text
        shown = first.json()["settings"]
        assert shown["light"]["probe_at"] == [1.0, 0.0, 0.5]
        np.testing.assert_allclose(shown["light"]["coefficients"][0], 2 * np.sqrt(4 * np.pi), rtol=1e-6)
        assert (shown["igi"]["sets"], shown["igi"]["vpls"], shown["igi"]["seed"]) == ([2, 2], 16, 4)
        with Lightwell(url, timeout=60.0) as client:
            job = client.wait(first.json()["id"])
            assert job.state == "succeeded", job.error
            paths = {artifact.path: artifact.id for artifact in job.artifacts}
            assert set(paths) == {"layers.exr", "picture.png", "preview.png", "report.json"}
            assert len(set(paths.values())) == 4
            report = json.loads(client.artifact(paths["report.json"]))
    # Half of the picture is sky.
    assert 0.5 < report["mean"][0][0] < 2.0
    picture = api.get(f"/artifacts/{paths['picture.png']}")
    assert picture.headers["Content-Type"] == "image/png"
    pixels = cv2.imdecode(np.frombuffer(picture.content, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == (16, 24, 3)


def test_light_among_probes_is_taken_to_the_middle_of_the_scene(api: httpx.Client, url: str, data: Path) -> None:
    """Of a field, and of a stream with gradients: what arrives at the ball, which stands at the origin."""
    slope = np.zeros((9, 3, 3))
    slope[0, :, 0] = 0.5 * np.sqrt(4 * np.pi)
    (data / "scenes" / "slope.toml").write_text(SCENE.replace('"hall"', '"left"\ngradients = true'))
    with Publisher(url, "left") as left, Publisher(url, "right") as right:
        left.publish(coefficients=coefficients(2.0), position=(-1.0, 0.0, 0.0), gradients=pack_coefficients(slope))
        right.publish(coefficients=coefficients(6.0), position=(3.0, 0.0, 0.0))
        wait_for(lambda: all(api.get(f"/streams/{name}/latest").is_success for name in ("left", "right")), "frames")
        assert api.post("/fields", json={"name": "stage", "streams": ["left", "right"]}).status_code == 201
        among = {"scene": "scenes/ball.toml", "light": {"field": "stage", "gain": 0.5}} | {"width": 24, "height": 16}
        beside = {"scene": "scenes/slope.toml", "width": 24, "height": 16}
        answers = [submit(api, settings) for settings in (among, beside)]
    assert [answer.status_code for answer in answers] == [202, 202], [answer.text for answer in answers]
    shown = [answer.json()["settings"]["light"]["coefficients"][0][0] / np.sqrt(4 * np.pi) for answer in answers]
    assert shown[1] == pytest.approx(2.5, rel=1e-5)
    assert 2.0 < shown[0] < 4.0
    with Lightwell(url, timeout=60.0) as client:
        for answer, radiance in zip(answers, (0.5 * shown[0], shown[1]), strict=True):
            job = client.wait(answer.json()["id"])
            assert job.state == "succeeded", job.error
            report = next(one.id for one in job.artifacts if one.path == "report.json")
            # Most of the picture is sky.
            mean = json.loads(client.artifact(report))["mean"][0][0]
            assert 0.6 * radiance < mean < 1.1 * radiance
    gone = submit(api, among | {"light": {"field": "none"}}, dry_run=True)
    assert (gone.status_code, "none" in gone.json()["detail"]) == (404, True), gone.text
    dark = submit(api, among, dry_run=True)
    assert (dark.status_code, "gives light now: left: " in dark.json()["detail"]) == (422, True), dark.text


def test_uploads_and_paths_are_checked_before_the_job_is_taken(api: httpx.Client, data: Path) -> None:
    mesh = api.post("/uploads?name=ball.glb", content=encode_glb([sphere(6, 8)])).json()["id"]
    sky = cv2.imencode(".hdr", np.ones((8, 16, 3), np.float32))[1].tobytes()
    sky = api.post("/uploads?name=sky.hdr", content=sky).json()["id"]
    (data / "scenes" / "broken.glb").write_bytes(b"glTF\2\0\0\0nothing")
    # A scene that somebody copied here must not make the server read what lies elsewhere.
    for name, line in {
        "copied.toml": 'mesh = "/etc/passwd"',
        "linked.toml": 'mesh = "link.glb"',
        "above.toml": 'mesh = "../../x.ply"',
    }.items():
        (data / "scenes" / name).write_text(f"method = 'igi'\n[camera]\nposition = [0, -4, 1]\n[[objects]]\n{line}\n")
    (data / "scenes" / "link.glb").symlink_to("/etc/hostname")
    (data / "captures").mkdir(exist_ok=True)
    (data / "captures" / "hall.jsonl").write_text('{"coefficients": [[1, 1, 1]], "capture_time_ns": 5}\n{"torn": 1}\n')
    cases: list[tuple[dict[str, Any], int, str]] = [
        ({"scene": mesh}, 200, "fits"),  # all of it is shown
        ({"scene": sky, "camera": AT}, 422, "light map"),
        ({"scene": mesh, "camera": AT, "light": {"map": mesh}}, 422, "is the mesh"),
        ({"scene": mesh, "camera": AT, "light": {"map": "../sky.exr"}}, 403, "data roots"),
        ({"scene": mesh, "camera": AT, "light": {"frames": "/etc/*.exr"}}, 403, "data roots"),
        ({"scene": mesh, "camera": AT, "light": {"frames": "scenes/no*.exr"}}, 422, "matches no file"),
        ({"scene": mesh, "camera": AT, "light": {"frames": f"scenes/{'x' * 300}.mp4"}}, 403, "no usable path"),
        ({"scene": mesh, "camera": AT, "light": {"grid": []}}, 422, 'must have at least 1 item"'),
        ({"scene": mesh, "camera": AT, "light": {"grid": "nojob.grid"}}, 422, "no grid"),
        ({"scene": mesh, "camera": AT, "light": {"stream": "none"}}, 404, "none"),
        ({"scene": mesh, "camera": AT, "light": {"frames": "captures/hall.jsonl"}}, 422, "hall.jsonl: line 2"),
        ({"scene": "scenes/copied.toml"}, 422, "objects[0]: /etc/passwd: lies outside"),
        ({"scene": "scenes/linked.toml"}, 422, "objects[0]: link.glb: lies outside"),
        ({"scene": "scenes/above.toml"}, 422, "objects[0]: ../../x.ply: lies outside"),
        ({"scene": "scenes/none.toml"}, 422, "no such file"),
        ({"scene": "scenes/broken.glb", "camera": AT}, 422, "broken.glb"),
        ({"scene": "/etc/passwd"}, 403, "data roots"),
        ({"scene": mesh, "camera": {"position": [0, 0, 0], "name": "door"}}, 422, "name and a position"),
    ]
    for settings, status, words in cases:
        answer = submit(api, settings, dry_run=True)
        assert (answer.status_code, words in answer.text) == (status, True), (settings, answer.text)
    good = TINY | {"scene": mesh, "camera": AT | {"orbit_degrees": 360}, "frames": 2, "light": {"map": sky}}
    answer = submit(api, good, dry_run=True)
    assert answer.json()["fits"], answer.text
    job = submit(api, good).json()
    assert (job["settings"]["scene"], job["settings"]["light"]["map"]) == (mesh, sky)
    for upload in (mesh, sky):
        refused = api.delete(f"/uploads/{upload}")
        if refused.status_code != 204:  # else the job has ended already
            assert (refused.status_code, job["id"] in refused.json()["detail"]) == (409, True)
    ended = wait_for(lambda: (found := api.get(f"/jobs/{job['id']}").json())["finished"] and found, "the end")
    assert ended["state"] == "succeeded", ended["error"]
    film = next(artifact for artifact in ended["artifacts"] if artifact["path"] == "film.mp4")
    assert film["media_type"] == "video/mp4"
    frames = next(artifact for artifact in ended["artifacts"] if artifact["path"] == "frames")
    assert api.get(f"/artifacts/{frames['id']}/00001.png").content.startswith(b"\x89PNG")
    assert str(data) not in json.dumps(ended)


def test_the_command_submits_and_waits(url: str) -> None:
    command = [
        sys.executable,
        "-m",
        "lightwell_server.cli",
        "submit",
        "igi-render",
        "--wait",
        "--json",
        "--server",
        url,
    ]
    settings = ("scene=scenes/ball.toml", "width=24", "height=16", "light.map=scenes/sky.exr", "igi.vpls=8")
    command += [part for setting in settings for part in ("-p", setting)]
    result = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert result.returncode == 0, result.stderr
    job = json.loads(result.stdout)
    assert job["state"] == "succeeded"
    assert "picture.png" in [artifact["path"] for artifact in job["artifacts"]]
