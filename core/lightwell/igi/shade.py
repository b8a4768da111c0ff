"""From incident radiance to the eye: a matte part and a Phong lobe (paper 004 §3.3; MATHS §8, §10).

``L = kd max(0, Σ w_lm c_lm) + ks h max(0, Σ k_l c_lm Y_lm(r))``: w the matte kernel over π about the shading normal, r
the view mirrored at it, k_l the factors of the normalised lobe. The matte kernel, where it may not be negative, and h
are those of `lightwell.igi.hemisphere`: no light comes from below. Otherwise ``w = A_l/π Y_lm(n)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.igi.hemisphere import lobe_table, matte_table
from lightwell.igi.materials import SHARPEST
from lightwell.igi_settings import IgiKernel
from lightwell.sh.basis import basis_at
from lightwell.sh.lobes import lambert_zonal

_OF_DEGREE_1 = float(np.sqrt(4 * np.pi / 3))
_OF_DEGREE_2 = float(np.sqrt(np.pi / 15))


class Responses(NamedTuple):
    """What surfaces get, by pixel and group of light, ``(n, G, 3)``; `shaded` makes radiance of it."""

    matte: NDArray[Any]
    """Irradiance over π."""
    lobe: NDArray[Any]
    """Radiance, blurred by the lobe."""


@njit(cache=True, nogil=True)
def respond(  # type: ignore[no-untyped-def]
    coefficients, rows, normals, views, geometric, exponents, glossy, factors, tilts, shares, sharpest, matte, lobe
):
    """Write what n surfaces get of their incident radiance.

    ``coefficients`` (K, G, bands², 3), ``rows`` (n,): which are whose, below 0 none; ``normals, views, geometric``
    (n, 3); ``exponents`` (n,); ``glossy`` (n,): whether the lobe is wanted; ``factors`` (bands,) of the matte part;
    ``tilts``: in their place, `matte_table`, where it is not empty; ``shares``: `lobe_table`. Out: ``matte, lobe``
    (n, G, 3), as in `Responses`; zero where there is no row.
    """
    bands = len(factors)
    basis = np.empty(max(bands * bands, 9))
    zonal = np.empty(bands)
    for i in range(len(normals)):
        if rows[i] < 0:
            matte[i] = 0
            lobe[i] = 0
            continue
        incident = coefficients[rows[i]]
        nx, ny, nz = float(normals[i, 0]), float(normals[i, 1]), float(normals[i, 2])
        if len(tilts):
            _tilted(tilts, normals[i], geometric[i], basis)
            _sum(incident, basis, min(bands * bands, 9), matte[i])
        else:
            basis_at(nx, ny, nz, bands, basis)
            _by_degree(factors, basis)
            _sum(incident, basis, bands * bands, matte[i])
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
        _by_degree(zonal, basis)
        _sum(incident, basis, bands * bands, lobe[i])
        share = _share(shares, s, rx * geometric[i, 0] + ry * geometric[i, 1] + rz * geometric[i, 2], sharpest)
        for group in range(lobe.shape[1]):
            for channel in range(3):
                lobe[i, group, channel] *= share


@njit(cache=True, nogil=True)
def _tilted(tilts, normal, geometric, out):  # type: ignore[no-untyped-def]
    """Write the coefficients (9,) of the matte kernel of a normal that is tilted against the geometric one."""
    g = np.array([float(geometric[0]), float(geometric[1]), float(geometric[2])])
    n = np.array([float(normal[0]), float(normal[1]), float(normal[2])])
    cosine = n[0] * g[0] + n[1] * g[1] + n[2] * g[2]
    t = n - cosine * g
    sine = np.sqrt(t[0] * t[0] + t[1] * t[1] + t[2] * t[2])
    # Without a tilt it does not matter in which direction.
    t = t / max(sine, 1e-30)
    b = np.array([g[1] * t[2] - g[2] * t[1], g[2] * t[0] - g[0] * t[2], g[0] * t[1] - g[1] * t[0]])
    place = min(np.arctan2(sine, max(cosine, 0.0)) / (np.pi / 2), 1.0) * (len(tilts) - 1)
    row = min(int(place), len(tilts) - 2)
    f = place - row
    a = (1 - f) * tilts[row] + f * tilts[row + 1]
    out[0] = a[0] * np.sqrt(4 * np.pi)
    for axis in range(3):
        # Y_1 are y, z, x.
        out[1 + (axis + 2) % 3] = _OF_DEGREE_1 * (a[1] * g[axis] + a[2] * t[axis])
    q = np.empty((3, 3))
    for j in range(3):
        for k in range(3):
            mixed = (g[j] * t[k] + t[j] * g[k]) / 2
            q[j, k] = a[3] * g[j] * g[k] + a[4] * mixed + a[5] * (t[j] * t[k] - b[j] * b[k])
    trace = (q[0, 0] + q[1, 1] + q[2, 2]) / 3
    out[4], out[5], out[7] = 4 * _OF_DEGREE_2 * q[0, 1], 4 * _OF_DEGREE_2 * q[1, 2], 4 * _OF_DEGREE_2 * q[0, 2]
    out[6] = 2 * np.sqrt(3.0) * _OF_DEGREE_2 * (q[2, 2] - trace)
    out[8] = 2 * _OF_DEGREE_2 * (q[0, 0] - q[1, 1])


@njit(cache=True, nogil=True)
def _by_degree(factors, basis):  # type: ignore[no-untyped-def]
    """Multiply ``basis`` (bands²,) with the factor of each degree."""
    k = 0
    for degree in range(len(factors)):
        for _ in range(2 * degree + 1):
            basis[k] *= factors[degree]
            k += 1


@njit(cache=True, nogil=True)
def _sum(coefficients, weights, count, out):  # type: ignore[no-untyped-def]
    """Write ``Σ w_k c_k`` over ``count`` of each group and channel; the groups' sum is not left below zero."""
    for channel in range(3):
        whole = 0.0
        for group in range(len(coefficients)):
            total = 0.0
            for k in range(count):
                total += weights[k] * coefficients[group, k, channel]
            out[group, channel] = total
            whole += total
        if whole < 0:
            for group in range(len(coefficients)):
                out[group, channel] = 0


@njit(cache=True, nogil=True)
def _share(table, exponent, cosine, sharpest):  # type: ignore[no-untyped-def]
    rows, columns = table.shape
    y = min(np.log1p(max(exponent, 0.0)) / np.log1p(sharpest), 1.0) * (rows - 1)
    x = np.arccos(min(max(cosine, -1.0), 1.0)) / np.pi * (columns - 1)
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
        lambert_zonal(bands) / np.pi,
        matte_table(bands) if kernel == "nonneg" else np.zeros((0, 6)),
        lobe_table(bands) if glossy.any() else np.ones((2, 2)),
        SHARPEST,
        matte,
        lobe,
    )
    return Responses(matte, lobe)
