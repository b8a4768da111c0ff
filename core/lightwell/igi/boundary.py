"""Light of a captured grid, which comes in at the boundary of its volume (MATHS §10).

The boundary is that of the grid's box, enlarged where the scene reaches beyond it: out there the field is that of the
nearest cell. What it sends inwards is the radiance of its coefficients under the Lanczos window, and nothing where that
still is below zero. (The window of MATHS §4.1(c), with which it is nowhere negative, blurs more: with 9 coefficients
irradiance is off by one and a half to twice as much.) Between the boundary and a surface light goes straight, as light
does, though truncated fields do not: near lamps a few percent are gained or lost.
"""

from __future__ import annotations

import numpy as np

from lightwell.conventions import LUMINANCE
from lightwell.igi.lights import BOUNDARY, VirtualLights, make_lights
from lightwell.igi.sources import Floats, Rays, cosine_directions, pick
from lightwell.igi.surfaces import Surfaces
from lightwell.render.light import StaticField
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal, zonal_to_coefficients
from lightwell.sh.window import apply_window, fixed_window

CELLS = 16
"""Each face has so many cells a side, and each cell as many samples as its light deserves."""
MARGIN = 0.05
"""Room between the scene and the boundary, of the scene's radius."""
DEFENSIVE = 0.05
"""Share of the samples that goes by area alone."""


class Boundary:
    """The six faces of the volume as a source."""

    is_sampled = True

    def __init__(self, field: StaticField, surfaces: Surfaces) -> None:
        lower, upper = field.box
        if len(surfaces.areas):
            low, high = (corner.astype(np.float64) for corner in surfaces.mesh.bounds)
            room = MARGIN * surfaces.radius
            lower, upper = np.minimum(lower, low - room), np.maximum(upper, high + room)
        self._field, self._lower, self._size = field, lower, upper - lower
        self._weights = fixed_window("lanczos", field.bands)
        face, row, column = (part.reshape(-1) for part in np.indices((6, CELLS, CELLS)))
        self._face, self._row, self._column = face, row, column
        everything = np.arange(len(face))
        places, inwards = self._places(everything, np.full((len(face), 2), 0.5))
        light = zonal_to_coefficients(lambert_zonal(field.bands), -inwards)
        # By row, as a grid's values are: coefficients of radiance at each place.
        arriving = np.maximum(np.einsum("nk,nkc->nc", light, self._coefficients(places)), 0) @ LUMINANCE
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
        """Return samples of the faces."""
        cells, places, inwards, area = self._sample(numbers, count)
        del cells
        flux = np.tile(area[:, None], (1, 3))
        least = clamp**2 * area / np.pi
        return make_lights(BOUNDARY, places, inwards, flux, least=least, coefficients=self._coefficients(places))

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return rays inwards, cosine-weighted about the faces' normals."""
        # Where light goes matters more than where in a cell it enters: the earlier numbers are the more even ones.
        _, places, inwards, area = self._sample(numbers[:, [0, 3, 4]], count)
        directions = cosine_directions(inwards, numbers[:, 1], numbers[:, 2])
        basis = evaluate(-directions, self._field.bands)
        radiance = np.maximum(np.einsum("nk,nkc->nc", basis, self._coefficients(places)), 0)
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

    def _coefficients(self, places: Floats) -> Floats:
        found = np.moveaxis(self._field.at(places), 1, 0)
        return np.moveaxis(apply_window(found, self._weights), 0, 1)
