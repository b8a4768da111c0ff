"""A small picture of a grid: what light a white surface gets in its three middle slices."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AnyGrid
from lightwell.field.grid import Grid
from lightwell.sh.lobes import lambert_zonal, zonal_to_coefficients

HEIGHT = 240
GAP = 8


def irradiance_slice(grid: Grid, axis: int, index: int, normal: tuple[float, float, float]) -> NDArray[np.float64]:
    """Return the irradiance on surfaces with ``normal`` in a slice across ``axis`` (0 … 2: x, y, z), ``(v, u, 3)``."""
    bands = min(grid.bands, 5)
    scaled = np.array(normal) / np.abs(normal).max()  # whose square neither overflows nor vanishes
    unit = scaled / np.linalg.norm(scaled)
    lobe = zonal_to_coefficients(lambert_zonal(bands), unit)
    part = np.take(grid.coefficients[..., : bands * bands, :], index, axis=2 - axis)
    return np.asarray(np.einsum("vukc,k->vuc", part, lobe))


def encode_png(pixels: NDArray[np.uint8]) -> bytes:
    """Return a picture ``(H, W, 3)`` RGB as PNG."""
    ok, data = cv2.imencode(".png", np.ascontiguousarray(pixels[..., ::-1]))
    assert ok
    return data.tobytes()


def preview_png(shown: AnyGrid, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> bytes:
    """Return a PNG of the middle slices across z, y and x, side by side, up or right = rising coordinate."""
    grid = shown.to_regular()
    slices = [irradiance_slice(grid, axis, grid.spec.resolution[axis] // 2, normal) for axis in (2, 1, 0)]
    white = max(float(np.quantile(np.concatenate([part.reshape(-1) for part in slices]), 0.98)), 1e-12)
    tiles = []
    for part in slices:
        pixels = np.clip(part[::-1] / white, 0, 1) ** (1 / 2.2) * 255
        width = max(1, round(HEIGHT * part.shape[1] / part.shape[0]))
        tiles.append(cv2.resize(pixels.astype(np.uint8), (width, HEIGHT), interpolation=cv2.INTER_NEAREST))
        tiles.append(np.full((HEIGHT, GAP, 3), 255, np.uint8))
    return encode_png(np.concatenate(tiles[:-1], axis=1))
