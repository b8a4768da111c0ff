"""Meshes whose light is known."""

from __future__ import annotations

import numpy as np

from lightwell.geometry import shapes
from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.transfer.ground import disc_triangles


def sphere(rings: int = 12, segments: int = 24, radius: float = 1.0, name: str = "sphere", albedo: float = 0.8) -> Mesh:
    """Return a sphere round the origin with exact normals: poles and rings."""
    unit = shapes.sphere(rings, segments)
    return make_mesh(name, radius * unit.positions, unit.triangles, unit.normals, albedo)


def bowl(rings: int, segments: int, albedo: float) -> Mesh:
    """Return the lower half of a unit sphere, open above, that looks inwards."""
    theta = np.pi / 2 * np.arange(1, rings + 1) / rings
    phi = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack(
        [
            np.outer(np.sin(theta), np.cos(phi)),
            np.outer(np.sin(theta), np.sin(phi)),
            np.repeat(-np.cos(theta)[:, None], segments, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    positions = np.concatenate([[[0.0, 0, -1]], ring])
    return make_mesh("bowl", positions, disc_triangles(rings, segments), -positions, albedo)


def quad(corners: list[list[float]], name: str = "quad", albedo: float = 0.8) -> Mesh:
    """Return two triangles."""
    return make_mesh(name, corners, [[0, 1, 2], [0, 2, 3]], albedo=albedo)
