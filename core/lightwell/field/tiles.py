"""The layout in which a browser uploads a grid to the GPU: four coefficients a texel (WEB.md §2, §4).

Coefficients are packed in groups of four: group g is the three tiles ``3g, 3g+1, 3g+2`` whose texels hold the red,
green and blue parts of the coefficients ``4g … 4g+3``. A count that is one above a multiple of four (1, 9, 25) ends
with one tile that holds red, green and blue of the last coefficient; 4, 16 and 36 divide evenly.

Gradients are packed as what the half-gradient rule (MATHS §7.8) adds to the hardware's trilinear filter. A fraction f
of the way along x from node 0 to node 1, a distance h apart, the terms ``½ G·(x − x_k)`` of x come to
``f (1 − f) · ½ h (G_0 − G_1)``, bilinear in y and z. So each axis has a *bend* ``½ h (G_i − G_{i+1})``, kept at node i,
and one look-up in the middle of that node along the axis, filtered along the other two, makes its part of the sum.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell.field.spec import Floats

LARGEST_HALF = 65504.0


def tile_count(coefficients: int) -> int:
    """Return the number of tiles of ``bands²`` coefficients: 1, 3, 7, 12, 19, 27 for 1 … 6 bands."""
    return coefficients // 4 * 3 + coefficients % 4


def pack_tiles(coefficients: NDArray[np.float32]) -> tuple[NDArray[np.float16], float]:
    """Return the tiles ``(tiles, z, y, x, 4)`` float16 of coefficients ``(z, y, x, bands², 3)``, and their scale.

    The scale is the power of two, 1 where possible, by which texels must be multiplied: halves end at 65504.
    """
    scale = _scale(float(np.abs(coefficients).max(initial=0.0)))
    return _pack(coefficients, scale), scale


def pack_bends(gradients: NDArray[np.float32], voxel: Floats) -> tuple[NDArray[np.float16], float]:
    """Return the bends of gradients ``(z, y, x, bands², 3, 3)`` per metre as tiles, and their scale as `pack_tiles`.

    Tiles are ``(3 · tiles, z, y, x, 4)`` float16: all of x, then of y, then of z. ``voxel`` ``(3,)`` is in metres.
    """
    bends = []
    for axis in range(3):
        along = 2 - axis
        bend = np.zeros(gradients.shape[:-1], np.float32)
        inner = (slice(None),) * along + (slice(0, -1),)
        bend[inner] = -0.5 * np.float32(voxel[axis]) * np.diff(gradients[..., axis], axis=along)
        bends.append(bend)
    scale = _scale(max(float(np.abs(bend).max(initial=0.0)) for bend in bends))
    return np.concatenate([_pack(bend, scale) for bend in bends]), scale


def _scale(largest: float) -> float:
    return 1.0 if largest <= LARGEST_HALF else float(2.0 ** np.ceil(np.log2(largest / LARGEST_HALF)))


def _pack(coefficients: NDArray[np.float32], scale: float) -> NDArray[np.float16]:
    count = coefficients.shape[3]
    out = np.zeros((tile_count(count), *coefficients.shape[:3], 4), np.float16)
    scaled = coefficients / np.float32(scale)
    for group in range(count // 4):
        for channel in range(3):
            out[3 * group + channel] = scaled[..., 4 * group : 4 * group + 4, channel]
    if count % 4:
        out[-1, ..., :3] = scaled[..., -1, :]
    return out


def unpack_tiles(tiles: NDArray[np.float16], coefficients: int, scale: float = 1.0) -> NDArray[np.float32]:
    """Return the coefficients ``(z, y, x, bands², 3)`` of tiles."""
    out = np.zeros((*tiles.shape[1:4], coefficients, 3), np.float32)
    for group in range(coefficients // 4):
        for channel in range(3):
            out[..., 4 * group : 4 * group + 4, channel] = tiles[3 * group + channel]
    if coefficients % 4:
        out[..., -1, :] = tiles[-1, ..., :3]
    return out * np.float32(scale)
