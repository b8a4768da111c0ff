"""``prt-transfer``: its artefacts, that they are the same however it is run, and that nothing is done twice."""

from __future__ import annotations

import itertools
import json
import shutil
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.inline_jobs import run_inline
from tests.support.jobs import digests, executor, wait_for, wait_for_end
from tests.support.shapes import quad, sphere

from lightwell.errors import LightwellError
from lightwell.geometry.mesh import Mesh
from lightwell.io.glb import encode_glb
from lightwell.io.meshes import load_meshes
from lightwell.job_settings import JobsSettings, PrtTransferSettings
from lightwell.transfer import kernels
from lightwell.transfer.compute import compute_transfer
from lightwell.transfer.directions import make_directions
from lightwell.transfer.visibility import unshadowed
from lightwell_workers.jobs.compute import InlineCompute
from lightwell_workers.jobs.context import JobCancelled, JobContext
from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.events import EventLog, read_events
from lightwell_workers.jobs.prt_plan import estimate, load_scene
from lightwell_workers.jobs.prt_tasks import compile_kernels, load_direct, save_scene, trace_part
from lightwell_workers.jobs.prt_transfer import PrtTransfer
from lightwell_workers.jobs.queue import Queue


def write_mesh(path: Path, *meshes: Mesh) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_glb(meshes))
    return path


@pytest.fixture(scope="module")
def mesh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    plate = quad([[-3, -3, -1.5], [3, -3, -1.5], [3, 3, -1.5], [-3, 3, -1.5]], "plate", albedo=0.4)
    return write_mesh(tmp_path_factory.mktemp("meshes") / "two.glb", sphere(10, 16, name="ball"), plate)


def run(folder: Path, mesh: Path, **settings: Any) -> tuple[Path, dict[str, Any]]:
    return run_inline("prt-transfer", folder, "transfer.json", **({"mesh": str(mesh), "directions": 256} | settings))


def blobs(results: Path, report: dict[str, Any], kind: str = "float32") -> list[np.ndarray[Any, Any]]:
    dtype = "<f4" if kind == "float32" else "<f2"
    return [
        np.frombuffer((results / entry[kind]).read_bytes(), dtype).reshape(entry["vertices"], entry["stride"])
        for entry in report["meshes"]
    ]


@pytest.mark.parametrize("sampling", ["hemisphere", "fibonacci", "stratified"])
def test_blobs_hold_what_is_computed_in_one_go(tmp_path: Path, mesh: Path, sampling: Any) -> None:
    results, report = run(tmp_path, mesh, sampling=sampling, directions=256, seed=3)
    expected = compute_transfer(load_meshes(mesh), make_directions(sampling, 256, 3), 5, turned=False).coefficients
    found = np.concatenate(blobs(results, report))
    np.testing.assert_allclose(found, expected[:, :, 0], atol=1e-6)
    halves = np.concatenate(blobs(results, report, "float16"))
    np.testing.assert_allclose(halves.astype(float), found, atol=2e-3)
    assert {key: report[key] for key in ("version", "bands", "channels", "directions", "sampling", "mode", "glb")} == {
        "version": 1,
        "bands": 5,
        "channels": 1,
        "directions": 256,
        "sampling": sampling,
        "mode": "shadowed",
        "glb": "scene.glb",
    }
    ball, plate = report["meshes"]
    assert (ball["name"], plate["name"], ball["stride"]) == ("ball", "plate", 25)
    assert (ball["vertices"], plate["vertices"], plate["triangles"]) == (9 * 16 + 2, 4, 2)
    np.testing.assert_allclose(ball["bounds"], [[-1, -1, -1], [1, 1, 1]], atol=1e-6)
    assert 0 < ball["error_mean"] < ball["error_max"] < 0.5
    assert sorted(path.name for path in results.iterdir()) == [
        "mesh-0.f16.bin",
        "mesh-0.f32.bin",
        "mesh-1.f16.bin",
        "mesh-1.f32.bin",
        "preview.png",
        "scene.glb",
        "transfer.json",
    ]


