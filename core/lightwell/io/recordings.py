"""Recorded light over time, whatever kind of file holds it.

=================================  ============================================  ======================
what                               named by                                      times
=================================  ============================================  ======================
pictures                           a folder, ``dir/*.exr``, ``frame.%04d.exr``   none: one after another
a video                            its file                                      the file's
coefficients                       lines of ``lightwell watch STREAM --json``    capture times
=================================  ============================================  ======================
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import FrameError, LightwellError, RenderError, SourceError
from lightwell.io.files import require_file
from lightwell.io.pictures import read_picture
from lightwell.io.recorded_lines import read_lines
from lightwell.io.sequences import MOST, find_sequence
from lightwell.io.videos import Video
from lightwell.scene_settings import LINE_SUFFIXES
from lightwell.video_settings import VideoSettings

Floats = NDArray[np.float64]

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".webm", ".avi", ".mxf", ".mpg", ".mpeg", ".ts", ".y4m", ".nut")
GAP_STEPS, GAP_SECONDS = 5.0, 0.5
"""Frames further apart than so many usual steps, and than so many seconds, have a gap between them."""
SAME_MOMENT = 1e-3
"""Of a step: moments that are closer than that to a frame are its own."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Frames in their order; `coefficients`, or pictures that `read_recorded_picture` reads."""

    name: str
    """What the recording is called in errors."""
    pictures: tuple[tuple[Path, int | None], ...]
    """File of each frame, and which frame of a video that is; empty where there are coefficients."""
    coefficients: Floats | None
    """``(n, bands², 3)`` of radiance."""
    times: Floats | None
    """``(n,)`` rising seconds since the first frame; None: frames follow each other evenly, at no known pace."""
    remarks: tuple[str, ...] = ()
    """What is missing in it, one line each."""

    @property
    def count(self) -> int:
        """How many frames."""
        return len(self.pictures) if self.coefficients is None else len(self.coefficients)

    @property
    def step(self) -> float:
        """Usual time between two frames, seconds; 0 where there is but one, or where times are not known."""
        return float(np.median(np.diff(self.times))) if self.times is not None and self.count > 1 else 0.0

    def frame(self, number: int) -> int:
        """Return the index of a frame that is counted from 0, or from the end where it is negative.

        Raises
        ------
        RenderError
            Where there is none.
        """
        if not -self.count <= number < self.count:
            raise RenderError(f"{self.name}: has no frame {number}: it has {self.count}, 0 … {self.count - 1}")
        return number % self.count

    def film_length(self, fps: float) -> int:
        """Return how many pictures show the whole of it: each frame once, or at its own pace where that is known."""
        if self.times is None:
            return self.count
        return max(1, round((float(self.times[-1]) + self.step) * fps))

    def moments(self, count: int, fps: float) -> Floats:
        """Return which frame each of ``count`` pictures shows, ``(count,)``.

        As many as `film_length` play at the recording's own pace, others are spread evenly over the whole of it.
        Pictures are shown until the next one comes; coefficients are linear in time between two frames, which
        `light_at` takes a fractional part for.
        """
        if self.times is None:
            return np.floor(np.arange(count) * self.count / count)
        seconds = 1 / fps if count == self.film_length(fps) else (float(self.times[-1]) + self.step) / count
        at = np.arange(count) * seconds
        near = SAME_MOMENT * self.step
        index = np.clip(np.searchsorted(self.times, at + near, "right") - 1, 0, self.count - 1)
        if self.coefficients is None or self.count == 1:
            return np.asarray(index, np.float64)
        following = np.minimum(index + 1, self.count - 1)
        span = self.times[following] - self.times[index]
        part = np.clip(np.divide(at - self.times[index], span, out=np.zeros(count), where=span > 0), 0, 1)
        return np.asarray(index + np.where(part * span < near, 0.0, part), np.float64)

    def light_at(self, moment: float) -> Floats:
        """Return the coefficients at a moment of `moments`, ``(bands², 3)``."""
        assert self.coefficients is not None
        first = int(moment)
        part = moment - first
        found: Floats = self.coefficients[first]
        return found if part == 0 else (1 - part) * found + part * self.coefficients[first + 1]


def open_recording(named: str, video: VideoSettings | None = None, stream: str | None = None) -> Recording:
    """Look what a recording holds.

    Parameters
    ----------
    named
        Folder, file, glob or printf pattern; its ending says what it is.
    video
        How a video's signal stands for light, where its file does not say.
    stream
        Which stream, where lines of several were recorded.

    Raises
    ------
    LightwellError
        Names the file, what is wrong with it, and what would help.
    """
    path = Path(named)
    suffix = path.suffix.lower()
    try:
        is_there, is_folder = path.exists(), path.is_dir()
    except OSError as error:
        raise FrameError(path.name, f"cannot be read: {error.strerror}") from None
    if is_folder or (not is_there and any(mark in path.name for mark in "*?[%")):
        return _sequence(named)
    if not is_there:
        raise FrameError(path.name, "does not exist")
    require_file(path)
    if suffix in LINE_SUFFIXES:
        return _lines(path, stream)
    if suffix in VIDEO_SUFFIXES:
        return _video(path, video or VideoSettings())
    return Recording(path.name, ((path, None),), None, None)


