"""An adaptive grid of SH coefficients: small bricks where the light changes fast, large ones where it does not.

Paper 000 (§6) asks for adaptive grids or octrees that leave the GPU its power. Here the leaves of an octree are bricks
of equally many nodes (`lightwell.field.bricks`), whatever they cover: a table says for every block which brick covers
it, and that brick alone has all that is interpolated there. Looking up a point is one read of the table and one
trilinear filter, without a descent through the tree. In memory neighbours share the nodes between them; a GPU gets
them brick by brick (`lightwell.field.atlas`). `lightwell.field.adapt` makes adaptive grids.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count, coefficient_count
from lightwell.field.brick_kernels import sample
from lightwell.field.bricks import Layout
from lightwell.field.grid import FieldSamples, Grid, Singles
from lightwell.field.points import Outside, place_points
from lightwell.field.spec import GridSpec


@dataclass(frozen=True)
class AdaptiveGrid:
    """Coefficients at the nodes of bricks. The field is continuous, from brick to brick too."""

    spec: GridSpec
    """The regular grid that it stands for."""
    pages: NDArray[np.int32]
    """``(z, y, x)``: the brick that covers each block."""
    levels: NDArray[np.uint8]
    """``(bricks,)``: 0 is as fine as the regular grid, each further level has nodes twice as far apart."""
    nodes: NDArray[np.int32]
    """``(bricks, z, y, x)``: the nodes of each brick, as rows of the two that follow."""
    coefficients: Singles
    """``(nodes, bands², 3)`` float32."""
    coverage: Singles
    """``(nodes,)``: share of the sphere that was measured, 0 … 1."""
    tolerance: float
    """Largest error against the regular grid at its cells' centres, relative to its rms coefficient vector."""
    attributes: dict[str, Any] = field(default_factory=dict)
    """Where the grid comes from; see `lightwell.io.grids`."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(self.coefficients.shape[1])

    @property
    def layout(self) -> Layout:
        """How the bricks lie."""
        return Layout(self.spec.resolution)

    @property
    def leaves(self) -> list[int]:
        """Number of bricks of each level, the finest first."""
        return [int(count) for count in np.bincount(self.levels, minlength=self.layout.top + 1)]

    def memory_bytes(self, precision: Literal["float32", "float16"] = "float32") -> int:
        """Return the memory that it takes, with coefficients of that precision."""
        coefficients = self.coefficients.size * np.dtype(precision).itemsize
        tables = self.pages.nbytes + self.levels.nbytes + self.nodes.nbytes
        return int(coefficients + self.coverage.nbytes + tables)

    def sample(
        self,
        points: ArrayLike,
        *,
        gradients: bool = False,
        bands: int | None = None,
        outside: Outside = "clamp",
    ) -> FieldSamples:
        """Return the light at ``points`` ``(…, 3)`` in metres: `Grid.sample` for an adaptive grid.

        Trilinear between the eight nearest nodes of the brick that covers a point; ``gradients`` returns the
        gradient of that, which jumps where trilinear cells meet. (The half-gradient rule of MATHS §7.8 belongs to
        regular grids.)

        Raises
        ------
        ValueError
            Where a point is not finite, lies outside with ``outside`` = ``error``, or more bands are asked for than
            there are.
        """
        wanted = bands or self.bands
        if wanted > self.bands:
            raise ValueError(f"the grid has {self.bands} bands, not {wanted}")
        count = coefficient_count(wanted)
        places, beyond = place_points(self.spec, points, outside)
        values = np.empty((len(places), count, 3))
        slopes = np.zeros((len(places) if gradients else 0, count, 3, 3))
        coverage = np.empty(len(places))
        self._sample(places, values, coverage, slopes)
        if outside == "nan":
            values[beyond], coverage[beyond] = np.nan, np.nan
            if gradients:
                slopes[beyond] = np.nan
        shape = np.shape(points)[:-1]
        return FieldSamples(
            values.reshape(*shape, count, 3),
            coverage.reshape(shape),
            slopes.reshape(*shape, count, 3, 3) if gradients else None,
        )

    def to_regular(self) -> Grid:
        """Return the regular grid that this one stands for, without gradients."""
        shape, count = self.spec.shape, self.coefficients.shape[1]
        coefficients, coverage = np.empty((*shape, count, 3), np.float32), np.empty(shape, np.float32)
        z, y, x = (np.arange(size, dtype=np.float64) for size in shape)
        values, covered = np.empty((y.size * x.size, count, 3)), np.empty(y.size * x.size)
        none = np.zeros((0, count, 3, 3))
        for index in range(z.size):  # slice by slice: values are float64
            places = np.stack(np.meshgrid(z[index : index + 1], y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
            self._sample(places, values, covered, none)
            coefficients[index] = values.reshape(coefficients.shape[1:])
            coverage[index] = covered.reshape(shape[1:])
        return Grid(self.spec, coefficients, coverage, None, None, self.attributes)

    def _sample(
        self,
        places: NDArray[np.float64],
        values: NDArray[np.float64],
        coverage: NDArray[np.float64],
        slopes: NDArray[np.float64],
    ) -> None:
        sample(
            places,
            np.array(self.spec.resolution, np.int64),
            self.spec.voxel,
            self.layout.depths,
            self.pages,
            self.levels,
            self.nodes,
            self.coefficients,
            self.coverage,
            values,
            coverage,
            slopes,
        )


AnyGrid = Grid | AdaptiveGrid
"""Grids of either form: `spec`, `bands`, `attributes`, `sample` and `to_regular` are the same."""
