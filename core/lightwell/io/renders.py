"""Writing rendered pictures: OpenEXR with all layers, PNG as a screen shows them."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lightwell.errors import RenderError
from lightwell.io.exr import COMPRESSIONS
from lightwell.io.files import write_atomically
from lightwell.render.picture import Rendering
from lightwell.render.tonemap import expose_and_encode

SUFFIXES = (".exr", ".png")
BLOCK_ROWS = 128
"""Of a picture that is encoded."""


def require_format(path: Path) -> None:
    """Raise `RenderError` where no picture of that name can be written: a late surprise costs a whole rendering."""
    if path.suffix.lower() not in SUFFIXES:
        raise RenderError(
            f"{path}: pictures are written as .exr or .png, not as {path.suffix or 'a name without type'}"
        )
    if path.is_dir() or not path.absolute().parent.is_dir():
        raise RenderError(f"{path}: is a folder, or lies in one that does not exist; give another file")


def write_rendering(path: Path, rendering: Rendering, ev: float = 0.0, *, tone_mapping: bool = True) -> None:
    """Write a rendering; the file appears whole or not at all.

    ``.exr`` holds linear radiance in float (``R G B``, and ``A`` = 1 where there is a backdrop, else the coverage by
    which the colour is premultiplied), and the layers ``coverage``, ``Z`` (metres along the viewing axis, infinite
    where nothing is), ``normal.X Y Z`` (world) and ``albedo.R G B``; exposure is left to the reader. ``.png`` holds
    sRGB of eight bits after exposure and tone mapping, with transparency where there is no backdrop.

    Raises
    ------
    RenderError
        Where the name has another ending or the file cannot be written.
    """
    require_format(path)
    try:
        if path.suffix.lower() == ".exr":
            _write_exr(path, rendering)
        else:
            write_atomically(path, rendering_png(rendering, ev, tone_mapping=tone_mapping))
    except (OSError, RuntimeError) as error:
        raise RenderError(f"{path}: cannot be written: {error}; give another file") from None


def rendering_png(rendering: Rendering, ev: float = 0.0, *, tone_mapping: bool = True) -> bytes:
    """Return a rendering as PNG: RGB in front of a backdrop, else RGBA with straight alpha."""
    coverage = None if rendering.has_backdrop else rendering.coverage
    return picture_png(rendering.colour, coverage, ev, tone_mapping=tone_mapping)


def picture_png(
    colour: NDArray[np.float32], coverage: NDArray[np.float32] | None, ev: float = 0.0, *, tone_mapping: bool = True
) -> bytes:
    """Return radiance ``(H, W, 3)`` as PNG: RGB, or RGBA where it is premultiplied with a coverage ``(H, W)``."""
    height, width = colour.shape[:2]
    pixels = np.empty((height, width, 3 if coverage is None else 4), np.uint8)
    # Some rows at a time: in double precision, with what tone mapping holds, pixels are ten times as large.
    for top in range(0, height, BLOCK_ROWS):
        rows = slice(top, top + BLOCK_ROWS)
        shown: NDArray[np.floating] = colour[rows]
        if coverage is not None:
            shown = shown / np.where(coverage[rows] > 0, coverage[rows], 1)[..., None]
            pixels[rows, :, 3] = np.rint(coverage[rows] * 255)
        pixels[rows, :, 2::-1] = expose_and_encode(shown, ev, tone_mapping=tone_mapping)
    return _png(pixels)


def _png(pixels: NDArray[np.uint8]) -> bytes:
    ok, data = cv2.imencode(".png", np.ascontiguousarray(pixels))
    assert ok
    return data.tobytes()


def _write_exr(path: Path, rendering: Rendering) -> None:
    layers = {
        "R": rendering.colour[..., 0],
        "G": rendering.colour[..., 1],
        "B": rendering.colour[..., 2],
        "A": np.ones_like(rendering.coverage) if rendering.has_backdrop else rendering.coverage,
        "Z": rendering.depth,
        "coverage": rendering.coverage,
        **{f"normal.{axis}": rendering.normal[..., i] for i, axis in enumerate("XYZ")},
        **{f"albedo.{channel}": rendering.albedo[..., i] for i, channel in enumerate("RGB")},
    }
    write_exr_layers(path, layers)


def write_exr_layers(path: Path, layers: Mapping[str, NDArray[Any]]) -> None:
    """Write channels ``(H, W)`` by name as float OpenEXR; the file appears whole or not at all."""
    header = {"compression": COMPRESSIONS["zip"], "type": OpenEXR.scanlineimage}
    channels = {name: np.ascontiguousarray(values, dtype=np.float32) for name, values in layers.items()}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        OpenEXR.File(header, channels, num_threads=0).write(str(temporary))
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)
