"""The picture: primary rays, hits, shading, and the mean over each pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import RenderError
from lightwell.geometry.mesh import front_normals
from lightwell.geometry.rays import Hits, RayScene
from lightwell.render.camera import Camera, require_size
from lightwell.render.scene import Scene, SceneObject
from lightwell.render.shading import Received, Surface, receive, shade
from lightwell.scene_settings import MAX_SAMPLES

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]

RAYS_AT_ONCE = 1 << 15
"""A point in a grid takes 600 bytes of coefficients."""
MAX_BACKS = 64
"""So many back faces a ray passes at most."""
STEP = 1e-5
"""How far a ray goes on behind a back face, of the scene's extent; Embree computes in single precision."""


@dataclass(frozen=True, eq=False)
class Rendering:
    """A picture and what else is known of its pixels; ``(height, width, …)`` float32, row 0 is the top."""

    colour: Singles
    """``(H, W, 3)`` linear radiance, Rec. 709; the backdrop where nothing is hit, black where there is none."""
    coverage: Singles
    """``(H, W)``: share of the pixel that objects cover. Without a backdrop the colour is premultiplied by it."""
    depth: Singles
    """``(H, W)`` metres along the viewing axis, mean of what is hit; infinite where nothing is."""
    normal: Singles
    """``(H, W, 3)`` unit vectors, world axes, mean of what is hit; zero where nothing is."""
    albedo: Singles
    """``(H, W, 3)``, mean of what is hit; zero where nothing is."""
    has_backdrop: bool


