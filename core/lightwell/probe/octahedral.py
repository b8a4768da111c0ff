"""Octahedral pictures: the sphere unfolded onto a square."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.errors import MappingError
from lightwell.probe.footprint import sum_solid_angles
from lightwell.probe.mapping import Bools, Floats, Mapping, Samples


class Octahedral(Mapping):
    """A square ``[−1, 1]²``, u right, v up: ``q = (u, v, 1−|u|−|v|)``, folded below, ``ω = q/|q|`` (MATHS §2.2).

    The centre is world +Z, the corners are −Z.
    """

    kind: ClassVar[str] = "octahedral"

    def __init__(self, height: int, width: int) -> None:
        super().__init__(height, width)
        if height != width:
            raise MappingError(f"an octahedral picture is square, this one has {width}×{height} pixels")

    def _octahedron(self, x: ArrayLike, y: ArrayLike) -> Floats:
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        u, v = 2 * x / self.width - 1, 1 - 2 * y / self.height
        z = 1 - np.abs(u) - np.abs(v)
        below = z < 0
        folded_u = np.where(below, np.copysign(1 - np.abs(v), u), u)
        folded_v = np.where(below, np.copysign(1 - np.abs(u), v), v)
        return np.stack([folded_u, folded_v, z], axis=-1)

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions of picture points, and whether they lie in the picture."""
        q = self._octahedron(x, y)
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return q / np.linalg.norm(q, axis=-1, keepdims=True), self._is_in_picture(x, y)

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions; every direction has one."""
        d = np.asarray(directions, dtype=np.float64)
        u, v, z = np.moveaxis(d / np.abs(d).sum(axis=-1, keepdims=True), -1, 0)
        below = z < 0
        unfolded_u = np.where(below, np.copysign(1 - np.abs(v), u), u)
        unfolded_v = np.where(below, np.copysign(1 - np.abs(u), v), v)
        x, y = (unfolded_u + 1) * (self.width / 2), (1 - unfolded_v) * (self.height / 2)
        return x, y, np.ones(x.shape, dtype=np.bool_)

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return ``(2/N)² / |q|³``."""
        q = self._octahedron(x, y)
        return np.asarray((2 / self.width) ** 2 / np.linalg.norm(q, axis=-1) ** 3)

    def footprints(self) -> Iterator[Samples]:
        """Yield eight triangles a pixel: their centroids, with their exact solid angles.

        Half pixels, cut along the direction of the fold in their quadrant, lie on one face of the octahedron each, so
        they are spherical triangles: ``tan(Ω/2) = a·(b×c) / (1 + a·b + b·c + c·a)`` (van Oosterom and Strackee 1983).
        """
        n = 2 * self.width
        corner = self.directions(np.arange(n + 1)[None, :] / 2, np.arange(n + 1)[:, None] / 2)[0]
        row, column = np.divmod(np.arange(n * n), n)
        # The fold |u|+|v| = 1 runs down to the right where u and v have the same sign, and up to the right elsewhere.
        falling = (row < self.width) == (column >= self.width)
        near = corner[row, np.where(falling, column, column + 1)]
        far = corner[row + 1, np.where(falling, column + 1, column)]
        pixel = (row // 2) * self.width + column // 2
        for third in (
            corner[row, np.where(falling, column + 1, column)],
            corner[row + 1, np.where(falling, column, column + 1)],
        ):
            centroid = near + far + third
            yield pixel, centroid / np.linalg.norm(centroid, axis=-1, keepdims=True), _triangles(near, far, third)

    def solid_angles(self) -> Floats:
        """Return the exact solid angles ``(N, N)``."""
        return self._solid_angles

    @cached_property
    def _solid_angles(self) -> Floats:
        return sum_solid_angles(self)


def _triangles(a: Floats, b: Floats, c: Floats) -> Floats:
    """Return the solid angles of spherical triangles of unit vectors ``(…, 3)``."""
    volume = np.abs(np.sum(a * np.cross(b, c), axis=-1))
    cosines = np.sum(a * b, axis=-1) + np.sum(b * c, axis=-1) + np.sum(c * a, axis=-1)
    return np.asarray(2 * np.arctan2(volume, 1 + cosines))
