"""A grid of SH coefficients in space, and what it says of any point."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count, coefficient_count
from lightwell.field.points import Outside, place_points
from lightwell.field.spec import Floats, GridSpec

Singles = NDArray[np.float32]


class FieldSamples(NamedTuple):
    """What a grid says of points ``(…, 3)``."""

    coefficients: Floats
    """``(…, bands², 3)``."""
    coverage: Floats
    """``(…)``: share of the sphere that was measured there, not repaired."""
    gradients: Floats | None = None
    """``(…, bands², 3, 3)`` per metre: the last axis is x, y, z."""


@dataclass(frozen=True)
class Grid:
    """Coefficients at the centres of the cells of a regular grid."""

    spec: GridSpec
    coefficients: Singles
    """``(z, y, x, bands², 3)`` float32."""
    coverage: Singles
    """``(z, y, x)``: share of the sphere that was measured, 0 … 1."""
    samples: Singles | None = None
    """``(z, y, x)``: mean kernel weight that a direction gathered."""
    gradients: Singles | None = None
    """``(z, y, x, bands², 3, 3)`` per metre."""
    attributes: dict[str, Any] = field(default_factory=dict)
    """Where the grid comes from; see `lightwell.io.grids`."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(self.coefficients.shape[3])

    def memory_bytes(self, precision: Literal["float32", "float16"] = "float32") -> int:
        """Return the memory of coefficients and coverage, with coefficients of that precision."""
        return int(self.coefficients.size * np.dtype(precision).itemsize + self.coverage.nbytes)

    def sample(
        self,
        points: ArrayLike,
        *,
        gradients: bool = False,
        bands: int | None = None,
        outside: Outside = "clamp",
    ) -> FieldSamples:
        """Return the light at ``points`` ``(…, 3)`` in metres.

        Trilinear between the eight nearest cell centres. Where the grid has gradients, each centre is extrapolated by
        half its gradient, ``Σ W (c + ½ G·(x − x_k))``, which is exact for fields that are quadratic in space
        (MATHS §7.8). ``gradients`` also returns the gradient: that stored, interpolated, or else that of the
        interpolation. Beyond the outermost centres the field is constant (``clamp``), not a number, or an error.

        Raises
        ------
        ValueError
            Where a point is not finite, lies outside with ``outside`` = ``error``, or more bands are asked for than
            there are.
        """
        wanted = bands or self.bands
        if wanted > self.bands:
            raise ValueError(f"the grid has {self.bands} bands, not {wanted}")
        count = coefficient_count(wanted)
        cells, beyond = place_points(self.spec, points, outside)
        half_gradient = self.gradients is not None
        table = self.gradients if self.gradients is not None else np.zeros((1, 1, 1, 1, 1, 1), np.float32)
        values = np.empty((len(cells), count, 3))
        slopes = np.zeros((len(cells) if gradients else 0, count, 3, 3))
        coverage = np.empty(len(cells))
        _sample(
            cells, self.spec.voxel, self.coefficients, self.coverage, table, half_gradient, values, slopes, coverage
        )
        if outside == "nan":
            values[beyond], coverage[beyond] = np.nan, np.nan
            if gradients:
                slopes[beyond] = np.nan
        shape = np.shape(points)[:-1]
        return FieldSamples(
            values.reshape(*shape, count, 3),
            coverage.reshape(shape),
            slopes.reshape(*shape, count, 3, 3) if gradients else None,
        )

    def to_regular(self) -> Self:
        """Return the regular grid that this is: `lightwell.field.adaptive.AdaptiveGrid` makes one."""
        return self


@njit(cache=True, nogil=True)
def _sample(  # type: ignore[no-untyped-def]
    cells, voxel, coefficients, coverage, gradients, half_gradient, values, slopes, covered
):
    count = values.shape[1]
    sloped = slopes.shape[0] > 0
    low = np.empty(3, np.int64)
    high = np.empty(3, np.int64)
    fraction = np.empty(3)
    offset = np.empty(3)
    for i in range(cells.shape[0]):
        inside = np.ones(3)
        for axis in range(3):
            size = coefficients.shape[2 - axis]
            place = min(max(cells[i, axis], 0.0), size - 1.0)
            if place != cells[i, axis] or size == 1:
                inside[axis] = 0.0
            low[axis] = min(int(place), max(size - 2, 0))
            high[axis] = min(low[axis] + 1, size - 1)
            fraction[axis] = place - low[axis]
        values[i] = 0.0
        covered[i] = 0.0
        for corner in range(8):
            weight = 1.0
            index = np.empty(3, np.int64)
            for axis in range(3):
                far = (corner >> axis) & 1
                index[axis] = high[axis] if far else low[axis]
                weight *= fraction[axis] if far else 1.0 - fraction[axis]
                offset[axis] = (fraction[axis] - far) * voxel[axis]
            z, y, x = index[2], index[1], index[0]
            covered[i] += weight * coverage[z, y, x]
            for k in range(count):
                for channel in range(3):
                    value = float(coefficients[z, y, x, k, channel])
                    if half_gradient:
                        for axis in range(3):
                            slope = float(gradients[z, y, x, k, channel, axis])
                            value += 0.5 * slope * offset[axis]
                            if sloped:
                                slopes[i, k, channel, axis] += weight * slope
                    elif sloped:
                        for axis in range(3):
                            # The derivative of the trilinear weight along this axis.
                            change = 1.0 / voxel[axis] * inside[axis]
                            for other in range(3):
                                far = (corner >> other) & 1
                                if other == axis:
                                    change *= 1.0 if far else -1.0
                                else:
                                    change *= fraction[other] if far else 1.0 - fraction[other]
                            slopes[i, k, channel, axis] += change * value
                    values[i, k, channel] += weight * value
