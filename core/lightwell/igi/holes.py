"""Rays against a mesh of which some triangles have holes.

Triangles without holes are in one hierarchy of Embree's, those with holes in another; a ray that meets a hole goes on
behind it. A scene without holes is a `RayScene` and no slower for this.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Int32s, Mesh
from lightwell.geometry.rays import MISS, Hits, RayScene
from lightwell.igi.coverage import CUT, WHOLE

Bools = NDArray[np.bool_]
Solid = Callable[[NDArray[np.integer], Float32s], Bools]

MOST_HOLES = 64
"""A ray passes so many holes at most; the next triangle stops it."""
ROUNDING = np.float32(4 * np.finfo(np.float32).eps)
"""Of a place along a ray, of the way there."""


class HoledScene(RayScene):
    """One mesh with holes; immutable, and may be used from several threads at once.

    Hits are those of `RayScene`, of the triangles of the whole mesh.
    """

    def __init__(self, mesh: Mesh, kind: NDArray[np.int8], solid: Solid, step: float) -> None:
        """Take the mesh and what `lightwell.igi.coverage.Coverage` says of it.

        Parameters
        ----------
        kind
            ``(F,)``: `WHOLE`, `CUT` or `ABSENT`.
        solid
            Says of points of triangles, ``(n,)`` and ``(n, 2)``, whether there is a surface.
        step
            Metres that a ray goes on behind a hole, at least.
        """
        self._whole, self._cut = (np.flatnonzero(kind == one).astype(np.int32) for one in (WHOLE, CUT))
        self._solid = solid
        self._least = np.float32(step)
        self._holed = RayScene([replace(mesh, triangles=mesh.triangles[self._cut])])
        super().__init__([replace(mesh, triangles=mesh.triangles[self._whole])])
        self.meshes = (mesh,)

    def occluded(self, origins: Float32s, directions: Float32s, distances: Float32s | None = None) -> Bools:
        """Return ``(N,)``: whether the ray from each origin meets a surface; as `RayScene.occluded`."""
        blocked = super().occluded(origins, directions, distances)
        free = np.flatnonzero(~blocked)
        if free.size:
            along = np.broadcast_to(directions, origins.shape)[free]
            ends = np.full(len(free), np.inf, np.float32) if distances is None else distances[free]
            blocked[free] = self._first(origins[free], along, ends).triangle >= 0
        return blocked

    def intersect(self, origins: Float32s, directions: Float32s, distances: Float32s | None = None) -> Hits:
        """Return the nearest hit of each ray; arguments as in `occluded`."""
        hits = super().intersect(origins, directions, distances)
        met = hits.triangle >= 0
        ends = hits.distance if distances is None else np.minimum(hits.distance, distances)
        cut = self._first(origins, np.broadcast_to(directions, origins.shape), ends)
        nearer = cut.triangle >= 0
        whole = self._whole[hits.triangle[met]]
        triangles = np.full(len(met), MISS, np.int32)
        triangles[met] = whole
        return Hits(
            np.where(met | nearer, 0, MISS).astype(np.int32),
            np.where(nearer, cut.triangle, triangles),
            np.where(nearer[:, None], cut.barycentric, hits.barycentric),
            np.where(nearer, cut.distance, hits.distance),
        )

    def _first(self, origins: Float32s, directions: Float32s, ends: Float32s) -> _Firsts:
        """Return the first surfaces on triangles with holes, nearer than ``ends (N,)``."""
        count = len(origins)
        triangles, barycentric = np.full(count, MISS, np.int32), np.zeros((count, 2), np.float32)
        distance = np.full(count, np.inf, np.float32)
        # Most rays meet none of these triangles, and this says so at half the price.
        rays = np.flatnonzero(self._holed.occluded(origins, directions, ends))
        begin = np.zeros(len(rays), np.float32)
        length = np.sqrt(directions[:, 0] ** 2 + directions[:, 1] ** 2 + directions[:, 2] ** 2)
        for holes in range(MOST_HOLES + 1):
            if not rays.size:
                break
            along = directions[rays]
            hits = self._holed.intersect(origins[rays] + begin[:, None] * along, along, ends[rays] - begin)
            met = hits.triangle >= 0
            rays, begin = rays[met], begin[met] + hits.distance[met]
            number, place = self._cut[hits.triangle[met]], hits.barycentric[met]
            there = self._solid(number, place) if holes < MOST_HOLES else np.ones(len(rays), np.bool_)
            found = rays[there]
            triangles[found], barycentric[found], distance[found] = number[there], place[there], begin[there]
            rays, begin = rays[~there], begin[~there]
            begin = begin + np.maximum(self._least / np.maximum(length[rays], np.float32(1e-30)), ROUNDING * begin)
            rays, begin = rays[begin < ends[rays]], begin[begin < ends[rays]]
        return _Firsts(triangles, barycentric, distance)


class _Firsts(NamedTuple):
    triangle: Int32s
    barycentric: Float32s
    distance: Float32s
