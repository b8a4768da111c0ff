"""Split light into one distant light and constant ambient light (MATHS §11a).

The direction is that of the luminance-weighted linear coefficients: the centroid of the light, not a detector of lamps.
Per channel, the light's irradiance is the least-squares fit of a directional light to the degrees above 0 in the metric
of irradiance, and the ambient radiance takes the rest of the mean, so that mean light is kept exactly.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import LUMINANCE, bands_of_count, degree_of_index
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal


@dataclass(frozen=True)
class DominantSplit:
    """One distant light plus constant light; all arrays ``(3,)`` float64."""

    direction: NDArray[np.float64]
    """Unit vector towards the light; +Z where the light has no direction."""
    irradiance: NDArray[np.float64]
    """RGB irradiance on a surface that faces the light; never negative."""
    ambient: NDArray[np.float64]
    """RGB radiance of the constant part; not negative where the mean light is not."""


def split_dominant(coefficients: ArrayLike) -> DominantSplit:
    """Return the dominant light and the ambient light of RGB coefficients.

    Parameters
    ----------
    coefficients
        ``(bands², 3)``, any number of bands.

    Returns
    -------
    The split. Black light, light without a linear part, and a single band have no direction: it is then +Z and the
    irradiance 0, so that everything is ambient.

    Raises
    ------
    ValueError
        Where the shape is not ``(bands², 3)``.
    """
    array, bands = _rgb(coefficients)
    whole_ambient = array[0] / np.sqrt(4 * np.pi)
    nothing = DominantSplit(np.array([0.0, 0.0, 1.0]), np.zeros(3), whole_ambient)
    if bands == 1:
        return nothing
    towards = np.array([3, 1, 2])  # c_11, c_1−1, c_10 go with x, y, z
    linear = array[towards] @ LUMINANCE
    length = float(np.linalg.norm(linear))
    if length == 0:
        return nothing
    direction = linear / length
    basis = evaluate(direction, bands)
    weights = lambert_zonal(bands)[degree_of_index(bands)] ** 2
    weights[0] = 0
    fitted = (weights * basis) @ array / np.sum(weights * basis**2)
    irradiance = np.clip(fitted, 0, np.maximum(array[0] * np.sqrt(4 * np.pi), 0))
    return DominantSplit(direction, irradiance, whole_ambient - irradiance / (4 * np.pi))


def remainder(coefficients: ArrayLike, split: DominantSplit) -> NDArray[np.float64]:
    """Return what the split leaves out, ``(bands², 3)``: coefficients minus the light's and the ambient's.

    `compose` of the split plus the remainder is the whole; degree 0 of the remainder is zero.
    """
    array, bands = _rgb(coefficients)
    return array - compose(split, bands)


def compose(split: DominantSplit, bands: int) -> NDArray[np.float64]:
    """Return the coefficients of the distant light and the ambient light together, ``(bands², 3)``."""
    coefficients: NDArray[np.float64] = evaluate(split.direction, bands)[:, np.newaxis] * split.irradiance
    coefficients[0] += split.ambient * np.sqrt(4 * np.pi)
    return coefficients


def _rgb(coefficients: ArrayLike) -> tuple[NDArray[np.float64], int]:
    array = np.asarray(coefficients, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise ValueError(f"RGB coefficients have the shape (bands², 3), not {array.shape}")
    return array, bands_of_count(array.shape[0])
