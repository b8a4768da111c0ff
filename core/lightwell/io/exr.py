"""Reading and writing OpenEXR pictures."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from lightwell.errors import FrameError
from lightwell.io.files import require_file

MAX_PIXELS = 1 << 27
"""Largest picture that is read (16384×8192); a damaged header can ask for anything."""

MAGIC = b"\x76\x2f\x31\x01"

COMPRESSIONS = {
    name.removesuffix("_COMPRESSION").lower().replace("no", "none"): value
    for name, value in vars(OpenEXR).items()
    if name.endswith("_COMPRESSION") and not name.startswith("NUM_")
}
"""Compressions by their lower-case name: none, rle, zips, zip, piz, pxr24, b44, b44a, dwaa, dwab, zstd, …"""


@dataclass(frozen=True)
class ExrPicture:
    """One picture read from a file."""

    pixels: NDArray[np.float16] | NDArray[np.float32]
    """``(H, W, 3)`` linear RGB, C-contiguous; H and W are those of the display window."""
    name: str
    """The file's name without its folder."""
    capture_time_ns: int | None = None
    """Nanoseconds since the Unix epoch, UTC, where the file says when it was taken."""
    attributes: dict[str, Any] = field(default_factory=dict)
    """The header."""


class _Colour(NamedTuple):
    """Where the colour is: part number and the channels that are red, green and blue."""

    part: int
    channels: tuple[str, str, str]


def read_rgb(path: str | Path) -> ExrPicture:
    """Read the colour of an OpenEXR file.

    Any compression; scan lines or tiles; channels of type half (kept), float or uint (both float32) in any order. Of
    several parts, or layers such as ``left.R``, the first with red, green and blue counts; a file that has only a
    luminance ``Y`` is grey. Alpha is ignored. Where the data window is not the display window, the picture is the
    display window, black where there is no data. A ``capDate`` with its ``utcOffset`` becomes the capture time
    (a ``timeCode`` alone has no date and gives none).

    The GIL is released while decoding, and no threads are used: read several files on several threads instead.

    Raises
    ------
    FrameError
        Whatever is wrong with the file: missing, no file, empty, truncated, not OpenEXR, no colour, deep or subsampled
        data, an absurd size, a name that is not UTF-8. It names the file and the reason.
    """
    path = Path(path)
    _check_is_exr(path)
    parts = _open(path, header_only=True).parts
    headers = [part.header for part in parts]
    colour = _find_colour(path.name, headers)
    header = headers[colour.part]
    _check_readable(path.name, header, colour)
    data = _read_channels(path, parts[colour.part].part_index, colour)
    pixels = _in_display_window(data, header)
    return ExrPicture(pixels, path.name, _capture_time_ns(header), dict(header))


DEPTH_CHANNELS = ("Z", "depth", "Depth", "Y", "V", "R")
"""Names under which renderers and scanners keep depth, the likeliest first; also in layers."""


def read_depth(path: str | Path) -> NDArray[np.float32]:
    """Read the depth of an OpenEXR file, ``(H, W)``, as it was written.

    The first channel of `DEPTH_CHANNELS` counts, of any part or layer. Outside of the data window it is 0.

    Raises
    ------
    FrameError
        As `read_rgb`.
    """
    path = Path(path)
    _check_is_exr(path)
    parts = _open(path, header_only=True).parts
    headers = [part.header for part in parts]
    chosen = _find_depth(path.name, headers)
    _check_readable(path.name, headers[chosen.part], chosen)
    data = _read_channels(path, parts[chosen.part].part_index, chosen)
    return np.ascontiguousarray(_in_display_window(data, headers[chosen.part])[..., 0], dtype=np.float32)


def _find_depth(name: str, headers: list[dict[str, Any]]) -> _Colour:
    named = [(part, channel.name) for part, header in enumerate(headers) for channel in header["channels"]]
    for wanted in DEPTH_CHANNELS:
        for part, channel in named:
            if channel.rpartition(".")[2] == wanted:
                return _Colour(part, (channel,) * 3)
    found = ", ".join(channel for _, channel in named) or "none"
    raise FrameError(name, f"has no depth: its channels are {found}, one of {', '.join(DEPTH_CHANNELS)} is needed")


