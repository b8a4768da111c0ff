"""Gradients of a probe at the centre of a sphere that carries the light, without the picture (MATHS §7.7)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count, degree_of_index
from lightwell.gradients.moments import direction_moments


@lru_cache(maxsize=16)
def _unit_sphere(bands: int) -> NDArray[np.float64]:
    """Return the gradients ``(3, bands², (bands + 1)²)`` by coefficient of a probe in a sphere of radius 1."""
    degree, source = degree_of_index(bands)[:, None], degree_of_index(bands + 1)[None, :]
    factor = np.where(source == degree + 1, degree + 2, np.where(source == degree - 1, 1 - degree, 0))
    return np.asarray(direction_moments(bands, bands + 1) * factor)


def sphere_gradients(coefficients: ArrayLike, radius_m: float) -> NDArray[np.float64]:
    """Return the gradients of a probe whose light comes from a sphere of ``radius_m`` round it.

    ``G^k_lm = (1/ρ) Σ M^k_lm,l'm' {l + 2 if l' = l + 1; 1 − l if l' = l − 1} c_l'm'``: degree l needs degree l + 1.

    Parameters
    ----------
    coefficients
        ``(n², …)`` not windowed, one band more than is wanted of the gradients.
    radius_m
        Metres; infinity gives 0.

    Returns
    -------
    ``((n − 1)², …, 3)`` per metre.

    Raises
    ------
    ValueError
        Where there are less than two bands or the radius is not positive.
    """
    values = np.asarray(coefficients, dtype=np.float64)
    bands = bands_of_count(values.shape[0]) - 1
    if bands < 1:
        raise ValueError("gradients need one band more than they have: two at least")
    if not radius_m > 0:
        raise ValueError(f"the sphere's radius must be positive, not {radius_m:g} m")
    return np.moveaxis(np.tensordot(_unit_sphere(bands), values, axes=(2, 0)), 0, -1) / radius_m
