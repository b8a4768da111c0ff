"""Reading any HDR picture that Lightwell understands."""

from __future__ import annotations

from pathlib import Path

from lightwell.errors import FrameError
from lightwell.io.exr import ExrPicture, read_rgb


def read_picture(path: str | Path) -> ExrPicture:
    """Read a picture."""
    path = Path(path)
    if path.suffix.lower() != ".exr":
        raise FrameError(path.name, "is not HDR")
    return read_rgb(path)
