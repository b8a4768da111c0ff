"""A regular grid in space."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class GridSpec:
    """Voxel-centred: cell i of an axis has its centre at ``lower + (i + ½) h``, ``h = (upper − lower) / resolution``.

    Arrays over the grid have the shape ``(z, y, x)``; positions and per-axis values are in the order x, y, z. Inside
    the resampling, lengths are in *cell units*: a position is ``(x − lower) / h``, so that cell i's centre is i + ½ and
    voxels are cubes, whatever their size in metres.
    """

    lower: tuple[float, float, float]
    """Lower corner of the first cell, metres."""
    upper: tuple[float, float, float]
    """Upper corner of the last cell, metres."""
    resolution: tuple[int, int, int]
    """Cells along x, y and z."""

    def __post_init__(self) -> None:
        if not all(
            np.isfinite([low, high]).all() and high > low for low, high in zip(self.lower, self.upper, strict=True)
        ):
            raise ValueError(f"bounds {self.lower} … {self.upper} must be finite and grow along every axis")
        if min(self.resolution) < 1:
            raise ValueError(f"resolution {self.resolution} must be at least 1 along every axis")

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape ``(z, y, x)`` of arrays over the grid."""
        return self.resolution[2], self.resolution[1], self.resolution[0]

    @property
    def cells(self) -> int:
        """Number of cells."""
        return self.resolution[0] * self.resolution[1] * self.resolution[2]

    @property
    def voxel(self) -> Floats:
        """Size of a cell along x, y and z, metres ``(3,)``."""
        return np.asarray((np.array(self.upper) - np.array(self.lower)) / np.array(self.resolution))

    def to_cells(self, points: ArrayLike) -> Floats:
        """Return points ``(…, 3)`` in metres in cell units."""
        return np.asarray((np.asarray(points, dtype=np.float64) - np.array(self.lower)) / self.voxel)

    def centres(self) -> Floats:
        """Return the cells' centres, ``(z, y, x, 3)`` in metres."""
        axes = [
            low + (np.arange(count) + 0.5) * size
            for low, count, size in zip(self.lower, self.resolution, self.voxel, strict=True)
        ]
        z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
        return np.stack([x, y, z], axis=-1)
