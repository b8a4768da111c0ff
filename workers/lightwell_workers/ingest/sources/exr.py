"""``exr:PATTERN``: a recorded sequence of EXR files, played as a fake camera."""

from __future__ import annotations

from pydantic import Field

from lightwell.errors import FrameError, SourceError
from lightwell.io.exr import read_rgb
from lightwell.settings import Settings
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, READERS, Picture, Playback
from lightwell_workers.ingest.sources.sequence import SequenceEntry, find_sequence
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options


class ExrOptions(Settings):
    """What the query of an ``exr:`` URL may set."""

    fps: float = Field(30.0, gt=0, le=1000, description="frame rate of the recording")
    loop: bool = Field(False, description="start again at the end")
    speed: float = Field(1.0, gt=0, le=1000, description="pace: 2 plays twice as fast")
    step: int = Field(1, ge=1, description="play every n-th frame, at the recording's own pace")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")
    first: int | None = Field(None, ge=0, description="first frame: its number in a printf pattern, else its position")
    last: int | None = Field(None, ge=0, description="last frame, inclusive")


def open_exr(url: SourceUrl, clock: Clock | None = None) -> Playback:
    """Open a sequence.

    A frame is due every ``step / (fps · speed)`` seconds.

    Raises
    ------
    SourceError
        Where nothing matches the pattern, or none of the first files can be read.
    """
    options = parse_options(url, ExrOptions)
    if not url.target:
        raise SourceError(f"source {url.text!r} names no files: exr:FOLDER, exr:dir/*.exr or exr:dir/frame.%04d.exr")
    entries = find_sequence(url.target, options.first, options.last)[:: options.step]
    _require_one_readable(url, entries)
    interval_ns = round(NANOSECONDS * options.step / (options.fps * options.speed))
    return Playback(url.text, _ExrReader(entries, options.loop), interval_ns, realtime=options.realtime, clock=clock)


class _ExrReader:
    threads = READERS

    def __init__(self, entries: list[SequenceEntry], loop: bool) -> None:
        self._entries = entries
        self.length = None if loop else len(entries)

    def read(self, position: int) -> Picture:
        entry = self._entries[position % len(self._entries)]
        if entry.path is None:
            raise FrameError(entry.name, "is missing from the sequence")
        try:
            picture = read_rgb(entry.path)
        except FrameError as error:
            raise FrameError(entry.name, error.reason) from error
        return Picture(pixels=picture.pixels, name=entry.name, capture_time_ns=picture.capture_time_ns)

    def close(self) -> None:
        pass


def _require_one_readable(url: SourceUrl, entries: list[SequenceEntry]) -> None:
    reason = ""
    for entry in entries:
        if entry.path is None:
            continue
        try:
            read_rgb(entry.path)
        except FrameError as error:
            reason = reason or str(error)
        else:
            return
    raise SourceError(f"source {url.text!r} has no frame that can be read ({reason}): is it a folder of EXR pictures?")
