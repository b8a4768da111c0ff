"""Where light comes from: the same everywhere, or a grid that says what arrives at each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count, coefficient_count
from lightwell.field.adaptive import AnyGrid
from lightwell.sh.window import apply_window

Floats = NDArray[np.float64]


class Light(Protocol):
    """Radiance coefficients at points."""

    @property
    def bands(self) -> int:
        """SH bands."""
        ...

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands²,  3)`` for ``points`` ``(n, 3)``, or ``(bands², 3)`` where all points get the same."""
        ...


@dataclass(frozen=True, eq=False)
class DistantLight:
    """Light from so far away that it is the same at every point: a probe, or one frame of a stream."""

    coefficients: Floats
    """``(bands², 3)`` of radiance."""

    def __post_init__(self) -> None:
        array = np.asarray(self.coefficients, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"light has the shape {array.shape}; (bands², 3) coefficients are needed")
        bands_of_count(array.shape[0])
        if not np.isfinite(array).all():
            raise ValueError("light must be finite")
        object.__setattr__(self, "coefficients", array)

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(self.coefficients.shape[0])

    def at(self, points: Floats) -> Floats:
        """Return ``(bands², 3)``."""
        del points
        return self.coefficients


@dataclass(frozen=True, eq=False)
class FieldLight:
    """An incident light field: trilinear coefficients of a grid, regular or adaptive, at each point.

    Beyond the outermost cell centres the field is that of the nearest one.
    """

    grid: AnyGrid
    most_bands: int | None = None
    """Use no more bands than these."""
    window: Floats | None = None
    """``(bands,)`` weights against ringing, `lightwell.sh.window.fixed_window`."""
    gain: float | Floats = 1.0
    """Factor, one or ``(3,)`` for each channel."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return min(self.grid.bands, self.most_bands or self.grid.bands)

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        found = self.grid.sample(points, bands=self.bands).coefficients
        if self.window is not None:
            found = np.moveaxis(apply_window(np.moveaxis(found, 1, 0), self.window), 0, 1)
        return found * self.gain


def with_bands(coefficients: Floats, bands: int) -> Floats:
    """Return the first ``bands`` bands of ``(…, K, 3)``; there are never more than there were."""
    return coefficients[..., : coefficient_count(bands), :]
