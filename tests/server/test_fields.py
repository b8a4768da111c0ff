"""Fields: several streams with known places, combined; through real sockets."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import httpx
import numpy as np
import pytest
from starlette.websockets import WebSocket, WebSocketDisconnect
from tests.support.publisher import Publisher
from tests.support.server import problem, running_server, wait_until
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from lightwell.gradients.interpolate import SampleSet
from lightwell.sh.engines import convert, convert_directions
from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_POLICY,
    SUBPROTOCOL,
    FieldHello,
    FieldMessage,
    FieldStatus,
    Frame,
    Heartbeat,
    Refused,
    decode_field,
    pack_coefficients,
)
from lightwell_client import AsyncField, Field, LightTimeoutError, Lightwell, ProblemError, RefusedError
from lightwell_server.routes.field_live import View, _send

LEFT, RIGHT = (-0.5, 0.0, 1.0), (0.5, 0.0, 1.0)
GENERATOR = np.random.default_rng(3)
LIGHTS = {name: GENERATOR.uniform(1, 2, (9, 3)).astype(np.float32) for name in ("left", "right", "third")}
SLOPES = {name: GENERATOR.uniform(-0.1, 0.1, (9, 3, 3)).astype(np.float32) for name in LIGHTS}
POINTS = [(0.25, 0.0, 1.0), (0.0, 0.2, 0.9), (-0.9, 0.1, 1.0)]


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    hub = {"heartbeat_seconds": 0.7}  # longer than the pauses between a field's looks at its members
    with running_server(tmp_path_factory.mktemp("data"), hub=hub) as url:
        yield url


@pytest.fixture
def api(server: str) -> Iterator[httpx.Client]:
    with httpx.Client(base_url=f"{server}/api/v1", timeout=30) as client:
        yield client
        for field in client.get("/fields").json()["fields"]:
            client.delete(f"/fields/{field['name']}")


def shine(publisher: Publisher, *, gradients: bool = True, **changes: Any) -> None:
    """Publish the light of the stream's name at its place."""
    name = publisher.stream.partition("-")[0]
    slopes = pack_coefficients(SLOPES[name]) if gradients else None
    publisher.publish(coefficients=pack_coefficients(LIGHTS[name]), gradients=slopes, **changes)


class Stage:
    """Two streams and their field."""

    def __init__(self, server: str, stack: ExitStack, tag: str) -> None:
        self.names = [f"left-{tag}", f"right-{tag}"]
        self.left, self.right = (stack.enter_context(Publisher(server, name)) for name in self.names)
        self.field = f"stage-{tag}"

    def shine(self, api: httpx.Client) -> None:
        shine(self.left, position=LEFT, trust_radius_m=0.2)
        shine(self.right, position=RIGHT)
        wait_until(lambda: all(api.get(f"/streams/{name}/latest").status_code == 200 for name in self.names))


@pytest.fixture
def stage(server: str, api: httpx.Client, request: pytest.FixtureRequest) -> Iterator[Stage]:
    with ExitStack() as stack:
        made = Stage(server, stack, f"{abs(hash(request.node.name)) % 10**8}")
        made.shine(api)
        answer = api.post("/fields", json={"name": made.field, "streams": made.names})
        assert answer.status_code == 201, answer.text
        assert answer.headers["Location"] == f"/api/v1/fields/{made.field}"
        yield made


def follow(server: str, field: str, query: str = "") -> ClientConnection:
    url = f"{server.replace('http', 'ws', 1)}/api/v1/fields/{field}/live?{query}"
    connection: ClientConnection = connect(url, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None, legacy=True)
    return connection


def receive(socket: ClientConnection) -> FieldMessage:
    data = socket.recv(30)
    assert isinstance(data, bytes)
    return decode_field(data)


def receive_of(socket: ClientConnection, kind: type[Any]) -> Any:
    while not isinstance(message := receive(socket), kind):
        pass
    return message


