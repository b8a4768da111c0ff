"""What light obeys in empty space: radiance does not change along its ray (MATHS §7.6).

``ω·∇L = 0`` in all directions. Its projection onto y_i is linear in the gradients, ``Σ_k Σ_j M^k_ij ∂_k c_j = 0``, and
exact for coefficients of a finite number of bands for all i of one band less. For i = 0 it says
``∂_x c_11 + ∂_y c_1,−1 + ∂_z c_10 = 0``.

It holds for coefficients as they are projected. Windowed ones (`lightwell.sh.window`) have to be divided by the
window's weights first.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count
from lightwell.gradients.moments import direction_moments


@lru_cache(maxsize=16)
def free_space_constraints(bands: int) -> NDArray[np.float64]:
    """Return the constraints on the gradients of ``bands`` bands, ``((bands − 1)², bands², 3)``, read-only.

    A gradient ``G`` ``(bands², 3)`` of one colour obeys ``Σ_jk constraint_ijk G_jk = 0``. Their rank is full.

    Raises
    ------
    ValueError
        For less than two bands, which are free.
    """
    if bands < 2:
        raise ValueError("free space constrains gradients of two bands and more")
    constraints = np.ascontiguousarray(np.moveaxis(direction_moments(bands - 1, bands), 0, -1))
    constraints.flags.writeable = False
    return constraints


@lru_cache(maxsize=16)
def _orthonormal(bands: int) -> NDArray[np.float64]:
    """Return an orthonormal basis of what the constraints forbid, ``((bands − 1)², bands² · 3)``."""
    constraints = free_space_constraints(bands)
    q, _ = np.linalg.qr(constraints.reshape(constraints.shape[0], -1).T)
    return np.ascontiguousarray(q.T)


def free_space_residual(gradients: ArrayLike) -> NDArray[np.float64]:
    """Return what gradients ``(…, bands², 3, 3)`` break of the constraints, ``(…, (bands − 1)², 3)`` by colour."""
    values = np.asarray(gradients, dtype=np.float64)
    constraints = free_space_constraints(bands_of_count(values.shape[-3]))
    return np.asarray(np.einsum("ijk,...jck->...ic", constraints, values, optimize=True))


def project_gradients(gradients: ArrayLike) -> NDArray[np.float64]:
    """Return the nearest gradients ``(…, bands², 3, 3)`` that obey the constraints.

    Takes off what noise adds to the forbidden part: of white noise in 25 coefficients 11 % of its rms. One band is
    free and is returned as it is.
    """
    values = np.asarray(gradients, dtype=np.float64)
    bands = bands_of_count(values.shape[-3])
    if bands < 2:
        return values
    forbidden = _orthonormal(bands)
    rows = np.moveaxis(values, -2, -3).reshape(-1, values.shape[-3] * 3)
    kept = rows - (rows @ forbidden.T) @ forbidden
    return np.moveaxis(kept.reshape(*values.shape[:-3], 3, values.shape[-3], 3), -3, -2)
