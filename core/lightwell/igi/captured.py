"""Light of a captured grid: what a surface gets of it, and what the surface sends on.

What a place gets is known there: the field's coefficients are the light that arrives, from all directions. So direct
light is by directions, each with the radiance that the field has at the pixel, and a shadow ray says what of it an
object keeps away. That radiance is taken as it is, also where it rings below zero: then a matte surface without
anything above it gets the irradiance of the field's own coefficients. (MATHS §10 has samples of the boundary of the
volume in its place, from which light goes straight; truncated fields do not, and irradiance near lamps is off by a
quarter, whatever the bands.)

Only what is reflected has to come from somewhere: paths begin at the boundary, that of the grid's box, enlarged where
the scene reaches beyond it; out there the field is that of the nearest cell. Paths carry what the coefficients make
under the Lanczos window, and nothing where that still is below zero. (The window of MATHS §4.1(c), with which it is
nowhere negative, blurs more.)
"""

from __future__ import annotations

import numpy as np

from lightwell.conventions import LUMINANCE
from lightwell.igi.lights import CAPTURED, VirtualLights, make_lights
from lightwell.igi.sky import Directions
from lightwell.igi.sources import Floats, Rays, cosine_directions, pick
from lightwell.igi.surfaces import Surfaces
from lightwell.probe.latlong import LatLong
from lightwell.render.light import StaticField
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal, zonal_to_coefficients
from lightwell.sh.window import fixed_window

CELLS = 16
"""Each face has so many cells a side, and each cell as many samples as its light deserves."""
MARGIN = 0.05
"""Room between the scene and the boundary, of the scene's radius."""
DEFENSIVE = 0.05
"""Share of the paths that goes by area alone."""
MAP_HEIGHT = 24
"""Rows of the map by which directions are drawn."""
PLACES = 4
"""That map is the mean over so many places along each axis of the scene."""
EVEN = 0.25
"""Share of the directions that is even: from some places light comes from elsewhere than on average."""


class CapturedField:
    """A grid as a source."""

    is_sampled = True

    def __init__(self, field: StaticField, surfaces: Surfaces) -> None:
        lower, upper = field.box
        within = lower, upper
        if len(surfaces.areas):
            low, high = (corner.astype(np.float64) for corner in surfaces.mesh.bounds)
            room = MARGIN * surfaces.radius
            within = low, high
            lower, upper = np.minimum(lower, low - room), np.maximum(upper, high + room)
        self._field, self._lower, self._size = field, lower, upper - lower
        self._window = np.repeat(fixed_window("lanczos", field.bands), 2 * np.arange(field.bands) + 1)
        self._directions = Directions(self._density(*within))
        face, row, column = (part.reshape(-1) for part in np.indices((6, CELLS, CELLS)))
        self._face, self._row, self._column = face, row, column
        everything = np.arange(len(face))
        places, inwards = self._places(everything, np.full((len(face), 2), 0.5))
        light = zonal_to_coefficients(lambert_zonal(field.bands), -inwards) * self._window
        arriving = np.maximum(np.einsum("nk,nkc->nc", light, field.at(places)), 0) @ LUMINANCE
        axis = face // 2
        self._areas = self._size[(axis + 1) % 3] * self._size[(axis + 2) % 3] / CELLS**2
        powers = arriving * self._areas
        self.power = float(powers.sum())
        if self.power > 0:
            shares = (1 - DEFENSIVE) * powers / self.power + DEFENSIVE * self._areas / self._areas.sum()
            self._shares = shares / shares.sum()
            self._cumulative = np.cumsum(self._shares)
            self._cumulative[-1] = 1.0

    def lights(self, numbers: Floats, count: float, clamp: float) -> VirtualLights:
        """Return directions, in which each place has its own light."""
        del clamp
        directions, _, solid_angle = self._directions.draw(numbers)
        flux = np.tile(solid_angle[:, None] / count, (1, 3))
        return make_lights(CAPTURED, np.zeros((len(numbers), 3)), directions, flux)

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return rays inwards, cosine-weighted about the faces' normals."""
        # Where light goes matters more than where in a cell it enters: the earlier numbers are the more even ones.
        _, places, inwards, area = self._sample(numbers[:, [0, 3, 4]], count)
        directions = cosine_directions(inwards, numbers[:, 1], numbers[:, 2])
        radiance = np.maximum(np.einsum("nk,nkc->nc", self._harmonics(-directions), self._field.at(places)), 0)
        return Rays(places, directions, np.pi * area[:, None] * radiance)

    def _sample(
        self, numbers: Floats, count: float
    ) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], Floats, Floats, Floats]:
        index, _ = pick(self._cumulative, numbers[:, 0])
        places, inwards = self._places(index, numbers[:, 1:3])
        return index, places, inwards, self._areas[index] / (count * self._shares[index])

    def _places(self, cells: np.ndarray[tuple[int], np.dtype[np.int64]], within: Floats) -> tuple[Floats, Floats]:
        """Return places on the faces ``(n, 3)`` and the normals inwards."""
        axis, far = self._face[cells] // 2, self._face[cells] % 2
        at = np.empty((len(cells), 3))
        rows = np.arange(len(cells))
        at[rows, axis] = far
        at[rows, (axis + 1) % 3] = (self._row[cells] + within[:, 0]) / CELLS
        at[rows, (axis + 2) % 3] = (self._column[cells] + within[:, 1]) / CELLS
        inwards = np.zeros((len(cells), 3))
        inwards[rows, axis] = 1 - 2 * far
        return self._lower + at * self._size, inwards

    def _harmonics(self, directions: Floats) -> Floats:
        """Return what makes windowed radiance from directions of coefficients, ``(n, bands²)``."""
        return np.asarray(evaluate(directions, self._field.bands) * self._window)

    def _density(self, lower: Floats, upper: Floats) -> Floats:
        """Return the luminance by direction on average over a box, ``(H, W)`` lat-long, not below a share of all."""
        inside = (np.indices((PLACES,) * 3).reshape(3, -1).T + 0.5) / PLACES
        coefficients = self._field.at(lower + inside * (upper - lower))
        mapping = LatLong(MAP_HEIGHT, 2 * MAP_HEIGHT)
        directions, _ = mapping.directions(*mapping.pixel_centres())
        radiance = np.einsum("dk,nkc->ndc", self._harmonics(directions.reshape(-1, 3)), coefficients)
        luminance = (np.maximum(radiance, 0) @ LUMINANCE).mean(axis=0).reshape(mapping.height, mapping.width)
        even = float((luminance * mapping.solid_angles()).sum()) / (4 * np.pi)
        return np.asarray((1 - EVEN) * luminance + EVEN * even)