def test_a_field_is_described_sampled_changed_and_deleted(api: httpx.Client, stage: Stage) -> None:
    described = api.get(f"/fields/{stage.field}")
    document = described.json()
    assert (document["origin"], document["revision"], document["streams"]) == ("api", 1, stage.names)
    assert [(m["stream"], m["used"], m["problem"], m["position_m"]) for m in document["members"]] == [
        (stage.names[0], True, "", list(LEFT)),
        (stage.names[1], True, "", list(RIGHT)),
    ]
    assert [m["trust_radius_m"] for m in document["members"]] == [0.2, None]

    at = "&".join(f"at={x},{y},{z}" for x, y, z in POINTS)
    exact = SampleSet(
        [LEFT, RIGHT],
        np.stack([LIGHTS["left"], LIGHTS["right"]]),
        np.stack([SLOPES["left"], SLOPES["right"]]),
    ).at(POINTS)
    sample = api.get(f"/fields/{stage.field}/sample?{at}").json()
    assert (sample["bands"], sample["gradients"], sample["units"]) == (3, True, "relative")
    np.testing.assert_allclose([p["coefficients"] for p in sample["points"]], exact, rtol=1e-6)
    unity = api.get(f"/fields/{stage.field}/sample?{at}&convention=unity&bands=2").json()
    for point, light in zip(unity["points"], exact, strict=True):
        np.testing.assert_allclose(point["coefficients"], convert(light[:4], "unity"), rtol=1e-5, atol=1e-7)
    shepard = api.get(f"/fields/{stage.field}/sample?{at}&method=shepard").json()
    assert not np.allclose([p["coefficients"] for p in shepard["points"]], exact)
    for nowhere in ("1,2", "1e160,0,0", "nan,0,0"):
        problem(api.get(f"/fields/{stage.field}/sample?at={nowhere}"), 422, "invalid-input")

    one = api.patch(
        f"/fields/{stage.field}", json={"streams": stage.names[:1]}, headers={"If-Match": described.headers["ETag"]}
    )
    assert (one.json()["revision"], one.json()["streams"]) == (2, stage.names[:1])
    late = api.delete(f"/fields/{stage.field}", headers={"If-Match": described.headers["ETag"]})
    problem(late, 412, "changed-meanwhile")
    assert api.delete(f"/fields/{stage.field}").status_code == 204
    assert stage.field in problem(api.get(f"/fields/{stage.field}"), 404, "no-such-field")["detail"]


def test_mistakes_are_named(api: httpx.Client, server: str, stage: Stage) -> None:
    def refused(streams: list[str], status: int = 422, kind: str = "invalid-input", name: str = "other") -> str:
        return str(problem(api.post("/fields", json={"name": name, "streams": streams}), status, kind)["detail"])

    left, right = stage.names
    assert refused([left], 409, "field-exists", stage.field)
    assert "streams.1: there is no stream 'nobody': create it first" in refused([left, "nobody"])
    assert "names 'x' twice" in refused(["x", "x"])
    assert "at least 1" in refused([])
    assert "no stream name" in refused(["No Name"])
    shine(stage.right)
    wait_until(lambda: not api.get(f"/streams/{right}/latest").json()["position"])
    assert 'PATCH the stream with {"position_m": [x, y, z]}' in refused([left, right])
    shine(stage.right, position=LEFT)
    wait_until(lambda: api.get(f"/streams/{right}/latest").json()["position"] == list(LEFT))
    assert f"the probes of '{left}' and '{right}' stand at one place" in refused([left, right])
    members = api.get(f"/fields/{stage.field}").json()["members"]  # the one that was made before goes on, and says so
    assert [m["used"] for m in members] == [True, False]
    assert members[1]["problem"] == f"its probe stands where that of '{left}' does: move one, or leave one out"
    shine(stage.right, position=RIGHT, units="W.sr-1.m-2")
    wait_until(lambda: "unit" in api.get(f"/fields/{stage.field}").json()["members"][1]["problem"])
    problem(api.patch(f"/fields/{stage.field}", json={"streams": ["nobody"]}), 422, "invalid-input")
    problem(api.get("/fields/nothing/sample?at=0,0,0"), 404, "no-such-field")
    with pytest.raises(RefusedError, match="there is no field 'nothing'"), Field("nothing", server, timeout=20) as f:
        f.next()


