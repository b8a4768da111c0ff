"""The product of a direction's components with the basis: ``ω_k y_i = Σ_j M^k_ij y_j`` (MATHS §7.6)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lightwell.sh.basis import evaluate


@lru_cache(maxsize=16)
def direction_moments(bands: int, other_bands: int) -> NDArray[np.float64]:
    """Return ``M^k_ij = ∫ ω_k y_i y_j dω`` as ``(3, bands², other_bands²)``, to rounding; read-only.

    Only degrees that differ by one are joined. The integrand is a polynomial: Gauss–Legendre times equal steps is
    exact.
    """
    nodes, weights = np.polynomial.legendre.leggauss(max(bands, other_bands) + 1)
    columns = 2 * (bands + other_bands)
    phi = 2 * np.pi * (np.arange(columns) + 0.5) / columns
    sine = np.sqrt(1 - nodes * nodes)[:, None]
    directions = np.stack(
        [sine * np.cos(phi), sine * np.sin(phi), np.broadcast_to(nodes[:, None], (nodes.size, columns))], axis=-1
    ).reshape(-1, 3)
    solid_angles = np.repeat(weights * 2 * np.pi / columns, columns)
    basis = evaluate(directions, max(bands, other_bands))
    weighted = solid_angles[:, None] * directions
    first, second = basis[:, : bands * bands], basis[:, : other_bands * other_bands]
    moments = np.asarray(np.einsum("nk,ni,nj->kij", weighted, first, second, optimize=True))
    moments[np.abs(moments) < 1e-13] = 0
    moments.flags.writeable = False
    return moments
