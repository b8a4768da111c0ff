"""What a surface gets from coefficients: radiance, irradiance, a Phong lobe.

All three are "blur, then evaluate": multiply each degree by the lobe's factor, then one evaluation of the basis a point
(MATHS §8). Nothing is clamped here: a result below zero is ringing, and windows are the remedy (`lightwell.sh.window`).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count, degree_of_index
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import lambert_zonal, phong_zonal


def convolve(coefficients: ArrayLike, zonal: ArrayLike) -> NDArray[np.float64]:
    """Return ``k_l c_lm``: coefficients ``(bands², ...)`` blurred by a lobe with the factors k, ``(bands,)``.

    Raises
    ------
    ValueError
        Where the two have not the same bands.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    factors = np.asarray(zonal, dtype=np.float64)
    bands = bands_of_count(array.shape[0])
    if factors.shape != (bands,):
        raise ValueError(f"{bands} bands need as many factors, not an array of the shape {factors.shape}")
    return array * factors[degree_of_index(bands)].reshape(-1, *[1] * (array.ndim - 1))


def radiance(coefficients: ArrayLike, directions: ArrayLike) -> NDArray[np.float64]:
    """Return the radiance that arrives from each direction.

    Parameters
    ----------
    coefficients
        ``(bands², 3)``, or ``(bands²,)`` for one channel.
    directions
        ``(..., 3)`` unit vectors towards the light.

    Returns
    -------
    ``(..., 3)``, or ``(...)`` for one channel, float64, in the coefficients' unit.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    values: NDArray[np.float64] = evaluate(directions, bands_of_count(array.shape[0])) @ array
    return values


def irradiance(coefficients: ArrayLike, normals: ArrayLike) -> NDArray[np.float64]:
    """Return the irradiance ``Σ A_l c_lm Y_lm(n)`` at each normal; ``ρ/π`` times it leaves a Lambertian surface.

    Shapes are those of `radiance`; the unit is the coefficients' times steradians.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    return radiance(convolve(array, lambert_zonal(bands_of_count(array.shape[0]))), normals)


def phong(
    coefficients: ArrayLike, reflected: ArrayLike, exponent: float, normalised: bool = True
) -> NDArray[np.float64]:
    """Return the radiance blurred by a Phong lobe about each mirror direction.

    Parameters
    ----------
    coefficients
        ``(bands², 3)`` or ``(bands²,)``.
    reflected
        ``(..., 3)`` unit vectors: the view direction reflected at the surface.
    exponent
        s ≥ 0 of ``max(0, cos)^s``.
    normalised
        As in `lightwell.sh.lobes.phong_zonal`.

    Returns
    -------
    Shapes are those of `radiance`.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    return radiance(convolve(array, phong_zonal(exponent, bands_of_count(array.shape[0]), normalised)), reflected)
