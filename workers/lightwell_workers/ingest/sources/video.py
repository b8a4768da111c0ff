"""``video:FILE``: a video file with a known transfer function, to linear light."""

from __future__ import annotations

from collections.abc import Generator, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import av
import numpy as np
from av.error import FFmpegError
from av.video.format import VideoFormat
from av.video.frame import VideoFrame
from av.video.plane import VideoPlane
from av.video.stream import VideoStream
from numpy.typing import NDArray
from pydantic import Field

from lightwell.errors import FrameError, SourceError
from lightwell.probe.samples import LARGEST_HALF
from lightwell.settings import Settings
from lightwell_workers.ingest.colour import (
    REFERENCE_WHITE,
    Matrix,
    Primaries,
    Range,
    Transfer,
    chroma_taps,
    linear_rgb,
    rec709_from,
    signal_from_codes,
    transfer_table,
)
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, EndOfRecordingError, Picture, Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options

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

PEAK_ROUNDING = 1e-5
"""How far the matrices, in float32, may leave the peak's light below the peak; a step of 16-bit codes is more."""


class VideoOptions(Settings):
    """What the query of a ``video:`` URL may set; what a file is tagged with need not be said."""

    transfer: Transfer | None = Field(None, description="transfer function: pq, hlg or linear")
    matrix: Literal["bt601", "bt709", "bt2020"] | None = Field(None, description="YCbCr matrix")
    primaries: Primaries | None = Field(None, description="primaries: bt709 or bt2020; the result is Rec. 709")
    range: Range | None = Field(None, description="range of the codes: limited or full")
    white: float = Field(REFERENCE_WHITE, gt=0, description="pq: luminance that becomes 1.0, cd/m²")
    fps: float | None = Field(None, gt=0, le=1000, description="frame rate, where not the file's own")
    loop: bool = Field(False, description="start again at the end")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")


def open_video(url: SourceUrl, clock: Clock | None = None) -> Playback:
    """Open a video file.

    PQ gives 1.0 for ``white`` cd/m² (the signal's peak is 10,000 cd/m²), HLG scene light with 1.0 for its peak,
    linear the signal itself. Sound is ignored; a frame that is damaged is skipped.

    Raises
    ------
    SourceError
        Where the file is no video, or nothing says which transfer function it has.
    """
    options = parse_options(url, VideoOptions)
    path = Path(url.target)
    if not path.is_file():
        raise SourceError(f"source {url.text!r}: there is no file {url.target!r}")
    try:
        container = av.open(str(path))
    except FFmpegError as error:
        raise SourceError(f"source {url.text!r}: {error.strerror or error}: is it a video file?") from error
    if not container.streams.video:
        container.close()
        raise SourceError(f"source {url.text!r} holds no video")
    stream = container.streams.video[0]
    try:
        converter = _Converter(url, options, stream)
    except SourceError:
        container.close()
        raise
    rate = Fraction(options.fps).limit_denominator(100_000) if options.fps else stream.average_rate or Fraction(30)
    reader = _VideoReader(path.name, container, stream, converter, options.loop)
    return Playback(url.text, reader, round(NANOSECONDS / rate), realtime=options.realtime, clock=clock)


class _VideoReader:
    """Decodes in file order; a position that is asked for later than its turn is decoded and thrown away."""

    length: int | None = None
    threads = 1

    def __init__(
        self,
        name: str,
        container: av.container.InputContainer,
        stream: VideoStream,
        converter: _Converter,
        loop: bool,
    ) -> None:
        self._name = name
        self._container = container
        self._stream = stream
        self._stream.thread_type = "AUTO"
        self._converter = converter
        self._loop = loop
        self._items = self._decode_forever()
        self._item: tuple[int, VideoFrame] | FrameError | None = None
        self._position = -1

    def read(self, position: int) -> Picture:
        while self._position < position:
            self._item = next(self._items, None)
            self._position += 1
        if self._item is None:
            raise EndOfRecordingError
        if isinstance(self._item, FrameError):
            raise self._item
        number, frame = self._item
        name = f"{self._name} frame {number}"
        try:
            pixels = self._converter.convert(frame)
        except ValueError as error:
            raise FrameError(name, str(error)) from error
        return Picture(pixels=pixels, name=name, clip_level=self._converter.clip_level(frame.format))

    def close(self) -> None:
        self._items.close()
        self._container.close()

    def _decode_forever(self) -> Generator[tuple[int, VideoFrame] | FrameError, None, None]:
        while True:
            count = 0
            for item in self._decode_once():
                count += isinstance(item, tuple)
                yield item
            if not self._loop or count == 0:
                return
            self._container.seek(0)

    def _decode_once(self) -> Iterator[tuple[int, VideoFrame] | FrameError]:
        number = 0
        packets = self._container.demux(self._stream)
        while True:
            try:
                packet = next(packets, None)
                if packet is None:
                    return
                frames = packet.decode()
            except FFmpegError as error:
                yield FrameError(f"{self._name} frame {number}", f"is damaged: {error.strerror or error}")
                number += 1
                continue
            for frame in frames:
                if frame.is_corrupt:
                    yield FrameError(f"{self._name} frame {number}", "is damaged")
                else:
                    yield number, frame
                number += 1


class _Converter:
    """Turns decoded frames into linear Rec. 709 RGB."""

    def __init__(self, url: SourceUrl, options: VideoOptions, stream: VideoStream) -> None:
        context = stream.codec_context
        transfer = options.transfer or _TRANSFERS.get(int(context.color_trc or 0))
        if transfer is None:
            raise SourceError(f"source {url.text!r} does not say how it is encoded: add ?transfer=pq, hlg or linear")
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
