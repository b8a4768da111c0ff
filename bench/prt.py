"""Transfer of the scenes of paper 003's Table 1 at 2,500 directions with visibility: time, memory, rays per second.

The paper's own models are not at hand: the sphere is a sphere, and the others are the bunny refined, or a knot, to as
many vertices as the paper's with a ground plane under each, as there. Jobs run in an executor as a server starts it;
compute processes are started and kernels compiled before the clock starts. Baselines: the paper's minutes, and for rays
per second bare Embree (OCCLUDED, whole batches of the very rays) on one core in the same run, both by core time, so
that other work on the machine hardly shows.
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

import lightwell_workers
from bench.jobs import job_queue, wait_for
from bench.report import Row, row
from lightwell.geometry.mesh import Mesh, make_mesh, vertex_normals
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import sphere
from lightwell.io.glb import encode_glb
from lightwell.io.meshes import load_meshes
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer import kernels
from lightwell.transfer.directions import make_directions
from lightwell.transfer.surface import make_surface
from lightwell_workers.jobs.prt_plan import load_scene
from lightwell_workers.jobs.queue import Queue

DIRECTIONS = 2500
SCENES = (
    ("sphere", 6384, 20, 48, 5.19),
    ("bunny", 7455, 20, 48, 7.17),
    ("knot (for the buddha)", 54938, 64, 96, 330.0),
    ("bunny refined (for the dragon)", 54952, 64, 96, 376.0),
)
"""Name, vertices with the ground, rings and segments of the ground, the paper's minutes."""
BUNNY = Path(lightwell_workers.__file__).parent / "samples" / "meshes" / "bunny.glb"
SAMPLED_VERTICES = 400
AIM_SECONDS, AIM_MB = 25.0, 2000.0
MEGABYTE = 1e6


def run() -> list[Row]:
    """Return seconds, core seconds, memory and rays per core second of each scene."""
    rows: list[Row] = []
    with job_queue() as (queue, data, executor):
        _job(queue, data / "warm.glb", _bunny(20_000), 8, 16, 1024)
        for name, vertices, rings, segments, minutes in SCENES:
            rows += _measure(queue, data, executor, name, vertices, (rings, segments), minutes)
    return rows


def _measure(
    queue: Queue, data: Path, executor: int, name: str, vertices: int, ground: tuple[int, int], minutes: float
) -> list[Row]:
    rings, segments = ground
    mesh = _shape(name, vertices - 1 - rings * segments)
    path = data / f"{vertices}.glb"
    meter = _Meter(executor)
    with meter:
        seconds, rays, tracing = _job(queue, path, mesh, rings, segments, DIRECTIONS)
    bare, found = _bare_rate(path, rings, segments)
    assert found == vertices, (found, vertices)
    title = f"{name}, {vertices}"
    return [
        row(f"{title}: whole job", seconds, "s", minutes * 60),
        row(f"{title}: core time", meter.core_seconds, "s"),
        row(f"{title}: peak memory of all processes", meter.peak_bytes / MEGABYTE, "MB", AIM_MB),
        row(f"{title}: rays a core second (millions)", rays / tracing / 1e6, "", bare / 1e6),
    ]


def _job(queue: Queue, path: Path, mesh: Mesh, rings: int, segments: int, directions: int) -> tuple[float, int, float]:
    """Run a job; return its seconds, from submission to the end, its rays and the core seconds of tracing them."""
    path.write_bytes(encode_glb([mesh]))
    started = time.perf_counter()
    settings = _settings(path, rings, segments, directions).model_dump(mode="json")
    job = queue.submit("prt-transfer", settings)[0].id
    wait_for(queue, job, poll_seconds=0.05)
    seconds = time.perf_counter() - started
    events: list[dict[str, Any]] = [event for _, event in queue.events(job)]
    rays, tracing = (sum(event.get(name, 0) for event in events) for name in ("rays", "core_seconds"))
    return seconds, int(rays), float(tracing)