def read_recorded_picture(
    path: Path, number: int | None, video: VideoSettings | None = None, check: Callable[[], None] | None = None
) -> NDArray[np.float16] | NDArray[np.float32]:
    """Return one picture of `Recording.pictures`, ``(H, W, 3)`` linear Rec. 709.

    Videos are decoded from their beginning, and go on from the picture that was read last; ``check`` is called with
    each picture on the way, and may raise.

    Raises
    ------
    FrameError
        Where it cannot be read: names the file and the frame.
    """
    if number is None:
        return read_picture(path).pixels
    try:
        state = path.stat()
    except OSError as error:
        raise FrameError(path.name, f"cannot be read: {error.strerror}") from None
    return _frames(str(path), state.st_mtime_ns, state.st_size, video or VideoSettings()).read(number, check)


def _lines(path: Path, stream: str | None) -> Recording:
    found = read_lines(path, stream)
    if found.times_ns is None:
        return Recording(path.name, (), found.coefficients, None)
    numbers, times = found.numbers, (found.times_ns - found.times_ns[0]) / 1e9
    remarks: list[str] = []
    first = 0
    wide = _gaps(times)
    if found.from_hello and len(wide) and wide[0] == 0:
        first, wide = 1, wide[1:]
        remarks.append(f"{path.name}: the frame of line {numbers[0]} is from before the recording: it is left out")
    if len(wide):
        steps = np.diff(times)
        longest = wide[np.argmax(steps[wide])]
        gaps = "a gap" if len(wide) == 1 else f"{len(wide)} gaps, the longest"
        remarks.append(
            f"{path.name}: has {gaps} of {steps[longest]:.1f} s after line {numbers[longest]}: the light is blended"
            " across"
        )
    return Recording(path.name, (), found.coefficients[first:], times[first:] - times[first], tuple(remarks))


def _gaps(times: Floats) -> NDArray[np.int64]:
    """Return the frames behind which frames are missing."""
    steps = np.diff(times)
    if len(steps) == 0:
        return np.zeros(0, np.int64)
    return np.flatnonzero(steps > max(GAP_SECONDS, GAP_STEPS * float(np.median(steps))))


def _sequence(named: str) -> Recording:
    entries = find_sequence(named)
    missing = [entry.name for entry in entries if entry.path is None]
    shown: list[tuple[Path, int | None]] = []
    for entry in entries:
        shown.append(shown[-1] if entry.path is None else (entry.path, None))
    remarks: list[str] = []
    if missing:
        remarks.append(
            f"{Path(named).name}: {len(missing)} of {len(entries)} frames are missing, the first is {missing[0]}: the"
            " one before is shown instead"
        )
    return Recording(Path(named).name, tuple(shown), None, None, tuple(remarks))


def _video(path: Path, settings: VideoSettings) -> Recording:
    video = _opened(path, settings)
    try:
        times = video.times()
    finally:
        video.close()
    if not len(times):
        raise SourceError(f"{path.name}: holds no picture")
    if len(times) > MOST:
        raise SourceError(f"{path.name}: holds more than {MOST} pictures: cut it")
    return Recording(path.name, tuple((path, number) for number in range(len(times))), None, times - times[0])


def _opened(path: Path, settings: VideoSettings) -> Video:
    try:
        return Video(path, settings)
    except SourceError as error:
        remedy = ": give light.video.transfer: pq, hlg or linear" if "encoded" in str(error) else ""
        raise SourceError(f"{path.name}: {error}{remedy}") from None


class _Frames:
    """The pictures of a video by number, quickest one after the other."""

    def __init__(self, path: Path, settings: VideoSettings) -> None:
        self._video = _opened(path, settings)
        self._lock = threading.Lock()
        self._items = self._video.frames()
        self._shown: tuple[int, NDArray[np.float32]] | None = None
        self._next = 0

    def read(self, number: int, check: Callable[[], None] | None) -> NDArray[np.float32]:
        with self._lock:
            if self._shown is not None and self._shown[0] == number:
                return self._shown[1]
            if number < self._next:
                self._video.rewind()
                self._items, self._next = self._video.frames(), 0
            for item in self._items:
                self._next += 1
                if self._next <= number:
                    if check is not None:
                        check()
                    continue
                if isinstance(item, LightwellError):
                    raise item
                pixels = self._video.pixels(*item)
                self._shown = (number, pixels)
                return pixels
            self._next = number + 1  # what follows is to begin anew
            raise FrameError(self._video.title(number), "cannot be decoded: the file is cut short or damaged")


@lru_cache(maxsize=2)
def _frames(path: str, changed_ns: int, size: int, settings: VideoSettings) -> _Frames:
    del changed_ns, size  # tell apart what may lie at the path one after the other
    return _Frames(Path(path), settings)
