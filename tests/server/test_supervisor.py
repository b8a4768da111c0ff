"""Embedded workers: real ingest processes, killed, replaced and orphaned."""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import psutil
import pytest
from tests.support.publisher import Publisher
from tests.support.server import problem, running_server, server_process, wait_until

from lightwell.settings import StreamSettings
from lightwell_client import LightStream
from lightwell_server.config import HubSettings, LogSettings, SupervisorSettings
from lightwell_server.hub import Hub
from lightwell_server.session import WorkerState
from lightwell_server.supervisor import Supervisor, _describe_exit

ROOM = {"source": "synthetic:room?fps=30", "bands": 3, "resolution": 64, "backdrop": {"enabled": False}}
SUPERVISOR = {"embedded": True, "backoff_first_seconds": 0.05, "backoff_longest_seconds": 0.2}


class Api:
    """What the tests ask of a server."""

    def __init__(self, url: str) -> None:
        self.url = url

    def stream(self, name: str = "room") -> dict[str, Any]:
        described: dict[str, Any] = httpx.get(f"{self.url}/api/v1/streams/{name}").json()
        return described

    def worker(self, name: str = "room") -> dict[str, Any]:
        worker: dict[str, Any] = self.stream(name)["worker"]
        return worker

    def patch(self, body: dict[str, Any], name: str = "room") -> None:
        httpx.patch(f"{self.url}/api/v1/streams/{name}", json=body).raise_for_status()

    def wait_for_state(self, state: str, name: str = "room") -> dict[str, Any]:
        wait_until(lambda: self.worker(name)["state"] == state)
        return self.worker(name)


@pytest.fixture
def api(tmp_path: Path) -> Iterator[Api]:
    with running_server(tmp_path, supervisor=SUPERVISOR, streams={"room": ROOM}) as url:
        yield Api(url)


def test_a_worker_lives_as_long_as_it_is_wanted(api: Api) -> None:
    with LightStream("room", api.url) as light:
        assert light.next(60).coefficients.shape == (9, 3)
        worker = api.wait_for_state("running")
        process = psutil.Process(worker["pid"])
        assert "ingest" in process.cmdline()

        api.patch({"filter": {"tau_seconds": 0.3}})  # the worker follows through its socket
        assert api.worker()["pid"] == process.pid

        api.patch({"source": "synthetic:room?fps=20"})  # another source needs another process
        wait_until(lambda: not process.is_running())
        wait_until(lambda: api.worker()["state"] == "running")
        session = api.stream()["session"]
        while light.next(60).session != session:
            pass
        process = psutil.Process(api.worker()["pid"])

        api.patch({"enabled": False})
        wait_until(lambda: not process.is_running())
        assert api.wait_for_state("stopped")["restarts"] == 0
        assert "hush" not in str(api.stream())


def test_a_killed_worker_is_back_and_the_client_sees_only_a_pause(api: Api) -> None:
    with LightStream("room", api.url) as light:
        light.next(60)
        worker = api.wait_for_state("running")
        session = api.stream()["session"]
        killed = time.monotonic()
        os.kill(worker["pid"], signal.SIGKILL)
        while (frame := light.next(60)).session == session:
            pass
        sys.stdout.write(f"frames again {time.monotonic() - killed:.2f} s after kill -9 of the ingest process\n")
        assert frame.seq >= 0
        assert light.reconnects == 0
    again = api.wait_for_state("running")
    assert again["restarts"] == 1
    assert "killed by signal 9" in again["last_error"]


def test_a_killed_server_takes_its_workers_along_and_the_client_waits_for_the_next(tmp_path: Path) -> None:
    (tmp_path / "lightwell.toml").write_text(
        '[streams.room]\nsource = "synthetic:room?fps=30"\nbands = 3\nresolution = 64\nbackdrop = { enabled = false }\n'
    )
    with server_process(tmp_path) as (url, process), LightStream("room", url) as light:
        session = light.next(60).session
        (worker,) = psutil.Process(process.pid).children()
        killed = time.monotonic()
        process.send_signal(signal.SIGKILL)
        process.wait()
        with server_process(tmp_path, port=int(url.rsplit(":", 1)[1])) as (again, successor):
            assert again == url
            while light.next(60).session == session:
                pass
            sys.stdout.write(f"frames again {time.monotonic() - killed:.2f} s after kill -9 of the server\n")
            wait_until(lambda: not worker.is_running() or worker.status() == psutil.STATUS_ZOMBIE)
            assert light.reconnects == 1
            assert len(psutil.Process(successor.pid).children()) == 1


