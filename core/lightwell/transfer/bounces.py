"""Light that comes by way of other surfaces, and vertices that are hidden (MATHS §9).

With M⁰ the direct transfer, ``M^{b+1}(x) = (1/π) ∫ (1 − V) ρ(x'_ω) M^b(x'_ω) max(0, n·ω) dω``; the total is ``Σ M^b``.
The surfaces that a vertex sees are those that its first rays met.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Float32s, Int32s
from lightwell.transfer import kernels
from lightwell.transfer.visibility import INSIDE

FILL_RINGS = 4


def reflected(transfer: Float32s, albedo: Float32s) -> Float32s:
    """Return albedo ``(V, channels)`` times transfer ``(V, bands², channels)``."""
    return np.ascontiguousarray(transfer * albedo[:, None, :])


def gather(hits: NDArray[Any], counts: NDArray[np.int32], triangles: Int32s, source: Float32s) -> Float32s:
    """Return the next bounce of B vertices, ``(B, bands², channels)``.

    ``hits`` and ``counts`` are those of `lightwell.transfer.visibility.DirectTransfer`, ``triangles (F, 3)`` the
    scene's, ``source (V, bands², channels)`` what `reflected` made of the bounce before.
    """
    flat = source.reshape(len(source), -1)
    out = np.empty((len(counts), flat.shape[1]), np.float32)
    kernels.gather_bounce(hits, counts, triangles, flat, out)
    return out.reshape(len(counts), *source.shape[1:])


def fill_hidden(transfer: Float32s, state: NDArray[np.uint8], triangles: Int32s) -> Float32s:
    """Return the transfer with vertices that lie inside solids taking the mean of their neighbours that do not.

    Where objects pass through each other, the triangle that does so has a vertex in the dark, whose blackness would
    show as a seam. Up to `FILL_RINGS` rings of vertices are filled; further in nobody looks. ``transfer (V, …)``,
    ``state (V,)``, ``triangles (F, 3)``.
    """
    hidden = np.asarray(state == INSIDE)
    values = transfer.reshape(len(transfer), -1).astype(np.float32)
    for _ in range(FILL_RINGS):
        if not hidden.any():
            break
        total, number = np.zeros(values.shape), np.zeros(len(values), np.int64)
        kernels.spread(triangles, hidden, values, total, number)
        found = number > 0
        values[found] = (total[found] / number[found, None]).astype(np.float32)
        hidden &= ~found
    return values.reshape(transfer.shape)
