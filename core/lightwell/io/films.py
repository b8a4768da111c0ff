"""Writing films: MP4 (H.264) by PyAV."""

from __future__ import annotations

import errno
import os
from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.error import FFmpegError
from av.video.stream import VideoStream
from numpy.typing import NDArray

from lightwell.errors import RenderError

CODEC = "libx264"
QUALITY = "16"
"""Constant rate factor: hardly to be told from the pictures."""
FULL = (errno.ENOSPC, errno.EDQUOT)
BT709, SRGB, LIMITED = 1, 13, 1
"""Numbers of ITU-T H.273: what players would guess differs."""


def write_film(path: Path, pictures: Iterable[NDArray[np.uint8]], fps: float) -> None:
    """Write pictures ``(H, W, 3)`` sRGB of one size, which may be one; the film appears whole or not at all.

    H.264 keeps colour for pairs of pixels: an odd last row or column is repeated. The same pictures give the same
    bytes.

    Raises
    ------
    RenderError
        Where it cannot be written.
    OSError
        Where the disk is full.
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}.partial{path.suffix}")
    try:
        _write(temporary, pictures, Fraction(fps).limit_denominator(1001))
        temporary.replace(path)
    except (FFmpegError, OSError, ValueError) as error:
        if isinstance(error, FFmpegError | OSError) and error.errno in FULL:
            raise OSError(error.errno, os.strerror(error.errno), str(path)) from None
        raise RenderError(f"{path.name}: the film cannot be written: {error}") from None
    finally:
        temporary.unlink(missing_ok=True)


def _write(path: Path, pictures: Iterable[NDArray[np.uint8]], rate: Fraction) -> None:
    # One thread: what several make depends on how many there are. x264's mb-tree reads memory that it has not written
    # (core 165, as MALLOC_PERTURB_ shows), and its bytes then differ from process to process.
    options = {"crf": QUALITY, "preset": "medium", "threads": "1", "x264-params": "mbtree=0"}
    container = {"movflags": "+faststart", "fflags": "+bitexact"}
    with av.open(str(path), "w", format="mp4", options=container) as film:
        stream: VideoStream | None = None
        for picture in pictures:
            even = np.pad(picture, ((0, picture.shape[0] % 2), (0, picture.shape[1] % 2), (0, 0)), mode="edge")
            if stream is None:
                added = film.add_stream(CODEC, rate=rate, options=options)
                assert isinstance(added, VideoStream)
                stream = added
                stream.height, stream.width = even.shape[:2]
                stream.pix_fmt = "yuv420p"
                context = stream.codec_context
                context.color_primaries = context.colorspace = BT709
                context.color_trc, context.color_range = SRGB, LIMITED
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")
            for packet in stream.encode(frame.reformat(format="yuv420p", dst_colorspace="ITU709")):
                film.mux(packet)
        if stream is None:
            raise ValueError("there are no pictures")
        for packet in stream.encode():
            film.mux(packet)