def test_one_socket_brings_the_frames_of_all(api: httpx.Client, server: str, stage: Stage) -> None:
    left, right = stage.names
    with follow(server, stage.field, "convention=three&bands=2") as socket:
        hello = receive(socket)
        assert isinstance(hello, FieldHello)
        assert (hello.protocol, hello.field, hello.convention) == (SUBPROTOCOL, stage.field, "three")
        assert [(m.stream, m.problem) for m in hello.members] == [(left, ""), (right, "")]
        frames = {frame.stream: frame for frame in (receive_of(socket, Frame) for _ in range(2))}
        assert set(frames) == {left, right}
        assert frames[left].position == pytest.approx(convert_directions(LEFT, "three"))
        assert frames[left].gradients is not None
        assert (frames[left].bands, len(frames[left].gradients)) == (2, 4 * 9 * 4)
        assert isinstance(receive_of(socket, Heartbeat), Heartbeat)

        stage.right.close()  # the worker goes: the field goes on with the rest, and says so
        told = receive_of(socket, FieldStatus)
        assert [bool(m.problem) for m in told.members] == [False, True]
        assert "stopped" in told.members[1].problem
        shine(stage.left, position=LEFT)
        assert receive_of(socket, Frame).seq == 1
        sample = api.get(f"/fields/{stage.field}/sample?at=0,0,1").json()
        assert [m["used"] for m in sample["members"]] == [True, False]

        with Publisher(server, right, session="again") as again:  # and comes back
            shine(again, position=RIGHT)
            told = receive_of(socket, FieldStatus)
            while told.members[1].problem:
                told = receive_of(socket, FieldStatus)
            assert receive_of(socket, Frame).session == "again"
        assert f'lightwell_field_subscribers{{field="{stage.field}"}} 1.0' in httpx.get(f"{server}/metrics").text

        api.delete(f"/fields/{stage.field}")
        assert "no field" in receive_of(socket, Refused).reason
        with pytest.raises(Exception, match=str(CLOSE_NOT_FOUND)):
            socket.recv(10)
    with follow(server, "gone") as socket:
        assert isinstance(receive(socket), Refused)


@pytest.mark.parametrize(
    ("query", "reason"),
    [("bands=9", "bands=9: must be 1 … 8"), ("gradients=1", "there are: bands, max_fps, convention, token")],
)
def test_a_wrong_parameter_is_refused(server: str, stage: Stage, query: str, reason: str) -> None:
    with follow(server, stage.field, query) as socket:
        message = receive(socket)
        assert isinstance(message, Refused)
        assert reason in message.reason


def test_a_message_is_refused(server: str, stage: Stage) -> None:
    with follow(server, stage.field) as socket:
        socket.send(b"x")
        assert "takes no messages" in receive_of(socket, Refused).reason
        with pytest.raises(Exception, match=str(CLOSE_POLICY)):
            socket.recv(10)


async def test_who_takes_nothing_is_cut_off_whatever_is_being_sent() -> None:
    """A status as well as a frame: no subscription of the hub watches over those."""

    class Stuck:
        async def send_bytes(self, data: bytes) -> None:
            del data
            await asyncio.Event().wait()

    view = SimpleNamespace(ready=asyncio.Event(), take=lambda: b"status", sending=None, patience_seconds=0.02)
    with pytest.raises(WebSocketDisconnect):
        await asyncio.wait_for(_send(cast(WebSocket, Stuck()), cast(View, view)), 20)


