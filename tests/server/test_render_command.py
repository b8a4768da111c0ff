"""``lightwell render`` as a process, and `lightwell_client.render` beside it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import httpx
import numpy as np
import OpenEXR
import pytest
from tests.support.publisher import Publisher
from tests.support.server import running_server

from lightwell.errors import LightwellError
from lightwell.geometry.shapes import box, sphere
from lightwell.io.exr import read_rgb
from lightwell.io.glb import encode_glb
from lightwell_client import Lightwell, render, render_igi

SCENE = """
[camera]
position = [0, -4, 1]
[picture]
width = 24
height = 16
samples = 2
[light]
{light}
[[objects]]
shape = "sphere"
albedo = 0.5
"""


def lightwell(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lightwell_server.cli", "render", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=100)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    rows = np.zeros((9, 3))
    rows[0] = np.sqrt(4 * np.pi)
    (tmp_path / "light.json").write_text(json.dumps({"bands": 3, "coefficients": rows.tolist()}))
    (tmp_path / "scene.toml").write_text(SCENE.format(light='file = "light.json"'))
    return tmp_path / "scene.toml"


def test_pictures_and_a_summary(scene: Path) -> None:
    out = scene.parent / "x.exr", scene.parent / "x.png"
    result = lightwell(str(scene), "--out", str(out[0]), "-o", str(out[1]), "--size", "30x20", "--ev", "0", "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["width"], summary["height"], summary["samples"], summary["ev"]) == (30, 20, 2, 0)
    assert [file["bytes"] for file in summary["out"]] == [path.stat().st_size for path in out]
    pixels = read_rgb(out[0]).pixels
    assert pixels.shape == (20, 30, 3)
    np.testing.assert_allclose(pixels[10, 15], 0.5, rtol=1e-5)  # albedo times radiance
    read = cv2.imread(str(out[1]))
    assert read is not None
    assert read.shape == (20, 30, 3)


def test_virtual_point_lights(scene: Path) -> None:
    out = scene.parent / "x.exr", scene.parent / "x.png"
    few = "--method", "igi", "--sets", "2x2", "--vpls", "1024", "--size", "30x20"
    result = lightwell(str(scene), "--out", str(out[0]), "-o", str(out[1]), *few, "--coefficients", "--json")
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert (summary["method"], summary["sets"], summary["vpls"], summary["bands"]) == ("igi", [2, 2], 1024, 3)
    assert (summary["samples"], summary["remarks"], result.stderr) == (2, [], "")
    assert summary["rays"] > 0
    pixels = read_rgb(out[0]).pixels
    covered = OpenEXR.File(str(out[0]), separate_channels=True).channels()["coverage"].pixels == 1
    np.testing.assert_allclose(pixels[covered].mean(), 0.5, rtol=0.03)  # albedo times radiance
    np.testing.assert_allclose(pixels[0, 0], 1, rtol=1e-4)  # the sky behind
    for arguments, message in {
        (*few, "--light", "x.exr", "--stream", "hall"): f"{scene}: light = ",
        (*few, "--frame", "1"): f"{scene}: light.file: light.json: has no frame 1",
        (*few, "--stream="): f"{scene}: light.stream = '': ",
        (*few, "--light", "x.exr"): f"{scene}: light.file: ",
        ("--sets", "2x2"): "--sets, --vpls and --coefficients: add --method igi",
        ("--method", "igi", "--sets", "99x1"): f"{scene}: igi.sets[0] = 99: ",
    }.items():
        refused = lightwell(str(scene), "--out", str(out[0]), *arguments)
        assert refused.returncode == 1
        assert refused.stderr.startswith(f"lightwell: {message}")


def test_a_model_without_camera_and_light(scene: Path) -> None:
    model, out = scene.parent / "model.glb", scene.parent / "x.exr"
    model.write_bytes(encode_glb([box(albedo=0.7)]))
    few = "--sets", "2x2", "--vpls", "256", "--size", "16x48", "--out", str(out)
    dark = lightwell(str(model), *few)
    assert dark.returncode == 0
    assert "has no camera: all of it is shown" in dark.stderr
    assert "there is no light" in dark.stderr
    assert "--light" in dark.stderr
    lit = lightwell(str(model), *few, "--light", str(scene.parent / "light.json"), "--frame", "-1")
    assert (lit.returncode, "there is no light" in lit.stderr) == (0, False)
    pixels = read_rgb(out).pixels
    np.testing.assert_allclose(pixels[24, 8], 0.7, rtol=0.1)
    np.testing.assert_allclose(pixels[:, [0, -1]], 1, rtol=1e-3)  # all of it is shown, beside it the sky


def test_interrupting_leaves_nothing_behind(scene: Path) -> None:
    arguments = ["--method", "igi", "--vpls", "65536", "--size", "2048x2048", "--out", str(scene.parent / "x.exr")]
    command = [sys.executable, "-m", "lightwell_server.cli", "render", str(scene), *arguments]
    before = sorted(scene.parent.iterdir())
    with scene.open("a") as file:
        file.write("mirror = 0.5\n")
    # The remark comes when the scene is loaded; what follows takes minutes.
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        assert "mirror: is left out" in process.stderr.readline()
        time.sleep(1)
        process.send_signal(signal.SIGINT)
        started = time.monotonic()
        assert process.wait(timeout=60) != 0
        assert "Traceback" not in process.stderr.read()
    assert time.monotonic() - started < 30
    assert sorted(scene.parent.iterdir()) == before


def test_mistakes_are_one_line(scene: Path) -> None:
    out = str(scene.parent / "x.png")
    for arguments, message in {
        (str(scene.parent / "no.toml"), "--out", out): f"{scene.parent / 'no.toml'}: there is no such file",
        (str(scene), "--out", "x.gif"): "x.gif: pictures are written as .exr or .png, not as .gif",
        (str(scene), "--out", out, "--size", "wide"): "--size: 'wide': must be width and height in pixels",
        (str(scene), "--out", out, "--size", "0x5"): "--size: '0x5': must lie between",
    }.items():
        result = lightwell(*arguments)
        assert (result.returncode, result.stdout) == (1, "")
        assert result.stderr.startswith(f"lightwell: {message}")
        assert len(result.stderr.splitlines()) == 1
    scene.write_text(scene.read_text() + "shine = 1\n")
    result = lightwell(str(scene), "--out", out)
    assert result.stderr == f"lightwell: {scene}: objects[0].shine is no option: check its spelling\n"


def test_light_of_a_stream_from_the_terminal_and_from_python(server: str, scene: Path) -> None:
    scene.write_text(SCENE.format(light='stream = "probe"'))
    with Publisher(server) as worker:
        worker.publish()
        result = lightwell(str(scene), "--out", str(scene.parent / "x.exr"), "--server", server, "--json")
        assert result.returncode == 0, result.stderr
        assert json.loads(result.stdout)["bands"] == 3
        picture = render(scene, server=server)
        with Lightwell(server) as client:
            latest = client.latest("probe", convention="unity")
    np.testing.assert_allclose(picture.colour, read_rgb(scene.parent / "x.exr").pixels, rtol=1e-5, atol=1e-6)
    assert picture.colour.shape == (16, 24, 3)
    given = render(scene, light=latest, size=(24, 16), out=scene.parent / "y.png")
    np.testing.assert_allclose(given.colour, picture.colour, rtol=1e-3, atol=1e-4)
    assert (scene.parent / "y.png").stat().st_size > 100
    missing = lightwell(str(scene), "--out", str(scene.parent / "x.exr"), "--server", "http://127.0.0.1:9")
    assert missing.returncode == 1
    assert "no answer from" in missing.stderr


@pytest.mark.slow
def test_results_of_a_transfer_job_on_a_server(tmp_path: Path, scene: Path) -> None:
    with running_server(tmp_path / "data") as url, Lightwell(url, timeout=60) as client:
        body = encode_glb([box(albedo=0.7), sphere(12, 24)])
        sent = httpx.post(f"{url}/api/v1/uploads?name=two.glb", content=body, timeout=60)
        settings = {"mesh": sent.json()["id"], "directions": 64, "bands": 3}
        job = client.wait(client.submit("prt-transfer", settings).id)
        assert job.state == "succeeded", job.error
        scene.write_text(
            SCENE.format(light='file = "light.json"').replace('shape = "sphere"', f'transfer = "{job.id}"')
        )
        result = lightwell(str(scene), "--out", str(tmp_path / "x.exr"), "--server", url, "--json")
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["objects"] == 2
    pixels = read_rgb(tmp_path / "x.exr").pixels
    # An open side of the box, and (the sphere is inside it) nothing else.
    np.testing.assert_allclose(pixels[9, 12], 0.5, rtol=0.03)


def test_render_takes_what_would_stand_in_a_file() -> None:
    document = {"camera": {"position": [0, -4, 1]}, "light": {"stream": "unused"}, "objects": [{"shape": "box"}]}
    light = np.zeros((4, 3))
    light[0] = 1
    rows: list[tuple[int, int]] = []
    picture = render(
        document, light=light, size=(8, 6), samples=1, progress=lambda done, total: rows.append((done, total))
    )
    assert picture.colour.shape == (6, 8, 3)
    assert rows[-1] == (6, 6)
    with pytest.raises(LightwellError, match="scene: light"):
        render({"camera": {"position": [0, -4, 1]}})


def test_virtual_point_lights_in_python(tmp_path: Path) -> None:
    light = np.zeros((4, 3))
    light[0] = np.sqrt(4 * np.pi)
    few = {"sets": "2x2", "vpls": 64, "bounces": 0}
    document = {"camera": {"position": [0, -4, 1]}, "objects": [{"shape": "box"}], "igi": few}
    tiles: list[tuple[int, int]] = []
    picture = render_igi(
        document,
        light=light,
        size=(8, 6),
        out=tmp_path / "x.exr",
        progress=lambda done, total: tiles.append((done, total)),
    )
    np.testing.assert_array_equal(read_rgb(tmp_path / "x.exr").pixels, picture.colour)
    assert tiles == [(1, 1)]
    np.testing.assert_allclose(picture.colour[0, 0], 1, rtol=1e-5)
    (tmp_path / "model.glb").write_bytes(encode_glb([box()]))
    with pytest.warns(UserWarning, match="has no camera: all of it is shown"):
        shown = render_igi(tmp_path / "model.glb", light=light, size=(8, 24), samples=1).coverage
    assert set(np.unique(shown)) == {0, 1}
    assert not shown[:, [0, -1]].any()
    with pytest.warns(UserWarning, match="scene: there is no light"):
        assert not render_igi(document, size=(4, 3)).colour.any()
    with pytest.raises(LightwellError, match="call render_igi"):
        render(document | {"method": "igi"})
