"""Reading any HDR picture that Lightwell understands."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np

from lightwell.errors import FrameError
from lightwell.io.exr import MAGIC, ExrPicture, read_rgb
from lightwell.io.files import require_file

# What OpenCV would print about a damaged picture goes into the error that names the picture.
cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)

LDR_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".gif", ".webp", ".tif", ".tiff", ".heic", ".avif"}


def read_picture(path: str | Path) -> ExrPicture:
    """Read an OpenEXR (``.exr``) or Radiance (``.hdr``, ``.pic``) picture as linear RGB.

    Raises
    ------
    FrameError
        As `read_rgb`; and for other formats, which cannot hold the range of real light.
    """
    path = Path(path)
    require_file(path)
    suffix = path.suffix.lower()
    if suffix in (".hdr", ".pic"):
        return _read_radiance(path)
    if suffix == ".exr" or _starts_with(path, MAGIC):
        return read_rgb(path)
    if suffix in LDR_SUFFIXES:
        raise FrameError(path.name, f"is not HDR: {suffix[1:].upper()} cannot hold real light; use .exr or .hdr")
    if not path.exists():
        raise FrameError(path.name, "does not exist")
    raise FrameError(path.name, "is not HDR: only OpenEXR (.exr) and Radiance (.hdr) pictures are read")


def _starts_with(path: Path, magic: bytes) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(len(magic)) == magic
    except OSError:
        return False


def _read_radiance(path: Path) -> ExrPicture:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise FrameError(path.name, "does not exist") from None
    except OSError as error:
        raise FrameError(path.name, f"cannot be read: {error.strerror}") from None
    if not data:
        raise FrameError(path.name, "is empty")
    if not data.startswith(b"#?"):
        raise FrameError(path.name, "is not a Radiance picture")
    _require_supported(path.name, data)
    try:
        decoded = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        raise FrameError(path.name, f"is damaged: {error.err}") from None
    if decoded is None or decoded.ndim != 3 or decoded.dtype != np.float32:
        raise FrameError(path.name, "is truncated or damaged: its pixels cannot be decoded")
    return ExrPicture(np.ascontiguousarray(decoded[..., ::-1], dtype=np.float32), path.name)


def _require_supported(name: str, data: bytes) -> None:
    """Raise `FrameError` for what the format allows and OpenCV does not read: XYZ colour, other orders of pixels."""
    header, _, rest = data.partition(b"\n\n")
    if b"\nFORMAT=32-bit_rle_xyze" in header:
        raise FrameError(name, "holds XYZ colour (32-bit_rle_xyze), which is not supported; convert it with ra_xyze -r")
    resolution = rest.partition(b"\n")[0].strip()
    if re.fullmatch(rb"[+-][XY] +\d+ +[+-][XY] +\d+", resolution) and not re.match(rb"-Y +\d+ +\+X", resolution):
        raise FrameError(
            name,
            f"has the orientation {resolution.decode()}, which is not supported; save it from the top left (-Y +X)",
        )
