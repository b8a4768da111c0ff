"""Gradients of a grid of coefficients (MATHS §7.6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.field.spec import Floats
from lightwell.gradients.freespace import project_gradients


def central_differences(coefficients: NDArray[np.float32], voxel: Floats) -> NDArray[np.float32]:
    """Return ``∂c/∂(x, y, z)`` per metre of coefficients ``(z, y, x, bands², 3)``: ``(z, y, x, bands², 3, 3)`` float32.

    Central differences within, one-sided at the borders; 0 along an axis of one cell. ``voxel`` ``(3,)`` is in metres.
    """
    out = np.zeros((*coefficients.shape, 3), np.float32)
    for axis in range(3):
        if coefficients.shape[2 - axis] > 1:
            out[..., axis] = np.gradient(coefficients, float(voxel[axis]), axis=2 - axis)
    return out


def project_in_place(gradients: NDArray[np.float32]) -> float:
    """Project a grid's gradients ``(z, y, x, bands², 3, 3)`` onto what light in empty space obeys, slice by slice.

    Returns the rms of what was taken off as a share of the rms gradient, 0 where all is dark.
    """
    before = removed = 0.0
    for part in gradients:
        kept = project_gradients(part)
        before += float(np.sum(part.astype(np.float64) ** 2))
        removed += float(np.sum((part - kept) ** 2))
        part[:] = kept
    return float(np.sqrt(removed / before)) if before > 0 else 0.0
