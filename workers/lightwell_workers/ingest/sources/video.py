"""``video:FILE``: a video file with a known transfer function, to linear light."""

from __future__ import annotations

from collections.abc import Generator
from fractions import Fraction
from pathlib import Path

from av.video.frame import VideoFrame
from pydantic import Field

from lightwell.errors import FrameError, SourceError
from lightwell.io.videos import Video
from lightwell.video_settings import VideoSettings
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, EndOfRecordingError, Picture, Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options


class VideoOptions(VideoSettings):
    """What the query of a ``video:`` URL may set."""

    fps: float | None = Field(None, gt=0, le=1000, description="frame rate, where not the file's own")
    loop: bool = Field(False, description="start again at the end")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")


def open_video(url: SourceUrl, clock: Clock | None = None) -> Playback:
    """Open a video file; a frame that is damaged is skipped.

    Raises
    ------
    SourceError
        Where the file is no video, or nothing says which transfer function it has.
    """
    options = parse_options(url, VideoOptions)
    try:
        video = Video(Path(url.target), options)
    except SourceError as error:
        remedy = ": add ?transfer=pq, hlg or linear" if "encoded" in str(error) else ""
        raise SourceError(f"source {url.text!r} {error}{remedy}") from error
    rate = Fraction(options.fps).limit_denominator(100_000) if options.fps else video.rate
    reader = _VideoReader(video, options.loop)
    return Playback(url.text, reader, round(NANOSECONDS / rate), realtime=options.realtime, clock=clock)


class _VideoReader:
    """Decodes in file order; a position that is asked for later than its turn is decoded and thrown away."""

    length: int | None = None
    threads = 1

    def __init__(self, video: Video, loop: bool) -> None:
        self._video = video
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
        pixels = self._video.pixels(number, frame)
        return Picture(pixels=pixels, name=self._video.title(number), clip_level=self._video.clip_level(frame))

    def close(self) -> None:
        self._items.close()
        self._video.close()

    def _decode_forever(self) -> Generator[tuple[int, VideoFrame] | FrameError, None, None]:
        while True:
            count = 0
            for item in self._video.frames():
                count += isinstance(item, tuple)
                yield item
            if not self._loop or count == 0:
                return
            self._video.rewind()
