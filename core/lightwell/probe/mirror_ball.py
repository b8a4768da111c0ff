"""Mirror ball seen from infinitely far away (orthographic camera)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.probe.disc import CentredDiscMapping
from lightwell.probe.mapping import Bools, Floats


class MirrorBall(CentredDiscMapping):
    """``n = (u, v, √(1−ρ²))``, ``ω = 2 n_z n − ẑ`` in camera axes; the centre shows −forward (MATHS §2.2).

    The solid angle per disc area is the constant 4: the whole disc shows the whole sphere.
    """

    kind: ClassVar[str] = "mirror-ball"

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions of picture points, and whether they lie on the ball."""
        u, v = self.disc_from_picture(x, y)
        rho_squared = u * u + v * v
        shrink = 1 / np.sqrt(np.maximum(rho_squared, 1))
        u, v = u * shrink, v * shrink
        nz = np.sqrt(np.maximum(1 - u * u - v * v, 0))
        camera = np.stack([2 * nz * u, 2 * nz * v, 2 * nz * nz - 1], axis=-1)
        return camera @ self.world_from_camera.T, self.sees(x, y)

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions; the normal is halfway between direction and camera."""
        u, v, z = np.moveaxis(np.asarray(directions, dtype=np.float64) @ self.world_from_camera, -1, 0)
        # |ω + ẑ|/2 = cos(θ/2) = n_z, so the disc point is (u, v) / (2 n_z); straight behind the ball, any rim point.
        sideways = np.hypot(u, v)
        half_angle = np.arctan2(sideways, z) / 2
        rho = np.sin(half_angle)
        unit_u = np.where(sideways > 0, u / np.maximum(sideways, 1e-300), 1.0)
        unit_v = np.where(sideways > 0, v / np.maximum(sideways, 1e-300), 0.0)
        return *self.picture_from_disc(unit_u * rho, unit_v * rho), np.ones(rho.shape, dtype=np.bool_)

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return 4 / radius²."""
        return np.full(np.broadcast_shapes(np.shape(x), np.shape(y)), 4 / self.radius**2)
