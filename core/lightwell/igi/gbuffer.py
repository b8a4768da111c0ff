"""What the camera sees through each pixel's centre (paper 004 §4: what is stored beside the coefficients)."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import RenderError
from lightwell.igi.surfaces import Singles, Surfaces
from lightwell.render.camera import Camera
from lightwell.render.picture import MAX_BACKS, STEP

Floats = NDArray[np.float64]
Places = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Rows and columns of pixels, ``(n,)`` each."""


@dataclass(frozen=True, eq=False)
class GBuffer:
    """Pixels of a rectangle, ``(H, W, …)`` float32; zero where nothing is seen."""

    seen: NDArray[np.bool_]
    """``(H, W)``: whether there is a surface."""
    view: Singles
    """``(H, W, 3)``: unit vectors away from the camera, also where nothing is seen."""
    place: Singles
    """``(H, W, 3)`` metres, lifted off the surface."""
    geometric: Singles
    """``(H, W, 3)`` unit normals of the triangles, on the side that is seen."""
    shading: Singles
    """``(H, W, 3)`` unit normals that materials go by."""
    kd: Singles
    """``(H, W, 3)``."""
    ks: Singles
    """``(H, W, 3)``."""
    exponent: Singles
    """``(H, W)``."""
    emission: Singles
    """``(H, W, 3)`` radiance."""
    depth: Singles
    """``(H, W)`` metres along the viewing axis; infinite where nothing is."""

    def part(self, rectangle: tuple[slice, slice]) -> GBuffer:
        """Return the pixels of a rectangle."""
        return GBuffer(*(getattr(self, field.name)[rectangle] for field in fields(self)))


def look(
    surfaces: Surfaces, camera: Camera, size: tuple[int, int], rows: tuple[int, int], columns: tuple[int, int]
) -> GBuffer:
    """Return what is seen through pixels ``rows[0] … rows[1] − 1`` and such columns, which may lie off the picture."""
    shape = (rows[1] - rows[0], columns[1] - columns[0])
    x, y = np.arange(*columns) + 0.5, np.arange(*rows) + 0.5
    directions = camera.looking(x[None], y[:, None], size).reshape(-1, 3).astype(np.float32)
    eye = np.array(camera.position, np.float32)
    triangles, barycentric, distance = _first_visible(surfaces, eye, directions)
    seen = triangles >= 0
    width = distance[seen] * np.float32(2 * np.tan(np.radians(camera.fov_degrees) / 2) / size[1])
    points = surfaces.at(triangles[seen], barycentric[seen], directions[seen], width)

    def spread(values: Singles, empty: float = 0.0) -> Singles:
        if seen.all():
            return values.reshape(*shape, *values.shape[1:])
        full = np.full((len(seen), *values.shape[1:]), np.float32(empty))
        full[seen] = values
        return full.reshape(*shape, *values.shape[1:])

    axis = -camera.world_from_camera[:, 2].astype(np.float32)
    along = directions[:, 0] * axis[0] + directions[:, 1] * axis[1] + directions[:, 2] * axis[2]
    return GBuffer(
        seen.reshape(shape),
        directions.reshape(*shape, 3),
        spread(points.position + np.float32(surfaces.lift) * points.geometric),
        spread(points.geometric),
        spread(points.shading),
        spread(points.kd),
        spread(points.ks),
        spread(points.exponent),
        spread(points.emission),
        spread(distance[seen] * along[seen], np.inf),
    )


def require_outside(surfaces: Surfaces, camera: Camera) -> None:
    """Raise `RenderError` where all that the camera could see is the inside of objects."""
    count = 64
    z = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    around = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1).astype(np.float32)
    hits = surfaces.rays.intersect(np.tile(np.array(camera.position, np.float32), (count, 1)), around)
    if (hits.triangle < 0).any() or not surfaces.hidden(hits.triangle, around).all():
        return
    name = surfaces.objects[surfaces.owner[hits.triangle[0]]].mesh.name
    where = ", ".join(f"{value:g}" for value in camera.position)
    raise RenderError(f"the camera stands inside object {name!r}, at ({where}): move it out")


def _first_visible(surfaces: Surfaces, eye: Singles, directions: Singles) -> tuple[NDArray[np.int32], Singles, Singles]:
    """Return triangle (−1: none), barycentric coordinates and distance of what each ray sees, behind hidden backs."""
    hits = surfaces.rays.intersect(np.broadcast_to(eye, directions.shape), directions)
    triangles, barycentric, distance = hits.triangle.copy(), hits.barycentric.copy(), hits.distance.copy()
    rays = np.flatnonzero(triangles >= 0)
    step = np.float32(STEP * max(surfaces.radius, float(np.abs(eye - surfaces.centre).max())))
    for _ in range(MAX_BACKS):
        rays = rays[surfaces.hidden(triangles[rays], directions[rays])]
        if not rays.size:
            return triangles, barycentric, distance
        travelled = distance[rays] + step
        further = surfaces.rays.intersect(eye + travelled[:, None] * directions[rays], directions[rays])
        triangles[rays], barycentric[rays] = further.triangle, further.barycentric
        distance[rays] = travelled + further.distance
        rays = rays[further.triangle >= 0]
    triangles[rays] = -1
    return triangles, barycentric, distance
