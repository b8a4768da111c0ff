"""Video files with a known transfer function, decoded to linear light."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from av.error import FFmpegError
from av.video.format import VideoFormat
from av.video.frame import VideoFrame
from av.video.plane import VideoPlane
from av.video.stream import VideoStream
from numpy.typing import NDArray

from lightwell.errors import FrameError, SourceError
from lightwell.io.video_colour import (
    chroma_taps,
    linear_rgb,
    rec709_from,
    signal_from_codes,
    transfer_table,
)
from lightwell.probe.samples import LARGEST_HALF
from lightwell.video_settings import Matrix, Primaries, Range, Transfer, VideoSettings

# Code points of ITU-T H.273, as FFmpeg reports them.
_TRANSFERS: dict[int, Transfer] = {16: "pq", 18: "hlg", 8: "linear"}
_MATRICES: dict[int, Matrix] = {1: "bt709", 5: "bt601", 6: "bt601", 9: "bt2020"}
_PRIMARIES: dict[int, Primaries] = {1: "bt709", 9: "bt2020"}
_RANGES: dict[int, Range] = {1: "limited", 2: "full"}

_PLANAR_FORM = {
    "nv12": "yuv420p",
    "nv16": "yuv422p",
    "p010le": "yuv420p10le",
    "p210le": "yuv422p10le",
    "yuyv422": "yuv422p",
    "uyvy422": "yuv422p",
    "rgb24": "gbrp",
    "bgr24": "gbrp",
    "rgb0": "gbrp",
    "bgr0": "gbrp",
    "rgba": "gbrp",
    "bgra": "gbrp",
    "rgb48le": "gbrp16le",
    "rgba64le": "gbrp16le",
}
"""Formats that pack several components into one plane, and the planar one of the same depth and sampling."""

_DEMUXERS = (
    "mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,avi,mxf,mpeg,mpegts,mpegvideo,yuv4mpegpipe,nut,ogg,flv,asf,h264,hevc,ivf,obu"
)
_FILE_ALONE = {"protocol_whitelist": "file", "format_whitelist": _DEMUXERS}
"""FFmpeg looks at what a file holds, not at its name: a playlist would make it read others, or a network."""

PEAK_ROUNDING = 1e-5
"""How far the matrices, in float32, may leave the peak's light below the peak; a step of 16-bit codes is more."""


class Video:
    """One video of a file, in the order of its pictures. Sound is ignored."""

    def __init__(self, path: Path, settings: VideoSettings) -> None:
        """Open a file.

        PQ gives 1.0 for the settings' ``white`` cd/m² (the signal's peak is 10,000 cd/m²), HLG scene light with 1.0 for
        its peak, linear the signal itself.

        Raises
        ------
        SourceError
            Where it is no video, or nothing says which transfer function it has. The words are what comes behind the
            name of the file.
        """
        if not path.is_file():
            raise SourceError(f"is no file: {str(path)!r}")
        self.name = path.name
        try:
            self._container = av.open(str(path), options=_FILE_ALONE)
        except (FFmpegError, OSError) as error:
            raise SourceError(f"cannot be read: {error.strerror or error}: is it a video file?") from error
        try:
            if not self._container.streams.video:
                raise SourceError("holds no video")
            self._stream = self._container.streams.video[0]
            self._stream.thread_type = "AUTO"
            self._converter = _Converter(settings, self._stream)
        except SourceError:
            self._container.close()
            raise

    @property
    def rate(self) -> Fraction:
        """Pictures a second, as far as the file says."""
        return self._stream.average_rate or Fraction(30)

    def close(self) -> None:
        """Let go of the file."""
        self._container.close()

    def rewind(self) -> None:
        """Let `frames` begin at the beginning again."""
        self._container.seek(0)

    def times(self) -> NDArray[np.float64]:
        """Return when each picture is shown, ``(n,)`` rising seconds, without decoding any; then `rewind`."""
        shown = [packet.pts for packet in self._container.demux(self._stream) if packet.size and not packet.is_discard]
        base = self._stream.time_base
        if base is None or any(pts is None for pts in shown):
            return np.arange(len(shown)) / float(self.rate)
        return np.sort(np.array(shown, np.float64)) * float(base)

    def frames(self) -> Iterator[tuple[int, VideoFrame] | FrameError]:
        """Yield number and picture of what follows; one that is damaged is an error, and counts."""
        number = 0
        packets = self._container.demux(self._stream)
        while True:
            try:
                packet = next(packets, None)
                if packet is None:
                    return
                frames = packet.decode()
            except FFmpegError as error:
                yield FrameError(self.title(number), f"is damaged: {error.strerror or error}")
                number += 1
                continue
            for frame in frames:
                if frame.is_corrupt:
                    yield FrameError(self.title(number), "is damaged")
                else:
                    yield number, frame
                number += 1

    def title(self, number: int) -> str:
        """Return what a picture is called in errors."""
        return f"{self.name} frame {number}"

    def pixels(self, number: int, frame: VideoFrame) -> NDArray[np.float32]:
        """Return linear Rec. 709 RGB, ``(height, width, 3)``; raises `FrameError` where its format is not supported."""
        try:
            return self._converter.convert(frame)
        except ValueError as error:
            raise FrameError(self.title(number), str(error)) from error

    def clip_level(self, frame: VideoFrame) -> float:
        """Return the light of the signal's peak, less what rounding may take from it."""
        return self._converter.clip_level(frame.format)


