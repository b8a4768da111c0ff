"""How far a gradient may be trusted (MATHS §7.4)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import LUMINANCE

RANGE = 0.17
"""Steps of this share of the light's mean distance are wrong by some 10 %."""

TOLERANCE = 0.1
"""Relative error that the radius from second differences stands for."""


def mean_distance(image: ArrayLike, inverse_distance: ArrayLike, solid_angles: ArrayLike) -> float:
    """Return the mean distance of light, ``r̄ = ∫L / ∫(L/r)``, L the luminance; infinite where no near light is seen.

    Parameters
    ----------
    image
        ``(…, 3)`` radiance.
    inverse_distance
        ``(…)`` 1/r per metre, 0 for sky.
    solid_angles
        ``(…)`` steradian.
    """
    light = np.maximum(np.asarray(image, dtype=np.float64) @ LUMINANCE, 0) * np.asarray(solid_angles, np.float64)
    near = float(np.sum(light * np.asarray(inverse_distance, np.float64)))
    return float(light.sum()) / near if near > 0 else float("inf")


def trust_radius(mean_distance_m: float) -> float:
    """Return the radius in metres within which extrapolation is right to about 10 %: ``.17 r̄``."""
    return RANGE * mean_distance_m


def grid_trust_radius(coefficients: ArrayLike, voxel: ArrayLike) -> NDArray[np.float64]:
    """Return the trust radius of each cell of a grid, ``(z, y, x)`` metres, from second differences.

    The next term of the series is ``½ |H| d²``, H the second derivatives: it reaches 10 % of ``|c|`` at
    ``d = √(2 · .1 |c| / |H|)``, with ``|H|² = Σ_ab |∂_a ∂_b c|²`` over all coefficients: a bound in all directions.
    Infinite where nothing bends.

    Parameters
    ----------
    coefficients
        ``(z, y, x, bands², 3)``.
    voxel
        ``(3,)`` size of a cell along x, y, z in metres. An axis of less than three cells adds nothing.
    """
    table, sizes = np.asarray(coefficients), np.asarray(voxel, dtype=np.float64)
    axes = [axis for axis in range(3) if table.shape[2 - axis] >= 3]
    bend, square = np.zeros(table.shape[:3]), np.zeros(table.shape[:3])
    for index in range(table.shape[3]):  # one at a time: derivatives of a whole grid would fill the memory
        values = table[..., index, :].astype(np.float64)
        square += np.sum(values * values, axis=-1)
        for first in axes:
            twice = _second(values, float(sizes[first]), 2 - first)
            bend += np.sum(twice * twice, axis=-1)
            slope = np.gradient(values, float(sizes[first]), axis=2 - first)
            for second in axes[axes.index(first) + 1 :]:
                twice = np.gradient(slope, float(sizes[second]), axis=2 - second)
                bend += 2 * np.sum(twice * twice, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        radius = np.sqrt(2 * TOLERANCE * np.sqrt(square / bend))
    return np.where(bend > 0, radius, np.inf)


def _second(values: NDArray[np.float64], step: float, axis: int) -> NDArray[np.float64]:
    """Return second differences along an axis; the outermost cells have their neighbours'."""
    moved = np.moveaxis(values, axis, 0)
    inner = (moved[2:] - 2 * moved[1:-1] + moved[:-2]) / (step * step)
    return np.moveaxis(np.concatenate([inner[:1], inner, inner[-1:]]), 0, axis)
