"""What a ``prt-transfer`` job works on and in which order: fixed before it starts, whatever computes it."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.io.meshes import load_meshes
from lightwell.io.uploads import read_record
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer.directions import make_directions
from lightwell.transfer.ground import ground_under
from lightwell_workers.jobs.kind import Estimate, JobError

VERSION = 1
"""Of the method; a new one makes earlier results unfit for reuse."""
MEGABYTE = 1 << 20
RAY_SECONDS = 0.3e-6
"""Core time of a ray and of what it adds."""
BOUNCE_SECONDS = 60e-9
"""Core time to gather one hit of one channel."""
VERTEX_SECONDS = 8e-6
"""Core time to read, write and bake a vertex."""
LEAST_SECONDS = 0.3
PROCESS_BYTES = 300 * MEGABYTE
VERTEX_BYTES = 1200
"""Memory of a vertex with its triangles, the ray hierarchy and its coefficients."""
HIT_BYTES = 12
HIT_SHARE = 0.5
"""Of all directions of a sphere, those that can meet another surface at most."""
PART_SECONDS = 0.5
LEAST_PART = 256
NOT_IN_DIGEST = {"mesh", "reuse", "checkpoint_seconds"}
"""Settings that do not change the result, or that show in the meshes."""


class Part(msgspec.Struct, array_like=True):
    """A range of vertices."""

    first: int
    last: int


class Plan(msgspec.Struct):
    """Written once, when the job is prepared."""

    digest: str
    """Of the meshes and all that decides the result."""
    objects: int
    """Meshes of the file; a ground plane comes after them."""
    vertices: int
    channels: int
    parts: list[Part]
    together: int
    """Parts in one checkpoint."""
    reused: str | None = None
    """Job whose result is taken."""


class MeshSize(NamedTuple):
    """What a mesh file holds."""

    vertices: int
    triangles: int


def mesh_size(path: Path) -> MeshSize:
    """Return how large a mesh is: as its upload says, else by reading it; raises `LightwellError`."""
    record = read_record(path.parent)
    if record is not None and record.path_below(path.parent) == path and record.contents.vertices is not None:
        return MeshSize(record.contents.vertices, record.contents.triangles or 0)
    try:
        found = path.stat()
    except OSError:
        found = None
    return _read_size(path, (found.st_mtime_ns, found.st_size) if found is not None else None)


@lru_cache(maxsize=64)
def _read_size(path: Path, version: tuple[int, int] | None) -> MeshSize:
    del version
    meshes = load_meshes(path)
    return MeshSize(sum(len(mesh.positions) for mesh in meshes), sum(len(mesh.triangles) for mesh in meshes))


def estimate(settings: PrtTransferSettings) -> Estimate:
    """Return what a job needs; raises `LightwellError` where the mesh cannot be used."""
    size = mesh_size(Path(settings.mesh))
    vertices = size.vertices + (settings.ground_rings * settings.ground_segments + 1 if settings.ground else 0)
    rays, hits, bounces = 0.0, 0.0, 0
    if settings.mode != "unshadowed":
        rays = vertices * settings.directions * (1.0 if settings.sampling == "hemisphere" else 0.5)
    if settings.mode == "interreflected":
        hits, bounces = HIT_SHARE * rays, settings.bounces
    values = settings.bands**2 * (3 if bounces else 1)
    held = HIT_SHARE * max(LEAST_PART * settings.directions, PART_SECONDS / RAY_SECONDS) if bounces else 0.0
    seconds = rays * RAY_SECONDS + bounces * hits * BOUNCE_SECONDS * (3 if bounces else 1)
    return Estimate(
        seconds=seconds + vertices * VERTEX_SECONDS + LEAST_SECONDS,
        memory_bytes=round(PROCESS_BYTES + vertices * (VERTEX_BYTES + 16 * values) + 2 * HIT_BYTES * held),
        disk_bytes=round(MEGABYTE + vertices * (160 + 10 * values + (112 if settings.bake else 0)) + HIT_BYTES * hits),
    )


def seconds_a_vertex(settings: PrtTransferSettings) -> float:
    """Return the core time of a vertex's rays."""
    return settings.directions * RAY_SECONDS * (1.0 if settings.sampling == "hemisphere" else 0.5)


def load_scene(settings: PrtTransferSettings, check: Callable[[], None] = lambda: None) -> list[Mesh]:
    """Return the meshes of a job: those of the file with the albedo that is asked for, and the ground.

    ``check`` is called after each object, and may raise to stop.

    Raises
    ------
    MeshError, JobError
        Where the file cannot be used, or an object is named that is not in it.
    """
    meshes = load_meshes(settings.mesh, settings.up)
    names = [mesh.name for mesh in meshes]
    for name in settings.object_albedo:
        if name not in names:
            raise JobError(f"object_albedo: there is no object {name!r} in {settings.mesh}; there are {names[:20]}")
    changed = []
    for mesh in meshes:
        check()
        albedo = settings.object_albedo.get(mesh.name, settings.albedo)
        normals = None if settings.normals == "triangles" else mesh.normals
        chosen = mesh.albedo if albedo is None else np.asarray(albedo, np.float32)
        changed.append(make_mesh(mesh.name, mesh.positions, mesh.triangles, normals, chosen))
    if settings.ground:
        check()
        changed.append(
            ground_under(
                changed,
                settings.ground_radius,
                settings.ground_rings,
                settings.ground_segments,
                settings.ground_albedo,
            )
        )
    return changed


def digest_of(settings: PrtTransferSettings, meshes: list[Mesh]) -> str:
    """Return the SHA-256 of all that decides the result."""
    digest = hashlib.sha256(f"prt-transfer {VERSION}\n".encode())
    digest.update(settings.model_dump_json(exclude=NOT_IN_DIGEST).encode())
    for mesh in meshes:
        digest.update(f"\n{mesh.name}\n{len(mesh.positions)} {len(mesh.triangles)}\n".encode())
        for array in (mesh.positions, mesh.triangles, mesh.normals, mesh.albedo):
            digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def make_parts(settings: PrtTransferSettings, vertices: int, processes: int) -> tuple[list[Part], int]:
    """Return ranges of vertices, and how many of them make a checkpoint."""
    cost = seconds_a_vertex(settings)
    size = max(LEAST_PART, round(min(PART_SECONDS, settings.checkpoint_seconds) / cost))
    parts = [Part(first, min(first + size, vertices)) for first in range(0, vertices, size)]
    return parts, max(1, round(processes * settings.checkpoint_seconds / (size * cost)))


def count_of_directions(settings: PrtTransferSettings) -> int:
    """Return how many directions are taken: jittered ones come in squares."""
    return make_directions(settings.sampling, settings.directions, settings.seed).count


def read_plan(path: Path) -> Plan:
    """Read a plan."""
    return msgspec.json.decode(path.read_bytes(), type=Plan)
