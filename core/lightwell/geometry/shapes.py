"""Simple shapes as meshes: for scenes without a mesh file, and for tests."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from lightwell.geometry.mesh import DEFAULT_ALBEDO, Mesh, make_mesh

ShapeName = Literal["sphere", "plane", "box"]


def make_shape(name: ShapeName, albedo: ArrayLike = DEFAULT_ALBEDO) -> Mesh:
    """Return a shape: sphere of radius 1 m, plane or box of half-edge 1 m, round the origin; the plane faces +Z."""
    match name:
        case "sphere":
            return sphere(albedo=albedo)
        case "plane":
            return plane(albedo=albedo)
        case "box":
            return box(albedo=albedo)


def sphere(rows: int = 64, columns: int = 128, albedo: ArrayLike = DEFAULT_ALBEDO) -> Mesh:
    """Return a unit sphere: two poles and ``rows − 1`` rings of ``columns`` vertices; normals are exact.

    Raises
    ------
    ValueError
        Where there are fewer than 2 rows or 3 columns.
    """
    if rows < 2 or columns < 3:
        raise ValueError(f"{rows} rows and {columns} columns make no sphere; at least 2 and 3 are needed")
    theta = np.pi * np.arange(1, rows) / rows
    phi = 2 * np.pi * np.arange(columns) / columns
    rings = np.stack(
        [
            np.outer(np.sin(theta), np.cos(phi)),
            np.outer(np.sin(theta), np.sin(phi)),
            np.repeat(np.cos(theta)[:, None], columns, axis=1),
        ],
        axis=-1,
    ).reshape(-1, 3)
    positions = np.concatenate([[[0.0, 0, 1]], rings, [[0.0, 0, -1]]])
    here, following, last = np.arange(columns), (np.arange(columns) + 1) % columns, len(positions) - 1
    triangles = [np.stack([np.zeros_like(here), 1 + here, 1 + following], axis=1)]
    for ring in range(rows - 2):
        upper, lower = 1 + ring * columns, 1 + (ring + 1) * columns
        triangles.append(np.stack([upper + here, lower + here, lower + following], axis=1))
        triangles.append(np.stack([upper + here, lower + following, upper + following], axis=1))
    bottom = 1 + (rows - 2) * columns
    triangles.append(np.stack([bottom + here, np.full_like(here, last), bottom + following], axis=1))
    return make_mesh("sphere", positions, np.concatenate(triangles), positions, albedo)


def plane(cells: int = 32, albedo: ArrayLike = DEFAULT_ALBEDO) -> Mesh:
    """Return the square −1 … 1 in x and y at z = 0, of ``cells`` × ``cells`` squares, facing +Z.

    Raises
    ------
    ValueError
        Where there is less than one cell.
    """
    if cells < 1:
        raise ValueError(f"{cells} cells make no plane; at least 1 is needed")
    line = np.linspace(-1, 1, cells + 1)
    y, x = np.meshgrid(line, line, indexing="ij")
    positions = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    corner = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).reshape(-1)
    right, above = corner + 1, corner + cells + 1
    triangles = np.concatenate(
        [np.stack([corner, right, above + 1], axis=1), np.stack([corner, above + 1, above], axis=1)]
    )
    return make_mesh("plane", positions, triangles, np.tile([0.0, 0, 1], (len(positions), 1)), albedo)


def box(albedo: ArrayLike = DEFAULT_ALBEDO) -> Mesh:
    """Return the cube −1 … 1 along each axis, with sharp edges: four vertices a side."""
    positions: list[np.ndarray[tuple[int], np.dtype[np.float64]]] = []
    normals, triangles = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            first, second = ((axis + 1) % 3, (axis + 2) % 3) if side > 0 else ((axis + 2) % 3, (axis + 1) % 3)
            start = len(positions)
            for along_first, along_second in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                corner = np.zeros(3)
                corner[[axis, first, second]] = side, along_first, along_second
                positions.append(corner)
                normals.append(side * np.eye(3)[axis])
            triangles += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
    return make_mesh("box", np.array(positions), np.array(triangles), np.array(normals), albedo)
