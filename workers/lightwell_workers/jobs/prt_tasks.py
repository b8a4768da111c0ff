"""The tasks of a ``prt-transfer`` job: what runs on the compute processes. They exchange data through files."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Mesh, make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import box
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer.bounces import fill_hidden, gather
from lightwell.transfer.directions import Directions, Sampling, make_directions
from lightwell.transfer.surface import Surface, make_surface, merge
from lightwell.transfer.visibility import HIT, DirectTransfer, Tracer
from lightwell_workers.jobs.context import stop_if_cancelled

LEAST_DIRECTIONS = 64
ROWS = 512
"""Vertices whose bounces are gathered between looks at whether the job is to stop."""


class Opened(NamedTuple):
    """The scene of a job in one compute process."""

    surface: Surface
    scene: RayScene
    directions: Directions


def save_arrays(path: Path, **arrays: NDArray[Any]) -> None:
    """Write arrays to a file that appears whole or not at all."""
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with unfinished.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def save_scene(path: Path, meshes: Sequence[Mesh]) -> None:
    """Write the meshes of a job."""
    arrays: dict[str, NDArray[Any]] = {"names": np.array([mesh.name for mesh in meshes])}
    for index, mesh in enumerate(meshes):
        for name in ("positions", "triangles", "normals", "albedo"):
            arrays[f"{index}.{name}"] = getattr(mesh, name)
    save_arrays(path, **arrays)


def load_meshes_of(path: Path) -> list[Mesh]:
    """Read what `save_scene` wrote."""
    with np.load(path) as file:
        return [
            Mesh(str(name), *(file[f"{index}.{array}"] for array in ("positions", "triangles", "normals", "albedo")))
            for index, name in enumerate(file["names"])
        ]


@lru_cache(maxsize=2)
def _open(scene: str, document: str, digest: str) -> Opened:
    """Return the scene of one job, which several threads of a process may work on."""
    del digest
    settings = PrtTransferSettings.model_validate_json(document)
    surface = make_surface(load_meshes_of(Path(scene)))
    directions = make_directions(settings.sampling, settings.directions, settings.seed)
    return Opened(surface, RayScene([surface.merged]), directions)


def trace_part(
    cancel: Path, document: str, digest: str, scene: str, out: str, first: int, last: int, keep_hits: bool
) -> tuple[int, float]:
    """Write the direct transfer of the vertices ``first`` … ``last − 1`` to ``out``; return rays and core seconds."""
    settings = PrtTransferSettings.model_validate_json(document)
    opened = _open(scene, document, digest)
    started = time.thread_time()
    # A tracer has room for the rays of one thread; workers of a cluster may have several.
    tracer = Tracer(opened.surface, opened.scene, opened.directions, settings.bands, settings.turn == "vertex")
    found = tracer.direct(first, last, keep_hits, partial(stop_if_cancelled, cancel))
    seconds = time.thread_time() - started
    save_arrays(
        Path(out),
        halves=found.halves,
        state=found.state,
        hits=found.hits.view(np.uint8),
        hit_counts=found.hit_counts,
        rays=np.array(found.rays),
    )
    return found.rays, seconds


def compile_kernels(cancel: Path, document: str) -> float:
    """Go once through all that the job's settings need, on next to nothing; return the seconds that it took.

    On a fresh installation most of a minute goes by while numba compiles; then its cache on disk serves every process.
    """
    stop_if_cancelled(cancel)
    started = time.perf_counter()
    settings = PrtTransferSettings.model_validate_json(document)
    _compile(settings.sampling, settings.turn == "vertex", settings.mode == "interreflected")
    return time.perf_counter() - started


@lru_cache
def _compile(sampling: Sampling, turned: bool, bounces: bool) -> None:
    outside, inside = box(), box()
    # The vertices of the inner box see no light: they are asked whether they lie inside a solid, and filled in.
    inside = make_mesh("inside", inside.positions * np.float32(0.5), inside.triangles, inside.normals, inside.albedo)
    surface = make_surface([outside, inside])
    directions = make_directions(sampling, LEAST_DIRECTIONS, 0)
    tracer = Tracer(surface, RayScene([surface.merged]), directions, 1, turned)
    count = len(surface.merged.positions)
    found = tracer.direct(0, count, bounces, lambda: None)
    filled = fill_hidden(found.halves.sum(axis=1), found.state, surface.merged.triangles)
    if bounces:
        gather(found.hits, found.hit_counts, surface.merged.triangles, filled[:, :, None])


def load_direct(path: Path) -> DirectTransfer:
    """Read what `trace_part` wrote."""
    with np.load(path) as file:
        return DirectTransfer(
            file["halves"], file["state"], file["hits"].view(HIT), file["hit_counts"], int(file["rays"])
        )


def load_sums(path: Path) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return ``halves`` and ``state`` of what `trace_part` wrote; its hits, most of the file, stay where they are."""
    with np.load(path) as file:
        return file["halves"], file["state"]


def bounce_part(cancel: Path, scene: str, direct: str, source: str, out: str) -> None:
    """Write what the vertices of a part get from the surfaces that they see.

    ``source``: ``(V, bands², channels)`` float32 as ``.npy``: albedo times the transfer of the bounce before.
    """
    part = load_direct(Path(direct))
    reflected: Float32s = np.load(source, mmap_mode="r")
    triangles = _triangles(scene)
    ends = np.concatenate([[0], np.cumsum(part.hit_counts)])
    rows = []
    for first in range(0, len(part.hit_counts), ROWS):
        stop_if_cancelled(cancel)
        last = min(first + ROWS, len(part.hit_counts))
        rows.append(gather(part.hits[ends[first] : ends[last]], part.hit_counts[first:last], triangles, reflected))
    save_arrays(Path(out), bounce=np.concatenate(rows))


@lru_cache(maxsize=2)
def _triangles(scene: str) -> NDArray[np.int32]:
    return merge(load_meshes_of(Path(scene))).triangles