def test_the_client_samples_what_comes(api: httpx.Client, server: str, stage: Stage) -> None:
    exact = SampleSet(
        [LEFT, RIGHT],
        np.stack([LIGHTS["left"], LIGHTS["right"]]),
        np.stack([SLOPES["left"], SLOPES["right"]]),
    ).at(POINTS)
    told: list[Any] = []
    with Field(stage.field, server, timeout=30, on_members=told.append) as field:
        light = field.next()  # of both at once: with a part of the probes it would be another
        np.testing.assert_allclose(light.at(POINTS), exact, rtol=1e-5)
        np.testing.assert_allclose(field.at(POINTS[0]), exact[0], rtol=1e-5)
        np.testing.assert_array_equal(light.positions, [LEFT, RIGHT])
        assert (light.problems, field.connected) == ({}, True)
        frame = light.frames[stage.names[0]]
        np.testing.assert_allclose(frame.at([0.1, 0, 0]), LIGHTS["left"] + 0.1 * SLOPES["left"][..., 0], rtol=1e-5)

        shine(stage.left, position=LEFT, gradients=False)
        while (light := field.next()).samples.known.all():
            pass
        # Half way the light departs from the mean by a quarter of how the right one's gradient does from the chord.
        chord, slope = LIGHTS["left"] - LIGHTS["right"], -SLOPES["right"][..., 0]
        middle = (LIGHTS["left"] + LIGHTS["right"]) / 2 + (slope - chord) / 4
        np.testing.assert_allclose(light.at((0, 0, 1)), middle, rtol=1e-5)
        sample = api.get(f"/fields/{stage.field}/sample?at=0,0,1").json()
        np.testing.assert_allclose(sample["points"][0]["coefficients"], middle, rtol=1e-5)
        assert (sample["gradients"], [m["gradients"] for m in sample["members"]]) == (True, [False, True])
        with pytest.raises(ValueError, match="gradients=True"):
            light.frames[stage.names[0]].at([0.1, 0, 0])

        stage.right.close()
        while stage.names[1] in light.frames:
            light = field.next()
        assert "stopped" in light.problems[stage.names[1]]
        assert len(told) >= 2
        with pytest.raises(LightTimeoutError, match=rf"no light of '{stage.field}' within 0.2 s \({stage.names[1]}: "):
            field.next(within_seconds=0.2)


async def test_the_asynchronous_client_follows_too(server: str, stage: Stage) -> None:
    async with AsyncField(stage.field, server, convention="unreal", timeout=30) as field:
        async for light in field:
            assert len(light.frames) == 2
            break
        point = convert_directions((0.0, 0.0, 1.0), "unreal")
        assert field.at(point).shape == (9, 3)
        await asyncio.to_thread(shine, stage.left, position=LEFT)
        assert (await field.next()).frames[stage.names[0]].seq == 1
    with pytest.raises(RuntimeError, match="async with AsyncField"):
        AsyncField(stage.field, server).latest()


def test_the_rest_client_manages_fields(server: str, stage: Stage) -> None:
    with Lightwell(server) as client:
        assert stage.field in [field.name for field in client.fields()]
        assert client.update_field(stage.field, stage.names[::-1]).streams == stage.names[::-1]
        assert client.field(stage.field).members[0].used
        sample = client.sample_field(stage.field, [0, 0, 1], convention="three", bands=1)
        assert sample.points[0].coefficients.shape == (1, 3)
        latest = client.latest(stage.names[0], gradients=True)
        assert latest.gradients is not None
        np.testing.assert_allclose(latest.gradients, SLOPES["left"], rtol=1e-6)
        assert (latest.position, latest.trust_radius_m) == (LEFT, 0.2)
        assert client.latest(stage.names[0]).gradients is None
        client.create_field("again", stage.names)
        client.delete_field("again")
        with pytest.raises(ProblemError, match="no field 'again'"):
            client.delete_field("again")


