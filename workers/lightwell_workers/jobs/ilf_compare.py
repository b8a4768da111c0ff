"""How far the grids of a simulated capture are from the exact field (MATHS §6)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import degree_of_index
from lightwell.field.spec import Floats, GridSpec
from lightwell.synthetic.scene import Scene, scene_from_json
from lightwell_workers.jobs.ilf_plan import Field

COMPARED_CELLS = 512
COMPARED_GRADIENTS = 128


def relative_error(
    field: Field, spec: GridSpec, coefficients: NDArray[Any], window: Floats | None = None
) -> float | None:
    """Return the rms error relative to the rms coefficient vector, at cells all over the grid; None where all is dark.

    ``coefficients`` are ``(z, y, x, bands², 3)``; where they are windowed, ``window`` ``(bands,)`` has the factors of
    the degrees, which the exact ones are given too. The capture must be simulated.
    """
    scene, chosen, places, factors = _compared(field, spec, COMPARED_CELLS, window)
    exact = scene.coefficients(places, field.settings.bands) * factors
    found = coefficients.reshape(-1, *coefficients.shape[3:])[chosen]
    scale = (exact**2).sum()
    return float(np.sqrt(((found - exact) ** 2).sum() / scale)) if scale > 0 else None


def relative_gradient_error(field: Field, spec: GridSpec, gradients: NDArray[Any], window: Floats) -> float:
    """Return the rms error of gradients ``(z, y, x, bands², 3, 3)`` per metre relative to the rms exact gradient.

    The exact ones are differences of the exact field over a hundredth of a cell. ``window`` ``(bands,)`` has the
    factors of the degrees. The capture must be simulated.
    """
    scene, chosen, places, factors = _compared(field, spec, COMPARED_GRADIENTS, window)
    exact = np.empty((len(places), *gradients.shape[3:]))
    for axis, step in enumerate(np.diag(spec.voxel * 0.01)):
        beyond, before = (scene.coefficients(places + sign * step, field.settings.bands) for sign in (1, -1))
        exact[..., axis] = (beyond - before) * factors / (2 * step[axis])
    found = gradients.reshape(-1, *gradients.shape[3:])[chosen]
    scale = (exact**2).sum()
    return float(np.sqrt(((found - exact) ** 2).sum() / scale)) if scale > 0 else 0.0


def _compared(
    field: Field, spec: GridSpec, most: int, window: Floats | None
) -> tuple[Scene, NDArray[np.intp], Floats, Floats]:
    """Return the scene, some cells ``(n,)``, their centres ``(n, 3)``, and the window's factors ``(bands², 1)``."""
    assert field.capture.info.scene is not None
    bands = field.settings.bands
    chosen = np.linspace(0, spec.cells - 1, min(spec.cells, most)).round().astype(np.intp)
    weights = np.ones(bands) if window is None else window
    factors = weights[degree_of_index(bands)][:, None]
    return scene_from_json(field.capture.info.scene), chosen, spec.centres().reshape(-1, 3)[chosen], factors
