"""From incident radiance to the eye: a matte part and a Phong lobe (paper 004 §3.3; MATHS §8, §10).

``L = kd/π max(0, Σ A_l h_l c_lm Y_lm(n)) + ks H max(0, Σ k_l c_lm Y_lm(r))``: n the shading normal, r the view mirrored
at it, k_l the factors of the normalised lobe, H the share of the lobe that is above the surface.

The window h of the matte part makes its kernel nowhere negative (MATHS §4.1b). That kernel is right for light from
all around; of an even sky over a surface it takes 7.1 % off, since what a surface gets comes from one side. A factor
gives that back and leaves the kernel non-negative: a lamp straight ahead then is 3.7 % too bright, where without the
window it is 6.25 %.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.igi.materials import SHARPEST
from lightwell.igi_settings import IgiKernel
from lightwell.render.material import horizon_factor
from lightwell.sh.basis import basis_at
from lightwell.sh.lobes import lambert_zonal, phong_zonal
from lightwell.sh.window import fixed_window

HORIZON_EXPONENTS = 49
HORIZON_COSINES = 129


class Responses(NamedTuple):
    """What surfaces get, by pixel and group of light, ``(n, G, 3)``; `shaded` makes radiance of it."""

    matte: NDArray[Any]
    """Irradiance over π."""
    lobe: NDArray[Any]
    """Radiance, blurred by the lobe."""


def matte_factors(kernel: IgiKernel, bands: int) -> NDArray[np.float64]:
    """Return the factor of each degree for the matte part, ``(bands,)``: ``A_l/π``, or ``A_l h_l/π`` and scaled."""
    factors = lambert_zonal(bands) / np.pi
    if kernel == "none":
        return factors
    factors = factors * fixed_window("nonneg", bands, target="irradiance")
    return factors / _under_even_sky(factors)


def _under_even_sky(factors: NDArray[np.float64]) -> float:
    """Return what a surface with these factors gets of radiance 1 from its upper side: 1 would be right."""
    # The half-space has c_l0 Y_l0 = (2l + 1)/2 ∫_0^1 P_l along its axis, and those moments are a lobe's of exponent 0.
    half = phong_zonal(0.0, len(factors))
    return float(np.sum(factors * (2 * np.arange(len(factors)) + 1) / 2 * half))


@cache
def horizon_table() -> NDArray[np.float64]:
    """Return H by exponent and by cosine of mirror direction and normal, for `respond`."""
    cosines = np.linspace(-1, 1, HORIZON_COSINES)
    steps = np.linspace(0, np.log1p(SHARPEST), HORIZON_EXPONENTS)
    return np.array([horizon_factor(cosines, float(np.expm1(step))) for step in steps])


@njit(cache=True, nogil=True)
def respond(coefficients, rows, normals, views, geometric, exponents, glossy, factors, horizon, sharpest, matte, lobe):  # type: ignore[no-untyped-def]
    """Write what n surfaces get of their incident radiance.

    ``coefficients`` (K, G, bands², 3), ``rows`` (n,): which are whose, below 0 none; ``normals, views, geometric``
    (n, 3); ``exponents`` (n,); ``glossy`` (n,): whether the lobe is wanted; ``factors`` (bands,) of the matte part;
    ``horizon``: `horizon_table`. Out: ``matte, lobe`` (n, G, 3), as in `Responses`; zero where there is no row.
    """
    bands = len(factors)
    basis = np.empty(bands * bands)
    zonal = np.empty(bands)
    for i in range(len(normals)):
        if rows[i] < 0:
            matte[i] = 0
            lobe[i] = 0
            continue
        incident = coefficients[rows[i]]
        nx, ny, nz = float(normals[i, 0]), float(normals[i, 1]), float(normals[i, 2])
        basis_at(nx, ny, nz, bands, basis)
        _sum(incident, basis, factors, matte[i])
        if not glossy[i]:
            lobe[i] = 0
            continue
        vx, vy, vz = float(views[i, 0]), float(views[i, 1]), float(views[i, 2])
        twice = 2 * (vx * nx + vy * ny + vz * nz)
        rx, ry, rz = vx - twice * nx, vy - twice * ny, vz - twice * nz
        length = np.sqrt(rx * rx + ry * ry + rz * rz)
        rx, ry, rz = rx / length, ry / length, rz / length
        s = float(exponents[i])
        zonal[0] = 1.0
        if bands > 1:
            zonal[1] = (s + 1) / (s + 2)
        for degree in range(2, bands):
            zonal[degree] = zonal[degree - 2] * (s - degree + 2) / (s + degree + 1)
        basis_at(rx, ry, rz, bands, basis)
        _sum(incident, basis, zonal, lobe[i])
        share = _horizon(horizon, s, rx * geometric[i, 0] + ry * geometric[i, 1] + rz * geometric[i, 2], sharpest)
        for group in range(lobe.shape[1]):
            for channel in range(3):
                lobe[i, group, channel] *= share


@njit(cache=True, nogil=True)
def _sum(coefficients, basis, factors, out):  # type: ignore[no-untyped-def]
    """Write ``Σ k_l c_lm Y_lm`` of each group and channel; the sum over the groups is not left below zero."""
    for channel in range(3):
        whole = 0.0
        for group in range(len(coefficients)):
            total = 0.0
            k = 0
            for degree in range(len(factors)):
                for _ in range(2 * degree + 1):
                    total += factors[degree] * basis[k] * coefficients[group, k, channel]
                    k += 1
            out[group, channel] = total
            whole += total
        if whole < 0:
            for group in range(len(coefficients)):
                out[group, channel] = 0


@njit(cache=True, nogil=True)
def _horizon(table, exponent, cosine, sharpest):  # type: ignore[no-untyped-def]
    rows, columns = table.shape
    y = min(np.log1p(max(exponent, 0.0)) / np.log1p(sharpest), 1.0) * (rows - 1)
    x = min(max(0.5 * (cosine + 1), 0.0), 1.0) * (columns - 1)
    i, j = min(int(y), rows - 2), min(int(x), columns - 2)
    f, g = y - i, x - j
    above = table[i, j] * (1 - g) + table[i, j + 1] * g
    below = table[i + 1, j] * (1 - g) + table[i + 1, j + 1] * g
    return above * (1 - f) + below * f


def responses(
    coefficients: NDArray[Any],
    normals: NDArray[np.floating],
    views: NDArray[np.floating],
    geometric: NDArray[np.floating],
    exponents: NDArray[np.floating],
    glossy: NDArray[np.bool_],
    kernel: IgiKernel,
    bands: int,
    rows: NDArray[np.int64] | None = None,
) -> Responses:
    """Return what surfaces get; arguments as in `respond`, by default each has its own row of the coefficients."""
    shape = (len(normals), coefficients.shape[1], 3)
    matte, lobe = np.empty(shape, coefficients.dtype), np.empty(shape, coefficients.dtype)
    respond(
        coefficients,
        np.arange(len(normals)) if rows is None else rows,
        normals,
        views,
        geometric,
        exponents,
        glossy,
        matte_factors(kernel, bands),
        horizon_table() if glossy.any() else np.ones((2, 2)),
        SHARPEST,
        matte,
        lobe,
    )
    return Responses(matte, lobe)
