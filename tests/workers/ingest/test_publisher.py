"""The publisher against a real server on a real socket."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from tests.support import messages
from tests.support.proxies import set_dead_proxies
from tests.support.publish_server import PublishServer
from tests.support.server import wait_until
from websockets.asyncio.client import ClientConnection

from lightwell.errors import SourceError
from lightwell.wire import CLOSE_REPLACED, CLOSE_UNAUTHORIZED, Frame
from lightwell_workers.ingest.publisher import (
    FIRST_PAUSE_SECONDS,
    LONGEST_PAUSE_SECONDS,
    Publisher,
    pause_seconds,
    publish_url,
)


class Callbacks:
    def __init__(self) -> None:
        self.settings: list[dict[str, object]] = []
        self.sent: list[Frame] = []
        self.settings_came = threading.Event()

    def on_settings(self, settings: dict[str, object]) -> None:
        self.settings.append(settings)
        self.settings_came.set()

    def on_sent(self, frame: Frame) -> None:
        self.sent.append(frame)


@contextmanager
def publishing(
    url: str, *, lossless: bool = False, token: str | None = None, callbacks: Callbacks | None = None
) -> Iterator[Publisher]:
    callbacks = callbacks or Callbacks()
    publisher = Publisher(
        publish_url(url, "test"),
        token,
        messages.announce,
        callbacks.on_settings,
        callbacks.on_sent,
        lossless=lossless,
    )
    publisher.start()
    try:
        yield publisher
    finally:
        publisher.close()


@pytest.mark.parametrize(
    ("server", "url"),
    [
        ("http://h:8400", "ws://h:8400/api/v1/streams/a-b/publish"),
        ("https://h/base/", "wss://h/base/api/v1/streams/a-b/publish"),
        ("ws://h:1", "ws://h:1/api/v1/streams/a-b/publish"),
    ],
)
def test_url(server: str, url: str) -> None:
    assert publish_url(server, "a-b") == url


@pytest.mark.parametrize("server", ["h:8400", "ftp://h", "", "http://"])
def test_bad_url(server: str) -> None:
    with pytest.raises(SourceError, match="no URL such as"):
        publish_url(server, "a")


def test_pauses_start_short_double_and_stay_bounded() -> None:
    assert pause_seconds(0, 0.0) == FIRST_PAUSE_SECONDS / 2
    assert [pause_seconds(n, 1.0) / FIRST_PAUSE_SECONDS for n in range(4)] == [1, 2, 4, 8]
    assert pause_seconds(10_000, 1.0) == LONGEST_PAUSE_SECONDS
    # A server that restarts within a second is found again within 5 s, whatever the jitter.
    assert LONGEST_PAUSE_SECONDS + 1.0 < 5.0


def test_frames_are_numbered_and_stamped_when_they_are_sent() -> None:
    with PublishServer() as server, publishing(server.url, lossless=True, token="t") as publisher:
        for number in range(30):
            publisher.publish(messages.frame(str(number)))
        publisher.report(messages.status())
        publisher.show(messages.backdrop())
        publisher.drain()
        assert publisher.finished.wait(10)
        server.wait_for(lambda s: len(s.frames) == 30 and bool(s.statuses) and bool(s.backdrops))
    assert server.paths == ["/api/v1/streams/test/publish"]
    assert [frame.seq for frame in server.frames] == list(range(30))
    assert [frame.source_frame for frame in server.frames] == [str(n) for n in range(30)]
    stamps = [frame.publish_time_ns for frame in server.frames]
    assert stamps == sorted(stamps)
    assert all(frame.quality.stage_ms["publish"] >= 0 for frame in server.frames)
    assert publisher.published == 30


def test_token_goes_along() -> None:
    with PublishServer(token="secret") as server, publishing(server.url, token="secret") as publisher:
        publisher.publish(messages.frame())
        server.wait_for(lambda s: len(s.frames) == 1)


def test_no_proxy_stands_before_a_server_on_this_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    set_dead_proxies(monkeypatch)
    with PublishServer() as server, publishing(server.url) as publisher:
        publisher.publish(messages.frame())
        server.wait_for(lambda s: len(s.frames) == 1, timeout=10)


@pytest.mark.parametrize(
    ("server", "reason"),
    [
        (PublishServer(token="secret", close_code=CLOSE_UNAUTHORIZED), "the token is wrong"),
        (PublishServer(refuse="stream x is unknown"), "stream x is unknown"),
        (PublishServer(subprotocol="lightwell.v9"), "lightwell.v1|subprotocol"),
    ],
    ids=["token", "refused", "protocol"],
)
def test_refusals_are_final(server: PublishServer, reason: str) -> None:
    with server, publishing(server.url, lossless=True) as publisher:
        assert publisher.finished.wait(10)
        for _ in range(50):
            publisher.publish(messages.frame())  # blocks nobody
    assert publisher.refused
    assert len(server.paths) <= 1
    assert any(part in publisher.refused for part in reason.split("|"))
    assert not publisher.close()


def test_failure_of_the_publisher_is_told() -> None:
    def fail(settings: dict[str, object]) -> None:
        raise ZeroDivisionError("a defect")

    callbacks = Callbacks()
    callbacks.on_settings = fail  # type: ignore[method-assign]
    with PublishServer() as server, publishing(server.url, lossless=True, callbacks=callbacks) as publisher:
        assert publisher.finished.wait(10)
        for _ in range(50):
            publisher.publish(messages.frame())  # blocks nobody
        assert publisher.refused == "a defect"
        assert not publisher.close()


def test_worker_that_is_replaced_does_not_come_back() -> None:
    with PublishServer() as server, publishing(server.url) as publisher:
        server.wait_for(lambda s: bool(s.announces))
        server.close_all(CLOSE_REPLACED, "")
        assert publisher.finished.wait(10)
    assert "another worker" in publisher.refused


def test_reconnects_after_the_server_has_gone_and_loses_nothing_it_still_holds() -> None:
    with PublishServer() as server, publishing(server.url, lossless=True) as publisher:
        publisher.publish(messages.frame("before"))
        server.wait_for(lambda s: len(s.frames) == 1)
        port = server.port
        server.stop()
        # What goes into a socket that is dead without knowing it is lost; from here on nothing may be.
        wait_until(lambda: publisher.error)
        for number in range(5):
            publisher.publish(messages.frame(str(number)))
        with PublishServer(port=port) as again:
            again.wait_for(lambda s: bool(s.frames) and s.frames[-1].source_frame == "4")
            assert [frame.source_frame for frame in again.frames] == [str(n) for n in range(5)]
            assert publisher.reconnects == 1
            assert len(again.announces) == 1


def test_last_status_survives_a_connection_that_closes_under_it(monkeypatch: pytest.MonkeyPatch) -> None:
    send = ClientConnection.send
    closed = threading.Event()

    async def close_under_the_status(connection: ClientConnection, message: bytes) -> None:
        if b"ended" in message and not closed.is_set():
            closed.set()
            await connection.close()
        await send(connection, message)

    monkeypatch.setattr(ClientConnection, "send", close_under_the_status)
    with PublishServer() as server, publishing(server.url, lossless=True) as publisher:
        publisher.publish(messages.frame())
        publisher.report(messages.status("ended"))
        publisher.drain()
        assert publisher.finished.wait(10)
        assert publisher.close()
        server.wait_for(lambda s: bool(s.statuses))
    assert closed.is_set()
    assert [status.state for status in server.statuses] == ["ended"]
    assert publisher.reconnects == 1


def test_waits_for_a_server_that_is_not_there_yet() -> None:
    with PublishServer() as server:
        port = server.port
    with publishing(f"http://127.0.0.1:{port}") as publisher:
        for number in range(10):
            publisher.publish(messages.frame(str(number)))  # returns at once
        assert publisher.overtaken == 9
        with PublishServer(port=port) as late:
            late.wait_for(lambda s: len(s.frames) == 1)
        assert late.frames[0].source_frame == "9"


def test_settings_arrive_on_welcome_and_configure() -> None:
    callbacks = Callbacks()
    with PublishServer(welcome_settings={"bands": 3}) as server, publishing(server.url, callbacks=callbacks):
        assert callbacks.settings_came.wait(10)
        callbacks.settings_came.clear()
        server.configure({"bands": 4})
        assert callbacks.settings_came.wait(10)
    assert callbacks.settings == [{"bands": 3}, {"bands": 4}]


def test_a_server_that_reads_nothing_blocks_nobody() -> None:
    with PublishServer() as server, publishing(server.url) as publisher:
        server.wait_for(lambda s: bool(s.announces))
        server.pause_reading()
        for number in range(300):
            publisher.show(messages.backdrop(number, size=1_000_000))
            publisher.publish(messages.frame(str(number)))
        assert publisher.overtaken > 0
        server.resume_reading()
        server.wait_for(lambda s: bool(s.frames) and s.frames[-1].source_frame == "299")
    seqs = [frame.seq for frame in server.frames]
    assert seqs == list(range(len(seqs)))  # what is overtaken takes no number
