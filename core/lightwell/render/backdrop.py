"""The surroundings: what is behind the objects and what mirrors show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lightwell.render.negatives import without_negatives
from lightwell.sh.shading import radiance

Floats = NDArray[np.float64]


class Backdrop(Protocol):
    """Radiance by direction."""

    def radiance(self, directions: Floats) -> Floats:
        """Return the radiance ``(n, 3)`` from unit ``directions`` ``(n, 3)``."""
        ...


@dataclass(frozen=True, eq=False)
class Harmonics:
    """The light as the coefficients hold it: blurred. Colours do not go below zero."""

    coefficients: Floats
    """``(bands², 3)``."""

    def radiance(self, directions: Floats) -> Floats:
        """Return ``(n, 3)``."""
        return without_negatives(radiance(self.coefficients, directions))


@dataclass(frozen=True, eq=False)
class Panorama:
    """A lat-long picture; row 0 is +Z, columns run with rising φ."""

    pixels: NDArray[np.floating]
    """``(H, W, 3)`` linear radiance, finite."""
    filter: Literal["linear", "nearest", "cubic"] = "linear"
    """Between pixel centres: linear; the nearest; or the cubic B-spline that the browser draws its picture with."""

    def __post_init__(self) -> None:
        if self.pixels.ndim != 3 or self.pixels.shape[2] != 3 or 0 in self.pixels.shape:
            raise ValueError(f"the backdrop has the shape {self.pixels.shape}; (height, width, 3) is needed")

    def radiance(self, directions: Floats) -> Floats:
        """Return ``(n, 3)``."""
        height, width, _ = self.pixels.shape
        phi = np.arctan2(directions[:, 1], directions[:, 0])
        theta = np.arccos(np.clip(directions[:, 2], -1, 1))
        x, y = phi / (2 * np.pi) * width - 0.5, theta / np.pi * height - 0.5
        if self.filter == "nearest":
            return self._pixel(np.rint(x), np.rint(y))
        column, row = np.floor(x), np.floor(y)
        across, down = _weights(x - column, self.filter), _weights(y - row, self.filter)
        first = -(len(across) // 2 - 1)
        total = np.zeros((len(directions), 3))
        for i, along_y in enumerate(down):
            for j, along_x in enumerate(across):
                total += (along_x * along_y)[:, None] * self._pixel(column + first + j, row + first + i)
        return total

    def _pixel(self, column: Floats, row: Floats) -> Floats:
        """Return pixels ``(n, 3)``: columns go round, rows end at the poles."""
        height, width, _ = self.pixels.shape
        rows = np.clip(row.astype(np.int64), 0, height - 1)
        return np.asarray(self.pixels[rows, column.astype(np.int64) % width], dtype=np.float64)


def _weights(f: Floats, name: str) -> list[Floats]:
    """Return the weights of the two or four pixels around, for the fraction f of the way to the next one."""
    if name == "linear":
        return [1 - f, f]
    return [(1 - f) ** 3 / 6, (4 - 6 * f**2 + 3 * f**3) / 6, (1 + 3 * f + 3 * f**2 - 3 * f**3) / 6, f**3 / 6]
