"""Distant surroundings: a lat-long map, sampled by luminance times solid angle (MATHS §10)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import LUMINANCE
from lightwell.igi.lights import DIRECTIONAL, VirtualLights, make_lights
from lightwell.igi.materials import BRIGHTEST
from lightwell.igi.sources import Floats, Rays, frames, pick
from lightwell.probe.latlong import LatLong
from lightwell.render.backdrop import Harmonics, Panorama

HARMONICS_HEIGHT = 64
"""Rows of the map of coefficients: 2.8° a pixel, of which 10 degrees of harmonics need none finer."""


@dataclass(frozen=True, eq=False)
class Sky:
    """Radiance by direction, from so far away that it is the same everywhere."""

    pixels: NDArray[np.float32]
    """``(H, W, 3)`` lat-long, row 0 is +Z; linear radiance, finite, not negative."""

    def __post_init__(self) -> None:
        pixels = np.asarray(self.pixels, np.float32)
        if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
            raise ValueError(f"the sky has the shape {pixels.shape}; (height, width, 3) is needed")
        if not (pixels.min() >= 0 and pixels.max() <= BRIGHTEST):
            raise ValueError(f"the sky must be finite and not negative, at most {BRIGHTEST:g}: repair the map first")
        object.__setattr__(self, "pixels", pixels)

    def radiance(self, directions: Floats) -> Floats:
        """Return the radiance ``(n, 3)`` from unit directions, linear between pixel centres."""
        return Panorama(self.pixels).radiance(directions)


def sky_of_harmonics(coefficients: Floats) -> Sky:
    """Return the map of coefficients ``(bands², 3)``; where they ring below zero, colours fade to black."""
    mapping = LatLong(HARMONICS_HEIGHT, 2 * HARMONICS_HEIGHT)
    directions, _ = mapping.directions(*mapping.pixel_centres())
    values = Harmonics(np.asarray(coefficients, np.float64)).radiance(directions.reshape(-1, 3))
    return Sky(values.reshape(mapping.height, mapping.width, 3).astype(np.float32))


class Directions:
    """Directions drawn from a lat-long map of how often each is wanted; even within a texel."""

    def __init__(self, density: Floats) -> None:
        """Take ``(H, W)``, not negative."""
        self._mapping = LatLong(*density.shape)
        self._density = density.reshape(-1)
        weights = self._density * self._mapping.solid_angles().reshape(-1)
        self.total = float(weights.sum())
        """Integral over the sphere."""
        self._cumulative = np.cumsum(weights) / self.total if self.total > 0 else np.ones(len(weights))
        self._cumulative[-1] = 1.0

    def draw(self, numbers: Floats) -> tuple[Floats, NDArray[np.int64], Floats]:
        """Return unit vectors ``(n, 3)``, their texels, and 1/p in steradians, of random numbers ``(n, 3)``."""
        texel, _ = pick(self._cumulative, numbers[:, 0])
        row, column = np.divmod(texel, self._mapping.width)
        edges = np.cos(np.pi * np.arange(self._mapping.height + 1) / self._mapping.height)
        z = edges[row] + (edges[row + 1] - edges[row]) * numbers[:, 1]
        phi = 2 * np.pi * (column + numbers[:, 2]) / self._mapping.width
        sine = np.sqrt(np.maximum(0, 1 - z * z))
        directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), z], axis=1)
        density = self._density[texel]
        return directions, texel, np.divide(self.total, density, out=np.zeros(len(texel)), where=density > 0)


class SkySource:
    """Light of a sky. Every texel is a patch of constant radiance."""

    is_sampled = True

    def __init__(self, sky: Sky, centre: Floats, radius: float) -> None:
        """Take a sky round a sphere that holds the scene."""
        self._texels = sky.pixels.reshape(-1, 3)
        self._directions = Directions(sky.pixels.astype(np.float64) @ LUMINANCE)
        self._centre, self._radius = centre, radius
        self.power = self._directions.total * np.pi * radius**2

    def lights(self, numbers: Floats, count: float, clamp: float) -> VirtualLights:
        """Return directional lights."""
        del clamp
        directions, irradiance = self._sample(numbers, count)
        return make_lights(DIRECTIONAL, np.zeros((len(numbers), 3)), directions, irradiance)

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return rays through a disc across the direction that covers the scene."""
        # The first numbers are the most even ones, and where in a texel is the least of it.
        directions, irradiance = self._sample(numbers[:, [0, 3, 4]], count)
        first, second = frames(directions)
        radius, angle = self._radius * np.sqrt(numbers[:, 1:2]), 2 * np.pi * numbers[:, 2:3]
        across = radius * np.cos(angle) * first + radius * np.sin(angle) * second
        origins = self._centre + across + 1.01 * self._radius * directions
        return Rays(origins, -directions, irradiance * np.pi * self._radius**2)

    def _sample(self, numbers: Floats, count: float) -> tuple[Floats, Floats]:
        """Return directions ``(n, 3)``, and ``L(ω) / (count p(ω))``, ``(n, 3)``, p = luminance over its integral."""
        directions, texel, inverse = self._directions.draw(numbers)
        return directions, self._texels[texel].astype(np.float64) * (inverse / count)[:, None]
