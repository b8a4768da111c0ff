"""Following a stream, with asyncio and without, on real sockets."""

from __future__ import annotations

import asyncio
import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from tests.support.proxies import set_dead_proxies
from tests.support.publisher import Publisher, make_backdrop, make_status
from tests.support.server import running_server, wait_until

from lightwell.wire import StreamStatus
from lightwell_client import (
    AsyncLightStream,
    BackdropPicture,
    ConnectionLostError,
    LightFrame,
    LightStream,
    LightTimeoutError,
    RefusedError,
)
from lightwell_client.stream import live_url


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    with running_server(tmp_path_factory.mktemp("data"), hub={"heartbeat_seconds": 0.2}) as url:
        yield url


def test_the_url_of_a_stream() -> None:
    assert live_url("http://host:1/", "a") == "ws://host:1/api/v1/streams/a/live"
    assert live_url("https://host/lights", "a b") == "wss://host/lights/api/v1/streams/a%20b/live"
    with pytest.raises(ValueError, match="no URL such as http://127"):
        live_url("host:8400", "a")


async def test_frames_come_in_the_form_that_was_asked_for(server: str) -> None:
    with Publisher(server, "form") as worker:
        worker.publish()
        async with AsyncLightStream("form", server, bands=2, convention="three", newest=False) as light:
            first = await light.next(10)
            assert (first.seq, first.bands, first.convention, first.coefficients.shape) == (0, 2, "three", (4, 3))
            assert first.mapping == "latlong"
            assert light.connected
            worker.publish()
            worker.publish()
            assert [(await light.next(10)).seq, (await light.next(10)).seq] == [1, 2]
            await light.change(bands=1, convention="unity")
            changed = await light.next(10)
            while changed.bands != 1:
                worker.publish()
                changed = await light.next(10)
            assert changed.convention == "unity"
            await asyncio.to_thread(worker.publish, gradients=bytes(9 * 9 * 4), position=(1.0, 2.0, 3.0))
            await light.change(gradients=True)  # the newest frame comes again, with what was missing
            while changed.gradients is None:
                changed = await light.next(10)
            assert changed.gradients.shape == (1, 3, 3)
            assert changed.position is not None
            assert changed.position.tolist() == [1, 3, 2]  # Unity's axes


async def test_the_frame_that_was_there_before_is_marked(server: str) -> None:
    with Publisher(server, "marked") as worker:
        worker.publish()
        async with AsyncLightStream("marked", server, newest=False) as light:
            assert (await light.next(10)).from_hello
            worker.publish()
            assert not (await light.next(10)).from_hello


