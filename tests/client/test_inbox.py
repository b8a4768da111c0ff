"""Frames between the socket and the program."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.publisher import make_frame

from lightwell.wire import unpack_coefficients
from lightwell_client.inbox import EVERY_FRAME_LIMIT, Inbox


def test_the_newest_wins_and_the_rest_is_counted() -> None:
    inbox = Inbox(newest=True)
    for seq in range(5):
        inbox.put(make_frame(seq), 10 + seq)
    frame = inbox.take("latlong")
    assert frame is not None
    assert (frame.seq, frame.missed, frame.received_time_ns, frame.mapping) == (4, 4, 14, "latlong")
    assert inbox.missed == 4
    assert inbox.take("latlong") is None


def test_missed_at_the_server_and_here_are_added() -> None:
    inbox = Inbox(newest=True)
    inbox.put_missed(3)
    inbox.put(make_frame(3), 0)
    inbox.put_missed(2)
    inbox.put(make_frame(6), 0)
    frame = inbox.take("")
    assert frame is not None
    assert frame.missed == 6
    assert inbox.missed == 6


def test_every_frame_is_kept_in_order_up_to_a_limit() -> None:
    inbox = Inbox(newest=False)
    for seq in range(EVERY_FRAME_LIMIT):
        assert not inbox.full
        inbox.put(make_frame(seq), 0)
    assert inbox.full
    frames = [inbox.take("") for _ in range(EVERY_FRAME_LIMIT)]
    assert [frame.seq for frame in frames if frame] == list(range(EVERY_FRAME_LIMIT))
    assert inbox.missed == 0


def test_a_frame_shown_again_after_a_reconnect_is_dropped() -> None:
    inbox = Inbox(newest=False)
    inbox.put(make_frame(7), 0)
    inbox.put(make_frame(7), 0)
    inbox.put(make_frame(7, session="s2"), 0)
    assert [frame.session for frame in (inbox.take(""), inbox.take("")) if frame] == ["s1", "s2"]
    assert inbox.take("") is None


def test_arrays_have_their_shapes_and_values() -> None:
    gradients = np.arange(81, dtype=np.float32)
    wire = make_frame(3, bands=3, gradients=gradients.tobytes())
    inbox = Inbox(newest=True)
    inbox.put(wire, wire.capture_time_ns + 5_000_000)
    frame = inbox.take("cube")
    assert frame is not None
    np.testing.assert_array_equal(frame.coefficients, unpack_coefficients(wire.coefficients))
    assert frame.coefficients.shape == (9, 3)
    assert not frame.coefficients.flags.writeable
    assert frame.gradients is not None
    assert frame.gradients[1, 2, 0] == 15
    assert frame.latency_seconds == pytest.approx(0.005)
    assert set(frame.as_json()) >= {
        "bands",
        "convention",
        "units",
        "window",
        "mapping",
        "coefficients",
        "stream",
        "seq",
        "capture_time_ns",
        "publish_time_ns",
        "missed",
    }


def test_coefficients_that_do_not_fit_the_bands_are_an_error() -> None:
    inbox = Inbox(newest=True)
    inbox.put(make_frame(0, bands=3, coefficients=b"\0" * 12), 0)
    with pytest.raises(ValueError, match="1 coefficients do not fit 3 bands"):
        inbox.take("")
