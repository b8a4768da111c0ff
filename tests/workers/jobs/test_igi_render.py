"""``igi-render``: pictures and films, the same bytes whatever happens meanwhile, and what is said where none can be."""

from __future__ import annotations

import errno
import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from tests.core.io.test_scenes import field_grid
from tests.support.inline_jobs import run_inline
from tests.support.jobs import digests, executor, wait_for, wait_for_end

from lightwell.errors import LightwellError
from lightwell.igi import render_igi
from lightwell.io.exr import write_rgb
from lightwell.io.films import write_film
from lightwell.io.grids import write_grid
from lightwell.io.igi_renders import write_igi_rendering
from lightwell.io.igi_scenes import load_igi_scene, meter
from lightwell.io.pictures import read_picture
from lightwell.io.scenes import read_scene_settings
from lightwell.job_settings import IgiRenderSettings, JobsSettings
from lightwell_workers.jobs.compute import InlineCompute
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.events import EventLog, read_events
from lightwell_workers.jobs.igi_plan import estimate
from lightwell_workers.jobs.kinds import load_kind
from lightwell_workers.jobs.queue import Queue
from lightwell_workers.jobs.roots import data_roots
from lightwell_workers.jobs.workflow import PREPARE, Runner

SCENE = """
method = "igi"
[camera]
position = [2.5, -2.5, 2.0]
target = [0.0, 0.0, 0.4]
fov_degrees = 50
[picture]
width = 45
height = 30
[igi]
sets = "2x2"
vpls = 32
bounces = 1
[[objects]]
shape = "plane"
scale = 2
albedo = 0.6
[[objects]]
shape = "sphere"
scale = 0.5
position = [0.0, 0.0, 0.5]
albedo = "#c04020"
"""
LAMP = """
[[objects]]
shape = "sphere"
scale = 0.2
position = [0.8, -0.6, 1.6]
emission = [6.0, 5.0, 4.0]
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Scenes with and without a lamp, and a recording of two frames, the second three times as bright."""
    place = tmp_path_factory.mktemp("scenes")
    (place / "lit.toml").write_text(SCENE + LAMP)
    (place / "unlit.toml").write_text(SCENE)
    for number, radiance in enumerate((1.0, 3.0)):
        write_rgb(place / f"hall.{number:04d}.exr", np.full((16, 32, 3), radiance, np.float32))
    return place


def run(place: Path, scene: Path, **settings: Any) -> tuple[Path, dict[str, Any]]:
    return run_inline("igi-render", place, scene=str(scene), **settings)


def read_png(path: Path) -> NDArray[np.uint8]:
    """Return a picture, RGB."""
    found = cv2.imread(str(path))
    assert found is not None
    return np.asarray(found[..., ::-1], np.uint8)


def test_a_picture_is_that_of_the_command(tmp_path: Path, folder: Path) -> None:
    results, report = run(tmp_path, folder / "lit.toml", igi={"seed": 3})
    assert sorted(path.name for path in results.iterdir()) == [
        "layers.exr",
        "picture.png",
        "preview.png",
        "report.json",
    ]
    loaded = load_igi_scene(read_scene_settings(folder / "lit.toml"), folder)
    settings = loaded.settings.model_copy(update={"seed": 3})
    whole = render_igi(loaded.scene, loaded.camera, (45, 30), settings, samples=loaded.samples)
    for name in ("layers.exr", "picture.png"):
        write_igi_rendering(tmp_path / name, whole, meter(whole.colour), backdrop=loaded.has_backdrop)
        assert (tmp_path / name).read_bytes() == (results / name).read_bytes()
    assert (report["igi"]["sets"], report["igi"]["vpls"], report["igi"]["seed"]) == ([2, 2], 32, 3)
    assert (report["width"], report["height"], report["frames"], report["rays"]) == (45, 30, 1, whole.rays)
    assert (report["ev"], report["samples"]) == (meter(whole.colour), loaded.samples)
    work = JobDirectory(tmp_path, "inline-job").work
    assert read_png(work / "preview.png").shape == (30, 45, 3)
    assert not list(work.glob("tile-*"))