def _settings(path: Path, rings: int, segments: int, directions: int) -> PrtTransferSettings:
    return PrtTransferSettings(
        mesh=str(path),
        sampling="stratified",
        directions=directions,
        ground=True,
        ground_rings=rings,
        ground_segments=segments,
    )


def _bare_rate(path: Path, rings: int, segments: int) -> tuple[float, int]:
    """Return the rays that Embree alone does in a core second, of a sample of the job's, and the vertices."""
    settings = _settings(path, rings, segments, DIRECTIONS)
    surface = make_surface(load_scene(settings))
    scene = RayScene([surface.merged])
    directions = make_directions("stratified", DIRECTIONS, settings.seed)
    chosen = np.linspace(0, surface.count - 1, SAMPLED_VERTICES).astype(np.int64)
    room = len(chosen) * directions.count
    origins, vectors = np.empty((room, 3), np.float32), np.empty((room, 3), np.float32)
    used = kernels.start_rays(
        surface.origins[chosen],
        surface.merged.normals[chosen],
        surface.sides[chosen],
        directions.vectors,
        np.zeros(len(chosen)),
        origins,
        vectors,
        np.empty(room, np.int32),
        np.empty(len(chosen) + 1, np.int64),
    )
    best = np.inf
    for _ in range(3):
        started = time.thread_time()
        scene.occluded(origins[:used], vectors[:used])
        best = min(best, time.thread_time() - started)
    return used / best, surface.count


class _Meter:
    """Watches a process and those below it: memory and core time."""

    def __init__(self, pid: int) -> None:
        self._pid = pid
        self._end = threading.Event()
        self.peak_bytes = 0
        self.core_seconds = 0.0

    def __enter__(self) -> None:
        self._before = self._core()
        self._thread = threading.Thread(target=self._watch)
        self._thread.start()

    def __exit__(self, *_: object) -> None:
        self.core_seconds = self._core() - self._before
        self._end.set()
        self._thread.join()

    def _processes(self) -> list[psutil.Process]:
        parent = psutil.Process(self._pid)
        return [parent, *parent.children(recursive=True)]

    def _core(self) -> float:
        return sum(sum(process.cpu_times()[:2]) for process in self._processes())

    def _watch(self) -> None:
        while not self._end.wait(0.05):
            self.peak_bytes = max(self.peak_bytes, sum(process.memory_info().rss for process in self._processes()))


def _shape(name: str, vertices: int) -> Mesh:
    if name.startswith("sphere"):
        return _sphere(vertices)
    return _knot(vertices) if name.startswith("knot") else _bunny(vertices)


def _sphere(vertices: int) -> Mesh:
    """Return a sphere of exactly so many vertices: two poles and rings."""
    body = vertices - 2
    segments = min((n for n in range(3, body) if body % n == 0), key=lambda n: abs(n - (2 * body) ** 0.5))
    rings = body // segments
    return sphere(rings + 1, segments)


def _bunny(vertices: int) -> Mesh:
    (mesh,) = load_meshes(BUNNY)
    return refine(mesh, vertices)


def _knot(vertices: int) -> Mesh:
    """Return a tube along a (2, 5) torus knot, which shadows itself much, refined to so many vertices."""
    along, around = 600, 64
    t = 2 * np.pi * np.arange(along) / along
    centre = np.stack(
        [(1 + 0.45 * np.cos(5 * t)) * np.cos(2 * t), (1 + 0.45 * np.cos(5 * t)) * np.sin(2 * t), 0.45 * np.sin(5 * t)],
        axis=1,
    )
    tangent = np.roll(centre, -1, axis=0) - np.roll(centre, 1, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    side = np.cross(tangent, centre * [1, 1, 0])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    across = np.cross(tangent, side)
    angle = 2 * np.pi * np.arange(around) / around
    radius = 0.17 * (1 + 0.15 * np.cos(9 * angle))[None, :, None]
    out = np.cos(angle)[None, :, None] * side[:, None] + np.sin(angle)[None, :, None] * across[:, None]
    points = (centre[:, None] + radius * out).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(along), np.arange(around), indexing="ij")
    a, b = i * around + j, i * around + (j + 1) % around
    c, d = ((i + 1) % along) * around + j, ((i + 1) % along) * around + (j + 1) % around
    quads = np.stack([a, b, d, c], axis=-1).reshape(-1, 4)
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    return refine(make_mesh("knot", points, triangles), vertices)


