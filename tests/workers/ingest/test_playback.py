"""Pacing, dropping and order, by a clock that the tests move."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pytest
from tests.support.fake_clock import FakeClock

from lightwell.errors import FrameError
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources.playback import EndOfRecordingError, Picture, Playback

INTERVAL_NS = 10_000_000
PIXELS = np.zeros((2, 4, 3), np.float32)


class NumberReader:
    """Names each picture after its position."""

    def __init__(self, length: int | None, threads: int = 2, bad: Callable[[int], bool] = lambda _: False) -> None:
        self.length = length
        self.threads = threads
        self.bad = bad
        self.closed = False
        self.capture_time_ns: int | None = None
        self.end: int | None = None
        self._done = threading.Condition()
        self._finished: set[int] = set()

    def read(self, position: int) -> Picture:
        try:
            if self.end is not None and position >= self.end:
                raise EndOfRecordingError
            if self.bad(position):
                raise FrameError(str(position), "is bad")
            return Picture(pixels=PIXELS, name=str(position), capture_time_ns=self.capture_time_ns)
        finally:
            with self._done:
                self._finished.add(position)
                self._done.notify_all()

    def wait_read(self, position: int) -> None:
        with self._done:
            assert self._done.wait_for(lambda: position in self._finished, 10)

    def close(self) -> None:
        self.closed = True


def name_of(item: Frame | FrameError) -> str:
    return item.name if isinstance(item, Frame) else f"bad {item.frame}"


def test_deadlines_are_absolute() -> None:
    clock, reader = FakeClock(), NumberReader(200)
    source = Playback("x:", reader, INTERVAL_NS, realtime=True, clock=clock)
    work_ms = np.random.default_rng(0).uniform(0, 9.9, 200)
    captured = []
    for item, milliseconds in zip(source, work_ms, strict=True):
        assert isinstance(item, Frame)
        captured.append(item.capture_time_ns)
        assert item.ingest_time_ns >= item.capture_time_ns
        clock.advance_ms(milliseconds)
    assert np.all(np.diff(captured) == INTERVAL_NS)
    assert source.frames_dropped == 0
    assert reader.closed


def test_first_picture_does_not_start_the_clock() -> None:
    clock = FakeClock()
    source = Playback("x:", NumberReader(3), INTERVAL_NS, realtime=True, clock=clock)
    assert source.first_picture() is PIXELS
    clock.advance_ms(5000)
    assert [name_of(item) for item in source] == ["0", "1", "2"]
    assert source.frames_dropped == 0


def test_bad_first_picture_is_none() -> None:
    assert Playback("x:", NumberReader(3, bad=lambda _: True), 1, realtime=True).first_picture() is None


def test_capture_time_is_when_the_frame_was_due_on_the_wall_clock() -> None:
    clock = FakeClock()
    frames = iter(Playback("x:", NumberReader(None), INTERVAL_NS, realtime=True, clock=clock))
    first = next(frames)
    assert isinstance(first, Frame)
    clock.wall_offset_ns += 3_000_000_000  # the wall clock is set
    clock.advance_ms(13)
    second = next(frames)
    assert isinstance(second, Frame)
    assert second.capture_time_ns - first.capture_time_ns == INTERVAL_NS + 3_000_000_000
    assert second.ingest_time_ns - second.capture_time_ns == 3_000_000


def test_newest_due_frame_wins_and_the_others_are_counted() -> None:
    clock, reader = FakeClock(), NumberReader(100)
    source = Playback("x:", reader, INTERVAL_NS, realtime=True, clock=clock)
    frames = iter(source)
    assert name_of(next(frames)) == "0"
    reader.wait_read(1)
    reader.wait_read(2)
    clock.advance_ms(75)
    late = [name_of(next(frames))]
    while late[-1] != "7":  # 1 or 2, where its reader thread had not quite ended
        late.append(name_of(next(frames)))
    assert len(late) <= 3
    assert source.frames_dropped == 7 - len(late)
    assert name_of(next(frames)) == "8"
    assert source.frames_dropped == 7 - len(late)


def test_last_frame_is_delivered_however_late() -> None:
    clock, reader = FakeClock(), NumberReader(20)
    source = Playback("x:", reader, INTERVAL_NS, realtime=True, clock=clock)
    frames = iter(source)
    next(frames)
    clock.advance_ms(5000)
    assert name_of(next(frames)) == "19"
    assert next(frames, None) is None
    assert source.frames_dropped == 18


def test_last_frame_is_delivered_when_the_end_is_due_too() -> None:
    clock, reader = FakeClock(), NumberReader(None)
    reader.end = 2
    source = Playback("x:", reader, INTERVAL_NS, realtime=True, clock=clock)
    frames = iter(source)
    assert name_of(next(frames)) == "0"
    reader.wait_read(1)
    reader.wait_read(2)  # which tells that there are no more
    clock.advance_ms(20)
    assert [name_of(item) for item in frames] == ["1"]
    assert source.frames_dropped == 0
    assert reader.closed


def test_reader_of_a_source_that_never_played_is_closed() -> None:
    reader = NumberReader(3)
    with Playback("x:", reader, INTERVAL_NS, realtime=True) as source:
        assert source.first_picture() is PIXELS
    assert reader.closed
    assert source.first_picture() is None
    assert list(source) == []


def test_bad_frames_take_their_turn() -> None:
    clock, reader = FakeClock(), NumberReader(6, bad=lambda position: position in (0, 3))
    source = Playback("x:", reader, INTERVAL_NS, realtime=True, clock=clock)
    times, got = [], []
    for item in source:
        times.append(clock.now_ns)
        got.append(name_of(item))
    assert got == ["bad 0", "1", "2", "bad 3", "4", "5"]
    assert np.all(np.diff(times) == INTERVAL_NS)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_every_frame_in_order_when_not_in_real_time(threads: int) -> None:
    clock, reader = FakeClock(), NumberReader(50, threads, bad=lambda position: position == 7)
    source = Playback("x:", reader, INTERVAL_NS, realtime=False, clock=clock)
    items = []
    for item in source:
        items.append(item)
        clock.advance_ms(500)
    assert [name_of(item) for item in items] == [f"bad {n}" if n == 7 else str(n) for n in range(50)]
    assert source.frames_dropped == 0
    times = [item.capture_time_ns for item in items if isinstance(item, Frame)]
    assert times[6] - times[0] == 6 * INTERVAL_NS


def test_recordings_own_time_starts_the_clock_when_not_in_real_time() -> None:
    reader = NumberReader(4, bad=lambda position: position == 0)
    reader.capture_time_ns = 42_000_000_000  # whole seconds: the same for every picture of this recording
    items = list(Playback("x:", reader, INTERVAL_NS, realtime=False, clock=FakeClock()))
    times = [item.capture_time_ns for item in items if isinstance(item, Frame)]
    assert times == [42_000_000_000, 42_000_000_000 + INTERVAL_NS, 42_000_000_000 + 2 * INTERVAL_NS]


@pytest.mark.parametrize("realtime", [True, False])
def test_reader_may_find_the_end(realtime: bool) -> None:
    reader = NumberReader(None, threads=1)
    reader.end = 5
    source = Playback("x:", reader, INTERVAL_NS, realtime=realtime, clock=FakeClock())
    assert [name_of(item) for item in source] == ["0", "1", "2", "3", "4"]


def test_close_wakes_a_waiting_iterator() -> None:
    source = Playback("x:", NumberReader(None), 3_600_000_000_000, realtime=True)
    got: list[Frame | FrameError] = []
    first = threading.Event()

    def play() -> None:
        for item in source:
            got.append(item)
            first.set()

    player = threading.Thread(target=play)
    player.start()
    assert first.wait(10)
    source.close()
    player.join(10)
    assert not player.is_alive()
    assert len(got) == 1