def test_a_path_is_a_film_of_pictures(tmp_path: Path, folder: Path) -> None:
    path = [
        {"position": [2.5, -2.5, 2.0], "target": [0, 0, 0.4]},
        {"position": [-2.5, -2.5, 1.0], "target": [0, 0, 0.4]},
    ]
    settings = {"camera": {"path": path}, "frames": 2, "fps": 12.5}
    results, report = run(tmp_path / "a", folder / "lit.toml", **settings)
    names = sorted(path.relative_to(results).as_posix() for path in results.rglob("*") if path.is_file())
    frames = [f"frames/0000{k}.{suffix}" for k in range(2) for suffix in ("exr", "png")]
    assert names == ["film.mp4", *frames, "preview.png", "report.json"]
    assert (report["frames"], report["fps"], len(report["mean"])) == (2, 12.5, 2)
    with av.open(str(results / "film.mp4")) as film:
        assert film.streams.video[0].average_rate == 12.5
        shown = [frame.to_ndarray(format="rgb24") for frame in film.decode(video=0)]
    assert [one.shape for one in shown] == [(30, 46, 3)] * 2
    for one, name in zip(shown, ("00000.png", "00001.png"), strict=True):
        picture = read_png(results / "frames" / name).astype(float)
        # Colour at half the resolution, and BT.709's range.
        assert np.abs(one[:, :45].astype(float) - picture).mean() < 6
    assert np.abs(shown[0].astype(float) - shown[1]).mean() > 3
    # Steps that run again, as after a kill, leave the same bytes.
    (tmp_path / "a" / "inline-job" / "work" / "frame-00001.json").unlink()
    before = {name: (results / name).read_bytes() for name in names}
    run(tmp_path / "a", folder / "lit.toml", **settings)
    assert {name: (results / name).read_bytes() for name in names} == before


def test_a_recording_is_light_over_time(tmp_path: Path, folder: Path) -> None:
    results, report = run(
        tmp_path / "a", folder / "unlit.toml", light={"frames": str(folder / "hall.%04d.exr"), "gain": 2.0}
    )
    assert report["frames"] == 2
    first, second = (read_picture(results / "frames" / f"0000{k}.exr").pixels for k in range(2))
    np.testing.assert_allclose(second, 3 * first, rtol=1e-4)
    # What is behind the objects is the light itself.
    np.testing.assert_allclose(first[0, 0], 2.0, rtol=1e-3)
    # One exposure for all: the film shows that it gets brighter.
    assert report["mean"][1][0] == pytest.approx(3 * report["mean"][0][0], rel=1e-4)
    _, slower = run(tmp_path / "b", folder / "unlit.toml", light={"frames": str(folder / "hall.*.exr")}, frames=3)
    means = [mean[0] for mean in slower["mean"]]
    np.testing.assert_allclose(np.array(means) / means[0], [1, 1, 3], rtol=1e-4)


def test_recorded_coefficients_are_light_over_time(tmp_path: Path, folder: Path) -> None:
    """Lines of ``watch --json`` at 10 frames a second, a film at 20: every other picture is between two of them."""
    lines = [
        {
            "stream": "hall",
            "capture_time_ns": 1_795_000_000_000_000_000 + k * 100_000_000,
            "convention": "lightwell",
            "units": "relative",
            "coefficients": [[radiance * np.sqrt(4 * np.pi)] * 3],
        }
        for k, radiance in enumerate((1.0, 2.0, 4.0))
    ]
    recorded = folder / "hall.jsonl"
    recorded.write_text("".join(json.dumps(line) + "\n" for line in lines))
    _, film = run(tmp_path / "a", folder / "unlit.toml", light={"frames": str(recorded)}, fps=20)
    assert film["frames"] == 6
    means = np.array([mean[0] for mean in film["mean"]])
    np.testing.assert_allclose(means / means[0], [1, 1.5, 2, 3, 4, 4], rtol=1e-3)
    light = {"frames": str(recorded), "frame": -2, "gain": 0.5, "stream": "hall"}
    results, still = run(tmp_path / "b", folder / "unlit.toml", light=light)
    assert (still["frames"], sorted(path.name for path in results.glob("*.exr"))) == (1, ["layers.exr"])
    np.testing.assert_allclose(read_picture(results / "layers.exr").pixels[0, 0], 1.0, rtol=1e-3)
    lines[1]["convention"] = "blender"
    recorded.write_text("".join(json.dumps(line) + "\n" for line in lines))
    with pytest.raises(LightwellError, match=r"light\.frames: hall\.jsonl: line 2: its convention 'blender'"):
        run(tmp_path / "c", folder / "unlit.toml", light={"frames": str(recorded)})


