"""Quadrature weights of lat-long rows (MATHS §2.1)."""

from __future__ import annotations

import numpy as np

from lightwell.probe.mapping import Floats
from lightwell.settings import ProjectionWeights


def row_weights(height: int, width: int, weights: ProjectionWeights = "solid-angle") -> Floats:
    """Return the weight of one pixel of each row of a lat-long picture, ``(height,)``, steradian.

    ``solid-angle``
        The pixel's exact solid angle ``(2π/W)·2 sinθ_i sin(π/2H)``: right for pixels that are means over their area,
        as those of cameras and of downsampled pictures are.
    ``paper``
        Paper 003, equation 12: ``(2π²/HW) sinθ_i``; it over-counts everything by π²/(24H²).
    ``fejer``
        Fejér's first rule ``(2π/W)(2/H)[1 − 2 Σ_{k=1}^{⌊H/2⌋} cos(2kθ_i)/(4k²−1)]``: exact for point samples of
        band-limited light where the degrees of light and basis add up to less than H and W.
    """
    theta = np.pi * (np.arange(height) + 0.5) / height
    if weights == "paper":
        return np.asarray(2 * np.pi**2 / (height * width) * np.sin(theta))
    if weights == "solid-angle":
        return np.asarray(2 * np.pi / width * 2 * np.sin(theta) * np.sin(np.pi / (2 * height)))
    k = np.arange(1, height // 2 + 1)
    series = np.array([np.sum(np.cos(2 * k * angle) / (4 * k * k - 1)) for angle in theta])
    return np.asarray(2 * np.pi / width * (2 / height) * (1 - 2 * series))
