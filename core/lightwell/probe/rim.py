"""The ring of pixels from which light is taken for what the probe cannot see."""

from __future__ import annotations

import numpy as np

from lightwell.probe.mapping import Floats, Mapping


def rim_weights(mapping: Mapping) -> Floats:
    """Return the weights ``(H·W,)``, summing to 1, of the mean that lights what the probe does not show.

    Round probes: equal weights for the covered pixels that have an uncovered neighbour or lie at the picture's edge.
    Other mappings show the whole sphere; what is left over is rounding, and every pixel has its solid angle's share.
    """
    if not mapping.is_round:
        return np.asarray(mapping.solid_angles() / mapping.solid_angles().sum()).reshape(-1)
    covered = mapping.coverage()
    padded = np.pad(covered, 1)
    inner = covered.copy()
    for dy in range(3):
        for dx in range(3):
            inner &= padded[dy : dy + mapping.height, dx : dx + mapping.width]
    rim = (covered & ~inner).reshape(-1)
    return np.asarray(rim / rim.sum())
