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

from lightwell.geometry.mesh import Float32s, Mesh
from lightwell.geometry.rays import RayScene
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer.bounces import gather
from lightwell.transfer.directions import make_directions
from lightwell.transfer.surface import Surface, make_surface, merge
from lightwell.transfer.visibility import HIT, DirectTransfer, Tracer
from lightwell_workers.jobs.context import stop_if_cancelled

ROWS = 512
"""Vertices whose bounces are gathered between looks at whether the job is to stop."""


class Opened(NamedTuple):
    """The scene of a job in one compute process."""

    surface: Surface
    tracer: Tracer


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
    """Return the scene of one job; no two threads of a process work on one job."""
    del digest
    settings = PrtTransferSettings.model_validate_json(document)
    surface = make_surface(load_meshes_of(Path(scene)))
    directions = make_directions(settings.sampling, settings.directions, settings.seed)
    tracer = Tracer(surface, RayScene([surface.merged]), directions, settings.bands, settings.turn == "vertex")
    return Opened(surface, tracer)


def trace_part(
    cancel: Path, document: str, digest: str, scene: str, out: str, first: int, last: int, keep_hits: bool
) -> tuple[int, float]:
    """Write the direct transfer of the vertices ``first`` … ``last − 1`` to ``out``; return rays and core seconds."""
    opened = _open(scene, document, digest)
    started = time.thread_time()
    found = opened.tracer.direct(first, last, keep_hits, partial(stop_if_cancelled, cancel))
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


def load_direct(path: Path) -> DirectTransfer:
    """Read what `trace_part` wrote."""
    with np.load(path) as file:
        return DirectTransfer(
            file["halves"], file["state"], file["hits"].view(HIT), file["hit_counts"], int(file["rays"])
        )


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