def render(
    scene: Scene,
    camera: Camera,
    size: tuple[int, int],
    samples: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> Rendering:
    """Render a picture.

    Parameters
    ----------
    scene, camera
        What is seen, and from where.
    size
        Width and height in pixels.
    samples
        N: a pixel is the mean of N² rays; 1 looks at pixel centres only.
    progress
        Called with the rows that are done and how many there are.

    Raises
    ------
    ValueError
        Where size or samples are out of range.
    RenderError
        Where the camera stands inside an object.
    """
    require_size(size)
    width, height = size
    if not 1 <= samples <= MAX_SAMPLES:
        raise ValueError(f"samples = {samples} must lie between 1 and {MAX_SAMPLES}")
    tracer = _Tracer(scene, camera)
    layers = {name: np.empty((height, width, channels), np.float32) for name, channels in _CHANNELS.items()}
    step = max(1, RAYS_AT_ONCE // (width * samples**2))
    for first in range(0, height, step):
        rows = slice(first, min(first + step, height))
        directions = camera.directions(size, samples, rows)
        seen = tracer.look(directions.reshape(-1, 3))
        for name, values in _pixel_means(seen, directions.shape[:3]).items():
            layers[name][rows] = values
        if progress is not None:
            progress(rows.stop, height)
    return Rendering(
        layers["colour"],
        layers["coverage"][..., 0],
        layers["depth"][..., 0],
        layers["normal"],
        layers["albedo"],
        scene.backdrop is not None,
    )


_CHANNELS = {"colour": 3, "coverage": 1, "depth": 1, "normal": 3, "albedo": 3}


def _pixel_means(seen: dict[str, Floats], shape: tuple[int, ...]) -> dict[str, Floats]:
    """Return the mean of each pixel's rays: of all of them for colour and coverage, of those that hit for the rest."""
    by_pixel = {name: values.reshape(*shape, -1) for name, values in seen.items()}
    count = by_pixel["coverage"].sum(axis=2)
    means = {name: by_pixel[name].mean(axis=2) for name in ("colour", "coverage")}
    for name in ("depth", "normal", "albedo"):
        means[name] = by_pixel[name].sum(axis=2) / np.maximum(count, 1)
    means["depth"][count == 0] = np.inf
    means["normal"] /= np.maximum(np.linalg.norm(means["normal"], axis=-1, keepdims=True), 1e-12)
    return means


class _Tracer:
    """Sends rays from the camera and shades what they meet."""

    def __init__(self, scene: Scene, camera: Camera) -> None:
        self._scene = scene
        self._eye = np.array(camera.position, dtype=np.float64)
        self._axis = -camera.world_from_camera[:, 2]
        self._rays = RayScene([item.mesh for item in scene.objects])
        self._fronts = [front_normals(item.mesh)[0] for item in scene.objects]
        corners = [np.stack(item.mesh.bounds) for item in scene.objects]
        self._step = STEP * float(np.ptp(np.concatenate([*corners, self._eye[None]]), axis=0).max())
        self._require_outside()
        self._at_vertices = [self._receive_at_vertices(item) for item in scene.objects]

    def look(self, directions: Floats) -> dict[str, Floats]:
        """Return what the rays ``(n, 3)`` see, by the names of `Rendering`; zeros where a layer has nothing."""
        count = len(directions)
        seen = {name: np.zeros((count, channels)) for name, channels in _CHANNELS.items()}
        hits = self._first_visible(directions)
        for index, item in enumerate(self._scene.objects):
            rays = np.flatnonzero(hits.mesh == index)
            if not rays.size:
                continue
            surface, received = self._surface(index, hits, rays, directions[rays])
            seen["colour"][rays] = shade(self._scene, surface, item.material, received)
            seen["coverage"][rays] = 1
            seen["depth"][rays, 0] = hits.distance[rays] * (directions[rays] @ self._axis)
            seen["normal"][rays] = surface.normals
            seen["albedo"][rays] = surface.albedo
        if self._scene.backdrop is not None:
            missed = hits.mesh < 0
            seen["colour"][missed] = self._scene.backdrop.radiance(directions[missed])
        return seen

    def _first_visible(self, directions: Floats) -> Hits:
        """Return the nearest hit of each ray, behind the backs of objects that are not two-sided."""
        hits = self._send(self._eye, directions)
        travelled = np.zeros(len(directions))
        rays = np.arange(len(directions))
        for _ in range(MAX_BACKS):
            rays = rays[self._hidden(hits, rays, directions)]
            if not rays.size:
                return hits
            travelled[rays] = hits.distance[rays] + self._step
            origins = self._eye + travelled[rays, None] * directions[rays]
            further = self._send(origins, directions[rays])
            hits.mesh[rays], hits.triangle[rays] = further.mesh, further.triangle
            hits.barycentric[rays], hits.distance[rays] = further.barycentric, travelled[rays] + further.distance
        hits.mesh[rays] = -1
        return hits

    def _send(self, origins: Floats, directions: Floats) -> Hits:
        """Return the nearest hits, in arrays of their own; origins are ``(n, 3)`` or ``(3,)``."""
        starts = np.broadcast_to(origins, directions.shape).astype(np.float32)
        mesh, triangle, barycentric, distance = self._rays.intersect(starts, directions.astype(np.float32))
        return Hits(mesh.copy(), triangle.copy(), barycentric.copy(), distance.copy())

    def _hidden(self, hits: Hits, rays: NDArray[np.int64], directions: Floats) -> NDArray[np.bool_]:
        """Say of each of ``rays`` whether it hit a back that is not shown."""
        hidden = np.zeros(len(rays), np.bool_)
        for index, item in enumerate(self._scene.objects):
            if item.material.two_sided:
                continue
            here = np.flatnonzero(hits.mesh[rays] == index)
            fronts = self._fronts[index][hits.triangle[rays[here]]]
            hidden[here] = np.einsum("nk,nk->n", fronts, directions[rays[here]]) > 0
        return hidden

    def _surface(self, index: int, hits: Hits, rays: NDArray[np.int64], directions: Floats) -> tuple[Surface, Received]:
        item = self._scene.objects[index]
        triangles = hits.triangle[rays]
        corners = item.mesh.triangles[triangles]
        u, v = hits.barycentric[rays].astype(np.float64).T
        weights = np.stack([1 - u - v, u, v], axis=1)

        def interpolate(values: NDArray[np.floating]) -> Floats:
            return np.asarray(np.einsum("nv,nv...->n...", weights, values[corners].astype(np.float64)))

        behind = np.einsum("nk,nk->n", self._fronts[index][triangles], directions) > 0
        normals = _normalised(interpolate(item.mesh.normals))
        normals[behind] *= -1
        albedo = item.material.albedo
        surface = Surface(
            interpolate(item.mesh.positions),
            normals,
            directions,
            interpolate(item.mesh.albedo) if albedo is None else np.broadcast_to(np.array(albedo), normals.shape),
            None if item.transfer is None else interpolate(item.transfer),
        )
        at_vertices = self._at_vertices[index]
        if at_vertices is None:
            received = receive(self._scene.light, surface, item.material)
        else:
            received = Received(*(interpolate(values) for values in at_vertices))
        if behind.any():
            points, seen, view, colour, _ = surface
            back = Surface(points[behind], seen[behind], view[behind], colour[behind], None)
            for values, own in zip(received, receive(self._scene.light, back, item.material), strict=True):
                values[behind] = own
        return surface, received

    def _receive_at_vertices(self, item: SceneObject) -> Received | None:
        """Return what each vertex gets, where that is how this scene is shaded."""
        if self._scene.sampling == "point":
            return None
        points = item.mesh.positions.astype(np.float64)
        transfer = None if item.transfer is None else item.transfer.astype(np.float64)
        view = _normalised(points - self._eye)
        surface = Surface(points, item.mesh.normals.astype(np.float64), view, np.zeros_like(points), transfer)
        return receive(self._scene.light, surface, item.material)

    def _require_outside(self) -> None:
        """Raise `RenderError` where all that the camera could see is the inside of objects."""
        count = 64
        z = 1 - (2 * np.arange(count) + 1) / count
        azimuth = np.arange(count) * np.pi * (3 - np.sqrt(5))
        ring = np.sqrt(1 - z * z)
        around = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
        hits = self._send(self._eye, around)
        if (hits.mesh < 0).any() or not self._hidden(hits, np.arange(count), around).all():
            return
        name = self._scene.objects[hits.mesh[0]].mesh.name
        where = ", ".join(f"{value:g}" for value in self._eye)
        raise RenderError(f"the camera stands inside object {name!r}, at ({where}): move it out")


def _normalised(vectors: Floats) -> Floats:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.asarray(vectors / np.maximum(length, 1e-12))
