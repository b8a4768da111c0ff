"""How far away the light comes from: stand-ins for the geometry round a probe.

A proxy answers ``distances(origin, directions)``: metres from ``origin`` ``(3,)`` along unit ``directions``
``(…, 3)`` to what is seen there, infinite where there is nothing (sky). All in the proxy's axes, metres.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.errors import ProxyError
from lightwell.geometry.rays import RayScene
from lightwell.probe.mapping import Mapping

Floats = NDArray[np.float64]

NEAREST_M = 1e-5
"""What is nearer than this touches the probe: no gradient can be told there."""


class Proxy(Protocol):
    """What light is taken to come from."""

    occludes: bool
    """Whether parts of it may hide others, so that neighbouring directions may end at different distances."""

    def distances(self, origin: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the distances ``(…)`` in metres along unit directions ``(…, 3)`` from ``origin`` ``(3,)``.

        Raises
        ------
        ProxyError
            Where the proxy says nothing sensible of this place.
        """
        ...


class SphereProxy:
    """The inside of a sphere: a dome, a round room, or a guess at how far things are."""

    occludes = False

    def __init__(self, radius_m: float, centre_m: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        if not (np.isfinite(radius_m) and radius_m > 0):
            raise ProxyError(f"the proxy's sphere has a radius of {radius_m:g} m; it must be positive and finite")
        self.radius_m = float(radius_m)
        self.centre_m = _point(centre_m, "the centre of the proxy's sphere")

    def distances(self, origin: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the distances ``(…)``. Raises `ProxyError` where the origin is not inside."""
        offset = _point(origin, "the probe's position") - self.centre_m
        inside = self.radius_m**2 - float(offset @ offset)
        if inside <= 0:
            raise ProxyError(
                f"the probe is {np.linalg.norm(offset):g} m from the centre of the proxy's sphere, outside its radius "
                f"of {self.radius_m:g} m; correct position_m, centre_m or radius_m"
            )
        along = np.asarray(directions, dtype=np.float64) @ offset
        root = np.sqrt(along * along + inside)
        # Of −along ± root the positive one, without cancellation.
        return np.asarray(np.where(along > 0, inside / (along + root), root - along))


class BoxProxy:
    """The inside of an axis-aligned box: a room."""

    occludes = False

    def __init__(self, lower_m: ArrayLike, upper_m: ArrayLike) -> None:
        self.lower_m = _point(lower_m, "the proxy box's lower corner")
        self.upper_m = _point(upper_m, "the proxy box's upper corner")
        if not (self.lower_m < self.upper_m).all():
            raise ProxyError(
                f"the proxy's box {_text(self.lower_m)} … {_text(self.upper_m)} must grow along every axis"
            )

    def distances(self, origin: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the distances ``(…)``. Raises `ProxyError` where the origin is not inside."""
        start = _point(origin, "the probe's position")
        if not ((self.lower_m < start) & (start < self.upper_m)).all():
            raise ProxyError(
                f"the probe at {_text(start)} m is not inside the proxy's box {_text(self.lower_m)} … "
                f"{_text(self.upper_m)} m; correct position_m or the box"
            )
        towards = np.asarray(directions, dtype=np.float64)
        room = np.where(towards > 0, self.upper_m - start, start - self.lower_m)
        speed = np.abs(towards)
        walls = np.full(towards.shape, np.inf)
        np.divide(room, speed, out=walls, where=speed > 1e-300)
        return np.asarray(walls.min(axis=-1))


class MeshProxy:
    """Triangle meshes, by Embree: a scanned or modelled room. Where rays leave it, there is sky."""

    occludes = True

    def __init__(self, scene: RayScene) -> None:
        if not any(len(mesh.triangles) for mesh in scene.meshes):
            raise ProxyError("the proxy's mesh has no triangles; name a mesh of the room")
        self.scene = scene

    def distances(self, origin: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the distances ``(…)``; both sides of triangles are seen."""
        towards = np.asarray(directions, dtype=np.float32)
        rays = towards.reshape(-1, 3)
        start = np.broadcast_to(_point(origin, "the probe's position").astype(np.float32), rays.shape)
        return self.scene.intersect(start, rays).distance.astype(np.float64).reshape(towards.shape[:-1])


class DepthProxy:
    """A depth map beside the frame: metres along the ray of each pixel, as the probe itself sees them.

    Nearest pixel: between a near and a far one nothing is seen. What is not positive and finite is sky.
    """

    occludes = True

    def __init__(self, mapping: Mapping, depth: ArrayLike) -> None:
        metres = np.asarray(depth, dtype=np.float64)
        if metres.shape != (mapping.height, mapping.width):
            raise ProxyError(
                f"the depth map has the shape {metres.shape}; a {mapping.kind} picture of "
                f"{mapping.width}×{mapping.height} pixels needs ({mapping.height}, {mapping.width})"
            )
        self.mapping = mapping
        self._metres = np.where(np.isfinite(metres) & (metres > 0), metres, np.inf)
        row, column = np.unravel_index(int(np.argmin(self._metres)), metres.shape)
        if self._metres[row, column] < NEAREST_M:
            raise ProxyError(
                f"the depth map has {self._metres[row, column]:g} m in row {row}, column {column}: depths are metres "
                "along the ray; 0 where there is nothing"
            )

    def distances(self, origin: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the distances ``(…)``, infinite where the mapping does not look. Directions are the mapping's."""
        x, y, seen = self.mapping.pixels(directions)
        column = np.clip(np.floor(x), 0, self.mapping.width - 1).astype(np.intp)
        row = np.clip(np.floor(y), 0, self.mapping.height - 1).astype(np.intp)
        return np.where(seen, self._metres[row, column], np.inf)


def inverse_distances(proxy: Proxy, origin: ArrayLike, directions: ArrayLike) -> Floats:
    """Return ``1/r`` ``(…)`` per metre, 0 for sky, of directions ``(…, 3)`` that cover the sphere.

    Raises
    ------
    ProxyError
        Where the proxy says nothing of this place, or nothing at all is seen from it.
    """
    distances = proxy.distances(origin, directions)
    place = _text(np.asarray(origin, dtype=np.float64))
    nearest = float(distances.min())
    if not nearest >= NEAREST_M:  # NaN is not either
        raise ProxyError(
            f"the probe at {place} m lies on the proxy's surface, {nearest:g} m from it; move it off, and check that "
            "lengths are in metres"
        )
    if not np.isfinite(distances).any():
        raise ProxyError(
            f"from the probe at {place} m the proxy is not seen in any direction; check its unit, axes and place"
        )
    return np.asarray(1 / distances)


def _point(values: ArrayLike, name: str) -> Floats:
    point = np.asarray(values, dtype=np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ProxyError(f"{name} must be three finite numbers, not {values!r}")
    return point


def _text(point: Floats) -> str:
    return "(" + ", ".join(format(float(value), "g") for value in point) + ")"
