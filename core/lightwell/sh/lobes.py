"""Zonal lobes: functions of the angle to one axis, one number a degree.

A lobe ``k(ω·r)`` is stored by its convolution factors ``k_l = 2π ∫ k(u) P_l(u) du``, −1 ≤ u ≤ 1 (Funk–Hecke). Then

- the lobe about the axis r has the coefficients ``k_l Y_lm(r)``,
- radiance c blurred by the lobe has the coefficients ``k_l c_lm``,

and no rotation matrix is needed for either (MATHS §8). For the clamped cosine the factors are the A_l of Ramamoorthi
and Hanrahan 2001. The "zonal harmonics" of other texts are ``z_l = √((2l+1)/4π) k_l``.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import MAX_BANDS, degree_of_index
from lightwell.sh.basis import evaluate


def lambert_zonal(bands: int) -> NDArray[np.float64]:
    """Return A_l of the clamped cosine, ``(bands,)``: π, 2π/3, π/4, 0, −π/24, 0, π/64 … (MATHS §8).

    The irradiance at a normal n is ``Σ A_l c_lm Y_lm(n)``.
    """
    return phong_zonal(1.0, bands, normalised=False)


def phong_zonal(exponent: float, bands: int, normalised: bool = True) -> NDArray[np.float64]:
    """Return the factors of the Phong lobe ``max(0, cos)^s``, ``(bands,)`` (MATHS §8).

    The moments ``I_l = ∫_0^1 u^s P_l(u) du`` follow from ``I_l = I_{l−2} (s−l+2)/(s+l+1)``.

    Parameters
    ----------
    exponent
        s ≥ 0, any real.
    bands
        1 … 11.
    normalised
        True: the lobe integrates to 1 (factor (s+1)/2π), so constant light keeps its radiance.
        False: peak 1; with ``s = 1`` these are the A_l of Lambert.

    Raises
    ------
    ValueError
        Where the exponent is negative or not finite, or the bands are out of range.
    """
    if not (np.isfinite(exponent) and exponent >= 0):
        raise ValueError(f"the Phong exponent {exponent} must be finite and not negative")
    _check_bands(bands)
    moments = np.empty(bands)
    moments[0] = 1 / (exponent + 1)
    if bands > 1:
        moments[1] = 1 / (exponent + 2)
    for degree in range(2, bands):
        moments[degree] = moments[degree - 2] * (exponent - degree + 2) / (exponent + degree + 1)
    # Adding zero turns −0 into 0.
    return moments * (exponent + 1 if normalised else 2 * np.pi) + 0.0


def cone_zonal(half_angle: float, bands: int) -> NDArray[np.float64]:
    """Return the factors of a cone: 1 within ``half_angle`` of the axis, 0 outside, ``(bands,)`` (MATHS §2.3).

    ``k_l = 2π (P_{l−1} − P_{l+1})(cos δ) / (2l+1)``; factor 0 is the solid angle ``2π(1 − cos δ)``. A probe that cannot
    see this cone loses these coefficients of a constant light.

    Parameters
    ----------
    half_angle
        δ in radians, 0 … π.
    bands
        1 … 11.

    Raises
    ------
    ValueError
        Where the angle or the bands are out of range.
    """
    if not 0 <= half_angle <= np.pi:
        raise ValueError(f"the half-angle {half_angle} is outside 0 … π radians")
    _check_bands(bands)
    polynomials = legendre.legvander(np.array([np.cos(half_angle)]), bands)[0]
    degree = np.arange(1, bands)
    # 1 − cos δ = 2 sin²(δ/2) keeps its digits for small cones.
    solid_angle = 4 * np.pi * np.sin(half_angle / 2) ** 2
    return np.concatenate([[solid_angle], 2 * np.pi * (polynomials[:-2] - polynomials[2:]) / (2 * degree + 1)])


def zonal_to_coefficients(zonal: ArrayLike, directions: ArrayLike) -> NDArray[np.float64]:
    """Return the coefficients ``k_l Y_lm(r)`` of a lobe about each axis r.

    Parameters
    ----------
    zonal
        ``(bands,)`` factors.
    directions
        ``(..., 3)`` unit axes.

    Returns
    -------
    ``(..., bands²)`` float64.
    """
    factors = np.asarray(zonal, dtype=np.float64)
    lobes: NDArray[np.float64] = evaluate(directions, len(factors)) * factors[degree_of_index(len(factors))]
    return lobes


def _check_bands(bands: int) -> None:
    if not 1 <= bands <= MAX_BANDS:
        raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