def test_the_scene_holds_the_same_vertices_turned_up_and_the_transfer(tmp_path: Path, mesh: Path) -> None:
    results, report = run(tmp_path, mesh, bands=3)
    data = (results / "scene.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    document = json.loads(data[20 : 20 + length])
    binary = data[20 + length + 8 :]
    assert [node["name"] for node in document["nodes"]] == ["ball", "plate"]
    for index, (blob, one) in enumerate(zip(blobs(results, report), load_meshes(mesh), strict=True)):
        attributes = document["meshes"][index]["primitives"][0]["attributes"]
        assert sorted(attributes) == ["COLOR_0", "NORMAL", "POSITION", "_PRT0", "_PRT1", "_PRT2"]

        def read(name: str, wanted: dict[str, int] = attributes) -> np.ndarray[Any, Any]:
            accessor = document["accessors"][wanted[name]]
            view = document["bufferViews"][accessor["bufferView"]]
            width = {"VEC3": 3, "VEC4": 4}[accessor["type"]]
            stride = view.get("byteStride", 4 * width) // 4
            begin = view["byteOffset"]
            rows = np.frombuffer(binary, "<f4", view["byteLength"] // 4, begin).reshape(-1, stride)
            skip = accessor.get("byteOffset", 0) // 4
            return rows[:, skip : skip + width]

        np.testing.assert_allclose(read("POSITION")[:, [0, 2, 1]] * [1, -1, 1], one.positions, atol=1e-6)
        np.testing.assert_allclose(read("COLOR_0"), one.albedo, atol=1e-6)
        lanes = np.concatenate([read(f"_PRT{slot}") for slot in range(3)], axis=1)
        np.testing.assert_array_equal(lanes[:, :9], blob)
        assert not lanes[:, 9:].any()
    loaded = load_meshes(results / "scene.glb")
    for before, after in zip(load_meshes(mesh), loaded, strict=True):
        np.testing.assert_allclose(after.positions, before.positions, atol=1e-6)
        np.testing.assert_allclose(after.normals, before.normals, atol=1e-5)
        np.testing.assert_array_equal(after.triangles, before.triangles)


def test_modes_ground_and_albedo(tmp_path: Path, mesh: Path) -> None:
    results, report = run(tmp_path / "a", mesh, mode="unshadowed", bake=False)
    exact = unshadowed(load_meshes(mesh)[0].normals, 5)
    np.testing.assert_allclose(blobs(results, report)[0], exact, atol=1e-6)
    assert report["meshes"][0]["error_max"] == 0
    shadowed = blobs(*run(tmp_path / "b", mesh))[1][:, 0]
    results, report = run(tmp_path / "c", mesh, mode="interreflected", bounces=2, albedo=0.5)
    assert report["channels"] == 1
    assert (blobs(results, report)[1][:, 0] >= shadowed).all()
    results, report = run(
        tmp_path / "d",
        mesh,
        mode="interreflected",
        object_albedo={"ball": [0.9, 0.1, 0.1]},
        ground=True,
        ground_rings=8,
        ground_segments=12,
    )
    assert (report["channels"], report["meshes"][0]["stride"]) == (3, 75)
    assert [entry["name"] for entry in report["meshes"]] == ["ball", "plate", "ground"]
    assert report["meshes"][2]["vertices"] == 8 * 12 + 1
    red, green, blue = blobs(results, report)[1].reshape(4, 25, 3)[:, 0].T
    assert (red > green).all()
    np.testing.assert_allclose(green, blue, atol=1e-6)
    glb = (results / "scene.glb").read_bytes()
    assert b"_PRT" not in glb


def test_the_parts_make_no_difference(tmp_path: Path, mesh: Path) -> None:
    settings = {"mode": "interreflected", "checkpoint_seconds": 0.05, "directions": 1024}
    one, _ = run(tmp_path / "one", mesh, **settings)
    other, _ = run(tmp_path / "other", mesh, **settings | {"checkpoint_seconds": 60})
    for path in one.iterdir():
        assert path.read_bytes() == (other / path.name).read_bytes(), path.name


def test_all_kernels_are_compiled_in_the_stage_that_says_so(tmp_path: Path, mesh: Path) -> None:
    folder = tmp_path / "job"
    compile_kernels(tmp_path / "cancel", PrtTransferSettings(mesh=str(mesh), mode="interreflected").model_dump_json())
    before = signatures()
    run(folder, mesh, mode="interreflected", bounces=1, bands=4)
    assert signatures() == before
    events = [event for path in folder.rglob("events.jsonl") for _, event in read_events(path)]
    stages = [event["stage"] for event in events if event["type"] == "progress"]
    assert [stage for stage, _ in itertools.groupby(stages)][:3] == ["prepare", "compile", "trace"]


def signatures() -> dict[str, int]:
    """Return how many times each kernel has been compiled in this process."""
    found = {name: getattr(value, "signatures", None) for name, value in vars(kernels).items()}
    return {name: len(value) for name, value in found.items() if value is not None}


def test_threads_of_a_worker_do_not_disturb_each_other(tmp_path: Path, mesh: Path) -> None:
    """Workers of a cluster of one's own may have several threads."""
    settings = PrtTransferSettings(mesh=str(mesh), directions=4096, ground=True, ground_rings=8, ground_segments=12)
    meshes = load_scene(settings)
    save_scene(tmp_path / "scene.npz", meshes)
    document, count = settings.model_dump_json(), sum(len(one.positions) for one in meshes)

    def part(first: int) -> NDArray[np.float32]:
        out = tmp_path / f"{first}.npz"
        trace_part(
            tmp_path / "none", document, "digest", str(tmp_path / "scene.npz"), str(out), first, first + 16, False
        )
        return load_direct(out).halves

    firsts = list(range(0, count - 16, 16))
    alone = [part(first) for first in firsts]
    with ThreadPoolExecutor(4) as pool:
        for one, other in zip(alone, pool.map(part, firsts), strict=True):
            np.testing.assert_array_equal(one, other)


def test_inside_out_objects_are_told_of(tmp_path: Path) -> None:
    ball = sphere(10, 16)
    path = write_mesh(
        tmp_path / "m.glb", Mesh("shell", ball.positions, ball.triangles[:, ::-1], -ball.normals, ball.albedo)
    )
    _, report = run(tmp_path, path)
    assert report["meshes"][0]["dark"] == report["meshes"][0]["vertices"]
    events = read_events(tmp_path / "inline-job" / "events.jsonl", 0)
    assert any("see no light" in event.get("message", "") for _, event in events)


def test_objects_that_float32_does_not_resolve_are_told_of(tmp_path: Path) -> None:
    ball = sphere(6, 8)
    for number, metres in enumerate((1e2, 1e5)):
        far = Mesh("shell", ball.positions + np.float32(metres), ball.triangles, ball.normals, ball.albedo)
        run(tmp_path / str(number), write_mesh(tmp_path / f"{number}.glb", far), directions=64)
        events = read_events(tmp_path / str(number) / "inline-job" / "events.jsonl", 0)
        told = [event["message"] for _, event in events if "far from the origin" in event.get("message", "")]
        assert len(told) == number, told


def test_mistakes_are_named(tmp_path: Path, mesh: Path) -> None:
    with pytest.raises(LightwellError, match=r"no object 'cube'.*'ball', 'plate'"):
        run(tmp_path / "a", mesh, object_albedo={"cube": [0, 0, 0]})
    with pytest.raises(LightwellError, match=r"gone\.glb"):
        estimate(PrtTransferSettings(mesh=str(tmp_path / "gone.glb")))


def test_the_estimate_grows_with_the_work(mesh: Path) -> None:
    def of(**settings: Any) -> Any:
        return estimate(PrtTransferSettings.model_validate({"mesh": str(mesh), "directions": 65536} | settings))

    assert of(mode="unshadowed").seconds < of(sampling="fibonacci").seconds < of().seconds
    assert of().seconds < of(mode="interreflected").seconds
    assert of().disk_bytes < of(mode="interreflected").disk_bytes
    assert of(ground=True).seconds > 20 * of().seconds


def test_the_same_work_is_done_once(tmp_path: Path) -> None:
    data = tmp_path
    path = write_mesh(data / "meshes" / "ball.glb", sphere(60, 90))
    settings = {"mesh": str(path), "directions": 400}
    with executor(data):
        queue = Queue(JobsSettings(), data)
        first = wait_for_end(queue, queue.submit("prt-transfer", settings)[0].id)
        assert first.state == "succeeded", first.error
        copy = data / "meshes" / "copy.glb"
        shutil.copyfile(path, copy)
        second = wait_for_end(queue, queue.submit("prt-transfer", settings | {"mesh": str(copy)})[0].id)
        assert digests(second) == digests(first)
        log = [event for _, event in queue.events(second.id)]
        assert any(event.get("job") == first.id for event in log)
        assert not any(event.get("stage") == "trace" for event in log)
        # Its files stay when the first job goes, and serve the next.
        queue.delete(first.id)
        third = wait_for_end(queue, queue.submit("prt-transfer", settings)[0].id)
        assert digests(third) == digests(first)
        assert any(event.get("job") == second.id for _, event in queue.events(third.id))
        other = wait_for_end(queue, queue.submit("prt-transfer", settings | {"seed": 1})[0].id)
        assert digests(other) != digests(first)
        for job in (second, third, other):
            queue.delete(job.id)
        again = wait_for_end(queue, queue.submit("prt-transfer", settings)[0].id)
        assert digests(again) == digests(first)
        assert any(event.get("stage") == "trace" for _, event in queue.events(again.id))
        queue.close()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_killed_job_gives_the_same_bytes(tmp_path: Path) -> None:
    data = tmp_path
    path = write_mesh(data / "meshes" / "fine.glb", sphere(60, 90))
    settings = {
        "mesh": str(path),
        "directions": 900,
        "mode": "interreflected",
        "ground": True,
        "checkpoint_seconds": 0.5,
        "reuse": False,
    }
    queue = Queue(JobsSettings(), data)
    with executor(data) as process:
        whole = wait_for_end(queue, queue.submit("prt-transfer", settings)[0].id)
        assert whole.state == "succeeded", whole.error
        job = queue.submit("prt-transfer", settings)[0].id
        for stage in ("trace", "bounce 1 of 2"):
            wait_for(partial(_is_in, queue, job, stage), stage)
            process.kill()
            for below in process.descendants():
                below.kill()
            process.start()
        killed = wait_for_end(queue, job, 300)
    assert killed.state == "succeeded", killed.error
    assert digests(killed) == digests(whole)
    queue.close()


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_a_cancelled_job_stops_within_two_seconds(tmp_path: Path) -> None:
    data = tmp_path
    path = write_mesh(data / "meshes" / "long.glb", sphere(200, 300))
    queue = Queue(JobsSettings(), data)
    with executor(data):
        job = queue.submit("prt-transfer", {"mesh": str(path), "directions": 20000, "reuse": False})[0].id
        wait_for(partial(_is_in, queue, job, "trace"), "tracing")
        time.sleep(2)
        asked = time.time_ns()
        queue.cancel(job)
        wait_for(lambda: queue.get(job).state == "cancelled", "the end")
        stopped = next(event["time_ns"] for _, event in queue.events(job) if event.get("state") == "cancelled")
        assert (stopped - asked) / 1e9 < 6  # two seconds where nothing else runs
    queue.close()


def _is_in(queue: Queue, job: str, stage: str) -> bool:
    progress = queue.get(job).progress
    return progress is not None and progress.stage == stage


def test_a_job_that_is_to_stop_stops_between_blocks(tmp_path: Path, mesh: Path) -> None:
    directory = JobDirectory(tmp_path, "inline-job")
    directory.path.mkdir()
    context = JobContext(directory, EventLog(directory.events), InlineCompute(), threading.Event())
    context.results.mkdir(parents=True)
    settings = PrtTransferSettings(mesh=str(mesh), directions=256)
    kind = PrtTransfer()
    kind.prepare(settings, context)
    steps = kind.steps(settings, context)
    directory.cancel.touch()
    with pytest.raises(JobCancelled):
        steps[0].run(context)
    directory.cancel.unlink()
    for step in steps:
        step.run(context)
    assert (context.results / "transfer.json").exists()
