"""What every probe mapping offers: where a point of the picture looks, and back, and how much of the sphere it sees."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from functools import cached_property
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.errors import MappingError

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Samples = tuple[NDArray[np.intp], Floats, Floats]
"""Pixel indices ``(n,)``, directions ``(n, 3)`` and solid angles ``(n,)`` of samples of footprints."""


class Region(NamedTuple):
    """Rows ``row0 … row1−1`` and columns ``col0 … col1−1`` of a picture."""

    row0: int
    row1: int
    col0: int
    col1: int


class Mapping(ABC):
    """How a picture of ``height`` by ``width`` pixels covers the sphere of directions.

    Picture points are ``(x, y)`` in pixels, x right and y down; pixel ``(row i, column j)`` covers
    ``[j, j+1] × [i, i+1]``. Directions are unit vectors in world axes that point towards the light.

    A pixel is *covered* where its whole area shows the probe. Pixels that straddle the probe's outline mix it with
    the background: they are never read. The strip of the sphere that they show is given to their nearest covered
    neighbours (MATHS §3, "masked and refilled").
    """

    kind: ClassVar[str]

    blind_axis: Floats | None = None
    """Centre of the cone of directions that the probe cannot show, ``(3,)`` in world axes; None where there is none."""
    blind_half_angle: float = 0.0
    """Half-angle of that cone, radians."""
    is_round: bool = False
    """True where the probe is a disc in the picture."""

    def __init__(self, height: int, width: int) -> None:
        if height < 1 or width < 1:
            raise MappingError(f"a picture of {width}×{height} pixels has no pixels")
        self.height = height
        self.width = width

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable value that two mappings share exactly where they are the same."""
        return (self.kind, self.height, self.width)

    @abstractmethod
    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions ``(…, 3)`` of picture points and whether the probe is seen there ``(…)``.

        Directions are finite unit vectors even where the probe is not seen, and mean nothing there.
        """

    def sees(self, x: ArrayLike, y: ArrayLike) -> Bools:
        """Return whether the probe is seen at picture points ``(…)``: the second value of `directions`."""
        return self.directions(x, y)[1]

    @abstractmethod
    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points x, y ``(…)`` that show the directions ``(…, 3)`` and whether any does ``(…)``."""

    @abstractmethod
    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return the solid angle per unit of picture area (steradian per square pixel) at picture points ``(…)``.

        It means nothing where the probe is not seen.
        """

    @abstractmethod
    def solid_angles(self) -> Floats:
        """Return the solid angle that each pixel stands for, ``(height, width)``; 0 for pixels that are not read."""

    @abstractmethod
    def footprints(self) -> Iterator[Samples]:
        """Yield samples of the pixels' footprints on the sphere, block by block.

        Each block is ``(pixel, direction, solid_angle)``: flat index ``row · width + column`` ``(n,)``, unit direction
        in world axes ``(n, 3)`` and the solid angle that the sample stands for, steradian ``(n,)``. They sum to
        `solid_angles` for each pixel.
        """

    def coverage(self) -> Bools:
        """Return which pixels show nothing but the probe, ``(height, width)``."""
        return self.solid_angles() > 0

    def nearest_covered(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Return points of pixels that are read near the given picture points, ``(…)``; those in such pixels stay."""
        column = np.asarray(np.clip(x, 0.0, self.width - 1e-9), dtype=np.float64)
        row = np.asarray(np.clip(y, 0.0, self.height - 1e-9), dtype=np.float64)
        return column, row

    @property
    def seen_solid_angle(self) -> float:
        """Solid angle that the probe shows, steradian: the sphere without the blind cone."""
        return 2 * math.pi * (1 + math.cos(self.blind_half_angle))

    @cached_property
    def region(self) -> Region:
        """Smallest box of the picture that holds every pixel that is read."""
        covered = self.coverage()
        rows, cols = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
        return Region(int(rows[0]), int(rows[-1]) + 1, int(cols[0]), int(cols[-1]) + 1)

    def pixel_centres(self) -> tuple[Floats, Floats]:
        """Return x ``(1, width)`` and y ``(height, 1)`` of the pixel centres."""
        return np.arange(0.5, self.width)[None, :], np.arange(0.5, self.height)[:, None]

    def _is_in_picture(self, x: Floats, y: Floats) -> Bools:
        return (x >= 0) & (x <= self.width) & (y >= 0) & (y <= self.height)
