"""What is overtaken, what waits, and in which order it goes."""

from __future__ import annotations

import threading

from tests.support.messages import backdrop, frame, status

from lightwell.wire import Frame
from lightwell_workers.ingest.outbox import LOSSLESS_CAPACITY, Outbox


def test_newest_frame_replaces_a_waiting_one() -> None:
    outbox = Outbox(lossless=False)
    for number in range(5):
        outbox.put_frame(frame(str(number)))
    taken = outbox.take()
    assert isinstance(taken, Frame)
    assert taken.source_frame == "4"
    assert outbox.overtaken == 4
    assert outbox.take() is None
    assert outbox.empty


def test_order_is_frames_then_status_then_backdrop() -> None:
    outbox = Outbox(lossless=False)
    outbox.put_backdrop(backdrop(1))
    outbox.put_backdrop(backdrop(2))
    outbox.put_status(status("starting"))
    outbox.put_status(status("running"))
    outbox.put_frame(frame())
    taken = [outbox.take() for _ in range(4)]
    assert [type(item).__name__ for item in taken] == ["Frame", "StreamStatus", "Backdrop", "NoneType"]
    assert taken[1] == status("running")
    assert taken[2] == backdrop(2)


def test_lossless_keeps_order_and_holds_the_pipeline_back() -> None:
    outbox = Outbox(lossless=True)
    total = 3 * LOSSLESS_CAPACITY

    def fill() -> None:
        for number in range(total):
            outbox.put_frame(frame(str(number)))

    filler = threading.Thread(target=fill)
    filler.start()
    names: list[str] = []
    while len(names) < total:
        taken = outbox.take()
        if isinstance(taken, Frame):
            names.append(taken.source_frame)
    filler.join(10)
    assert names == [str(n) for n in range(total)]
    assert outbox.overtaken == 0


def test_lossless_never_holds_more_than_its_capacity() -> None:
    outbox = Outbox(lossless=True)
    for number in range(LOSSLESS_CAPACITY):
        outbox.put_frame(frame(str(number)))
    let_in = threading.Event()

    def put_one_more() -> None:
        outbox.put_frame(frame("late"))
        let_in.set()

    waiter = threading.Thread(target=put_one_more)
    waiter.start()
    assert not let_in.wait(0.05)
    outbox.close()
    assert let_in.wait(10)
    waiter.join(10)


def test_closed_lossless_outbox_does_not_grow() -> None:
    outbox = Outbox(lossless=True)
    outbox.close()
    for number in range(2 * LOSSLESS_CAPACITY):
        outbox.put_frame(frame(str(number)))
    taken = [item.source_frame for item in iter(outbox.take, None) if isinstance(item, Frame)]
    assert taken == [str(n) for n in range(LOSSLESS_CAPACITY)]


def test_frame_that_could_not_be_sent_goes_back() -> None:
    lossless = Outbox(lossless=True)
    lossless.put_frame(frame("1"))
    lossless.put_back(frame("0"))
    assert [item.source_frame for item in (lossless.take(), lossless.take()) if isinstance(item, Frame)] == ["0", "1"]

    live = Outbox(lossless=False)
    live.put_frame(frame("1"))
    live.put_back(frame("0"))
    assert live.overtaken == 1
    taken = live.take()
    assert isinstance(taken, Frame)
    assert taken.source_frame == "1"


def test_status_and_backdrop_that_could_not_be_sent_go_back_unless_newer_ones_wait() -> None:
    outbox = Outbox(lossless=False)
    outbox.put_back(status("ended"))
    outbox.put_back(backdrop(1))
    assert [outbox.take(), outbox.take(), outbox.take()] == [status("ended"), backdrop(1), None]

    outbox.put_status(status("ended"))
    outbox.put_backdrop(backdrop(2))
    outbox.put_back(status("running"))
    outbox.put_back(backdrop(1))
    assert [outbox.take(), outbox.take(), outbox.take()] == [status("ended"), backdrop(2), None]