def _check_is_exr(path: Path) -> None:
    """Raise `FrameError` with a readable reason where the file cannot be OpenEXR at all."""
    require_file(path)
    try:
        with path.open("rb") as file:
            start = file.read(8)
    except FileNotFoundError:
        raise FrameError(path.name, "does not exist") from None
    except OSError as error:
        raise FrameError(path.name, f"cannot be read: {error.strerror}") from None
    if not start:
        raise FrameError(path.name, "is empty")
    if not start.startswith(MAGIC):
        kind = "; it is a PNG" if start.startswith(b"\x89PNG") else "; it is a JPEG" if start[:2] == b"\xff\xd8" else ""
        raise FrameError(path.name, f"is not an OpenEXR file{kind}")


def _open(path: Path, **options: Any) -> Any:  # noqa: ANN401
    try:
        return OpenEXR.File(str(path), num_threads=0, **options)
    except RuntimeError as error:
        # The file has been opened before: what OpenEXR cannot open is a header that it refuses.
        refused = str(error).startswith("Unable to open")
        reason = "its header cannot be read" if refused else f"OpenEXR says {error}"
        raise FrameError(path.name, f"is damaged: {reason}") from None


def _find_colour(name: str, headers: list[dict[str, Any]]) -> _Colour:
    """Return the first part and layer with red, green and blue, or else with luminance."""
    luminance = None
    found: list[str] = []
    for part, header in enumerate(headers):
        names = [channel.name for channel in header["channels"]]
        layers = sorted({channel.rpartition(".")[0] for channel in names}, key=lambda layer: (layer != "", layer))
        for layer in layers:
            prefix = f"{layer}." if layer else ""
            if all(prefix + colour in names for colour in "RGB"):
                return _Colour(part, (prefix + "R", prefix + "G", prefix + "B"))
            if prefix + "Y" in names and luminance is None:
                luminance = _Colour(part, (prefix + "Y",) * 3)
        found += names
    if luminance is None:
        raise FrameError(name, f"has no colour: its channels are {', '.join(found) or 'none'}, R, G and B are needed")
    return luminance


def _check_readable(name: str, header: dict[str, Any], colour: _Colour) -> None:
    """Raise `FrameError` for what would be read wrongly or could not be held in memory."""
    if header["type"] in (OpenEXR.deepscanline, OpenEXR.deeptile):
        raise FrameError(name, "holds deep data (several samples a pixel); flatten it first")
    for channel in header["channels"]:
        if channel.name in colour.channels and (channel.xSampling, channel.ySampling) != (1, 1):
            raise FrameError(name, f"has the subsampled channel {channel.name}; convert it to RGB of full resolution")
    for window in ("dataWindow", "displayWindow"):
        width, height = _window_size(header[window])
        if width < 1 or height < 1 or width * height > MAX_PIXELS:
            raise FrameError(name, f"has a {window} of {width}×{height} pixels; at most {MAX_PIXELS} are read")


def _window_size(window: Any) -> tuple[int, int]:  # noqa: ANN401
    """Return width and height of a window; its last row and column belong to it."""
    (x0, y0), (x1, y1) = window[0].tolist(), window[1].tolist()
    return x1 - x0 + 1, y1 - y0 + 1


def _read_channels(path: Path, part_index: int, colour: _Colour) -> NDArray[np.float16] | NDArray[np.float32]:
    """Return the colour of the data window, ``(h, w, 3)``."""
    if colour.channels == ("R", "G", "B"):
        # OpenEXR decodes these into one interleaved array; with an alpha it has four samples a pixel. Channels of
        # different types it will not put together.
        try:
            channels = _part(path, _open(path), part_index).channels
        except ValueError:
            channels = {}
        for name in ("RGB", "RGBA"):
            if name in channels and channels[name].pixels.dtype != np.uint32:
                return np.ascontiguousarray(channels[name].pixels[..., :3])
    channels = _part(path, _open(path, separate_channels=True), part_index).channels
    planes = [channels[name].pixels for name in colour.channels]
    kind = np.float16 if all(plane.dtype == np.float16 for plane in planes) else np.float32
    return np.stack([plane.astype(kind, copy=False) for plane in planes], axis=-1)


