"""Threads, order, counters and failures of the pipeline, with a source that the test feeds."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from types import TracebackType
from typing import Self

import numpy as np
import pytest
import structlog

from lightwell import wire
from lightwell.errors import FrameError, MappingError
from lightwell.settings import StreamSettings
from lightwell_workers.ingest.frame import Frame, Pixels
from lightwell_workers.ingest.pipeline import REDUCERS, Pipeline

SETTINGS = StreamSettings.model_validate({"source": "synthetic:room", "backdrop": {"enabled": False}})


def frame(name: str, height: int = 8, width: int = 16, value: float = 1.0) -> Frame:
    pixels = np.full((height, width, 3), value, np.float32)
    return Frame(pixels=pixels, name=name, capture_time_ns=10**18 + int(name) * 10**7, ingest_time_ns=10**18)


class ListSource:
    url = "list:"
    frames_dropped = 0
    interval_seconds = 0.01

    def __init__(self, items: list[Frame | FrameError], *, is_live: bool = False) -> None:
        self.items = items
        self.is_live = is_live
        self.pulled = 0
        self._closed = threading.Event()

    def first_picture(self) -> Pixels | None:
        return next((item.pixels for item in self.items if isinstance(item, Frame)), None)

    def __iter__(self) -> Iterator[Frame | FrameError]:
        for item in self.items:
            if self._closed.is_set():
                return
            self.pulled += 1
            yield item

    def close(self) -> None:
        self._closed.set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()


class ListSink:
    def __init__(self) -> None:
        self.frames: list[wire.Frame] = []
        self.backdrops: list[wire.Backdrop] = []
        self.open = threading.Event()
        self.open.set()

    def publish(self, frame: wire.Frame) -> None:
        assert self.open.wait(20)
        self.frames.append(frame)

    def show(self, backdrop: wire.Backdrop) -> None:
        self.backdrops.append(backdrop)


def run(items: list[Frame | FrameError], settings: StreamSettings = SETTINGS) -> tuple[Pipeline, ListSink]:
    sink = ListSink()
    pipeline = Pipeline(ListSource(items), settings, "s", "session", sink)
    pipeline.run()
    return pipeline, sink


def test_frames_leave_in_order_each_once() -> None:
    sizes = [(8, 16)] * 3 + [(256, 512)] * 40 + [(8, 16)] * 40  # slow and fast ones side by side
    pipeline, sink = run([frame(str(n), *size) for n, size in enumerate(sizes)])
    names = [int(item.source_frame) for item in sink.frames]
    assert names == sorted(set(names))
    assert pipeline.counters.frames_in == len(sizes)
    assert pipeline.counters.frames_finished == len(names)
    assert pipeline.counters.frames_skipped == len(sizes) - len(names) == 8  # three, then five: until most are new


def test_bad_frames_are_counted_each_time_and_logged_once() -> None:
    bad = [FrameError("a.exr", "is cut short"), FrameError("b.exr", "is empty")]
    items: list[Frame | FrameError] = []
    for lap in range(5):
        items += [frame(str(3 * lap)), bad[0], frame(str(3 * lap + 1)), bad[1]]
    with structlog.testing.capture_logs() as logs:
        pipeline, sink = run(items)
    assert len(sink.frames) == 10
    assert pipeline.counters.frames_skipped == 10
    assert pipeline.counters.last_error == "b.exr: is empty"
    skipped = [(entry["frame"], entry["reason"]) for entry in logs if entry["event"] == "frame skipped"]
    assert skipped == [("a.exr", "is cut short"), ("b.exr", "is empty")]


def test_an_odd_first_frame_of_a_loop_is_skipped_and_logged_once() -> None:
    lap: list[Frame | FrameError] = [frame("0", 16, 32), *(frame(str(n)) for n in range(1, 9))]
    with structlog.testing.capture_logs() as logs:
        pipeline, sink = run(lap * 5)
    assert [item.source_frame for item in sink.frames][8:] == [str(n) for n in range(1, 9)] * 4
    assert pipeline.counters.frames_skipped == 5  # one good frame of the first lap, the odd one of each other
    assert [entry["frame"] for entry in logs if entry["event"] == "frame skipped"] == ["1", "0"]


@pytest.mark.parametrize("position", [0, 1])
def test_frame_too_bright_for_a_message_is_skipped(position: int) -> None:
    items: list[Frame | FrameError] = [frame("0"), frame("1"), frame("2")]
    items[position] = frame(str(position), value=1e38)
    pipeline, sink = run(items)
    assert [item.source_frame for item in sink.frames] == [str(n) for n in range(3) if n != position]
    assert all(np.isfinite(wire.unpack_coefficients(item.coefficients)).all() for item in sink.frames)
    assert pipeline.counters.frames_skipped == 1
    assert pipeline.counters.last_error.startswith(f"{position}: gives a coefficient of")


def test_samples_are_counted_over_all_frames() -> None:
    pipeline, _ = run([frame("0", value=np.nan), frame("1", value=-1.0), frame("2", value=np.inf)])
    samples = 8 * 16 * 3
    counters = pipeline.counters
    assert (counters.nan_samples, counters.negative_samples, counters.infinite_samples) == (samples,) * 3


def test_nothing_is_pulled_that_cannot_be_worked_on() -> None:
    source, sink = ListSource([frame(str(n)) for n in range(50)]), ListSink()
    sink.open.clear()
    pipeline = Pipeline(source, SETTINGS, "s", "session", sink)
    runner = threading.Thread(target=pipeline.run)
    runner.start()
    assert not threading.Event().wait(0.3)
    assert source.pulled <= REDUCERS
    sink.open.set()
    runner.join(20)
    assert [item.source_frame for item in sink.frames] == [str(n) for n in range(50)]


def test_pictures_that_do_not_fit_the_mapping_end_the_pipeline() -> None:
    settings = StreamSettings.model_validate({"source": "exr:x", "mapping": {"kind": "cube"}})
    with pytest.raises(MappingError):
        run([frame(str(n), 7, 11) for n in range(20)], settings)


def test_settings_that_do_not_fit_change_nothing() -> None:
    settings = StreamSettings.model_validate({"source": "exr:x", "mapping": {"kind": "octahedral"}})
    pipeline, _ = run([frame("0", 16, 16)], settings)
    with pytest.raises(MappingError):
        pipeline.configure(settings.model_copy(update={"weights": "fejer"}))
    assert pipeline.settings is settings
    pipeline.configure(settings.model_copy(update={"bands": 3}))
    assert pipeline.settings.bands == 3


def test_backdrops_go_beside_the_frames() -> None:
    settings = StreamSettings.model_validate({"source": "exr:x", "backdrop": {"width": 32}})
    _, sink = run([frame("0")], settings)
    assert [(item.width, item.height) for item in sink.backdrops] == [(32, 16)]
