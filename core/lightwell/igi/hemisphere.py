"""Kernels for light that all comes from the upper side of a surface.

Virtual lights below the geometric horizon of a pixel count for nothing, so that its incident radiance is that of a
hemisphere. MATHS §8 and §10 have kernels for light from all around: cut off at three bands, a lamp straight ahead
comes out by 17/16 too bright, and a narrow lobe in an even sky by a quarter. What a kernel does below the horizon
does not matter here, and that is enough freedom to do better.

Matte
    ``max(0, n·ω)`` is sought on the hemisphere about the geometric normal g alone. Where n = g that is ``n·ω``, a
    harmonic of degree 1: a flat surface gets its irradiance without any error. Where the shading normal is tilted, by
    τ, it is the polynomial of degree 2 (1 for two bands) that is nearest in least squares among those that are nowhere
    negative there and right for an even sky, ``π (1 + cos τ)/2``. The rms error, of the kernel's own, is 0 for τ = 0,
    5 % at 10°, 7 % at 40°, 8 % at 60°; that of MATHS §4.1(b) is 7 to 8 %, and of the bare bands 6 to 7 %.
Lobe
    The truncated lobe times ``H / max(R, ½)``: H is the share of the lobe that is above the surface, R what the
    truncated lobe makes of an even sky. R is H already but for the truncation (the light is clipped, so that the lobe
    need not be), and an even sky gives H.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from lightwell.igi.materials import SHARPEST
from lightwell.render.material import horizon_factor
from lightwell.sh.lobes import phong_zonal

Floats = NDArray[np.float64]

MATTE_TILTS = 91
"""Tilts 0 … π/2; beyond that the kernel is that of π/2."""
LOBE_EXPONENTS, LOBE_ANGLES = 49, 181

_RINGS, _SECTORS = 32, 48
_STEPS = 40
_STIFF = 1e4
"""Weight of directions in which the kernel would be negative."""


@cache
def matte_table(bands: int) -> Floats:
    """Return the matte kernel by tilt, ``(MATTE_TILTS, 6)``, over π.

    They are factors of ``1, z, x, z² − 1/3, x z, x² − y²``, z along the geometric normal and x the way in which the
    shading normal is tilted; the last three are 0 with two bands.
    """
    nodes, weights = legendre.leggauss(_RINGS)
    azimuth = np.pi * (np.arange(_SECTORS) + 0.5) / _SECTORS
    z, phi = (part.reshape(-1) for part in np.meshgrid((nodes + 1) / 2, azimuth, indexing="ij"))
    solid = np.repeat(weights / 2, _SECTORS) * 2 * np.pi / _SECTORS
    terms = _terms(z, phi)
    rim = _terms(np.zeros(_SECTORS), azimuth)
    kept = 6 if bands > 2 else 3
    table = np.zeros((MATTE_TILTS, 6))
    table[0, 1] = 1 / np.pi
    for row, tilt in list(zip(table, np.linspace(0, np.pi / 2, MATTE_TILTS), strict=True))[1:]:
        wanted = np.maximum(np.cos(tilt) * z + np.sin(tilt) * np.sqrt(1 - z * z) * np.cos(phi), 0)
        whole = np.pi * (1 + np.cos(tilt)) / 2
        row[:kept] = _nearest(terms[:, :kept], solid, wanted, whole)
        lowest = max(0.0, -float(min((terms @ row).min(), (rim @ row).min())))
        row[0] += lowest
        row *= whole / (whole + 2 * np.pi * lowest) / np.pi
    return table


def _terms(z: Floats, phi: Floats) -> Floats:
    ring = np.sqrt(1 - z * z)
    x, y = ring * np.cos(phi), ring * np.sin(phi)
    return np.stack([np.ones_like(z), z, x, z * z - 1 / 3, x * z, x * x - y * y], axis=1)


def _nearest(terms: Floats, solid: Floats, wanted: Floats, whole: float) -> Floats:
    """Return the factors of ``terms (n, k)`` nearest to ``wanted``, hardly negative, whose integral is ``whole``."""
    sums = solid @ terms
    negative = np.zeros(len(wanted), np.bool_)
    for _ in range(_STEPS):
        weights = solid * np.where(negative, _STIFF, 1)
        matrix = np.block([[(terms.T * weights) @ terms, sums[:, None]], [sums[None], np.zeros((1, 1))]])
        right = np.append((weights * np.where(negative, 0, wanted)) @ terms, whole)
        found = np.linalg.solve(matrix, right)[:-1]
        before, negative = negative, terms @ found < 0
        if np.array_equal(before, negative):
            break
    return np.asarray(found)


@cache
def lobe_table(bands: int) -> Floats:
    """Return ``H / max(R, ½)``, ``(LOBE_EXPONENTS, LOBE_ANGLES)``.

    By exponent, even in ``log(1 + s)`` up to `SHARPEST`, and by the angle from the geometric normal to the mirror
    direction, even in 0 … π.
    """
    cosines = np.cos(np.linspace(0, np.pi, LOBE_ANGLES))
    degrees = np.arange(bands)
    # The half-space has c_l0 Y_l0 = (2l + 1)/2 ∫_0^1 P_l along its axis, and those moments are a lobe's of exponent 0.
    half = (2 * degrees + 1) / 2 * phong_zonal(0.0, bands)
    along = legendre.legvander(cosines, bands - 1)
    exponents = np.expm1(np.linspace(0, np.log1p(SHARPEST), LOBE_EXPONENTS))
    even = np.array([along @ (half * phong_zonal(float(s), bands)) for s in exponents])
    above = np.array([horizon_factor(cosines, float(s)) for s in exponents])
    return np.asarray(above / np.maximum(even, 0.5))
