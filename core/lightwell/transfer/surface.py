"""The points from which rays start: the vertices of all meshes, lifted off their own surface.

What is done about bad meshes:

- The side that a vertex looks to is that of its vertex normal; which way the triangles are wound does not matter.
- The lift goes along the geometric normal: the mean of the triangles round a vertex, each turned to the side of
  the vertex normal. Where triangles are missing, degenerate or cancel out, the vertex normal takes its place.
- The lift is `LIFT` of the mesh's diagonal, but no more than `LIFT_OF_EDGE` of the mean edge at the vertex, so that it
  does not jump over fine detail, and never less than float32 resolves there.
- A triangle keeps light out from both sides. Holes let it in.
- Light that falls on the back of a surface (the side away from its vertex normals) is lost: of that side nothing is
  known. A sheet that is to be lit from both sides needs two layers of triangles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Int32s, Mesh, vertex_normals

LIFT = 1e-4
LIFT_OF_EDGE = 0.05
LIFT_ULPS = 32
FAR_ULPS = 1 << 12
"""A mesh whose diagonal is fewer of float32's steps is too coarse there: the lift alone is a hundredth of it."""


@dataclass(frozen=True)
class Surface:
    """All vertices of a scene, mesh after mesh."""

    meshes: tuple[Mesh, ...]
    first_vertex: tuple[int, ...]
    """Where each mesh begins, and the total: one more entry than there are meshes."""
    merged: Mesh
    """All meshes as one."""
    origins: Float32s
    """``(V, 3)`` metres: where the rays of each vertex start."""
    sides: Float32s
    """``(V, 3)`` unit geometric normals; a ray below them starts into its own surface."""

    @property
    def count(self) -> int:
        """Number of vertices."""
        return len(self.origins)


def make_surface(meshes: Sequence[Mesh]) -> Surface:
    """Return the vertices of meshes (at least one), lifted off their surfaces."""
    first = np.concatenate([[0], np.cumsum([len(mesh.positions) for mesh in meshes])]).tolist()
    sides = [_geometric_normals(mesh) for mesh in meshes]
    lifted = [
        mesh.positions.astype(np.float64) + side * _lift(mesh)[:, None]
        for mesh, side in zip(meshes, sides, strict=True)
    ]
    return Surface(
        tuple(meshes),
        tuple(first),
        merge(meshes),
        np.concatenate(lifted).astype(np.float32),
        np.concatenate(sides).astype(np.float32),
    )


def is_far_away(mesh: Mesh) -> bool:
    """Return whether a mesh is so small and so far from the origin that float32 does not resolve it."""
    lower, upper = mesh.bounds
    diagonal = float(np.linalg.norm(upper.astype(np.float64) - lower))
    return 0 < diagonal < FAR_ULPS * float(np.spacing(np.abs(mesh.positions).max()))


def merge(meshes: Sequence[Mesh]) -> Mesh:
    """Return all meshes as one."""
    counts = [len(mesh.positions) for mesh in meshes]
    starts = np.cumsum([0, *counts[:-1]])
    triangles: list[Int32s] = [mesh.triangles + np.int32(start) for mesh, start in zip(meshes, starts, strict=True)]
    return Mesh(
        "scene",
        np.concatenate([mesh.positions for mesh in meshes]),
        np.concatenate(triangles),
        np.concatenate([mesh.normals for mesh in meshes]),
        np.concatenate([mesh.albedo for mesh in meshes]),
    )


def _geometric_normals(mesh: Mesh) -> NDArray[np.float64]:
    normals = vertex_normals(mesh.positions, mesh.triangles, towards=mesh.normals)
    # At right angles to the vertex normal, or missing, it says nothing about the side.
    unclear = np.einsum("vi,vi->v", normals, mesh.normals) < 0.05
    normals[unclear] = mesh.normals[unclear]
    return normals


def _lift(mesh: Mesh) -> NDArray[np.float64]:
    """Return how far each vertex is lifted, metres ``(V,)``."""
    lower, upper = mesh.bounds
    wanted = LIFT * float(np.linalg.norm(upper.astype(np.float64) - lower))
    most = LIFT_OF_EDGE * _mean_edges(mesh)
    resolved = LIFT_ULPS * np.spacing(np.abs(mesh.positions).max(axis=1)).astype(np.float64)
    return np.asarray(np.maximum(np.where(most > 0, np.minimum(wanted, most), wanted), resolved))


def _mean_edges(mesh: Mesh) -> NDArray[np.float64]:
    """Return the mean length of the edges at each vertex, metres ``(V,)``; 0 where there are none."""
    count = len(mesh.positions)
    total, edges = np.zeros(count), np.zeros(count)
    for corner in range(3):
        a, b = mesh.triangles[:, corner], mesh.triangles[:, (corner + 1) % 3]
        length = np.linalg.norm(mesh.positions[a].astype(np.float64) - mesh.positions[b], axis=1)
        for end in (a, b):
            total += np.bincount(end, length, minlength=count)
            edges += np.bincount(end, length > 0, minlength=count)
    return np.asarray(np.divide(total, edges, out=np.zeros(count), where=edges > 0))
