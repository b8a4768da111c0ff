"""The layout in which a GPU reads an adaptive grid: bricks side by side in 3D textures of halves.

A brick has its border nodes in it, so that the hardware's trilinear filter never reads past it. Coefficients are packed
four a texel, as `lightwell.field.tiles` does it for regular grids. For a place p, in steps from the first node::

    block   = min(floor(p / 4), blocks − 1)
    brick   = pages[block];  span = 2^min(level[brick], depths)      per axis
    local   = p / span − floor(block / span) · 4                      nodes into the brick, 0 … 4
    slot    = (brick mod nx, brick / nx mod ny, brick / (nx ny))
    texture = (slot · nodes + local + ½) / size
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.tiles import pack_tiles, tile_count


class Atlas(NamedTuple):
    """Bricks for a GPU."""

    tiles: NDArray[np.float16]
    """``(tiles, z, y, x, 4)``."""
    scale: float
    """Texels must be multiplied by it."""
    slots: tuple[int, int, int]
    """Bricks along x, y and z."""


def atlas_slots(bricks: int) -> tuple[int, int, int]:
    """Return how many bricks lie along x, y and z of the atlas: about equally many."""
    x = math.ceil(round(bricks ** (1 / 3), 9))
    y = math.ceil(math.sqrt(bricks / x))
    return x, y, -(-bricks // (x * y))


def atlas_bytes(grid: AdaptiveGrid) -> int:
    """Return the memory of the atlas without making it."""
    x, y, z = atlas_slots(len(grid.levels))
    nodes = math.prod(grid.layout.brick_shape)
    return tile_count(grid.coefficients.shape[1]) * x * y * z * nodes * 4 * 2


def make_atlas(grid: AdaptiveGrid) -> Atlas:
    """Return the bricks of a grid as a GPU takes them; slots without a brick are 0."""
    slots = atlas_slots(len(grid.levels))
    across, up, deep = slots
    shape = grid.layout.brick_shape
    cells = np.zeros((deep * up * across, *shape, *grid.coefficients.shape[1:]), np.float32)
    cells[: len(grid.nodes)] = grid.coefficients[grid.nodes]
    placed = cells.reshape(deep, up, across, *cells.shape[1:]).transpose(0, 3, 1, 4, 2, 5, 6, 7)
    tiles, scale = pack_tiles(placed.reshape(deep * shape[0], up * shape[1], across * shape[2], *cells.shape[4:]))
    return Atlas(tiles, scale, slots)
