"""Pictures of heights, for bumps: grey ones of 8 or 16 bits, or OpenEXR."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import FrameError
from lightwell.io.files import require_file
from lightwell.io.pictures import read_picture
from lightwell.io.texture_pixels import MAX_TEXTURE_PIXELS


def read_heights(path: Path) -> NDArray[np.float32]:
    """Return heights ``(H, W, 1)``, finite: the brightness of a picture, 0 … 1; the green of ``.exr`` and ``.hdr``.

    Raises
    ------
    FrameError
        Where the picture cannot be read: names the file, and what would do.
    """
    from PIL import Image, UnidentifiedImageError

    if path.suffix.lower() in (".exr", ".hdr"):
        heights = np.ascontiguousarray(read_picture(path).pixels[:, :, 1:2], np.float32)
        if not np.isfinite(heights).all():
            raise FrameError(path.name, "holds heights that are not finite: repair them")
        return heights
    require_file(path)
    try:
        with Image.open(path) as picture:
            if picture.size[0] * picture.size[1] > MAX_TEXTURE_PIXELS:
                raise FrameError(path.name, f"has more than {MAX_TEXTURE_PIXELS} pixels: shrink it")
            # Pillow cuts 16 bits off at 255 instead of scaling them.
            deep = picture.mode.startswith("I")
            values = np.asarray(picture if deep else picture.convert("L")).astype(np.float32)
    except FileNotFoundError:
        raise FrameError(path.name, "does not exist") from None
    except (OSError, ValueError, SyntaxError, UnidentifiedImageError, Image.DecompressionBombError):
        raise FrameError(path.name, "is no picture, or damaged; heights are PNG, JPEG or .exr") from None
    return (values / np.float32(65535 if deep else 255))[:, :, None]
