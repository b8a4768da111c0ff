"""How an adaptive grid divides a regular one into bricks.

The centres of the regular grid's cells are its *nodes*; lengths here are in steps from node to node. The space between
the nodes is cut into *blocks* of `STEPS` steps along each axis. A brick of level l covers ``2^l`` blocks along each
axis, aligned to multiples of that, with `STEPS` + 1 nodes that are ``2^l`` steps apart; on an axis that ends sooner,
where fewer blocks than that lie, as many as it takes. An axis with a single cell has a single node.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

STEPS = 4
"""Steps along each axis of a brick: it has one node more."""

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Layout:
    """The bricks of a grid of ``resolution`` (x, y, z) cells. Arrays are in the order x, y, z."""

    resolution: tuple[int, int, int]

    @property
    def blocks(self) -> Integers:
        """Blocks along each axis ``(3,)``."""
        return np.maximum(1, -(-(np.array(self.resolution, np.int64) - 1) // STEPS))

    @property
    def depths(self) -> Integers:
        """The level ``(3,)`` from which on one brick covers an axis."""
        return np.array([int(count - 1).bit_length() for count in self.blocks.tolist()], np.int64)

    @property
    def top(self) -> int:
        """The coarsest level: one brick covers everything."""
        return int(self.depths.max())

    @property
    def page_shape(self) -> tuple[int, int, int]:
        """Shape ``(z, y, x)`` of arrays over the blocks."""
        x, y, z = self.blocks.tolist()
        return z, y, x

    @property
    def brick_shape(self) -> tuple[int, int, int]:
        """Shape ``(z, y, x)`` of a brick's nodes."""
        x, y, z = (STEPS + 1 if count > 1 else 1 for count in self.resolution)
        return z, y, x

    def spans(self, level: int) -> Integers:
        """Return how many blocks a brick covers along each axis, ``(3,)``: also the steps from node to node."""
        return np.left_shift(1, np.minimum(level, self.depths))

    def bricks(self, level: int) -> Integers:
        """Return how many bricks of one level it takes along each axis, ``(3,)``."""
        return -(-self.blocks // self.spans(level))

    def nodes(self, level: int) -> Integers:
        """Return how many nodes they have together along each axis, ``(3,)``; neighbours share those between them."""
        return np.where(np.array(self.resolution) > 1, STEPS * self.bricks(level) + 1, 1)