def test_a_video_is_light_over_time(tmp_path: Path, folder: Path) -> None:
    write_film(folder / "hall.mp4", [np.full((16, 32, 3), code, np.uint8) for code in (60, 120, 240)], 12)
    light = {"frames": str(folder / "hall.mp4"), "video": {"transfer": "linear"}}
    _, film = run(tmp_path / "a", folder / "unlit.toml", light=light, fps=12)
    means = np.array([mean[0] for mean in film["mean"]])
    np.testing.assert_allclose(means / means[0], [1, 2, 4], rtol=0.03)
    _, still = run(tmp_path / "b", folder / "unlit.toml", light=light | {"frame": 1})
    assert still["mean"] == [film["mean"][1]]
    for changes, words in (
        ({"video": {}}, r"light\.frames: hall\.mp4: does not say how it is encoded: give light\.video\.transfer"),
        ({"frame": 3}, r"light\.frame: hall\.mp4: has no frame 3: it has 3, 0 … 2"),
    ):
        with pytest.raises(LightwellError, match=words):
            run(tmp_path / "c", folder / "unlit.toml", light=light | changes)


def test_a_film_that_begins_in_the_dark_is_told_which_exposure_fits(tmp_path: Path, folder: Path) -> None:
    rows = [{"capture_time_ns": k * 100_000_000, "coefficients": [[level] * 3]} for k, level in enumerate((1e-3, 3, 4))]
    (folder / "dusk.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))
    settings = {"light": {"frames": str(folder / "dusk.jsonl")}, "fps": 10, "width": 12, "height": 8}
    _, film = run(tmp_path / "a", folder / "unlit.toml", **settings)
    fits = np.log2(0.18 / film["mean"][1][1])
    assert [float(remark.rpartition(" ")[2]) for remark in film["remarks"]] == pytest.approx([fits], abs=0.3)
    assert film["ev"] > fits + 4
    _, film = run(tmp_path / "b", folder / "unlit.toml", **settings, ev=float(fits))
    assert film["remarks"] == []


def test_grids_add_up_and_follow(tmp_path: Path, folder: Path) -> None:
    write_grid(folder / "one.zarr", field_grid())
    grid = str(folder / "one.zarr")
    _, once = run(tmp_path / "a", folder / "unlit.toml", light={"grid": grid}, width=12, height=8)
    _, twice = run(tmp_path / "b", folder / "unlit.toml", light={"grid": [grid, grid]}, width=12, height=8)
    np.testing.assert_allclose(twice["mean"], 2 * np.array(once["mean"]), rtol=1e-4)
    assert once["mean"][0][0] > 0
    live = 3 * field_grid().sample(np.zeros((1, 3))).coefficients[0]
    light = {"grid": [grid, grid], "stream": "hall", "coefficients": live.tolist(), "probe_at": [0, 0, 0]}
    _, follows = run(tmp_path / "c", folder / "unlit.toml", light=light, width=12, height=8)
    np.testing.assert_allclose(follows["mean"], 3 * np.array(once["mean"]), rtol=1e-3)


def test_jobs_read_nothing_outside_the_data_roots(tmp_path: Path, folder: Path) -> None:
    """What a job's scene names when it is prepared counts, whatever it was when it was submitted."""
    data = tmp_path / "data"
    (data / "scenes").mkdir(parents=True)
    (data / "scenes" / "far.toml").write_text(SCENE + f'[[objects]]\nmesh = "{folder}/ball.glb"\n')
    (data / "scenes" / "near.toml").write_text(SCENE)
    (data / "captures" / "hall").mkdir(parents=True)
    (data / "captures" / "hall" / "0.exr").symlink_to(folder / "hall.0000.exr")
    roots = data_roots(JobsSettings(), data)
    directory = JobDirectory(data / "jobs", "a-job-of-it")
    directory.path.mkdir(parents=True)
    context = JobContext(directory, EventLog(directory.events), InlineCompute(), threading.Event(), roots)
    context.results.mkdir(parents=True)
    for scene, light, words in (
        ("far.toml", {}, r"far\.toml: objects\[2\]: .*ball\.glb: lies outside the folders"),
        (
            "near.toml",
            {"frames": str(data / "captures" / "hall")},
            r"light\.frames: 0\.exr: lies outside the data roots",
        ),
        (
            "near.toml",
            {"map": str(data / "captures" / "hall" / "0.exr")},
            r"light\.map: 0\.exr: lies outside the data roots",
        ),
    ):
        settings = IgiRenderSettings.model_validate({"scene": str(data / "scenes" / scene), "light": light})
        with pytest.raises(LightwellError, match=words):
            load_kind("igi-render").prepare(settings, context)
        # Nor does the server, to say what a job would need.
        with pytest.raises(LightwellError, match=words):
            load_kind("igi-render").estimate(settings, roots)
    runner = Runner(JobsSettings(), data / "jobs")
    runner.close()
    assert runner.roots == roots


def test_a_job_shows_the_recording_of_when_it_began(tmp_path: Path, folder: Path) -> None:
    """Coefficients are kept; a picture or a video that changes before its turn comes ends the job."""
    recorded, sky = tmp_path / "r.jsonl", tmp_path / "sky.exr"
    recorded.write_text('{"coefficients": [[1, 1, 1]]}\n')
    write_rgb(sky, np.ones((8, 16, 3), np.float32))
    small = {"scene": str(folder / "unlit.toml"), "width": 12, "height": 8}
    runner = Runner(JobsSettings(data_roots=(tmp_path, folder)), tmp_path / "jobs")

    def step(job: str, named: Path, index: int) -> int:
        document = IgiRenderSettings.model_validate(small | {"light": {"frames": str(named)}}).model_dump(mode="json")
        return runner._run(job, "igi-render", document, index, threading.Event())

    steps = step("of-lines", recorded, PREPARE)
    recorded.unlink()
    for index in range(steps + 1):
        step("of-lines", recorded, index)
    assert JobDirectory(tmp_path / "jobs", "of-lines").manifest.is_file()
    step("of-pictures", sky, PREPARE)
    write_rgb(sky, np.full((8, 16, 3), 2.0, np.float32))
    with pytest.raises(LightwellError, match=r"light\.frames: sky\.exr: has changed since the job began: submit"):
        step("of-pictures", sky, 0)
    sky.unlink()
    with pytest.raises(LightwellError, match=r"light\.frames: sky\.exr: cannot be read: No such file"):
        step("of-pictures", sky, 0)
    runner.close()


def test_a_damaged_frame_is_named(tmp_path: Path, folder: Path) -> None:
    write_rgb(tmp_path / "torn.0.exr", np.ones((16, 32, 3), np.float32))
    (tmp_path / "torn.1.exr").write_bytes((tmp_path / "torn.0.exr").read_bytes()[:400])
    with pytest.raises(LightwellError, match=r"torn\.1\.exr"):
        run(tmp_path, folder / "unlit.toml", light={"frames": str(tmp_path / "torn.%d.exr")})


def test_a_stream_is_what_it_showed(tmp_path: Path, folder: Path) -> None:
    constant = [[np.sqrt(4 * np.pi)] * 3, *[[0, 0, 0]] * 8]
    light = {"stream": "hall", "coefficients": constant}
    results, _ = run(tmp_path / "a", folder / "unlit.toml", light=light)
    np.testing.assert_allclose(read_picture(results / "layers.exr").pixels[0, 0], 1.0, rtol=1e-3)
    with pytest.raises(LightwellError, match="submit it to one"):
        run(tmp_path / "b", folder / "unlit.toml", light={"stream": "hall"})


def test_without_light_the_picture_is_black_and_the_log_says_so(tmp_path: Path, folder: Path) -> None:
    results, report = run(tmp_path, folder / "unlit.toml")
    assert not read_png(results / "picture.png").any()
    assert report["mean"] == [[0, 0, 0]]
    assert "no light" in report["remarks"][0]
    events = [event for _, event in read_events(JobDirectory(tmp_path, "inline-job").events)]
    assert [event["level"] for event in events if "no light" in event.get("message", "")] == ["warning"]


def test_what_cannot_be_rendered_is_said(tmp_path: Path, folder: Path) -> None:
    (folder / "broken.glb").write_bytes(b"glTF\2\0\0\0nothing")
    gltf = {
        "asset": {"version": "2.0"},
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
        "textures": [{"source": 0}],
        "images": [{"uri": "gone.png"}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": "data:;base64," + "A" * 48, "byteLength": 36}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    (folder / "bare.gltf").write_text(json.dumps(gltf))
    at = {"position": [3, 0, 1]}
    write_rgb(folder / "bright.exr", np.full((8, 16, 3), 1e20, np.float32))
    (folder / "bright.json").write_text('{"coefficients": [[1e20, 1e20, 1e20]]}')
    (folder / "bright.toml").write_text(SCENE + '[light]\nfile = "bright.json"\ngain = 1e12\n')
    refused: list[tuple[str, dict[str, Any], str]] = [
        ("none.toml", {}, "none.toml.*no such file"),
        ("hall.0000.exr", {}, "type .exr"),
        ("broken.glb", {"camera": at}, "broken.glb"),
        ("bare.gltf", {"camera": at}, "gone.png"),
        ("lit.toml", {"camera": {"position": [0.0, 0.0, 0.5]}}, "inside object 'sphere'"),
        ("lit.toml", {"camera": {"path": [at, {"position": [0.0, 0.0, 0.5]}]}, "frames": 3}, "picture 2.*inside"),
        ("lit.toml", {"camera": {"path": [at, {"position": [-3, 0, -1]}]}, "frames": 3}, "where the camera stands"),
        ("lit.toml", {"light": {"map": str(folder / "none.exr")}}, r"light\.map: none\.exr: does not exist"),
        ("lit.toml", {"light": {"map": str(folder / "lit.toml")}}, r"light\.map: lit\.toml: is not HDR"),
        ("lit.toml", {"light": {"frames": str(folder / "lit.toml")}}, r"light\.frames: lit\.toml: is not HDR"),
        (
            "lit.toml",
            {"light": {"map": str(folder / "hall.0000.exr"), "mapping": {"kind": "cube"}}},
            r"light\.mapping: hall\.0000\.exr",
        ),
        ("lit.toml", {"light": {"frames": str(folder / "none.*.exr")}}, "matches no file"),
        ("lit.toml", {"light": {"grid": "no.such-grid"}}, "no grid"),
        ("lit.toml", {"frames": 3}, "nothing changes from picture to picture"),
        (
            "lit.toml",
            {"light": {"map": str(folder / "bright.exr"), "gain": 1e12}},
            r"light\.map: bright\.exr: the sky must be .*, or lower light\.gain",
        ),
        (
            "lit.toml",
            {"light": {"frames": str(folder / "bright.json"), "gain": 1e12}},
            r"light\.gain = 1e\+12: with it the sky must be",
        ),
        ("bright.toml", {}, r"bright\.toml: light: the sky must be .*, or lower light\.gain"),
        ("lit.toml", {"light": {"coefficients": [[1, 1, 1]]}}, r"light\.coefficients: .*give light\.stream"),
    ]
    for number, (scene, settings, words) in enumerate(refused):
        with pytest.raises(LightwellError, match=words):
            run(tmp_path / str(number), folder / scene, **settings)
    for settings, words in (
        ({"light": {"map": "a", "stream": "b"}}, "not map and stream"),
        ({"light": {"frames": "a.mp4", "stream": "b"}}, "not frames and stream"),
        ({"light": {"map": "a.exr", "frame": 3}}, "give frames"),
        ({"light": {"stream": "hall", "coefficients": [[1, 1, 1]] * 3}}, "bands² rows"),
        ({"light": {"stream": "hall", "coefficients": []}}, "bands² rows"),
        ({"camera": {"position": [0, 0, 0.5], "target": [0, 0, 0.5]}}, "must differ"),
        ({"camera": {"position": [0, 0, 0.5], "up": [0, 0, 0]}}, "up must have a length"),
        ({"camera": {"target": [0, 0, 1], "fov_degrees": 50}}, "has target, fov_degrees but no position"),
        ({"camera": {"path": [at, at | {"up": [0, 0, 0]}]}}, "up must have a length"),
        ({"camera": {"path": [at]}}, "two cameras"),
        ({"fps": 0.001}, "greater than or equal to 0.01"),  # films count in 1/1001 s
        ({"camera": {"path": [at, at], "orbit_degrees": 9}}, "leave name"),
        ({"width": 16384, "height": 16384}, "at most"),
    ):
        with pytest.raises(ValueError, match=words):
            IgiRenderSettings.model_validate({"scene": "x.toml"} | settings)
    with pytest.raises(LightwellError, match="no pictures"):
        write_film(tmp_path / "film.mp4", [], 24)


def test_a_full_disk_is_said_as_such(tmp_path: Path, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What writes pictures and films says it in ways of its own; the job then can be tried again."""

    def full(*_: Any) -> None:
        raise RuntimeError(f'Failed to write pixel data to "a.exr". {os.strerror(errno.ENOSPC)}.')

    monkeypatch.setattr("lightwell.io.igi_renders.write_exr_layers", full)
    with pytest.raises(OSError, match=r"layers\.exr") as caught:
        run(tmp_path, folder / "lit.toml")
    assert caught.value.errno == errno.ENOSPC
    monkeypatch.setattr("lightwell.io.films._write", lambda *_: (_ for _ in ()).throw(OSError(errno.ENOSPC, "full")))
    with pytest.raises(OSError, match=r"film\.mp4"):
        write_film(tmp_path / "film.mp4", [], 24)


def test_estimates_grow_with_the_work(folder: Path) -> None:
    def needs(**settings: Any) -> Any:
        return estimate(IgiRenderSettings.model_validate({"scene": str(folder / "lit.toml")} | settings))

    small, large = needs(), needs(width=1024, height=1024, igi={"vpls": 16384})
    film = needs(frames=10, camera={"orbit_degrees": 360})
    assert small.seconds < 1
    assert large.seconds > 100 * small.seconds
    assert film.disk_bytes > 2 * small.disk_bytes
    assert large.memory_bytes > small.memory_bytes
    assert large.disk_bytes > 1024 * 1024 * 19 * 4


@pytest.mark.slow
def test_kill_resume_and_cancel(tmp_path: Path, folder: Path) -> None:
    """Killed in the middle, a job goes on with the tiles that are there, to the bytes of a run in one go."""
    settings = {
        "scene": str(folder / "lit.toml"),
        "width": 200,
        "height": 140,
        "frames": 2,
        "camera": {"orbit_degrees": 40},
        "samples": 1,
        "igi": {"sets": [1, 1], "vpls": 1024},
        "checkpoint_seconds": 0.5,
    }
    document = IgiRenderSettings.model_validate(settings).model_dump(mode="json")
    data = tmp_path / "data"
    data.mkdir()
    queue = Queue(JobsSettings(), data)
    with executor(data) as worker:
        job = queue.submit("igi-render", document)[0].id
        directory = JobDirectory(queue.root, job)
        wait_for(lambda: len(list(directory.work.glob("tile-*"))) >= 2, "the first tiles")
        assert read_png(directory.preview).shape == (140, 200, 3)
        worker.kill()
        kept = {path: path.stat().st_mtime_ns for path in directory.work.glob("tile-*.npz")}
        assert queue.get(job).state == "running"
        worker.start()
        wait_for(lambda: len(list(directory.work.glob("tile-*"))) > len(kept) or directory.manifest.exists(), "more")
        again = {path: path.stat().st_mtime_ns for path in kept if path.exists()}
        assert all(again[path] == kept[path] for path in again)
        ended = wait_for_end(queue, job)
        assert ended.state == "succeeded", ended.error

        other = queue.submit("igi-render", document | {"igi": document["igi"] | {"vpls": 65536}})[0].id
        wait_for(lambda: (queue.get(other).progress or ended.progress).stage == "render", "rendering")  # type: ignore[union-attr]
        started = time.monotonic()
        queue.cancel(other)
        assert wait_for_end(queue, other, 10).state == "cancelled"
        assert time.monotonic() - started < 4
    results, _ = run_inline("igi-render", tmp_path / "whole", **document)
    whole = JobDirectory(tmp_path / "whole", "inline-job")
    whole.publish(results)
    assert {artifact.path: artifact.sha256 for artifact in whole.read_manifest()} == digests(ended)
    queue.close()
