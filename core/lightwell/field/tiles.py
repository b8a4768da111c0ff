"""The layout in which a browser uploads a grid to the GPU: four coefficients a texel (WEB.md §2, §4).

Coefficients are packed in groups of four: group g is the three tiles ``3g, 3g+1, 3g+2`` whose texels hold the red,
green and blue parts of the coefficients ``4g … 4g+3``. A count that is one above a multiple of four (1, 9, 25) ends
with one tile that holds red, green and blue of the last coefficient; 4, 16 and 36 divide evenly.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LARGEST_HALF = 65504.0


def tile_count(coefficients: int) -> int:
    """Return the number of tiles of ``bands²`` coefficients: 1, 3, 7, 12, 19, 27 for 1 … 6 bands."""
    return coefficients // 4 * 3 + coefficients % 4


def pack_tiles(coefficients: NDArray[np.float32]) -> tuple[NDArray[np.float16], float]:
    """Return the tiles ``(tiles, z, y, x, 4)`` float16 of coefficients ``(z, y, x, bands², 3)``, and their scale.

    The scale is the power of two, 1 where possible, by which texels must be multiplied: halves end at 65504.
    """
    count = coefficients.shape[3]
    largest = float(np.abs(coefficients).max(initial=0.0))
    scale = 1.0 if largest <= LARGEST_HALF else 2.0 ** np.ceil(np.log2(largest / LARGEST_HALF))
    out = np.zeros((tile_count(count), *coefficients.shape[:3], 4), np.float16)
    scaled = coefficients / np.float32(scale)
    for group in range(count // 4):
        for channel in range(3):
            out[3 * group + channel] = scaled[..., 4 * group : 4 * group + 4, channel]
    if count % 4:
        out[-1, ..., :3] = scaled[..., -1, :]
    return out, float(scale)


def unpack_tiles(tiles: NDArray[np.float16], coefficients: int, scale: float = 1.0) -> NDArray[np.float32]:
    """Return the coefficients ``(z, y, x, bands², 3)`` of tiles."""
    out = np.zeros((*tiles.shape[1:4], coefficients, 3), np.float32)
    for group in range(coefficients // 4):
        for channel in range(3):
            out[..., 4 * group : 4 * group + 4, channel] = tiles[3 * group + channel]
    if coefficients % 4:
        out[..., -1, :] = tiles[-1, ..., :3]
    return out * np.float32(scale)
