"""Light beside a sample, from its gradient (MATHS §7.4). Needs no more than numpy: the Python client has it too."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

LARGEST_CHANGE = 0.7
"""Most that a step may change the mean radiance by, as a share of it: beyond, the step is cut short."""


def limit_change(coefficients: NDArray[np.float64], change: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return ``coefficients + s · change``, both ``(…, bands², 3)``; s for each colour, so that c₀ keeps 30 %.

    ``s = min(1, 0.7 c₀ / |change₀|)``; 0 where c₀ is not positive. So c₀ never becomes negative.
    """
    mean, step = np.maximum(coefficients[..., :1, :], 0), np.abs(change[..., :1, :])
    limit = LARGEST_CHANGE * mean
    share = np.where(step > limit, limit / np.where(step > limit, step, 1), 1.0)
    return np.asarray(coefficients + share * change)


def extrapolate(coefficients: ArrayLike, gradients: ArrayLike, offset: ArrayLike) -> NDArray[np.float64]:
    """Return the coefficients at ``offset`` from where they were sampled: ``c + s · (G·d)``.

    The step is cut short for each colour (`limit_change`), so that its mean radiance keeps at least 30 %.

    Parameters
    ----------
    coefficients
        ``(bands², 3)``, or ``(…, bands², 3)`` for as many samples as offsets.
    gradients
        ``(bands², 3, 3)`` per metre, or ``(…, bands², 3, 3)``.
    offset
        ``(…, 3)`` metres.

    Returns
    -------
    ``(…, bands², 3)``.
    """
    values = np.asarray(coefficients, dtype=np.float64)
    change = np.einsum("...ick,...k->...ic", np.asarray(gradients, dtype=np.float64), np.asarray(offset, np.float64))
    return limit_change(values, change)