def refine(mesh: Mesh, vertices: int) -> Mesh:
    """Return a closed mesh with exactly so many vertices: its longest edges halved, bent like its normals."""
    points, triangles = mesh.positions.astype(np.float64), mesh.triangles.astype(np.int64)
    if len(points) > vertices:
        raise ValueError(f"{mesh.name} has {len(points)} vertices; it cannot be refined to {vertices}")
    while len(points) < vertices:
        points, triangles = _halve_longest(points, triangles, vertices - len(points))
    return make_mesh(mesh.name, points, triangles)


def _halve_longest(
    points: NDArray[np.float64], triangles: NDArray[np.int64], most: int
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Halve up to ``most`` edges, longest first, no two of one triangle."""
    ends = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, owner = np.unique(ends, axis=0, return_inverse=True)
    owner = owner.reshape(-1)
    by_edge = np.argsort(owner, kind="stable") // 3
    starts = np.searchsorted(np.sort(owner), np.arange(len(edges) + 1))
    length = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1)
    taken = np.zeros(len(triangles), np.bool_)
    normals = vertex_normals(points.astype(np.float32), triangles.astype(np.int32))
    new_points: list[NDArray[np.float64]] = []
    new_triangles: list[list[int]] = []
    gone: list[int] = []
    for edge in np.argsort(-length)[: max(1, len(edges) // 3)]:
        sharing = by_edge[starts[edge] : starts[edge + 1]]
        if len(new_points) == most or taken[sharing].any():
            continue
        taken[sharing] = True
        a, b = edges[edge]
        middle, along = (points[a] + points[b]) / 2, points[b] - points[a]
        # Phong tessellation (Boubekeur and Alexa 2008): towards the planes of the ends.
        bend = ((along / 2) @ normals[b] * normals[b] - (along / 2) @ normals[a] * normals[a]) / 2
        new_points.append(middle + 0.5 * bend)
        number = len(points) + len(new_points) - 1
        for triangle in sharing:
            corners = triangles[triangle].tolist()
            gone.append(int(triangle))
            new_triangles += [[number if c == a else c for c in corners], [number if c == b else c for c in corners]]
    kept = np.delete(triangles, gone, axis=0)
    return np.concatenate([points, new_points]), np.concatenate([kept, new_triangles])


def print_report(name: str, rows: list[Row]) -> None:
    """Print one line a scene."""
    table = Table(title=f"{name}: {DIRECTIONS} directions, shadows, ground", title_justify="left")
    for heading in ("scene", "job s", "paper min", "faster", "core s", "MB", "Mray/s", "Embree", "ratio"):
        table.add_column(heading, justify="left" if heading == "scene" else "right")
    for first in range(0, len(rows), 4):
        job, core, memory, rays = rows[first : first + 4]
        paper = job.get("baseline", 0.0)
        table.add_row(
            job["name"].partition(":")[0],
            f"{job['value']:.1f}",
            f"{paper / 60:.2f}",
            f"{paper / job['value']:.0f}",
            f"{core['value']:.1f}",
            f"{memory['value']:.0f}",
            f"{rays['value']:.2f}",
            f"{rays.get('baseline', 0):.2f}",
            f"{rays.get('ratio', 0):.2f}",
        )
    console = Console(file=sys.stdout)
    console.print(table)
    console.print(f"aim: 55,000 vertices in {AIM_SECONDS:.0f} s on 2 cores with less than {AIM_MB:.0f} MB")