def test_stopping_the_server_leaves_nobody_behind(tmp_path: Path) -> None:
    with running_server(tmp_path, supervisor=SUPERVISOR, streams={"room": ROOM}) as url:
        api = Api(url)
        process = psutil.Process(api.wait_for_state("running")["pid"])
    assert not process.is_running()


def test_a_source_that_cannot_be_opened_is_tried_again_with_its_reason(tmp_path: Path) -> None:
    broken = ROOM | {"source": "exr:/nowhere/at/all?password=hush"}
    with running_server(tmp_path, supervisor=SUPERVISOR, streams={"room": broken}) as url:
        api = Api(url)
        wait_until(lambda: api.worker()["restarts"] >= 2)
        worker = api.worker()
        assert "ended with status 1" in worker["last_error"]
        assert any("/nowhere/at/all" in line for line in worker["stderr_tail"])
        assert "hush" not in str(api.stream())
        assert problem(httpx.get(f"{url}/api/v1/streams/room/latest"), 404, "no-frame-yet")


def test_a_worker_without_frames_is_started_anew(tmp_path: Path) -> None:
    impatient = SUPERVISOR | {"startup_seconds": 0.2}
    with running_server(tmp_path, supervisor=impatient, streams={"room": ROOM}) as url:
        api = Api(url)
        wait_until(lambda: api.worker()["restarts"] >= 1)
        assert api.worker()["last_error"].startswith("no frame for ")


def test_a_slow_source_is_not_taken_for_a_dead_one(tmp_path: Path) -> None:
    slow, hasty = ROOM | {"source": "synthetic:room?fps=1"}, SUPERVISOR | {"watchdog_seconds": 0.3}
    with running_server(tmp_path, supervisor=hasty, streams={"room": slow}) as url, LightStream("room", url) as light:
        session = light.next(60).session
        assert [light.next(60).session for _ in range(2)] == [session, session]
        assert Api(url).worker()["restarts"] == 0


def test_workers_log_as_their_server_does(tmp_path: Path) -> None:
    broken, log = ROOM | {"source": "exr:/nowhere/at/all"}, {"level": "error", "format": "json"}
    with running_server(tmp_path, supervisor=SUPERVISOR, streams={"room": broken}, log=log) as url:
        api = Api(url)
        wait_until(lambda: api.worker()["restarts"] >= 1)
        tail = api.worker()["stderr_tail"]
        assert "/nowhere/at/all" in "".join(tail)
        assert '"level": "info"' not in "".join(tail)


def test_a_source_that_ends_is_left_alone(tmp_path: Path) -> None:
    short = ROOM | {"source": "synthetic:room?fps=30&frames=10"}
    with running_server(tmp_path, supervisor=SUPERVISOR, streams={"room": short}) as url:
        api = Api(url)
        worker = api.wait_for_state("ended")
        assert (worker["pid"], worker["restarts"], api.stream()["state"]) == (None, 0, "ended")
        assert httpx.get(f"{url}/readyz").status_code == 200


def test_a_worker_from_elsewhere_has_the_stream_to_itself(api: Api) -> None:
    process = psutil.Process(api.wait_for_state("running")["pid"])
    with Publisher(api.url, "room", settings={"source": "exr:/mine"}) as worker:
        assert worker.welcome.settings["source"] == "exr:/mine"
        api.wait_for_state("yielded")
        wait_until(lambda: not process.is_running())
        assert api.stream()["session"] == worker.session
    api.wait_for_state("running")


