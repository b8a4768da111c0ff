"""A small picture of meshes with their transfer, under a sky with a low sun."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count
from lightwell.geometry.mesh import Float32s
from lightwell.geometry.rays import RayScene
from lightwell.sh.basis import evaluate
from lightwell.transfer.surface import Surface

WIDTH, HEIGHT = 480, 360
SUPERSAMPLING = 2
SUN = np.array([0.45, -0.6, 0.66])
SUN_IRRADIANCE = np.array([2.1, 1.95, 1.6])
SKY = np.array([0.2, 0.24, 0.31])
FIELD_OF_VIEW = 0.6
"""Radians across the height."""
BACKGROUND = 0.92


def picture(surface: Surface, transfer: Float32s, shown: int) -> NDArray[np.uint8]:
    """Return an sRGB picture ``(HEIGHT, WIDTH, 3)``; the camera is aimed at the first ``shown`` meshes.

    ``transfer (V, bands², 1 or 3)``.
    """
    bands = bands_of_count(transfer.shape[1])
    light = np.zeros((bands * bands, 3))
    light[0] = SKY * np.sqrt(4 * np.pi)
    # A truncated sun rings: the coefficients of each degree fall as those of a cone of some 20 degrees do.
    fade = np.repeat(1 / (1 + 0.06 * np.arange(bands) ** 2.0), 2 * np.arange(bands) + 1)
    light += (fade * evaluate(SUN / np.linalg.norm(SUN), bands))[:, None] * SUN_IRRADIANCE
    irradiance = np.einsum("vkc,kd->vd" if transfer.shape[2] == 1 else "vkc,kc->vc", transfer, light)
    radiance = np.maximum(irradiance, 0) * surface.merged.albedo / np.pi
    eye, directions = _camera(surface, shown)
    hits = RayScene([surface.merged]).intersect(np.broadcast_to(eye, directions.shape).astype(np.float32), directions)
    met = hits.triangle >= 0
    corners = surface.merged.triangles[hits.triangle[met]]
    u, v = hits.barycentric[met].T
    shares = np.stack([1 - u - v, u, v], axis=1)
    image = np.full((len(directions), 3), BACKGROUND)
    image[met] = np.einsum("ri,ric->rc", shares, radiance[corners])
    fine = image.reshape(HEIGHT, SUPERSAMPLING, WIDTH, SUPERSAMPLING, 3).mean(axis=(1, 3))
    return np.asarray(np.clip(fine, 0, 1) ** (1 / 2.2) * 255 + 0.5, np.uint8)


def _camera(surface: Surface, shown: int) -> tuple[NDArray[np.float64], Float32s]:
    """Return the eye and the direction of each sample, row after row from the top."""
    seen = surface.meshes[:shown]
    lower = np.min([mesh.bounds[0] for mesh in seen], axis=0).astype(np.float64)
    upper = np.max([mesh.bounds[1] for mesh in seen], axis=0).astype(np.float64)
    centre, radius = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)) / 2, 1e-9)
    backwards = np.array([0.35, -0.85, 0.4])
    backwards /= np.linalg.norm(backwards)
    right = np.cross([0, 0, 1], backwards)
    right /= np.linalg.norm(right)
    up = np.cross(backwards, right)
    eye = centre + backwards * radius / np.sin(FIELD_OF_VIEW / 2) * 1.02
    scale = np.tan(FIELD_OF_VIEW / 2)
    rows = (1 - 2 * (np.arange(HEIGHT * SUPERSAMPLING) + 0.5) / (HEIGHT * SUPERSAMPLING)) * scale
    columns = (2 * (np.arange(WIDTH * SUPERSAMPLING) + 0.5) / (WIDTH * SUPERSAMPLING) - 1) * scale * WIDTH / HEIGHT
    y, x = np.meshgrid(rows, columns, indexing="ij")
    vectors = x[..., None] * right + y[..., None] * up - backwards
    return eye, (vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)).reshape(-1, 3).astype(np.float32)
