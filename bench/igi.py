"""A picture by virtual point lights: time, share of bare Embree, memory (issue 6).

1024 × 1024 pixels, 4 × 4 sets, 1,024 virtual lights, 9 coefficients, of a room with panels, the bunny and a bump-mapped
floor. The baseline of the share is bare Embree: the very shadow rays of some tiles again (OCCLUDED, the same batches),
by core time of the same run, so that other work on the machine hardly shows.
"""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path

import numpy as np
import psutil
from numpy.typing import NDArray

import lightwell_workers
from bench.report import Row, row
from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import box, plane
from lightwell.igi import IgiMaterial, IgiObject, IgiScene, Texture, render_igi
from lightwell.igi.render import IgiRenderer
from lightwell.igi.rendering import cut
from lightwell.igi_settings import IgiSettings
from lightwell.io.meshes import load_meshes
from lightwell.render import Camera

SIZE = (1024, 1024)
SETTINGS = IgiSettings(sets=(4, 4), vpls=1024, bands=3)
CAMERA = Camera((1.5, -1.7, 1.7), (-0.3, 0.4, 0.9), fov_degrees=60)
BUNNY = Path(lightwell_workers.__file__).parent / "samples" / "meshes" / "bunny.glb"
SAMPLED_TILES = 8
AIM_SECONDS, AIM_SHARE, AIM_MB = 40.0, 0.6, 2000.0


def run() -> list[Row]:
    """Return seconds, core seconds, rays, the share of bare Embree, and memory."""
    scene = _scene()
    render_igi(scene, CAMERA, (64, 64), SETTINGS)
    with _Peak() as peak:
        core, started = time.process_time(), time.perf_counter()
        picture = render_igi(scene, CAMERA, SIZE, SETTINGS)
        seconds, core = time.perf_counter() - started, time.process_time() - core
    tracing, whole, rays = _tracing(scene)
    cores = os.cpu_count() or 1
    return [
        row(f"1024 × 1024, 4 × 4 sets, 1,024 lights: whole picture, {cores} cores", seconds, "s", AIM_SECONDS),
        row("the same: core time", core, "s"),
        row("shadow rays (millions)", picture.rays / 1e6, ""),
        row("bare Embree, rays a core second (millions)", rays / tracing / 1e6, ""),
        row("share of bare Embree in the core time of tiles", tracing / whole, "", AIM_SHARE),
        row("share of the light that the clamp takes", picture.clamp_bias, ""),
        row("peak memory", peak.bytes / 1e6, "MB", AIM_MB),
    ]


class _Recorder:
    """Passes rays on and keeps them."""

    def __init__(self, rays: RayScene) -> None:
        self._rays = rays
        self.batches: list[tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.float32]]] = []

    def occluded(
        self, origins: NDArray[np.float32], directions: NDArray[np.float32], distances: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        self.batches.append((origins.copy(), directions.copy(), distances.copy()))
        return self._rays.occluded(origins, directions, distances)


def _tracing(scene: IgiScene) -> tuple[float, float, int]:
    """Return core seconds of bare Embree and of whole tiles, on one thread, and the number of rays."""
    renderer = IgiRenderer(scene, SETTINGS)
    tiles = cut(SIZE)
    chosen = [tiles[k] for k in np.linspace(0, len(tiles) - 1, SAMPLED_TILES).astype(int)]
    bare, whole, count = 0.0, 0.0, 0
    for tile in chosen:
        started = time.thread_time()
        renderer.tile(CAMERA, SIZE, tile)
        whole += time.thread_time() - started
        recorder = _Recorder(renderer.surfaces.rays)
        renderer._gatherer._rays = recorder  # type: ignore[assignment]
        renderer.tile(CAMERA, SIZE, tile)
        renderer._gatherer._rays = renderer.surfaces.rays
        started = time.thread_time()
        for origins, directions, distances in recorder.batches:
            renderer.surfaces.rays.occluded(origins, directions, distances)
        bare += time.thread_time() - started
        count += sum(len(batch[0]) for batch in recorder.batches)
    return bare, whole, count


class _Peak:
    """Watches this process's memory."""

    def __init__(self) -> None:
        self._end = threading.Event()
        self.bytes = 0

    def __enter__(self) -> _Peak:
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        process = psutil.Process()
        while not self._end.wait(0.05):
            self.bytes = max(self.bytes, process.memory_info().rss)


def _scene() -> IgiScene:
    def matte(*base: float) -> IgiMaterial:
        return IgiMaterial(base=(base[0], base[1], base[2]), specular=0)

    inside = box()
    room = make_mesh("room", inside.positions * [2, 2, 1.5] + [0, 0, 1.5], inside.triangles, -inside.normals)
    flat = plane(1)
    floor = make_mesh("floor", flat.positions * [2, 2, 1] + [0, 0, 0.002], flat.triangles, flat.normals)
    uv = (2 * (flat.positions[:, :2] + 1)).astype(np.float32)
    waves = np.sin(np.linspace(0, 16 * np.pi, 256, endpoint=False))
    heights = (waves[:, None] * waves)[..., None].astype(np.float32)
    bumpy = IgiMaterial(base=(0.5, 0.45, 0.4), roughness=0.5, bump_texture=Texture(heights), bump_metres=0.01)
    panels = [
        make_mesh(
            "panel",
            flat.positions * [width / 2, depth / 2, 1] + np.array([x, y, 2.97]),
            flat.triangles[:, ::-1],
            -flat.normals,
        )
        for width, depth, x, y in ((1.0, 0.6, -0.8, 0.6), (0.6, 1.0, 1.0, -0.6))
    ]
    return IgiScene(
        (
            IgiObject(room, matte(0.7, 0.68, 0.65)),
            IgiObject(floor, bumpy, (uv,)),
            IgiObject(_bunny(), matte(0.6, 0.5, 0.3)),
            *(IgiObject(panel, IgiMaterial(base=(0, 0, 0), emission=(14.0, 14.0, 13.0))) for panel in panels),
        )
    )


def _bunny() -> Mesh:
    """Return the bunny, 1.2 m tall, on the floor."""
    (mesh,) = load_meshes(BUNNY)
    lower, upper = mesh.bounds
    scale = 1.2 / float(upper[2] - lower[2])
    middle = (lower + upper) / 2
    moved = (mesh.positions - [middle[0], middle[1], lower[2]]) * scale + [-0.4, 0.5, 0.002]
    return make_mesh("bunny", moved, mesh.triangles, mesh.normals, mesh.albedo)
