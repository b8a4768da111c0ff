"""Octahedral pictures: the sphere unfolded onto a square."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.errors import MappingError
from lightwell.probe.footprint import centre_footprints
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
        """Yield the centre of every pixel, with its solid angle."""
        yield centre_footprints(self, np.ones((self.height, self.width), dtype=np.bool_), self._solid_angles)

    def solid_angles(self) -> Floats:
        """Return the solid angles ``(N, N)``: the density at the pixels' centres, scaled to 4π in all.

        At the folds, where a pixel's exact solid angle belongs to two faces, this makes the better quadrature: half the
        error of the exact ones on light of degree 4.
        """
        return self._solid_angles

    @cached_property
    def _solid_angles(self) -> Floats:
        density = self.density(*self.pixel_centres())
        return np.asarray(density * (4 * math.pi / density.sum()))
