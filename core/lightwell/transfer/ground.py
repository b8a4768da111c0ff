"""A round ground plane under the objects of a scene, for their shadows to fall on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.transfer.surface import LIFT

RING_POWER = 1.5
"""Rings stand closer together towards the middle, where the shadows are."""
GAP_LIFTS = 3.0


def ground_under(meshes: Sequence[Mesh], radius_factor: float, rings: int, segments: int, albedo: float) -> Mesh:
    """Return a horizontal disc just below the lowest point of the meshes, ``1 + rings · segments`` vertices.

    Its radius is ``radius_factor`` times that of the objects seen from above, its centre below theirs. It lies a little
    lower than they do, so that their lowest vertices, lifted off their surface, are still above it.

    Raises
    ------
    ValueError
        Where there are no meshes, rings or segments enough.
    """
    if not meshes or rings < 1 or segments < 3:
        raise ValueError(f"{len(meshes)} meshes, {rings} rings and {segments} segments make no ground")
    lower = np.min([mesh.bounds[0] for mesh in meshes], axis=0).astype(np.float64)
    upper = np.max([mesh.bounds[1] for mesh in meshes], axis=0).astype(np.float64)
    size = upper - lower
    centre = (lower + upper) / 2
    radius = radius_factor * max(float(np.hypot(size[0], size[1])) / 2, float(np.linalg.norm(size)) * 0.05)
    height = lower[2] - GAP_LIFTS * LIFT * max(float(np.linalg.norm(size)), 1e-6)
    distances = radius * (np.arange(1, rings + 1) / rings) ** RING_POWER
    angles = 2 * np.pi * np.arange(segments) / segments
    ring = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    plane = np.concatenate([np.zeros((1, 2)), (distances[:, None, None] * ring).reshape(-1, 2)]) + centre[:2]
    positions = np.concatenate([plane, np.full((len(plane), 1), height)], axis=1)
    return make_mesh(
        "ground", positions, disc_triangles(rings, segments), np.tile([0.0, 0, 1], (len(plane), 1)), albedo
    )


def disc_triangles(rings: int, segments: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
    """Return the triangles of a centre and rings of vertices round it, counter-clockwise from above."""
    here = np.arange(segments)
    following = (here + 1) % segments
    fan = np.stack([np.zeros(segments, np.int64), 1 + here, 1 + following], axis=1)
    bands = []
    for ring in range(rings - 1):
        inner, outer = 1 + ring * segments, 1 + (ring + 1) * segments
        a, b, c, d = inner + here, inner + following, outer + here, outer + following
        bands += [np.stack([a, c, d], axis=1), np.stack([a, d, b], axis=1)]
    return np.concatenate([fan, *bands])
