"""Playing numbered pictures as a camera would deliver them: read ahead, paced, the newest first."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import FrameError
from lightwell.probe.samples import LARGEST_HALF
from lightwell_workers.ingest.frame import Frame, Pixels
from lightwell_workers.ingest.sources.clock import Clock, SystemClock

READERS = 2
"""Pictures that are read at the same time: decoding releases the GIL and scales to two threads (DATA.md §3)."""

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """What a reader read."""

    pixels: Pixels
    name: str
    capture_time_ns: int | None = None
    """When it was captured, where the recording says so."""
    clip_level: float = LARGEST_HALF
    truth: NDArray[np.float64] | None = None
    world_from_camera: NDArray[np.float64] | None = None
    position_m: NDArray[np.float64] | None = None


class EndOfRecordingError(Exception):
    """There is no picture at this position and none behind it."""


class Reader(Protocol):
    """Pictures by position, counted from 0."""

    length: int | None
    """How many positions there are; None where only reading tells (`EndOfRecordingError`), or there is no end."""
    threads: int
    """How many positions may be read at the same time; with 1 none is asked for that lies before the last one."""

    def read(self, position: int) -> Picture:
        """Return the picture at ``position``; raises `FrameError` where it cannot be used."""

    def close(self) -> None:
        """Let go of files."""


@dataclass(slots=True)
class _Pending:
    position: int
    picture: Future[tuple[Picture, float]]

    @property
    def is_end(self) -> bool:
        """Whether the read has told that the recording ends before this position."""
        return self.picture.done() and isinstance(self.picture.exception(), EndOfRecordingError)

    @property
    def is_read(self) -> bool:
        """Whether there is a picture, or an error in its place, to deliver."""
        return self.picture.done() and not self.is_end


class Playback:
    """A source that plays a reader's pictures at a fixed rate.

    In real time position ``p`` is due at ``start + p · interval``: deadlines are absolute, so lateness never adds up.
    When several pictures are due, the newest that has been read is delivered and the ones before it are dropped and
    counted. The capture time is the wall-clock time at which the picture was due.

    As fast as possible (``realtime=False``) every picture is delivered. The capture time is then the first picture's
    own, where the recording says it, or else the start, plus ``p · interval``: files know whole seconds only, which is
    too coarse for what follows.
    """

    def __init__(
        self, url: str, reader: Reader, interval_ns: int, *, realtime: bool, clock: Clock | None = None
    ) -> None:
        self.url = url
        self.is_live = realtime
        self.interval_seconds = interval_ns / NANOSECONDS
        self._reader = reader
        self._interval_ns = interval_ns
        self._clock: Clock = clock or SystemClock()
        self._closed = threading.Event()
        self._reader_taken = False
        self._taking_reader = threading.Lock()
        self._dropped = 0
        self._length = reader.length

    @property
    def frames_dropped(self) -> int:
        """Pictures that were overtaken by a newer one."""
        return self._dropped

    def close(self) -> None:
        """End the iteration, also while it waits; the iteration then closes the reader, if it ever began."""
        self._closed.set()
        if self._take_reader():
            self._reader.close()

    def __enter__(self) -> Self:
        """Return the source."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close it."""
        self.close()

    def first_picture(self) -> Pixels | None:
        """Return the first picture; None where it cannot be used, or the source is closed."""
        with self._taking_reader:
            if self._reader_taken:
                return None
            try:
                return self._reader.read(0).pixels
            except (FrameError, EndOfRecordingError):
                return None

    def __iter__(self) -> Iterator[Frame | FrameError]:
        """Yield the frames."""
        if not self._take_reader():
            return
        pool = ThreadPoolExecutor(self._reader.threads, thread_name_prefix="source")
        try:
            yield from self._play_live(pool) if self.is_live else self._play_all(pool)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            self._reader.close()

    def _take_reader(self) -> bool:
        """Return True to the first caller, who then has to close the reader."""
        with self._taking_reader:
            is_first, self._reader_taken = not self._reader_taken, True
        return is_first

    def _play_all(self, pool: ThreadPoolExecutor) -> Iterator[Frame | FrameError]:
        start_ns: int | None = None
        pending: deque[_Pending] = deque()
        position = 0
        while not self._closed.is_set():
            while len(pending) <= self._reader.threads and self._exists(position):
                pending.append(self._submit(pool, position))
                position += 1
            if not pending:
                return
            taken = pending.popleft()
            try:
                picture, source_ms = taken.picture.result()
            except EndOfRecordingError:
                return
            except FrameError as error:
                yield error
                continue
            offset_ns = taken.position * self._interval_ns
            wall_ns = self._clock.wall_ns()
            if start_ns is None:
                start_ns = (picture.capture_time_ns or wall_ns) - offset_ns
            yield _frame(picture, source_ms, start_ns + offset_ns, wall_ns)

    def _play_live(self, pool: ThreadPoolExecutor) -> Iterator[Frame | FrameError]:
        pending: deque[_Pending] = deque()
        position = 0
        start_ns: int | None = None  # the first picture is due as soon as it has been read
        just_asked = True
        while not self._closed.is_set():
            self._learn_length(pending)
            newest_due = 0 if start_ns is None else (self._clock.steady_ns() - start_ns) // self._interval_ns
            if self._length is not None:
                newest_due = min(newest_due, self._length - 1)

            # Drop what is overtaken: pictures read ahead, when a newer one is due that is not being read yet (but not
            # those that finish while we wait, or a slow disk would never deliver), and positions never asked for.
            if just_asked and position <= newest_due:
                self._drop(pending, max((i + 1 for i, p in enumerate(pending) if p.is_read), default=0))
            just_asked = False
            if position < newest_due:
                self._dropped += newest_due - position
                position = newest_due

            # Keep the readers busy, also while the picture that is delivered next is being worked on.
            while len(pending) <= self._reader.threads and self._exists(position):
                pending.append(self._submit(pool, position))
                position += 1
            if not pending:
                return

            # Wait until a picture is due and read.
            ready = [i for i, p in enumerate(pending) if p.position <= newest_due and p.is_read]
            if not ready:
                due = [p.picture for p in pending if p.position <= newest_due]
                if due:
                    wait(due, timeout=self._interval_ns / NANOSECONDS, return_when=FIRST_COMPLETED)
                elif start_ns is not None:
                    self._clock.wait_until(start_ns + pending[0].position * self._interval_ns, self._closed)
                continue

            # Deliver the newest of them.
            self._drop(pending, ready[-1])
            taken = pending.popleft()
            if start_ns is None:
                start_ns = self._clock.steady_ns()
            just_asked = True
            try:
                picture, source_ms = taken.picture.result()
            except FrameError as error:
                yield error
                continue
            due_ns = start_ns + taken.position * self._interval_ns
            wall_ns = self._clock.wall_ns()
            yield _frame(picture, source_ms, wall_ns - (self._clock.steady_ns() - due_ns), wall_ns)

    def _learn_length(self, pending: deque[_Pending]) -> None:
        """Forget positions behind the end, as soon as a read has told where that is."""
        end = next((p.position for p in pending if p.is_end), None)
        if end is not None:
            self._length = end
            while pending and pending[-1].position >= end:
                pending.pop().picture.cancel()

    def _drop(self, pending: deque[_Pending], count: int) -> None:
        """Drop the first ``count``; a read that fails in them was not going to be seen."""
        for _ in range(count):
            pending.popleft().picture.cancel()
            self._dropped += 1

    def _exists(self, position: int) -> bool:
        return self._length is None or position < self._length

    def _submit(self, pool: ThreadPoolExecutor, position: int) -> _Pending:
        return _Pending(position, pool.submit(self._read, position))

    def _read(self, position: int) -> tuple[Picture, float]:
        started_ns = time.perf_counter_ns()
        picture = self._reader.read(position)
        return picture, (time.perf_counter_ns() - started_ns) / 1e6


def _frame(picture: Picture, source_ms: float, capture_time_ns: int, ingest_time_ns: int) -> Frame:
    return Frame(
        pixels=picture.pixels,
        name=picture.name,
        capture_time_ns=capture_time_ns,
        ingest_time_ns=ingest_time_ns,
        source_ms=source_ms,
        clip_level=picture.clip_level,
        truth=picture.truth,
        world_from_camera=picture.world_from_camera,
        position_m=picture.position_m,
    )
