"""The transfer as its formula says: every vertex, every direction, every triangle, in double precision."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.sh.basis import evaluate
from lightwell.transfer.directions import Directions
from lightwell.transfer.surface import Surface

Floats = NDArray[np.float64]


def meets(origin: Floats, direction: Floats, corners: Floats) -> tuple[float, int, float, float]:
    """Return distance, triangle, u and v of the nearest hit (Möller and Trumbore 1997); infinite distance: none."""
    best: tuple[float, int, float, float] = (np.inf, -1, 0.0, 0.0)
    for index, (a, b, c) in enumerate(corners):
        one, other = b - a, c - a
        across = np.cross(direction, other)
        determinant = one @ across
        if abs(determinant) < 1e-300:
            continue
        u = (origin - a) @ across / determinant
        q = np.cross(origin - a, one)
        v = direction @ q / determinant
        distance = other @ q / determinant
        if u >= 0 and v >= 0 and u + v <= 1 and 0 < distance < best[0]:
            best = (float(distance), index, float(u), float(v))
    return best


def transfer(surface: Surface, directions: Directions, bands: int, bounces: int) -> Floats:
    """Return the transfer ``(V, bands², 3)`` of a scene, directions in world axes, with so many bounces."""
    assert not directions.about_normal
    merged = surface.merged
    corners = merged.positions.astype(float)[merged.triangles]
    vectors = directions.vectors.astype(float)
    basis = evaluate(vectors, bands)
    count = surface.count
    direct = np.zeros((count, bands * bands, 3))
    seen: list[list[tuple[float, int, Floats]]] = [[] for _ in range(count)]
    for vertex in range(count):
        for k, direction in enumerate(vectors):
            cosine = float(merged.normals[vertex].astype(float) @ direction)
            if cosine <= 0 or surface.sides[vertex].astype(float) @ direction <= 0:
                continue
            distance, triangle, u, v = meets(surface.origins[vertex].astype(float), direction, corners)
            if not np.isfinite(distance):
                direct[vertex] += directions.weight * cosine * basis[k][:, None]
                continue
            shares = np.array([1 - u - v, u, v])
            normal = shares @ merged.normals[merged.triangles[triangle]].astype(float)
            if normal @ direction < 0:
                seen[vertex].append((directions.weight * cosine, triangle, shares))
    total, bounce = direct.copy(), direct
    for _ in range(bounces):
        following: Any = np.zeros_like(direct)
        for vertex in range(count):
            for weight, triangle, shares in seen[vertex]:
                for share, corner in zip(shares, merged.triangles[triangle], strict=True):
                    following[vertex] += weight / np.pi * share * merged.albedo[corner] * bounce[corner]
        bounce = following
        total = total + bounce
    return total
