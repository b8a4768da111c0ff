"""A mapping seen through a coarser grid of pixels."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.probe.footprint import gauss_footprints, rim_footprints
from lightwell.probe.mapping import Bools, Floats, Mapping, Samples


class ReducedMapping(Mapping):
    """The region of another mapping's picture, divided into ``height`` by ``width`` equal cells.

    ``solid_angles`` ``(height, width)`` are the sums of the source's over each cell: with them the means that
    `Downsampler` takes keep the energy exactly. ``whole`` ``(height, width)`` tells which cells hold only pixels that
    are read.
    """

    kind: ClassVar[str] = "reduced"

    def __init__(self, source: Mapping, height: int, width: int, solid_angles: Floats, whole: Bools) -> None:
        super().__init__(height, width)
        self.source = source
        self.blind_axis = source.blind_axis
        self.blind_half_angle = source.blind_half_angle
        self.is_round = source.is_round
        region = source.region
        self._origin = (region.col0, region.row0)
        self._cell = ((region.col1 - region.col0) / width, (region.row1 - region.row0) / height)
        self._solid_angles = solid_angles
        self._whole = whole

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, self.source.key)

    def _source_point(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        return (
            self._origin[0] + np.asarray(x, dtype=np.float64) * self._cell[0],
            self._origin[1] + np.asarray(y, dtype=np.float64) * self._cell[1],
        )

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return what the source says of the same points."""
        return self.source.directions(*self._source_point(x, y))

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the source's points on this grid."""
        x, y, seen = self.source.pixels(directions)
        return (x - self._origin[0]) / self._cell[0], (y - self._origin[1]) / self._cell[1], seen

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the source's density, per unit of this grid's area."""
        return self.source.density(*self._source_point(x, y)) * (self._cell[0] * self._cell[1])

    def nearest_covered(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Return the source's nearest covered points on this grid."""
        near_x, near_y = self.source.nearest_covered(*self._source_point(x, y))
        return (
            np.clip((near_x - self._origin[0]) / self._cell[0], 0, self.width - 1e-9),
            np.clip((near_y - self._origin[1]) / self._cell[1], 0, self.height - 1e-9),
        )

    def footprints(self) -> Iterator[Samples]:
        """Yield samples of the cells, scaled in each cell to its solid angle.

        Cells that hold pixels which are not read are sampled like the rim of a full picture: what those pixels show
        goes to the nearest pixel that is read.
        """
        blocks = [*gauss_footprints(self, self._whole), rim_footprints(self, self._partial())]
        pixel, direction, solid_angle = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
        wanted = self._solid_angles.reshape(-1)
        # Cells whose share of read pixels is too small for the samples' grid get one sample there.
        missed = np.flatnonzero((np.bincount(pixel, minlength=wanted.size) == 0) & (wanted > 0))
        x, y = self.nearest_covered(missed % self.width + 0.5, missed // self.width + 0.5)
        pixel = np.concatenate([pixel, missed])
        direction = np.concatenate([direction, self.directions(x, y)[0]])
        solid_angle = np.concatenate([solid_angle, np.ones(missed.size)])
        total = np.bincount(pixel, solid_angle, wanted.size)
        yield pixel, direction, solid_angle * (wanted / np.maximum(total, 1e-300))[pixel]

    def _partial(self) -> Bools:
        """Return the cells that hold pixels which are not read, and lie in or beside the probe."""
        near = np.pad(self._solid_angles > 0, 1)
        near[1:] |= near[:-1]
        near[:-1] |= near[1:]
        near[:, 1:] |= near[:, :-1]
        near[:, :-1] |= near[:, 1:]
        return near[1:-1, 1:-1] & ~self._whole

    def solid_angles(self) -> Floats:
        """Return the sums of the source's solid angles in each cell, ``(height, width)``; 0 where no pixel is read."""
        return self._solid_angles
