"""Colours below zero: truncated harmonics ring."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import LUMINANCE

Floats = NDArray[np.float64]


def without_negatives(rgb: Floats) -> Floats:
    """Return colours ``(…, 3)`` moved towards their luminance just so far that no channel is negative.

    The luminance stays (0 where it was negative); clipping the channels would turn dark places blue or red. This is the
    browser's ``withoutNegatives``.
    """
    luminance = np.maximum(rgb @ LUMINANCE, 0.0)[..., None]
    smallest = rgb.min(axis=-1, keepdims=True)
    keep = np.ones_like(smallest)
    np.divide(luminance, luminance - smallest, out=keep, where=smallest < 0)
    moved: Floats = np.maximum(luminance + keep * (rgb - luminance), 0.0)
    return moved
