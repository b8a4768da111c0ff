"""Slow, obvious references for `lightwell.sh`: definitions, quadrature, sampling and dense search."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from math import factorial

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

Array = NDArray[np.float64]


def directions(count: int, seed: int = 0) -> Array:
    """Uniformly distributed unit vectors, ``(count, 3)``."""
    vectors = np.random.default_rng(seed).normal(size=(count, 3))
    units: Array = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return units


def rotation(seed: int) -> Array:
    """A random proper rotation."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q if np.linalg.det(q) > 0 else -q


def basis(ω: Array, bands: int) -> Array:
    """The definition: ``K_lm P_l^|m|(cos θ) {cos mφ, sin |m|φ}`` without Condon–Shortley phase."""
    x, y, z = ω[..., 0], ω[..., 1], ω[..., 2]
    sine, azimuth = np.hypot(x, y), np.arctan2(y, x)
    columns = []
    for degree in range(bands):
        for order in range(-degree, degree + 1):
            m = abs(order)
            norm = np.sqrt(
                (1 if m == 0 else 2) * (2 * degree + 1) / (4 * np.pi) * factorial(degree - m) / factorial(degree + m)
            )
            unit = np.zeros(degree + 1)
            unit[degree] = 1
            associated = sine**m * legendre.legval(z, legendre.legder(unit, m))
            columns.append(norm * associated * (np.cos(m * azimuth) if order >= 0 else np.sin(m * azimuth)))
    return np.stack(columns, axis=-1)


def sphere_quadrature(degree: int) -> tuple[Array, Array]:
    """Points and weights that integrate polynomials up to ``degree`` exactly over the sphere."""
    z, weights = legendre.leggauss(degree // 2 + 1)
    azimuth = 2 * np.pi * np.arange(degree + 1) / (degree + 1)
    z, azimuth = (grid.ravel() for grid in np.meshgrid(z, azimuth, indexing="ij"))
    ring = np.sqrt(1 - z * z)
    points = np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)
    return points, np.repeat(weights, degree + 1) * 2 * np.pi / (degree + 1)


def zonal_factors(kernel: Callable[[Array], Array], bands: int, breaks: tuple[float, ...] = (-1.0, 0.0, 1.0)) -> Array:
    """``2π ∫ kernel(u) P_l(u) du`` by Gauss–Legendre quadrature between the breaks."""
    u, weights = legendre.leggauss(40)
    total = np.zeros(bands)
    for low, high in pairwise(breaks):
        at = low + (high - low) * (u + 1) / 2
        values = weights * (high - low) / 2 * kernel(at)
        total += 2 * np.pi * values @ legendre.legvander(at, bands - 1)
    return total


def rotation_matrix(turn: Array, bands: int) -> Array:
    """Least squares from samples: ``Y(Rω) = M Y(ω)``."""
    ω = directions(4 * bands * bands, seed=99)
    solution = np.linalg.lstsq(basis(ω, bands), basis(ω @ turn.T, bands), rcond=None)[0]
    return np.asarray(solution.T, dtype=np.float64)


@cache
def _dense(bands: int) -> tuple[Array, Array]:
    points = directions(4000, seed=1)
    return points, basis(points, bands)


def sphere_minimum(coefficients: Array) -> float:
    """Dense sampling, then pattern search from the best two points until the steps vanish."""
    bands = int(np.sqrt(len(coefficients)))
    points, dense = _dense(bands)
    values = dense @ coefficients
    best = float(values.min())
    for n in points[np.argsort(values)[:2]]:
        value, step = float(basis(n, bands) @ coefficients), 0.1
        while step > 1e-7:
            around = n + step * directions(16, seed=5)
            around /= np.linalg.norm(around, axis=1, keepdims=True)
            candidates = basis(around, bands) @ coefficients
            if candidates.min() < value:
                value, n = float(candidates.min()), around[candidates.argmin()]
            else:
                step /= 2
        best = min(best, value)
    return best
