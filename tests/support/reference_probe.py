"""Slow, obvious references for `lightwell.probe`, and maps and mappings that its tests share."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import sphericart
from numpy.typing import NDArray

from lightwell.io.exr import read_rgb
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.settings import MappingSettings

HDRI = Path(__file__).parents[2] / "workers/lightwell_workers/samples/hdri"
MAP_NAMES = sorted(path.stem for path in HDRI.glob("*.exr"))

ROOT_4PI = math.sqrt(4 * math.pi)

MAPPINGS: dict[str, tuple[dict[str, Any], int, int]] = {
    "latlong": ({"kind": "latlong"}, 64, 128),
    "octahedral": ({"kind": "octahedral"}, 90, 90),
    "row strip": ({"kind": "cube"}, 32, 192),
    "column strip": ({"kind": "cube"}, 192, 32),
    "horizontal cross": ({"kind": "cube"}, 96, 128),
    "vertical cross": ({"kind": "cube"}, 128, 96),
    "mirror ball": ({"kind": "mirror-ball"}, 120, 100),
    "angular": ({"kind": "angular"}, 100, 100),
    "fisheye 180": ({"kind": "fisheye", "fov_degrees": 180}, 100, 100),
    "fisheye equisolid": (
        {"kind": "fisheye", "fov_degrees": 240, "fisheye": "equisolid", "disc": (70, 50, 48)},
        100,
        130,
    ),
    "fisheye 360 equisolid": ({"kind": "fisheye", "fov_degrees": 360, "fisheye": "equisolid"}, 100, 100),
    "sphere": (
        {"kind": "mirror-sphere", "sphere_radius_m": 0.0458, "sphere_distance_m": 1.25, "disc": (50, 50, 50)},
        100,
        100,
    ),
    "sphere near": (
        {"kind": "mirror-sphere", "sphere_radius_m": 0.4, "sphere_distance_m": 1.25, "disc": (50, 50, 50)},
        100,
        100,
    ),
    "sphere off axis": (
        {
            "kind": "mirror-sphere",
            "sphere_radius_m": 0.0915,
            "sphere_distance_m": 1.25,
            "fov_degrees": 40,
            "disc": (190, 70, 30.6),
        },
        200,
        300,
    ),
}
"""Settings, height and width of one picture of each kind."""

CAMERA_AXES = {"forward": (0.3, -0.8, 0.2), "up": (0.1, 0.2, 1.0)}
"""A camera that looks somewhere else than the default."""


def mapping_of(name: str) -> Mapping:
    """Return the mapping of one entry of `MAPPINGS`, seen by the turned camera."""
    settings, height, width = MAPPINGS[name]
    return make_mapping(MappingSettings.model_validate({**CAMERA_AXES, **settings}), height, width)


@cache
def real_map(name: str) -> NDArray[np.float16]:
    """Return a real lat-long map, ``(256, 512, 3)``."""
    pixels = read_rgb(HDRI / f"{name}.exr").pixels
    assert pixels.dtype == np.float16
    return np.asarray(pixels, dtype=np.float16)


def basis(directions: NDArray[np.float64], bands: int) -> NDArray[np.float64]:
    """Return the basis by sphericart, an independent implementation, ``(…, bands²)``."""
    flat = np.ascontiguousarray(directions.reshape(-1, 3))
    if bands == 1:
        return np.full((*directions.shape[:-1], 1), 1 / ROOT_4PI)
    values = sphericart.SphericalHarmonics(bands - 1).compute(flat)
    return np.asarray(values).reshape(*directions.shape[:-1], bands * bands)


def latlong_directions(height: int, width: int) -> NDArray[np.float64]:
    """Return the directions of the pixel centres straight from the convention, ``(H, W, 3)``."""
    theta = math.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2 * math.pi * (np.arange(width) + 0.5)[None, :] / width
    ones = np.ones_like(phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) * ones], axis=-1)


def latlong_solid_angles(height: int, width: int) -> NDArray[np.float64]:
    """Return ``(2π/W)(cosθ_{i−½} − cosθ_{i+½})`` of each pixel, ``(H, W)``."""
    edges = np.cos(math.pi * np.arange(height + 1) / height)
    return np.repeat((edges[:-1] - edges[1:])[:, None] * (2 * math.pi / width), width, axis=1)


def project_latlong(image: NDArray[Any], bands: int) -> NDArray[np.float64]:
    """Return ``Σ ΔΩ L Y`` over the pixels of a lat-long picture in float64, ``(bands², 3)``."""
    height, width, _ = image.shape
    weighted = image.astype(np.float64) * latlong_solid_angles(height, width)[..., None]
    return np.asarray(np.einsum("ijk,ijc->kc", basis(latlong_directions(height, width), bands), weighted))


def project_centres(mapping: Mapping, image: NDArray[Any], bands: int) -> NDArray[np.float64]:
    """Return ``Σ ΔΩ L Y`` with the basis at the centres of the pixels of any picture, ``(bands², 3)``."""
    directions, _ = mapping.directions(*mapping.pixel_centres())
    weighted = image.astype(np.float64) * mapping.solid_angles()[..., None]
    return np.asarray(np.einsum("ijk,ijc->kc", basis(directions, bands), weighted))


def area_means(image: NDArray[Any], weights: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """Return weighted means over equal cells by splitting every pixel, one at a time, ``(height, width, 3)``."""
    rows, cols = image.shape[:2]
    total, weight = np.zeros((height, width, 3)), np.zeros((height, width, 1))
    for i in range(rows):
        for j in range(cols):
            for target_i in range(height):
                tall = min(i + 1, (target_i + 1) * rows / height) - max(i, target_i * rows / height)
                for target_j in range(width):
                    wide = min(j + 1, (target_j + 1) * cols / width) - max(j, target_j * cols / width)
                    if tall > 0 and wide > 0:
                        share = tall * wide * weights[i, j]
                        total[target_i, target_j] += share * image[i, j].astype(np.float64)
                        weight[target_i, target_j] += share
    return np.divide(total, weight, out=np.zeros_like(total), where=weight > 0)


def latlong_means(image: NDArray[Any], height: int, width: int) -> NDArray[np.float64]:
    """Return means over the cells of a coarser lat-long grid, piece by piece with exact solid angles."""
    rows, cols = image.shape[:2]
    total, weight = np.zeros((height, width, 3)), np.zeros((height, width, 1))
    for i, target_i in np.ndindex(rows, height):
        top, bottom = max(i / rows, target_i / height), min((i + 1) / rows, (target_i + 1) / height)
        for j, target_j in np.ndindex(cols, width):
            wide = min((j + 1) / cols, (target_j + 1) / width) - max(j / cols, target_j / width)
            if bottom > top and wide > 0:
                solid_angle = wide * (math.cos(math.pi * top) - math.cos(math.pi * bottom))
                total[target_i, target_j] += solid_angle * image[i, j].astype(np.float64)
                weight[target_i, target_j] += solid_angle
    return np.asarray(total / weight)


def relative_error(value: NDArray[Any], reference: NDArray[Any]) -> float:
    """Return ``|value − reference| / |reference|`` over the whole coefficient vector."""
    return float(np.linalg.norm(value - reference) / np.linalg.norm(reference))


def random_directions(count: int, seed: int = 0) -> NDArray[np.float64]:
    """Return uniformly distributed unit vectors, ``(count, 3)``."""
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
