"""The live socket, with real subscribers: good ones, slow ones, vanished ones."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx
import pytest
from tests.support.publisher import Publisher, make_backdrop, make_status
from tests.support.server import receive, receive_of, running_server, subscribe, wait_until
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection
from websockets.typing import Subprotocol

from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_POLICY,
    CLOSE_WRONG_PROTOCOL,
    SUBPROTOCOL,
    Backdrop,
    Frame,
    Heartbeat,
    Hello,
    Missed,
    Refused,
    StreamStatus,
    Subscribe,
    encode,
)


@pytest.fixture
def worker(shared_server: str, request: pytest.FixtureRequest) -> Iterator[Publisher]:
    name = request.node.name.lower()[5:40].strip("_").replace("[", "-").replace("]", "")
    with Publisher(shared_server, name) as publisher:
        yield publisher


def refusal(connection: ClientConnection) -> tuple[int, str, str]:
    """Return the close code, the close reason and the reason of the refusal."""
    message = receive(connection)
    assert isinstance(message, Refused)
    with pytest.raises(ConnectionClosed) as closed:
        connection.recv()
    assert closed.value.rcvd is not None
    return closed.value.rcvd.code, closed.value.rcvd.reason, message.reason


def test_frames_reach_every_subscriber_in_its_own_form(shared_server: str, worker: Publisher) -> None:
    plain = subscribe(shared_server, worker.stream)
    three = subscribe(shared_server, worker.stream, "convention=three&bands=2")
    for light in (plain, three):
        hello = receive(light)
        assert isinstance(hello, Hello)
        assert (hello.protocol, hello.latest, hello.stream.mapping) == (SUBPROTOCOL, None, "latlong")
    sent = worker.publish()
    frame = receive(plain)
    assert frame == sent
    frame = receive(three)
    assert isinstance(frame, Frame)
    assert (frame.seq, frame.bands, frame.convention) == (0, 2, "three")
    late = subscribe(shared_server, worker.stream)
    hello = receive(late)
    assert isinstance(hello, Hello)
    assert hello.latest == sent
    for light in (plain, three, late):
        light.close()


def test_status_and_backdrops_pass_through(shared_server: str, worker: Publisher) -> None:
    light = subscribe(shared_server, worker.stream, "backdrop=true")
    receive(light)
    status = make_status(stream=worker.stream, frames_in=3)
    worker.send(status)
    assert receive_of(light, StreamStatus) == status
    backdrop = make_backdrop(stream=worker.stream)
    worker.send(backdrop)
    assert receive_of(light, Backdrop) == backdrop
    light.close()


def test_a_subscription_can_change(shared_server: str, worker: Publisher) -> None:
    worker.publish()
    light = subscribe(shared_server, worker.stream)
    receive(light)
    light.send(encode(Subscribe(convention="unity", bands=1)))
    frame = receive_of(light, Frame)
    assert (frame.convention, frame.bands) == ("unity", 1)
    light.close()


def test_heartbeats_come_while_nothing_else_does(shared_server: str, worker: Publisher) -> None:
    light = subscribe(shared_server, worker.stream)
    hello = receive(light)
    assert isinstance(hello, Hello)
    assert hello.heartbeat_seconds == 0.3
    assert isinstance(receive(light), Heartbeat)
    assert isinstance(receive(light), Heartbeat)
    light.close()


def test_max_fps_thins_without_counting(shared_server: str, worker: Publisher) -> None:
    """One frame in twenty minutes: the first comes, the others wait until the subscriber asks for more."""
    light = subscribe(shared_server, worker.stream, "max_fps=0.001")
    receive(light)
    url = f"{shared_server}/api/v1/streams/{worker.stream}"
    for _ in range(20):
        worker.publish()
        wait_until(lambda: httpx.get(url).json()["frames_received"] == worker.sent)
    light.send(encode(Subscribe(max_fps=1000)))
    seqs: list[int] = []
    while not seqs or seqs[-1] < 19:
        message = receive(light)
        assert not isinstance(message, Missed)
        if isinstance(message, Frame):
            seqs.append(message.seq)
    assert seqs == [0, 19]
    light.close()


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("bands=x", "bands=x: must be 1 … 8"),
        ("max_fps=0", "max_fps=0: must be above 0, at most 1000"),
        ("bands=9", "bands=9: must be 1 … 8"),
        ("max_fps=nan", "max_fps=nan: must be above 0, at most 1000"),
        ("backdrop=maybe", "backdrop=maybe: must be 1 or 0"),
        ("convention=maya", "convention=maya: must be one of lightwell, three"),
        (
            "band=3",
            "band is no parameter of this socket; there are: bands, max_fps, convention, backdrop, gradients, token",
        ),
    ],
)
def test_a_wrong_parameter_is_refused_with_a_reason(
    shared_server: str, worker: Publisher, query: str, reason: str
) -> None:
    light = subscribe(shared_server, worker.stream, query)
    code, short, full = refusal(light)
    assert code == CLOSE_POLICY
    assert reason in full
    assert full.startswith(short.rstrip("…"))


def test_an_unknown_stream_is_refused_with_those_there_are(shared_server: str, worker: Publisher) -> None:
    code, _, full = refusal(subscribe(shared_server, "nowhere"))
    assert code == CLOSE_NOT_FOUND
    assert "there is no stream 'nowhere'" in full
    assert worker.stream in full


@pytest.mark.parametrize("offered", [["lightwell.v9"], ["lightwell.v9", "chat"]])
def test_another_protocol_version_is_refused_readably(
    shared_server: str, worker: Publisher, offered: list[str]
) -> None:
    subprotocols = [Subprotocol(name) for name in offered]
    code, short, _ = refusal(subscribe(shared_server, worker.stream, subprotocols=subprotocols))
    assert code == CLOSE_WRONG_PROTOCOL
    assert short == f"this server speaks the subprotocol lightwell.v1; offered: {', '.join(offered)}"


def test_a_client_that_offers_no_subprotocol_is_served(shared_server: str, worker: Publisher) -> None:
    light = subscribe(shared_server, worker.stream, subprotocols=None)
    assert isinstance(receive(light), Hello)
    light.close()


@pytest.mark.parametrize("message", [b"\x00", encode(Heartbeat(server_time_ns=0)), encode(Subscribe(max_fps=-1))])
def test_nonsense_from_a_subscriber_is_refused(shared_server: str, worker: Publisher, message: bytes) -> None:
    light = subscribe(shared_server, worker.stream)
    receive(light)
    light.send(message)
    assert refusal(light)[0] == CLOSE_POLICY


def test_text_from_a_subscriber_is_refused_with_the_remedy(shared_server: str, worker: Publisher) -> None:
    light = subscribe(shared_server, worker.stream)
    receive(light)
    light.send('{"type": "subscribe"}')
    assert refusal(light)[2] == "that was text: send binary MessagePack"


def test_compression_is_not_negotiated(shared_server: str, worker: Publisher) -> None:
    light = subscribe(shared_server, worker.stream, compression="deflate")
    assert light.response is not None
    assert "Sec-WebSocket-Extensions" not in light.response.headers
    light.close()


def stalled_subscriber(url: str, query: str = "") -> socket.socket:
    """Return a socket that has subscribed, reads nothing, and has little room."""
    parts = urlsplit(url)
    peer = socket.socket()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    peer.connect((parts.hostname, parts.port))
    peer.sendall(
        f"GET /api/v1/streams/probe/live?{query} HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
    )
    return peer


def drain(peer: socket.socket) -> None:
    """Read until the other end closes or resets the connection."""
    with contextlib.suppress(ConnectionResetError):
        while peer.recv(65536):
            pass


def subscribers(url: str) -> int:
    (stream,) = httpx.get(f"{url}/api/v1/streams").json()["streams"]
    count: int = stream["subscribers"]
    return count


def metric(url: str, name: str) -> float:
    for line in httpx.get(f"{url}/metrics").text.splitlines():
        if line.startswith(f"{name}{{"):
            return float(line.split()[-1])
    raise AssertionError(f"no metric {name}")


def test_a_stalled_client_is_cut_off_and_harms_nobody(tmp_path: Path) -> None:
    hub = {"stall_seconds": 1.0, "write_buffer_kb": 4, "socket_buffer_kb": 4}
    with running_server(tmp_path, hub=hub) as url, Publisher(url) as worker:
        live = subscribe(url)
        receive(live)
        peer = stalled_subscriber(url, "backdrop=true")
        wait_until(lambda: subscribers(url) == 2)
        picture = b"\xff\xd8" + bytes(20_000)
        seqs: list[int] = []
        while metric(url, "lightwell_subscribers_stalled_total") == 0:
            worker.send(make_backdrop(worker.sent, jpeg=picture))
            sent = worker.publish()
            seqs.append(receive_of(live, Frame).seq)
            assert seqs[-1] == sent.seq
            time.sleep(0.01)
        assert seqs == list(range(len(seqs)))
        wait_until(lambda: subscribers(url) == 1)
        peer.settimeout(30)
        drain(peer)  # what was on its way, then the end
        peer.close()
        live.close()


def test_a_slow_client_that_wakes_up_is_told_what_it_missed_and_gets_the_newest(tmp_path: Path) -> None:
    hub = {"write_buffer_kb": 1, "socket_buffer_kb": 4}
    with running_server(tmp_path, hub=hub) as url, Publisher(url) as worker:
        options: dict[str, Any] = {"max_queue": 1}
        parts = urlsplit(url)
        peer = socket.socket()
        peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        peer.connect((parts.hostname, parts.port))
        light = subscribe(url, sock=peer, **options)
        receive(light)
        while metric(url, "lightwell_frames_missed_total") == 0:
            worker.publish()
        for _ in range(50):
            last = worker.publish()
        wait_until(lambda: metric(url, "lightwell_frames_received_total") == worker.sent)
        got = missed = 0
        while True:
            message = receive(light)
            if isinstance(message, Missed):
                missed += message.count
                assert message.total == missed
            elif isinstance(message, Frame):
                got += 1
                if message.seq == last.seq:
                    break
        assert missed >= 50
        assert got + missed == worker.sent
        light.close()


def test_a_client_that_vanishes_is_forgotten(tmp_path: Path) -> None:
    with running_server(tmp_path) as url, Publisher(url):
        peer = stalled_subscriber(url)
        wait_until(lambda: subscribers(url) == 1)
        peer.close()
        wait_until(lambda: subscribers(url) == 0)


def test_there_are_only_so_many_subscribers(tmp_path: Path) -> None:
    with running_server(tmp_path, hub={"max_subscribers": 1}) as url, Publisher(url):
        light = subscribe(url)
        receive(light)
        assert refusal(subscribe(url))[0] == CLOSE_POLICY
        light.close()


def test_subscribers_are_told_that_a_stream_is_deleted_and_that_the_server_stops(tmp_path: Path) -> None:
    with running_server(tmp_path) as url, Publisher(url), Publisher(url, "other"):
        deleted, other = subscribe(url), subscribe(url, "other")
        receive(deleted), receive(other)
        httpx.delete(f"{url}/api/v1/streams/probe").raise_for_status()
        assert receive_of(deleted, Refused).reason == "the stream 'probe' has been deleted"
    assert receive_of(other, Refused).reason == "the server is shutting down"
    deleted.close()
    other.close()
