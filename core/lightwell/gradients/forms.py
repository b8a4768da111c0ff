"""The integrals behind gradients (MATHS §7.1 to 7.3), as sums over given samples: for analysis and as a check.

They freeze visibility: the outline of an occluder would move with what is behind it. `lightwell.gradients.image` does
not, and is what the live path uses.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.sh.basis import evaluate, evaluate_with_gradient

Floats = NDArray[np.float64]


class Derived(NamedTuple):
    """Coefficients and what they change by in space."""

    coefficients: Floats
    """``(bands², channels)``."""
    gradients: Floats
    """``(bands², channels, 3)`` per metre."""


def surface_form(
    origin: ArrayLike, points: ArrayLike, normals: ArrayLike, areas: ArrayLike, radiance: ArrayLike, bands: int
) -> Derived:
    """Return coefficients and gradients at ``origin`` of light from pieces of surfaces (7.1, paper 001).

    ``G = ∫ L [(n·s)/r⁴ ∇_S y + y (n/r³ − 3 (n·s) s/r⁵)] dA`` with ``s = x − p``.

    Parameters
    ----------
    origin
        ``(3,)`` metres.
    points, normals
        ``(n, 3)`` metres and unit vectors; pieces that face away (``n·s ≥ 0``) are not seen.
    areas
        ``(n,)`` m².
    radiance
        ``(n, channels)``, the same in all directions.
    """
    s = np.asarray(points, dtype=np.float64) - np.asarray(origin, dtype=np.float64)
    n, light = np.asarray(normals, dtype=np.float64), np.asarray(radiance, dtype=np.float64)
    r = np.linalg.norm(s, axis=1)
    facing = np.sum(n * s, axis=1)
    weight = np.where(facing < 0, np.asarray(areas, dtype=np.float64), 0)
    values, slopes = evaluate_with_gradient(s / r[:, None], bands)
    coefficients = np.einsum("n,nc,ni->ic", -weight * facing / r**3, light, values, optimize=True)
    spread = n / r[:, None] ** 3 - 3 * (facing / r**5)[:, None] * s
    turned = np.einsum("n,nc,nik->ick", weight * facing / r**4, light, slopes, optimize=True)
    grown = np.einsum("n,nc,ni,nk->ick", weight, light, values, spread, optimize=True)
    return Derived(coefficients, turned + grown)


def directional_form(
    directions: ArrayLike,
    solid_angles: ArrayLike,
    distances: ArrayLike,
    normals: ArrayLike,
    radiance: ArrayLike,
    bands: int,
) -> Derived:
    """Return coefficients and gradients of light from directions, of surfaces with known normals (7.2).

    ``G = ∫ (L/r) [−∇_S y + y (3ω − n/(n·ω))] dω``. It grows without bound where surfaces are seen at a grazing angle.

    Parameters
    ----------
    directions
        ``(n, 3)`` unit vectors.
    solid_angles, distances
        ``(n,)`` steradian, metres; at an infinite distance there is no gradient.
    normals
        ``(n, 3)`` unit normals of what is seen.
    radiance
        ``(n, channels)``.
    """
    omega, n = np.asarray(directions, dtype=np.float64), np.asarray(normals, dtype=np.float64)
    light, weight = np.asarray(radiance, dtype=np.float64), np.asarray(solid_angles, dtype=np.float64)
    values, slopes = evaluate_with_gradient(omega, bands)
    coefficients = np.einsum("n,nc,ni->ic", weight, light, values, optimize=True)
    near = weight / np.asarray(distances, dtype=np.float64)
    spread = 3 * omega - n / np.sum(n * omega, axis=1)[:, None]
    turned = np.einsum("n,nc,nik->ick", near, light, slopes, optimize=True)
    grown = np.einsum("n,nc,ni,nk->ick", near, light, values, spread, optimize=True)
    return Derived(coefficients, grown - turned)


def normal_free_form(
    directions: ArrayLike,
    solid_angles: ArrayLike,
    distances: ArrayLike,
    inverse_slopes: ArrayLike,
    radiance: ArrayLike,
    bands: int,
) -> Floats:
    """Return gradients from a picture and its depth, without normals (7.3, second form): ``(bands², channels, 3)``.

    ``G = ∫ L [(2/r) y ω − (1/r) ∇_S y − y ∇_S(1/r)] dω``, exact where r is smooth.

    Parameters
    ----------
    directions, solid_angles, distances, radiance
        As in `directional_form`.
    inverse_slopes
        ``(n, 3)`` ``∇_S (1/r)``, per metre and radian, across each direction.
    """
    omega, slope = np.asarray(directions, dtype=np.float64), np.asarray(inverse_slopes, dtype=np.float64)
    light, weight = np.asarray(radiance, dtype=np.float64), np.asarray(solid_angles, dtype=np.float64)
    values, slopes = evaluate_with_gradient(omega, bands)
    near = 1 / np.asarray(distances, dtype=np.float64)
    spread = 2 * near[:, None] * omega - slope
    turned = np.einsum("n,nc,nik->ick", weight * near, light, slopes, optimize=True)
    grown = np.einsum("n,nc,ni,nk->ick", weight, light, values, spread, optimize=True)
    return np.asarray(grown - turned)


def radiance_slope_form(
    directions: ArrayLike, solid_angles: ArrayLike, distances: ArrayLike, radiance_slopes: ArrayLike, bands: int
) -> Floats:
    """Return gradients from how radiance changes over the sphere (7.3, first form): ``(bands², channels, 3)``.

    ``G = ∫ (y/r) ∇_S L dω``; ``radiance_slopes`` ``(n, channels, 3)`` is ``∇_S L`` per radian. Exact where L has no
    edges; those are what `lightwell.gradients.image` adds up.
    """
    values = evaluate(directions, bands)
    near = np.asarray(solid_angles, dtype=np.float64) / np.asarray(distances, dtype=np.float64)
    return np.asarray(np.einsum("n,ni,nck->ick", near, values, np.asarray(radiance_slopes, np.float64), optimize=True))
