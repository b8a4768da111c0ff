"""Reading and writing OpenEXR pictures."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lightwell.errors import FrameError


@dataclass(frozen=True)
class ExrPicture:
    """One picture read from a file."""

    pixels: NDArray[np.float16] | NDArray[np.float32]
    """``(H, W, 3)`` linear RGB, C-contiguous."""
    name: str
    capture_time_ns: int | None = None
    attributes: dict[str, Any] = field(default_factory=dict)


def read_rgb(path: str | Path) -> ExrPicture:
    """Read the RGB of an OpenEXR file."""
    path = Path(path)
    try:
        file = OpenEXR.File(str(path), num_threads=0)
        channels = file.channels()
        for name in ("RGB", "RGBA"):
            if name in channels:
                pixels = np.ascontiguousarray(channels[name].pixels[..., :3])
                return ExrPicture(pixels, path.name, None, dict(file.header()))
    except (RuntimeError, ValueError) as error:
        raise FrameError(path.name, str(error)) from None
    raise FrameError(path.name, "holds no colour channels")


def write_rgb(
    path: str | Path,
    pixels: NDArray[np.float16] | NDArray[np.float32],
    compression: str = "zstd",
    attributes: dict[str, Any] | None = None,
) -> None:
    """Write an RGB picture; the file appears whole or not at all."""
    path = Path(path)
    kind = getattr(OpenEXR, f"{compression.upper()}_COMPRESSION")
    temporary = path.with_name(f".{path.name}.partial")
    header = {"compression": kind, "type": OpenEXR.scanlineimage} | (attributes or {})
    OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels)}).write(str(temporary))
    temporary.replace(path)
