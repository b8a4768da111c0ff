"""Rays against triangle meshes, by Embree.

Embree answers a whole batch in one call without the GIL: run one batch a thread. Rays start at distance 0, so an origin
that lies on a surface is to be lifted off it first (`lightwell.transfer.offsets`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Int32s, Mesh

MISS = -1


class Hits(NamedTuple):
    """The nearest hit of each of N rays."""

    mesh: Int32s
    """``(N,)`` index of the mesh, −1 where nothing was hit."""
    triangle: Int32s
    """``(N,)`` index of the triangle in its mesh, −1 where nothing was hit."""
    barycentric: Float32s
    """``(N, 2)``: u and v; the point is ``(1 − u − v) a + u b + v c``."""
    distance: Float32s
    """``(N,)`` in lengths of the direction: metres for unit vectors; infinite where nothing was hit."""


class RayScene:
    """Meshes that rays can be sent into; immutable, and may be used from several threads at once."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self.meshes = tuple(meshes)
        self._scene = EmbreeScene()
        solid = [index for index, mesh in enumerate(self.meshes) if len(mesh.triangles)]
        # Embree numbers its geometries as they come; meshes without triangles are not among them.
        self._mesh_of_geometry = np.array([*solid, MISS], dtype=np.int32)
        self._geometries = [
            TriangleMesh(self._scene, self.meshes[index].positions, self.meshes[index].triangles) for index in solid
        ]
        # The first ray builds the hierarchy, which two threads must not do at once.
        self.occluded(np.zeros((1, 3), np.float32), np.array([[0, 0, 1]], np.float32))

    def occluded(self, origins: Float32s, directions: Float32s, distances: Float32s | None = None) -> NDArray[np.bool_]:
        """Return ``(N,)``: whether the ray from each origin meets anything.

        ``origins (N, 3)`` metres; ``directions (N, 3)``, or ``(1, 3)`` for all rays; ``distances (N,)``: where each ray
        ends, in lengths of its direction; by default nowhere.
        """
        if not self._geometries or len(origins) == 0:
            return np.zeros(len(origins), np.bool_)
        ends = None if distances is None else np.ascontiguousarray(distances, dtype=np.float32)
        answers = self._scene.run(_rows(origins), _rows(directions), ends, query="OCCLUDED")
        return np.asarray(answers == 0)  # 0 a hit, −1 free

    def intersect(self, origins: Float32s, directions: Float32s, distances: Float32s | None = None) -> Hits:
        """Return the nearest hit of each ray; arguments as in `occluded`."""
        count = len(origins)
        if not self._geometries or count == 0:
            missed = np.full(count, MISS, np.int32)
            return Hits(missed, missed.copy(), np.zeros((count, 2), np.float32), np.full(count, np.inf, np.float32))
        ends = None if distances is None else np.ascontiguousarray(distances, dtype=np.float32)
        answers = self._scene.run(_rows(origins), _rows(directions), ends, query="INTERSECT", output=True)
        missed = answers["primID"] < 0
        geometry = np.where(missed, len(self._geometries), answers["geomID"])
        return Hits(
            self._mesh_of_geometry[geometry],
            np.where(missed, MISS, answers["primID"]),
            np.stack([answers["u"], answers["v"]], axis=1),
            np.where(missed, np.float32(np.inf), answers["tfar"]),
        )


def _rows(vectors: Float32s) -> Float32s:
    """Return vectors as Embree's binding reads them."""
    return np.ascontiguousarray(vectors, dtype=np.float32)
