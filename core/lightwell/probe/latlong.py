"""Lat-long (equirectangular) panoramas."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.probe.mapping import Bools, Floats, Mapping, Samples
from lightwell.probe.weights import row_weights


class LatLong(Mapping):
    """Row 0 is world +Z: ``θ = π y/H``, ``φ = 2π x/W``, direction ``(sinθ cosφ, sinθ sinφ, cosθ)`` (MATHS §2.1).

    x is periodic: any x looks somewhere. Any ratio of width to height is accepted.
    """

    kind: ClassVar[str] = "latlong"

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions ``(…, 3)`` of picture points, and whether ``0 ≤ y ≤ H``."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        theta, phi = np.pi * y / self.height, 2 * np.pi * x / self.width
        sin_theta = np.sin(theta)
        directions = np.stack([sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.cos(theta)], axis=-1)
        return directions, (y >= 0) & (y <= self.height)

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions ``(…, 3)``; every direction has one, ``0 ≤ x < W``."""
        x, y, z = np.moveaxis(np.asarray(directions, dtype=np.float64), -1, 0)
        theta = np.arctan2(np.hypot(x, y), z)
        turns = np.arctan2(y, x) / (2 * np.pi)
        column = (turns - np.floor(turns)) * self.width
        column = np.where(column >= self.width, 0.0, column)
        return column, theta * (self.height / np.pi), np.ones(theta.shape, dtype=np.bool_)

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return ``(2π/W)(π/H) sinθ``."""
        _, y = np.broadcast_arrays(x, np.asarray(y, dtype=np.float64))
        return 2 * np.pi**2 / (self.width * self.height) * np.sin(np.pi * y / self.height)

    def row_solid_angles(self) -> Floats:
        """Return the exact solid angle of one pixel of each row, ``(H,)``: ``(2π/W)(cosθ_{i−½} − cosθ_{i+½})``."""
        return row_weights(self.height, self.width)

    def solid_angles(self) -> Floats:
        """Return the exact solid angle of each pixel, ``(H, W)``; they sum to 4π."""
        return np.repeat(self.row_solid_angles()[:, None], self.width, axis=1)

    def footprints(self) -> Iterator[Samples]:
        """Yield one sample a pixel: its centre, with its exact solid angle."""
        directions = self.directions(*self.pixel_centres())[0].reshape(-1, 3)
        yield np.arange(directions.shape[0]), directions, self.solid_angles().reshape(-1)
