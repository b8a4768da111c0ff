"""The publish socket: who may publish, and what is not taken."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.publisher import Publisher, make_backdrop, make_frame, make_status
from tests.support.server import receive, receive_of, running_server, subscribe
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from lightwell.wire import (
    CLOSE_POLICY,
    CLOSE_REPLACED,
    SUBPROTOCOL,
    Announce,
    Frame,
    Message,
    Refused,
    Subscribe,
    encode,
    pack_coefficients,
)


def refused(worker: Publisher) -> tuple[int, str]:
    """Return the close code and the reason."""
    reply = worker.receive()
    assert isinstance(reply, Refused)
    with pytest.raises(ConnectionClosed) as closed:
        worker.socket.recv()
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, reply.reason


def test_the_newer_worker_wins(shared_server: str) -> None:
    older = Publisher(shared_server, "replaced", "old")
    light = subscribe(shared_server, "replaced")
    receive(light)
    newer = Publisher(shared_server, "replaced", "new")
    assert refused(older) == (CLOSE_REPLACED, "replaced: a newer worker publishes this stream")
    newer.publish()
    assert receive_of(light, Frame).session == "new"
    for end in (older, newer, light):
        end.close()


MISTAKES: list[tuple[str, Message | bytes, str]] = [
    ("nan", make_frame(stream="nan", coefficients=pack_coefficients(np.full((9, 3), np.nan))), "must be finite"),
    ("length", make_frame(stream="length", coefficients=b"\0" * 24), "must be 108 bytes"),
    ("name", make_frame(stream="other"), "the message is of stream 'other', the socket is of 'name'"),
    ("session", make_status(stream="session", session="s9"), "the message is of session 's9'"),
    ("jpeg", make_backdrop(stream="jpeg", jpeg=b"x"), "the backdrop is no JPEG"),
    ("bands", encode(make_frame(stream="bands")).replace(b"\xa5bands\x03", b"\xa5bands\x09"), "Expected `int` <= 8"),
    ("kind", Subscribe(bands=3), "Invalid value 'subscribe'"),
    (
        "twice",
        Announce(stream="twice", session="s1", worker_version="0", settings={}),
        "announce may only be the first",
    ),
    ("nonsense", b"\xc1", "that is no message of the publish socket"),
    ("text", b"", "that is no message of the publish socket"),
]


@pytest.mark.parametrize(("name", "message", "reason"), MISTAKES, ids=[name for name, _, _ in MISTAKES])
def test_a_message_that_is_not_valid_ends_the_connection_with_the_reason(
    shared_server: str, name: str, message: Message | bytes, reason: str
) -> None:
    with Publisher(shared_server, name) as worker:
        light = subscribe(shared_server, name)
        receive(light)
        good = worker.publish()
        assert receive_of(light, Frame) == good
        worker.socket.send(message if isinstance(message, bytes) else encode(message))
        code, said = refused(worker)
        assert code == CLOSE_POLICY
        assert reason in said
        light.close()


def first_answer(server: str, message: Message | None, stream: str = "shy") -> str:
    """Return why the server refuses a worker whose first message is this one."""
    url = f"{server.replace('http', 'ws', 1)}/api/v1/streams/{stream}/publish"
    with connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None) as socket:
        if message is not None:
            with contextlib.suppress(ConnectionClosed):  # refused already; the reason is there to be read
                socket.send(encode(message))
        refusal = receive(socket)
        assert isinstance(refusal, Refused)
        return refusal.reason


def announce(**changes: Any) -> Announce:
    values: dict[str, Any] = {"stream": "shy", "session": "s", "worker_version": "0", "settings": {"source": "exr:x"}}
    return Announce(**values | changes)


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (make_frame(), "the first message must be announce"),
        (announce(stream="bold"), "announced stream 'bold' on the socket of 'shy'"),
        (announce(settings={}), "announced settings: source is missing"),
        (announce(settings={"source": "exr:x", "bands": 9}), "announced settings: bands = 9: must be less than"),
    ],
)
def test_a_worker_must_announce_itself(shared_server: str, message: Message, reason: str) -> None:
    assert reason in first_answer(shared_server, message)


def test_a_name_that_cannot_be_a_stream_is_refused(shared_server: str) -> None:
    assert "is no stream name" in first_answer(shared_server, announce(), stream="Shy%20One")


def test_a_worker_that_says_nothing_is_sent_away_and_a_large_message_too(tmp_path: Path) -> None:
    with running_server(tmp_path, hub={"announce_seconds": 0.2, "max_message_kb": 64}) as url:
        assert first_answer(url, None) == "no announce message came within 0.2 s"
        with Publisher(url) as worker:
            worker.send(make_backdrop(jpeg=b"\xff\xd8" + bytes(70_000)))
            with pytest.raises(ConnectionClosed) as closed:
                worker.socket.recv()
            assert closed.value.rcvd is not None
            assert closed.value.rcvd.code == 1009


def test_a_worker_that_leaves_and_comes_back_goes_on(shared_server: str) -> None:
    light = None
    for session in ("one", "two"):
        with Publisher(shared_server, "again", session) as worker:
            if light is None:
                light = subscribe(shared_server, "again")
                receive(light)
            sent = worker.publish()
            assert receive_of(light, Frame) == sent
    assert light is not None
    light.close()
