"""Transfer of vertices by asking Embree what they see (paper 003 eq. 3; MATHS §9).

``t_lm(x) = ∫ V(x, ω) max(0, n·ω) Y_lm(ω) dω``; the irradiance under light c is ``E = Σ t_lm c_lm``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s
from lightwell.geometry.rays import Hits, RayScene
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal, zonal_to_coefficients
from lightwell.transfer import kernels
from lightwell.transfer.directions import Directions
from lightwell.transfer.surface import Surface

RAYS_AT_ONCE = 1 << 17
INSIDE_DIRECTIONS = 128
INSIDE_SHARE = 0.5
"""Of the hits of a vertex that sees no light: where more are on the back of surfaces, it is inside something."""

HIT = np.dtype([("triangle", "<i4"), ("u", "<u2"), ("v", "<u2"), ("weight", "<f4")])
"""A surface that a vertex sees: where, and the solid angle times cosine that it takes up."""

SEEN, DARK, INSIDE = 0, 1, 2


@dataclass(frozen=True)
class DirectTransfer:
    """Transfer of a range of vertices, without bounces."""

    halves: Float32s
    """``(B, 2, bands²)``: what each half of the directions adds; their sum is the transfer."""
    state: NDArray[np.uint8]
    """``(B,)``: `SEEN`; `DARK`: sees no light; `INSIDE`: sees none, as it lies inside a solid."""
    hits: NDArray[Any]
    """Of the dtype `HIT`, vertex after vertex; empty where they were not asked for."""
    hit_counts: NDArray[np.int32]
    """``(B,)``."""
    rays: int
    """Rays that were traced."""


def unshadowed(normals: Float32s, bands: int) -> Float32s:
    """Return ``A_l Y_lm(n)``, ``(V, bands²)``: the transfer of a vertex that sees the whole hemisphere."""
    return zonal_to_coefficients(lambert_zonal(bands), normals.astype(np.float64)).astype(np.float32)


def turn_of_vertices(first: int, last: int) -> NDArray[np.float64]:
    """Return an angle for each vertex, radians ``(last − first,)``: of its number only, and unlike its neighbours'."""
    golden = 0.6180339887498949
    return np.asarray(2 * np.pi * np.modf(np.arange(first, last) * golden)[0])


