"""Points at which a grid is asked for its light."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.field.spec import Floats, GridSpec

Outside = Literal["clamp", "nan", "error"]
"""What a grid says of points beyond its bounds."""


def place_points(spec: GridSpec, points: ArrayLike, outside: Outside) -> tuple[Floats, NDArray[np.bool_]]:
    """Return where ``points`` ``(…, 3)`` in metres lie, ``(n, 3)``, and which of them lie beyond the grid, ``(n,)``.

    Places are in cells, 0 at the centre of the first one, and are not clamped.

    Raises
    ------
    ValueError
        Where a point is not finite, or lies outside with ``outside`` = ``error``.
    """
    flat = np.ascontiguousarray(np.asarray(points, dtype=np.float64).reshape(-1, 3))
    if not np.isfinite(flat).all():
        raise ValueError("points must be finite")
    lower, upper = np.array(spec.lower), np.array(spec.upper)
    beyond: NDArray[np.bool_] = np.any((flat < lower) | (flat > upper), axis=1)
    if outside == "error" and beyond.any():
        where = ", ".join(f"{value:g}" for value in flat[np.argmax(beyond)])
        raise ValueError(f"({where}) lies outside the grid, {spec.lower} … {spec.upper}")
    return spec.to_cells(flat) - 0.5, beyond
