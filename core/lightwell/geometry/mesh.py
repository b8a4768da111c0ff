"""A triangle mesh: positions, triangles, normals and albedo, in world axes (right-handed, +Z up)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float32s = NDArray[np.float32]
Int32s = NDArray[np.int32]

DEFAULT_ALBEDO = 0.8
"""Of a surface of which nothing is known: a light paint."""


@dataclass(frozen=True)
class Mesh:
    """One object. Its arrays have been checked by `make_mesh`, which is how meshes are made.

    Triangles may be degenerate, may meet in any way and need not close a volume. Front is where the corners run
    counter-clockwise, but nothing here relies on it: the vertex normals say which way a surface looks.
    """

    name: str
    positions: Float32s
    """``(V, 3)`` metres, finite."""
    triangles: Int32s
    """``(F, 3)`` indices of vertices, 0 … V − 1."""
    normals: Float32s
    """``(V, 3)`` unit vectors."""
    albedo: Float32s
    """``(V, 3)`` linear Rec. 709, 0 … 1."""

    @property
    def bounds(self) -> tuple[Float32s, Float32s]:
        """Lower and upper corner, metres, ``(3,)`` each."""
        return self.positions.min(axis=0), self.positions.max(axis=0)


def make_mesh(
    name: str,
    positions: ArrayLike,
    triangles: ArrayLike,
    normals: ArrayLike | None = None,
    albedo: ArrayLike = DEFAULT_ALBEDO,
) -> Mesh:
    """Return a checked mesh.

    Parameters
    ----------
    name
        What the object is called.
    positions
        ``(V, 3)`` metres, V ≥ 1.
    triangles
        ``(F, 3)`` integers; F may be 0.
    normals
        ``(V, 3)``, normalised here. Where they are missing, zero or not finite, the mean of the triangles round
        a vertex takes their place (`vertex_normals`), and +Z where there is none.
    albedo
        ``(V, 3)``, ``(3,)`` or one number, linear; clipped to 0 … 1.

    Raises
    ------
    ValueError
        Where a shape is wrong, a position is not finite or an index names no vertex.
    """
    places = np.ascontiguousarray(positions, dtype=np.float32)
    if places.ndim != 2 or places.shape[1] != 3 or len(places) == 0:
        raise ValueError(f"positions have the shape {places.shape}; they must be (V, 3) with at least one vertex")
    bad = np.flatnonzero(~np.isfinite(places).all(axis=1))
    if bad.size:
        raise ValueError(f"{bad.size} of {len(places)} vertices are not finite numbers, the first is number {bad[0]}")
    corners = np.asarray(triangles)
    if corners.size == 0:
        corners = corners.reshape(0, 3)
    if corners.ndim != 2 or corners.shape[1] != 3:
        raise ValueError(f"triangles have the shape {corners.shape}; they must be (F, 3)")
    if corners.size and not (corners.min() >= 0 and corners.max() < len(places)):
        raise ValueError(f"triangles name vertices {corners.min()} … {corners.max()}, but there are {len(places)}")
    corners = np.ascontiguousarray(corners, dtype=np.int32)
    return Mesh(
        name,
        places,
        corners,
        _unit_normals(places, corners, normals),
        np.ascontiguousarray(np.clip(np.broadcast_to(np.asarray(albedo, np.float32), places.shape), 0, 1)),
    )


def face_normals(positions: Float32s, triangles: Int32s) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return unit normals ``(F, 3)`` (zero where a triangle is degenerate) and areas ``(F,)`` in square metres."""
    corners = positions.astype(np.float64)[triangles]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    doubled = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(doubled, np.finfo(np.float64).tiny)[:, None], doubled / 2


def front_normals(mesh: Mesh) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return `face_normals`, each turned to the side to which the normals of the triangle's vertices point."""
    normals, areas = face_normals(mesh.positions, mesh.triangles)
    sides = np.einsum("fk,fvk->f", normals, mesh.normals[mesh.triangles].astype(np.float64))
    return normals * np.where(sides < 0, -1.0, 1.0)[:, None], areas


def vertex_normals(positions: Float32s, triangles: Int32s, towards: Float32s | None = None) -> NDArray[np.float64]:
    """Return the mean normal of the triangles round each vertex, ``(V, 3)`` unit vectors or zero.

    Triangles count by their angle at the vertex (Thürmer and Wüthrich 1998), so that it does not matter how a polygon
    was cut into triangles. With ``towards (V, 3)`` each triangle's normal is turned to the side of that vector of the
    vertex, whichever way the triangle is wound.
    """
    normals, _ = face_normals(positions, triangles)
    corners = positions.astype(np.float64)[triangles]
    total = np.zeros((len(positions), 3))
    for corner in range(3):
        one = corners[:, (corner + 1) % 3] - corners[:, corner]
        other = corners[:, (corner + 2) % 3] - corners[:, corner]
        share = np.arctan2(np.linalg.norm(np.cross(one, other), axis=1), np.einsum("fi,fi->f", one, other))
        if towards is not None:
            share = share * np.where(np.einsum("fi,fi->f", normals, towards[triangles[:, corner]]) < 0, -1, 1)
        for axis in range(3):
            # Without triangles, bincount forgets the type of its weights.
            sums = np.bincount(triangles[:, corner], share * normals[:, axis], minlength=len(positions))
            total[:, axis] += sums.astype(np.float64)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(np.divide(total, length, out=np.zeros_like(total), where=length > 1e-9))


def _unit_normals(positions: Float32s, triangles: Int32s, given: ArrayLike | None) -> Float32s:
    """Return unit normals ``(V, 3)``: the given ones where they can be used, those of the triangles elsewhere."""
    normals = np.zeros(positions.shape) if given is None else np.array(given, dtype=np.float64)
    if normals.shape != positions.shape:
        raise ValueError(f"normals have the shape {normals.shape}; there are {len(positions)} vertices")
    length = np.linalg.norm(normals, axis=1)
    usable = np.isfinite(length) & (length > 1e-12)
    normals[usable] /= length[usable, None]
    if not usable.all():
        normals[~usable] = vertex_normals(positions, triangles)[~usable]
        normals[~usable & ~normals.any(axis=1)] = (0.0, 0.0, 1.0)
    return np.ascontiguousarray(normals, dtype=np.float32)
