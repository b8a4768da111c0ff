"""How far the grids of a simulated capture are from the exact field (MATHS §6)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import degree_of_index
from lightwell.field.spec import Floats, GridSpec
from lightwell.synthetic.scene import scene_from_json
from lightwell_workers.jobs.ilf_plan import Field

COMPARED_CELLS = 512


def relative_error(field: Field, spec: GridSpec, coefficients: NDArray[Any], window: Floats | None = None) -> float:
    """Return the rms error relative to the rms coefficient vector, at cells all over the grid.

    ``coefficients`` are ``(z, y, x, bands², 3)``; where they are windowed, ``window`` ``(bands,)`` has the factors of
    the degrees, which the exact ones are given too. The capture must be simulated.
    """
    assert field.capture.info.scene is not None
    scene = scene_from_json(field.capture.info.scene)
    bands = field.settings.bands
    chosen = np.linspace(0, spec.cells - 1, min(spec.cells, COMPARED_CELLS)).round().astype(np.intp)
    exact = scene.coefficients(spec.centres().reshape(-1, 3)[chosen], bands)
    if window is not None:
        exact *= window[degree_of_index(bands)][:, None]
    found = coefficients.reshape(-1, *coefficients.shape[3:])[chosen]
    return float(np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum()))
