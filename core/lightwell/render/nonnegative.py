"""Least squares without negative parts, for the few unknowns of `lightwell.render.light.modulate`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PRIOR = 1e-9
"""Weight of the gains' pull towards 1, of the trace of the Gram matrix. It decides only what the light does not: which
of two lamps that look the same to the probe has changed, and what a lamp does that the probe does not see."""
DARKEST = 1e-30
"""The same where all lamps are dark there."""


def nonnegative_gains(columns: Floats, target: Floats) -> Floats:
    """Return the gains g ≥ 0 ``(n,)`` that minimise ``‖Σ g_k column_k − target‖² + λ ‖g − 1‖²``.

    Exact: the solution is the unconstrained one of those unknowns that are not 0, and of the few unknowns that there
    are here every subset is tried. λ is `PRIOR` of the Gram matrix' trace, so that the solution is unique.

    Parameters
    ----------
    columns
        ``(m, n)``; n ≤ 4 or so: the cost is 2ⁿ.
    target
        ``(m,)``.
    """
    count = columns.shape[1]
    pull = max(PRIOR * float((columns**2).sum()), DARKEST)
    gram = columns.T @ columns + pull * np.eye(count)
    right = columns.T @ target + pull
    best, least = np.zeros(count), 0.0
    for subset in range(1, 1 << count):
        used = [k for k in range(count) if subset >> k & 1]
        found = np.linalg.solve(gram[np.ix_(used, used)], right[used])
        # At the solution of a subset the objective is a constant − g·r: the larger g·r, the better.
        gained = float(found @ right[used])
        if (found >= 0).all() and gained > least:
            best, least = np.zeros(count), gained
            best[used] = found
    return best