class StubbornWorkers:
    """A supervisor whose processes only note that they started, and must be killed."""

    def __init__(self, directory: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._journal = directory / "journal"
        self._journal.touch()
        program = directory / "worker"
        program.write_text(
            "#!/bin/sh\ntrap '' TERM\n"
            f"for other in $(cat '{self._journal}'); do kill -0 $other && echo overlap >> '{self._journal}'; done\n"
            f"echo $$ >> '{self._journal}'\nexec sleep 600\n"
        )
        program.chmod(0o755)
        monkeypatch.setattr(sys, "executable", str(program))
        self.supervisor = Supervisor(
            Hub(HubSettings(), "run"),
            SupervisorSettings(stop_seconds=2.0),  # long enough to be seen on a busy machine
            server_url="http://127.0.0.1:9",
            token="t",
            uploads=directory,
            log_settings=LogSettings(),
        )

    def apply(self, source: str) -> None:
        self.supervisor.apply("room", StreamSettings(source=source))

    def started(self) -> list[str]:
        return self._journal.read_text().split()

    def alive(self) -> int:
        return sum(psutil.pid_exists(int(pid)) for pid in self.started())

    async def until_started(self, count: int) -> None:
        await asyncio.to_thread(wait_until, lambda: len(self.started()) >= count)

    async def until_stopping(self) -> None:
        await asyncio.to_thread(wait_until, self._is_stopping)

    def _is_stopping(self) -> bool:
        report = self.supervisor.report("room")
        return report is not None and report.state is WorkerState.STOPPING


@pytest.fixture
def stubborn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> StubbornWorkers:
    return StubbornWorkers(tmp_path, monkeypatch)


@pytest.mark.parametrize("while_stopping", [False, True])
async def test_removing_a_worker_that_is_being_replaced_starts_nothing(
    stubborn: StubbornWorkers, while_stopping: bool
) -> None:
    stubborn.apply("exr:a")
    await stubborn.until_started(1)
    stubborn.apply("exr:b")
    if while_stopping:
        await stubborn.until_stopping()
    async with asyncio.timeout(30):
        await stubborn.supervisor.remove("room")
    assert (len(stubborn.started()), stubborn.alive()) == (1, 0)


@pytest.mark.parametrize("while_stopping", [False, True])
async def test_a_worker_that_is_replaced_twice_never_meets_another(
    stubborn: StubbornWorkers, while_stopping: bool
) -> None:
    stubborn.apply("exr:a")
    await stubborn.until_started(1)
    stubborn.apply("exr:b")
    if while_stopping:
        await stubborn.until_stopping()
    stubborn.apply("exr:c")
    await stubborn.until_started(2)
    await stubborn.supervisor.close()
    assert "overlap" not in stubborn.started()
    assert (len(stubborn.started()), stubborn.alive()) == (2, 0)


async def test_a_second_cancellation_does_not_leave_the_process_behind(stubborn: StubbornWorkers) -> None:
    stubborn.apply("exr:a")
    await stubborn.until_started(1)
    (task,) = [task for task in asyncio.all_tasks() if task.get_name() == "worker room"]
    task.cancel()
    await stubborn.until_stopping()
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    assert stubborn.alive() == 0


STATISTICS = ('{"event": "ended", "level": "info", "frames_in": 3}', "2026-11-22 [info     ] ended   frames_in=3")


@pytest.mark.parametrize(
    ("tail", "said"),
    [
        ((), ""),
        (STATISTICS, ""),
        (('{"event": "failed", "level": "error", "reason": "no such file"}', *STATISTICS), ": no such file"),
        (('{"event": "frame skipped", "level": "warning"}', *STATISTICS), ": frame skipped"),
        (("lightwell: source 'exr:x' matches no file",), ": lightwell: source 'exr:x' matches no file"),
        (("2026-11-22 [error    ] failed   reason=gone", *STATISTICS), ": 2026-11-22 [error    ] failed   reason=gone"),
        (("old", "ValueError: x", "7", *STATISTICS), ": 7"),
    ],
)
def test_the_last_error_is_the_reason(tail: tuple[str, ...], said: str) -> None:
    assert _describe_exit(1, tail) == f"the ingest process ended with status 1{said}"
    assert _describe_exit(-9, tail) == f"the ingest process was killed by signal 9{said}"
