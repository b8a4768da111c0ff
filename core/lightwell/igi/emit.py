"""Lamps: emissive surfaces, points, spots and parallel light."""

from __future__ import annotations

import numpy as np

from lightwell.conventions import LUMINANCE
from lightwell.igi.lights import DIRECTIONAL, NONE, POINT, SURFACE, VirtualLights, make_lights
from lightwell.igi.scene import DirectionalLight, PointLight
from lightwell.igi.sequence import halton
from lightwell.igi.sources import Floats, Rays, cosine_directions, frames, pick
from lightwell.igi.surfaces import Surfaces

LOOKS, LEAST_LOOKS = 4096, 7
"""So often the emission of all triangles is looked at to see how many samples each deserves; each so often at least."""
DEFENSIVE = 0.05
"""Share of the samples that goes by area alone: a texture may be bright where it was not looked at."""


class EmissiveSurfaces:
    """Light of all emissive triangles, of both sides if two-sided: points by power, then even over each triangle."""

    is_sampled = True

    def __init__(self, surfaces: Surfaces) -> None:
        self._surfaces = surfaces
        emits = np.array([item.material.emits for item in surfaces.objects], np.bool_)
        fronts = np.flatnonzero(emits[surfaces.owner] & (surfaces.areas > 0))
        backs = fronts[surfaces.two_sided(fronts)]
        self._triangles = np.concatenate([fronts, backs])
        self._sides = np.repeat([1.0, -1.0], [len(fronts), len(backs)])
        areas = surfaces.areas[self._triangles]
        powers = np.pi * areas * (self._mean_emission() @ LUMINANCE)
        self.power = float(powers.sum())
        if self.power > 0:
            shares = (1 - DEFENSIVE) * powers / self.power + DEFENSIVE * areas / areas.sum()
            self._shares = shares
            self._cumulative = np.cumsum(shares) / shares.sum()
            self._cumulative[-1] = 1.0

    def _mean_emission(self) -> Floats:
        """Return the mean radiance of each triangle, ``(n, 3)``, about."""
        count = len(self._triangles)
        if not count:
            return np.zeros((0, 3))
        points = _in_triangles(*halton(max(LEAST_LOOKS, -(-LOOKS // count)), 2, 0).T)
        total = np.zeros((count, 3))
        at_once = max(LOOKS // count, 1)
        for part in (points[first : first + at_once] for first in range(0, len(points), at_once)):
            seen = self._surfaces.emission(np.repeat(self._triangles, len(part)), np.tile(part, (count, 1)))
            total += seen.reshape(count, len(part), 3).sum(axis=1)
        return total / len(points)

    def lights(self, numbers: Floats, count: float, clamp: float) -> VirtualLights:
        """Return samples of the surfaces."""
        places, normals, flux, area = self._sample(numbers, count)
        return make_lights(SURFACE, places, normals, flux, least=clamp**2 * area / np.pi)

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return rays from the surfaces, cosine-weighted about their normals."""
        # Where light goes matters more than where it leaves a lamp: the earlier numbers are the more even ones.
        places, normals, flux, _ = self._sample(numbers[:, [0, 3, 4]], count)
        return Rays(places, cosine_directions(normals, numbers[:, 1], numbers[:, 2]), flux)

    def _sample(self, numbers: Floats, count: float) -> tuple[Floats, Floats, Floats, Floats]:
        """Return places, normals, flux ``π L A / (count p)`` and the area that each sample stands for."""
        index, _ = pick(self._cumulative, numbers[:, 0])
        triangles = self._triangles[index]
        barycentric = _in_triangles(numbers[:, 1], numbers[:, 2])
        corners = self._surfaces.mesh.positions[self._surfaces.mesh.triangles[triangles]].astype(np.float64)
        u, v = barycentric[:, :1], barycentric[:, 1:]
        normals = self._surfaces.fronts[triangles].astype(np.float64) * self._sides[index, None]
        places = (1 - u - v) * corners[:, 0] + u * corners[:, 1] + v * corners[:, 2] + self._surfaces.lift * normals
        area = self._surfaces.areas[triangles] / (count * self._shares[index])
        return places, normals, np.pi * area[:, None] * self._surfaces.emission(triangles, barycentric), area


def _in_triangles(a: Floats, b: Floats) -> Floats:
    """Return barycentric coordinates ``(n, 2)``, even over triangles, of two numbers each."""
    root = np.sqrt(a)
    return np.stack([root * (1 - b), root * b], axis=1)


class Lamp:
    """A punctual light: whole in every set, and a source of rays for what it lights."""

    is_sampled = False

    def __init__(self, lamp: PointLight | DirectionalLight, centre: Floats, radius: float) -> None:
        """Take a lamp and a sphere that holds the scene."""
        self._lamp, self._centre, self._radius = lamp, centre, radius
        if isinstance(lamp, DirectionalLight):
            self._axis = np.asarray(lamp.towards, np.float64) / np.linalg.norm(lamp.towards)
            self._colour = np.asarray(lamp.irradiance, np.float64)
            solid_angle = np.pi * radius**2
        else:
            axis = np.array((0.0, 0.0, 1.0) if lamp.direction is None else lamp.direction)
            self._axis = axis / np.linalg.norm(axis)
            self._colour = np.asarray(lamp.intensity, np.float64)
            self._lowest = -1.0 if lamp.direction is None else float(np.cos(lamp.outer_angle))
            solid_angle = 2 * np.pi * (1 - self._lowest)
        self._extent = solid_angle
        self.power = float(self._colour @ LUMINANCE) * solid_angle

    @property
    def light(self) -> VirtualLights:
        """The lamp as a virtual light."""
        if isinstance(self._lamp, DirectionalLight):
            return make_lights(DIRECTIONAL, np.zeros((1, 3)), self._axis, self._colour[None])
        falloff = (0.0, 1.0) if self._lamp.direction is None else self._lamp.falloff
        place = np.asarray(self._lamp.position, np.float64)
        return make_lights(POINT, place, self._axis, self._colour[None], falloff=falloff)

    def lights(self, numbers: Floats, count: float, clamp: float) -> VirtualLights:
        """Return nothing: `light` is all there is."""
        del numbers, count, clamp
        return NONE

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return parallel rays through a disc that covers the scene, or rays even over the lamp's cone."""
        # The first numbers are the most even ones; which lamp it is leaves the others to the direction.
        angle = 2 * np.pi * numbers[:, 2:3]
        first, second = frames(self._axis[None])
        if isinstance(self._lamp, DirectionalLight):
            radius = self._radius * np.sqrt(numbers[:, 1:2])
            across = radius * np.cos(angle) * first + radius * np.sin(angle) * second
            origins = self._centre + across + 1.01 * self._radius * self._axis
            directions = np.tile(-self._axis, (len(numbers), 1))
            return Rays(origins, directions, np.tile(self._colour * (self._extent / count), (len(numbers), 1)))
        z = 1 - (1 - self._lowest) * numbers[:, 1:2]
        sine = np.sqrt(np.maximum(0, 1 - z * z))
        directions = sine * np.cos(angle) * first + sine * np.sin(angle) * second + z * self._axis
        a, b = (0.0, 1.0) if self._lamp.direction is None else self._lamp.falloff
        strength = np.clip(a * z + b, 0, 1) ** 2
        origins = np.tile(np.asarray(self._lamp.position, np.float64), (len(numbers), 1))
        return Rays(origins, directions, strength * self._colour * (self._extent / count))
