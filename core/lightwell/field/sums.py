"""Running sums of a grid: what the directions so far have added to its coefficients."""

from __future__ import annotations

import math
from typing import Self

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import coefficient_count
from lightwell.field.plane import AXES
from lightwell.field.spec import GridSpec

Singles = NDArray[np.float32]


class FieldSums:
    """Partial sums over directions; sums of several ranges of directions add up.

    The full radiance of a cell is never stored (paper 000 §3.1).
    """

    def __init__(self, spec: GridSpec, bands: int, *, gradients: bool = False) -> None:
        self.spec = spec
        self.bands = bands
        self.coefficients: Singles = np.zeros((*spec.shape, coefficient_count(bands), 3), np.float32)
        """``(z, y, x, bands², 3)``."""
        self.coverage: Singles = np.zeros(spec.shape, np.float32)
        """``(z, y, x)``: solid angle of the directions that had a sample within the kernel, steradian."""
        self.samples: Singles = np.zeros(spec.shape, np.float32)
        """``(z, y, x)``: kernel weight gathered, integrated over directions, steradian."""
        self.gradients: Singles | None = None
        """``(z, y, x, bands², 3, 3)`` per metre, the last axis x, y, z; or None."""
        if gradients:
            self.gradients = np.zeros((*self.coefficients.shape, 3), np.float32)
        self.dark = 0.0
        """Solid angle of directions that had no sample at all, steradian."""

    def add(self, other: FieldSums) -> None:
        """Add the sums of other directions; their grid and bands must be the same, and both have gradients or none."""
        self.coefficients += other.coefficients
        if self.gradients is not None and other.gradients is not None:
            self.gradients += other.gradients
        self.coverage += other.coverage
        self.samples += other.samples
        self.dark += other.dark

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """Return what `restore` needs."""
        arrays: dict[str, NDArray[np.generic]] = {
            "coefficients": self.coefficients,
            "coverage": self.coverage,
            "samples": self.samples,
            "dark": np.array(self.dark),
        }
        if self.gradients is not None:
            arrays["gradients"] = self.gradients
        return arrays

    @classmethod
    def restore(cls, spec: GridSpec, bands: int, arrays: dict[str, NDArray[np.generic]]) -> Self:
        """Return sums from `arrays`; raises ``ValueError`` where they are of another grid."""
        sums = cls(spec, bands, gradients="gradients" in arrays)
        for name in arrays.keys() - {"dark"}:
            if arrays[name].shape != getattr(sums, name).shape:
                raise ValueError(f"{name} has the shape {arrays[name].shape}, not {getattr(sums, name).shape}")
            setattr(sums, name, np.asarray(arrays[name], np.float32))
        sums.dark = float(arrays["dark"])
        return sums

    def covered(self) -> Singles:
        """Return the share of the sphere that each cell had samples for, ``(z, y, x)``, 0 … 1."""
        return np.asarray(self.coverage / np.float32(4 * math.pi))


def layered(array: NDArray[np.float32], axis: int) -> NDArray[np.float32]:
    """Return a view of an array over the grid ``(z, y, x, …)`` as ``(w, v, u, …)`` for the layer axis ``axis``."""
    u, v = AXES[axis]
    order = (2 - axis, 2 - v, 2 - u)
    return array.transpose(*order, *range(3, array.ndim))