class _Converter:
    """Turns decoded frames into linear Rec. 709 RGB."""

    def __init__(self, options: VideoSettings, stream: VideoStream) -> None:
        context = stream.codec_context
        transfer = options.transfer or _TRANSFERS.get(int(context.color_trc or 0))
        if transfer is None:
            raise SourceError("does not say how it is encoded")
        primaries = options.primaries or _PRIMARIES.get(int(context.color_primaries or 0), "bt709")
        self._table = transfer_table(transfer, options.white)
        self._gamut = rec709_from(primaries).astype(np.float32)
        self._matrix: Matrix = options.matrix or _MATRICES.get(
            int(context.colorspace or 0), "bt2020" if primaries == "bt2020" else "bt709"
        )
        self._range = options.range or _RANGES.get(int(context.color_range or 0))

    def clip_level(self, pixel_format: VideoFormat) -> float:
        """Return the light of the signal's peak, less what rounding may take from it."""
        if self._table.size:
            peak = float(self._table[-1])
        elif _is_float(pixel_format):
            return LARGEST_HALF
        else:
            peak = 1.0
        return peak * (1 - PEAK_ROUNDING)

    def convert(self, frame: VideoFrame) -> NDArray[np.float32]:
        """Return ``(height, width, 3)``; raises ``ValueError`` where the pixel format is unknown."""
        if not _has_one_plane_each(frame.format):
            planar = _PLANAR_FORM.get(frame.format.name)
            if planar is None:
                raise ValueError(f"has the pixel format {frame.format.name}, which is not supported")
            frame = frame.reformat(format=planar)
        pixel_format = frame.format
        planes = [_samples(frame.planes[c.plane], pixel_format, c.bits) for c in pixel_format.components[:3]]
        if len(planes) < 3:
            planes = planes[:1] * 3
        scale, offset = self._signal(pixel_format)
        height, width = planes[0].shape
        rows, row_weights = chroma_taps(height, planes[1].shape[0], centred=True)
        cols, col_weights = chroma_taps(width, planes[1].shape[1], centred=False)
        out = np.empty((height, width, 3), dtype=np.float32)
        linear_rgb(
            planes[0],
            planes[1],
            planes[2],
            rows,
            row_weights,
            cols,
            col_weights,
            scale.astype(np.float32),
            offset.astype(np.float32),
            self._table,
            self._gamut,
            out,
        )
        return out

    def _signal(self, pixel_format: VideoFormat) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        if _is_float(pixel_format):
            return np.eye(3), np.zeros(3)
        bits = pixel_format.components[0].bits
        if pixel_format.is_rgb:
            return signal_from_codes("rgb", bits, self._range or "full")
        code_range = self._range or ("full" if pixel_format.name.startswith("yuvj") else "limited")
        scale, offset = signal_from_codes(self._matrix, bits, code_range)
        if len(pixel_format.components) < 3:  # grey: Y' alone
            scale, offset = signal_from_codes("rgb", bits, code_range)
        return scale, offset


def _has_one_plane_each(pixel_format: VideoFormat) -> bool:
    planes = [component.plane for component in pixel_format.components]
    return len(set(planes)) == len(planes)


def _is_float(pixel_format: VideoFormat) -> bool:
    return pixel_format.name.endswith(("f16le", "f16be", "f32le", "f32be"))


def _samples(plane: VideoPlane, pixel_format: VideoFormat, bits: int) -> NDArray[Any]:
    """Return the plane's samples, ``(height, width)``, uint8, uint16 or float32."""
    kind = "f" if _is_float(pixel_format) else "u"
    dtype = np.dtype(f"{'>' if pixel_format.is_big_endian else '<'}{kind}{1 if bits <= 8 else 2 if bits <= 16 else 4}")
    rows = np.frombuffer(memoryview(plane), dtype=dtype).reshape(plane.height, plane.line_size // dtype.itemsize)
    samples = rows[:, : plane.width]
    if kind == "f":
        return samples.astype(np.float32)
    return np.ascontiguousarray(samples, dtype=dtype.newbyteorder("="))