def _part(path: Path, file: Any, part_index: int) -> Any:  # noqa: ANN401
    """Return a part with its pixels. OpenEXR leaves parts out that it cannot decode."""
    for part in file.parts:
        if part.part_index == part_index and part.channels:
            return part
    raise FrameError(path.name, "is truncated or damaged: its pixels cannot be decoded")


def _in_display_window(
    data: NDArray[np.float16] | NDArray[np.float32], header: dict[str, Any]
) -> NDArray[np.float16] | NDArray[np.float32]:
    """Return the display window, with the data where its window says."""
    width, height = _window_size(header["displayWindow"])
    dx, dy = (header["dataWindow"][0] - header["displayWindow"][0]).tolist()
    if (dx, dy) == (0, 0) and data.shape[:2] == (height, width):
        return data
    picture = np.zeros((height, width, 3), data.dtype)
    rows = slice(max(dy, 0), max(min(dy + data.shape[0], height), 0))
    cols = slice(max(dx, 0), max(min(dx + data.shape[1], width), 0))
    if rows.start < rows.stop and cols.start < cols.stop:
        picture[rows, cols] = data[rows.start - dy : rows.stop - dy, cols.start - dx : cols.stop - dx]
    return picture


def _capture_time_ns(header: dict[str, Any]) -> int | None:
    """Return the time of ``capDate`` (local, whole seconds); ``utcOffset`` is what is added to it to get UTC."""
    try:
        local = datetime.strptime(header["capDate"], "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC)
    except (KeyError, TypeError, ValueError):
        return None
    seconds = local.timestamp() + float(header.get("utcOffset", 0.0))
    return round(seconds * 1e9) if seconds >= 0 else None


def write_rgb(
    path: str | Path,
    pixels: NDArray[np.floating[Any]],
    compression: str = "zstd",
    attributes: dict[str, Any] | None = None,
) -> None:
    """Write an RGB picture; the file appears whole or not at all.

    Parameters
    ----------
    path
        Where to.
    pixels
        ``(H, W, 3)`` linear RGB. float16 is written as half; everything else as float.
    compression
        A name in `COMPRESSIONS`.
    attributes
        Further header entries, such as ``capDate`` and ``utcOffset``.

    Raises
    ------
    ValueError
        Where the shape is wrong, the compression is unknown, or a half picture holds an infinity: something above
        65504 has been converted to half, which a float32 picture would have kept.
    FrameError
        Where the file cannot be written.
    """
    path = Path(path)
    if pixels.ndim != 3 or pixels.shape[2] != 3 or 0 in pixels.shape:
        raise ValueError(f"pixels have the shape {pixels.shape}; (height, width, 3) is needed")
    if compression not in COMPRESSIONS:
        raise ValueError(f"compression {compression!r} is none of {', '.join(sorted(COMPRESSIONS))}")
    if pixels.dtype == np.float16 and np.isinf(pixels).any():
        raise ValueError("a half picture holds infinite samples: radiance above 65504 needs float32 pixels")
    kind = np.float16 if pixels.dtype == np.float16 else np.float32
    header = {"compression": COMPRESSIONS[compression], "type": OpenEXR.scanlineimage, **(attributes or {})}
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        OpenEXR.File(header, {"RGB": np.ascontiguousarray(pixels, dtype=kind)}, num_threads=0).write(str(temporary))
        temporary.replace(path)
    except (RuntimeError, OSError) as error:
        raise FrameError(path.name, f"cannot be written: {error}") from None
    finally:
        temporary.unlink(missing_ok=True)