async def test_no_proxy_stands_before_a_server_on_this_machine(server: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with Publisher(server, "direct") as worker:
        worker.publish()
        set_dead_proxies(monkeypatch)
        async with AsyncLightStream("direct", server, reconnect=False) as light:
            assert (await light.next(10)).seq == 0


async def test_a_program_that_is_slow_gets_the_newest(server: str) -> None:
    told: list[int] = []
    with Publisher(server, "slow") as worker:
        async with AsyncLightStream("slow", server, on_missed=told.append) as light:
            worker.publish()
            await light.next(10)
            for _ in range(20):
                worker.publish()
            await asyncio.to_thread(wait_until, lambda: light.missed == 19)
            frame = await light.next(10)
            assert (frame.seq, frame.missed, light.missed) == (20, 19, 19)


def test_a_loop_that_draws_takes_the_newest_without_waiting(server: str) -> None:
    with Publisher(server, "draw") as worker, LightStream("draw", server) as light:
        assert light.latest() is None
        for seq in range(3):
            worker.publish()
            while (frame := light.latest()) is None or frame.seq < seq:
                pass
    with LightStream("nowhere", server) as light, pytest.raises(RefusedError):
        wait_until(light.latest)


async def test_callbacks_tell_of_status_backdrop_and_connection(server: str) -> None:
    states: list[StreamStatus] = []
    pictures: list[BackdropPicture] = []
    connections: list[bool] = []
    with Publisher(server, "calls") as worker:
        async with AsyncLightStream(
            "calls", server, on_status=states.append, on_backdrop=pictures.append, on_connection=connections.append
        ) as light:
            worker.publish()
            await light.next(10)
            worker.send(make_status(stream="calls", frames_in=5))
            worker.send(make_backdrop(3, stream="calls"))
            await asyncio.to_thread(wait_until, lambda: states and pictures)
            assert light.status is not None
            assert (light.status.frames_in, pictures[0].seq) == (5, 3)
            assert light.info is not None
            assert light.info.name == "calls"
    assert connections == [True, False]


async def test_a_refusal_is_raised_with_its_reason(server: str) -> None:
    with Publisher(server, "known"):
        for light, reason in (
            (AsyncLightStream("nowhere", server), "there is no stream 'nowhere'"),
            (AsyncLightStream("known", server, token="wrong"), "not one of this server's"),
            (AsyncLightStream("known", server, bands=9), "bands=9: must be 1 … 8"),
            (AsyncLightStream("a/b", server), r"a/b: ws://.* answers HTTP 40\d .*: check name and address"),
        ):
            async with light:
                with pytest.raises(RefusedError, match=reason):
                    await light.next(10)


async def test_a_timeout_is_raised_where_it_was_asked_for(server: str) -> None:
    with Publisher(server, "silent"):
        async with AsyncLightStream("silent", server, timeout=0.1) as light:
            with pytest.raises(LightTimeoutError, match=r"no frame of 'silent' within 0\.1 s"):
                await anext(light)
            with pytest.raises(TimeoutError):
                await light.next(0.05)


async def test_without_reconnection_a_loss_is_raised(tmp_path: Path) -> None:
    with running_server(tmp_path) as url:
        worker = Publisher(url)
        worker.publish()
        light = AsyncLightStream("probe", url, reconnect=False)
        await light.__aenter__()
        assert (await light.next(10)).seq == 0
    with pytest.raises(ConnectionLostError, match="no connection to ws://"):
        await light.next(30)
    await light.__aexit__(None, None, None)
    worker.close()
    async with AsyncLightStream("probe", url, reconnect=False) as light:
        with pytest.raises(ConnectionLostError):
            await light.next(30)


def test_outside_its_context_a_stream_says_how_to_use_it() -> None:
    with pytest.raises(RuntimeError, match="with LightStream"):
        LightStream("probe").next()
    with pytest.raises(RuntimeError, match="async with"):
        asyncio.run(AsyncLightStream("probe").next())


def test_the_blocking_stream_iterates(server: str) -> None:
    with Publisher(server, "plain") as worker, LightStream("plain", server, newest=False) as light:
        for seq in range(5):
            worker.publish()
            frame = next(light)
            assert frame.seq == seq
            assert light.latest() is frame
        assert (light.missed, light.connected, light.reconnects) == (0, True, 0)
        light.change(bands=2)
        while light.next(10).bands != 2:
            worker.publish()
    wait_until(lambda: not any(thread.name == "light plain" for thread in threading.enumerate()))


def test_the_stream_outlives_its_server(tmp_path: Path) -> None:
    """The server goes, and another comes on its port: the iterator only waits; a stream not there yet is waited for."""
    config = {"port": 0}
    with running_server(tmp_path, server=config) as url:
        config["port"] = int(url.rsplit(":", 1)[1])
        worker = Publisher(url)
        worker.publish()
        light = LightStream("probe", url).__enter__()
        assert light.next(10).session == "s1"
        worker.close()
    frames: list[LightFrame] = []
    waiting = threading.Thread(target=lambda: frames.append(light.next()))
    waiting.start()
    wait_until(lambda: not light.connected)
    with running_server(tmp_path, server=config) as url:
        wait_until(lambda: "no stream 'probe'" in light.last_error)
        with Publisher(url, session="s2") as worker:
            worker.publish()
            waiting.join()
            assert frames[0].session == "s2"
            assert light.reconnects == 1
            light.__exit__(None, None, None)


async def test_a_server_that_falls_silent_is_left() -> None:
    """A peer that accepts and never speaks is dropped after the handshake's time, not waited for for ever."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
        async with AsyncLightStream("probe", f"http://127.0.0.1:{port}", timeout=0.2) as light:
            with pytest.raises(LightTimeoutError):
                await light.next()