def test_sockets_of_a_field_without_light_count_too(tmp_path: Path) -> None:
    fields = {"stage": {"streams": ["nobody"]}}
    with running_server(tmp_path, hub={"max_subscribers": 1}, fields=fields) as url:
        with follow(url, "stage") as first, follow(url, "stage") as second:
            assert isinstance(receive(first), FieldHello)
            assert "has 1 subscribers: no more" in receive_of(second, Refused).reason
        wait_until(lambda: httpx.get(f"{url}/api/v1/fields/stage").json()["subscribers"] == 0)
        with follow(url, "stage") as third:
            assert isinstance(receive(third), FieldHello)


def test_fields_survive_a_restart_and_come_from_the_file(tmp_path: Path) -> None:
    streams = {"left": {"source": "exr:/none", "enabled": False, "position_m": LEFT}}
    fields = {"filed": {"streams": ["left", "right"]}}
    with running_server(tmp_path, streams=streams) as url, Lightwell(url) as client:
        client.create_field("kept", ["left"])
    with running_server(tmp_path, streams=streams, fields=fields) as url, Lightwell(url) as client:
        described = {field.name: field for field in client.fields()}
        assert [(name, field.origin) for name, field in described.items()] == [("filed", "file"), ("kept", "api")]
        assert [member.problem for member in described["filed"].members] == [
            "the stream is stopped",
            "there is no such stream now",
        ]
        assert described["kept"].members[0].position_m == LEFT
        with pytest.raises(ProblemError, match="is in the configuration file"):
            client.delete_field("filed")
        client.update_field("filed", ["left"])
        client.delete_field("filed")
        assert client.field("filed").streams == ["left", "right"]
        with pytest.raises(ProblemError, match="no stream of the field 'kept' gives light now: left: the stream is"):
            client.sample_field("kept", [0, 0, 0])


def test_a_program_that_draws_outlives_a_server_that_starts_again(tmp_path: Path) -> None:
    both = dict(zip(("left", "right"), (LEFT, RIGHT), strict=True))
    exact = SampleSet([LEFT, RIGHT], [LIGHTS[name] for name in both], [SLOPES[name] for name in both]).at(POINTS)
    with ExitStack() as stack:
        with (
            running_server(tmp_path, hub={"heartbeat_seconds": 1}) as url,
            ExitStack() as workers,
            Lightwell(url) as rest,
        ):
            port = int(url.rpartition(":")[2])
            for name, place in both.items():
                shine(workers.enter_context(Publisher(url, name)), position=place)
            wait_until(lambda: all(rest.latest(name) for name in both))
            rest.create_field("stage", list(both))
            field = stack.enter_context(Field("stage", url, timeout=30))
            np.testing.assert_allclose(field.next().at(POINTS), exact, rtol=1e-5)
        wait_until(lambda: not field.connected)
        np.testing.assert_allclose(field.at(POINTS), exact, rtol=1e-5)
        with running_server(tmp_path, server={"port": port, "data_dir": tmp_path}) as url:
            wait_until(lambda: field.connected and field.members[0].problem)
            assert field.latest() is None
            np.testing.assert_allclose(field.at(POINTS), exact, rtol=1e-5)  # the last there was
            with Publisher(url, "left") as left, Publisher(url, "right") as right:
                shine(left, position=LEFT)
                assert list(field.next().frames) == ["left"]
                shine(right, position=RIGHT)
                while len((light := field.next()).frames) < 2:
                    pass
                np.testing.assert_allclose(light.at(POINTS), exact, rtol=1e-5)
                # What the server has not noticed yet: both at one place.
                shine(right, position=LEFT)
                light = field.next()
                assert "stands where" in light.problems["right"]
                np.testing.assert_allclose(light.at(LEFT), LIGHTS["left"], rtol=1e-5)
