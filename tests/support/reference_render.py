"""Slow, obvious references for `lightwell.render`: one ray, one triangle, one quadrature at a time."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from tests.support import reference_sh

from lightwell.render.scene import SceneObject

Array = NDArray[np.float64]


def hemisphere(axis: Array, nodes: int = 14) -> tuple[Array, Array]:
    """Points and weights over the hemisphere about ``axis``; exact for polynomials of moderate degree."""
    u, weights = legendre.leggauss(nodes)
    z, weights = (u + 1) / 2, weights / 2
    azimuth = 2 * np.pi * (np.arange(2 * nodes) + 0.5) / (2 * nodes)
    z, azimuth = (grid.ravel() for grid in np.meshgrid(z, azimuth, indexing="ij"))
    ring = np.sqrt(1 - z * z)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    right = np.cross(helper, axis)
    right /= np.linalg.norm(right)
    local = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    return local @ np.stack([right, np.cross(axis, right), axis]), np.repeat(weights, 2 * nodes) * np.pi / nodes


def irradiance(coefficients: Array, normal: Array) -> Array:
    """``∫ L (n·ω) dω`` over the hemisphere, with L the sum of the harmonics."""
    directions, weights = hemisphere(normal)
    radiance = reference_sh.basis(directions, int(np.sqrt(len(coefficients)))) @ coefficients
    return np.asarray((weights * (directions @ normal)) @ radiance)


def lobe(coefficients: Array, reflected: Array, exponent: float, normalised: bool) -> Array:
    """``∫ L cos^s dω`` about the mirror direction, times (s+1)/2π where normalised."""
    directions, weights = hemisphere(reflected)
    radiance = reference_sh.basis(directions, int(np.sqrt(len(coefficients)))) @ coefficients
    scale = (exponent + 1) / (2 * np.pi) if normalised else 1.0
    return np.asarray(scale * (weights * (directions @ reflected) ** exponent) @ radiance)


def share_above(cosine: float, exponent: float) -> float:
    """Share of a Phong lobe above a plane to whose normal its axis has this cosine."""
    axis = np.array([np.sqrt(max(0.0, 1 - cosine * cosine)), 0.0, cosine])
    directions, weights = hemisphere(axis, 150)
    inside = weights * (directions @ axis) ** exponent
    return float(inside[directions[:, 2] > 0].sum() / inside.sum())


def nearest(objects: list[SceneObject], origin: Array, direction: Array) -> tuple[int, int, Array] | None:
    """The nearest front-facing hit, triangle by triangle (Möller and Trumbore 1997): object, triangle, weights."""
    best: tuple[float, tuple[int, int, Array]] | None = None
    for index, item in enumerate(objects):
        for number, corners in enumerate(item.mesh.triangles):
            a, b, c = item.mesh.positions[corners].astype(np.float64)
            across, along = b - a, c - a
            p = np.cross(direction, along)
            determinant = across @ p
            if abs(determinant) < 1e-14 or determinant < 0:  # in the plane, or seen from behind
                continue
            s = origin - a
            u = (s @ p) / determinant
            q = np.cross(s, across)
            v = (direction @ q) / determinant
            distance = (along @ q) / determinant
            if u < 0 or v < 0 or u + v > 1 or distance <= 0 or (best is not None and distance >= best[0]):
                continue
            best = distance, (index, number, np.array([1 - u - v, u, v]))
    return None if best is None else best[1]


def pixel(
    objects: list[SceneObject],
    light_at: Callable[[Array], Array],
    origin: Array,
    direction: Array,
) -> Array | None:
    """Radiance along one ray of objects without negatives, mirrors and backdrop; None where nothing is hit."""
    hit = nearest(objects, origin, direction)
    if hit is None:
        return None
    item, corners, weights = objects[hit[0]], objects[hit[0]].mesh.triangles[hit[1]], hit[2]
    point = weights @ item.mesh.positions[corners].astype(np.float64)
    normal = weights @ item.mesh.normals[corners].astype(np.float64)
    normal /= np.linalg.norm(normal)
    albedo = np.array(item.material.albedo or weights @ item.mesh.albedo[corners].astype(np.float64))
    coefficients = light_at(point)
    visible = 1.0
    if item.transfer is None:
        received = irradiance(coefficients, normal)
    else:
        transfer = np.tensordot(weights, item.transfer[corners].astype(np.float64), axes=1)
        received = (transfer * coefficients[: len(transfer)]).sum(axis=0)
        visible = float(np.clip(transfer[0].mean() / (np.pi / np.sqrt(4 * np.pi)), 0, 1))
    reflected = direction - 2 * (direction @ normal) * normal
    material = item.material
    polished = visible * lobe(coefficients, reflected, material.exponent, material.normalised)
    return np.asarray((1 - material.gloss) * albedo * received / np.pi + material.gloss * polished)