class Tracer:
    """Traces the rays of vertices of one scene; for one thread."""

    def __init__(
        self, surface: Surface, scene: RayScene, directions: Directions, bands: int, turned: bool = True
    ) -> None:
        """Take a scene of ``surface.merged`` alone; ``turned``: turn directions about normals from vertex to vertex."""
        self._surface = surface
        self._scene = scene
        self._directions = directions
        self._bands = bands
        self._turned = turned
        table = np.empty((0, bands * bands)) if directions.about_normal else evaluate(directions.vectors, bands)
        self._table = table.astype(np.float32)
        self._start = kernels.start_rays_about_normals if directions.about_normal else kernels.start_rays
        self.block = max(1, RAYS_AT_ONCE // directions.count)
        """Vertices that are traced together."""
        self._make_room(self.block * directions.count)

    def _make_room(self, rays: int) -> None:
        self._origins = np.empty((rays, 3), np.float32)
        self._vectors = np.empty((rays, 3), np.float32)
        self._index = np.empty(rays, np.int32)

    def direct(self, first: int, last: int, keep_hits: bool, check: Callable[[], None]) -> DirectTransfer:
        """Return the transfer of the vertices ``first`` … ``last − 1``; ``check`` is called between blocks."""
        count = self._bands * self._bands
        halves = np.zeros((last - first, 2, count))
        hit_counts = np.zeros(last - first, np.int32)
        hits: list[NDArray[Any]] = []
        rays = 0
        for begin in range(first, last, self.block):
            check()
            end = min(begin + self.block, last)
            rows = slice(begin - first, end - first)
            rays += self._block(begin, end, halves[rows], hits if keep_hits else None, hit_counts[rows])
        state = np.full(last - first, SEEN, np.uint8)
        dark = np.flatnonzero(~halves.any(axis=(1, 2))) + first
        for begin in range(0, len(dark), self.block):
            check()
            chosen = dark[begin : begin + self.block]
            state[chosen - first] = np.where(self._are_inside(chosen), INSIDE, DARK)
        return DirectTransfer(
            halves.astype(np.float32),
            state,
            np.concatenate(hits) if hits else np.empty(0, HIT),
            hit_counts,
            rays,
        )

    def _rays(self, chosen: Any, vectors: Float32s) -> tuple[int, NDArray[np.int64]]:  # noqa: ANN401
        """Fill in the rays of some vertices; return their number and where those of each vertex begin."""
        origins = self._surface.origins[chosen]
        starts = np.empty(len(origins) + 1, np.int64)
        turns = np.zeros(len(origins))
        if self._turned and self._directions.about_normal:
            numbers = np.arange(chosen.start, chosen.stop) if isinstance(chosen, slice) else chosen
            turns = turn_of_vertices(0, int(numbers[-1]) + 1)[numbers]
        used = self._start(
            origins,
            self._surface.merged.normals[chosen],
            self._surface.sides[chosen],
            vectors,
            turns,
            self._origins,
            self._vectors,
            self._index,
            starts,
        )
        return used, starts

    def _block(
        self,
        first: int,
        last: int,
        sums: NDArray[np.float64],
        hits: list[NDArray[Any]] | None,
        hit_counts: NDArray[np.int32],
    ) -> int:
        used, starts = self._rays(slice(first, last), self._directions.vectors)
        origins, vectors = self._origins[:used], self._vectors[:used]
        normals = self._surface.merged.normals[first:last]
        weight = np.float32(self._directions.weight)
        if hits is None:
            free = ~self._scene.occluded(origins, vectors)
        else:
            met = self._scene.intersect(origins, vectors)
            free = met.triangle < 0
            out = np.empty(used, HIT)
            kept = kernels.keep_hits(
                starts,
                met.triangle,
                met.barycentric,
                vectors,
                normals,
                self._surface.merged.triangles,
                self._surface.merged.normals,
                weight,
                self._directions.about_normal,
                out,
                hit_counts,
            )
            hits.append(out[:kept].copy())
        kernels.add_free(
            starts, free, vectors, self._index, normals, self._table, self._directions.half, weight, self._bands, sums
        )
        return int(used)

    def _are_inside(self, chosen: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which of some vertices that see no light are inside a solid, ``(len(chosen),)``."""
        step = max(1, self._directions.count // INSIDE_DIRECTIONS)
        used, starts = self._rays(chosen, np.ascontiguousarray(self._directions.vectors[::step]))
        met: Hits = self._scene.intersect(self._origins[:used], self._vectors[:used])
        hit, back = np.zeros(len(chosen), np.int64), np.zeros(len(chosen), np.int64)
        merged = self._surface.merged
        kernels.count_backs(
            starts,
            met.triangle,
            met.barycentric,
            self._vectors[:used],
            merged.triangles,
            merged.normals,
            hit,
            back,
        )
        return np.asarray((hit > 0) & (back > INSIDE_SHARE * hit))


def error_of_halves(halves: Float32s, bands: int) -> Float32s:
    """Return the estimated error of each vertex's transfer, ``(B,)``, relative to a vertex that sees all of its sky.

    The halves A and B of the directions are two estimates 2A and 2B of the transfer, whose mean is A + B; the standard
    error of that mean is ``‖A − B‖`` over the coefficients. The reference is that of a vertex that sees all,
    ``‖A_l Y_lm(n)‖ = √(Σ A_l² (2l + 1) / 4π)``, the same for every n.
    """
    factors = lambert_zonal(bands)
    full = float(np.sqrt(np.sum(factors**2 * (2 * np.arange(bands) + 1)) / (4 * np.pi)))
    difference = halves[:, 0].astype(np.float64) - halves[:, 1]
    return np.asarray(np.linalg.norm(difference, axis=1) / full, np.float32)
