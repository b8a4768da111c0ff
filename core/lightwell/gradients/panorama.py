"""Probe pictures of any mapping as the lat-long pictures that gradients are made of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.probe.half import Picture
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats, Mapping
from lightwell.probe.unwrap import Lookup


class GradientPanorama:
    """The lat-long grid on which a mapping's gradients are summed.

    Lat-long pictures are taken as they are. Others are read at ``width`` × ``width/2`` directions; what they do not
    show is marked in ``seen``, and its edges are left out of the sum.

    Attributes
    ----------
    height, width
        Size of the grid.
    directions
        ``(height, width, 3)`` unit vectors in the mapping's axes.
    seen
        ``(height, width)`` bool; None where everything is seen.
    """

    def __init__(self, mapping: Mapping, width: int = 256) -> None:
        self._lookup: Lookup | None = None
        self.seen: NDArray[np.bool_] | None = None
        grid = mapping if isinstance(mapping, LatLong) else LatLong(width // 2, width)
        self.height, self.width = grid.height, grid.width
        self.directions: Floats = grid.directions(*grid.pixel_centres())[0]
        if isinstance(mapping, LatLong):
            return
        flat = self.directions.reshape(-1, 3)
        self._lookup = Lookup(mapping, flat)
        seen = mapping.pixels(flat)[2].reshape(self.height, self.width)
        self.seen = None if seen.all() else seen

    def __call__(self, image: Picture) -> Picture:
        """Return the picture on the grid, ``(height, width, 3)``."""
        if self._lookup is None:
            return image
        return self._lookup(image).reshape(self.height, self.width, 3)
