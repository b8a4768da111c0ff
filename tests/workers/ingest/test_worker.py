"""Whole workers in processes of their own, against a real socket."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.publish_server import PublishServer

from lightwell.io.exr import write_rgb
from lightwell.settings import StreamSettings
from lightwell.wire import CLOSE_UNAUTHORIZED, Frame, StreamStatus


@contextmanager
def worker(
    server: PublishServer, source: str | None, *options: str, **environment: str
) -> Iterator[subprocess.Popen[str]]:
    """Run ``lightwell ingest``; killed at the end, if it still runs."""
    arguments = [*([] if source is None else [source]), "--stream", "test", "--server", server.url, "--json", *options]
    process = subprocess.Popen(
        [sys.executable, "-m", "lightwell_server.cli", "ingest", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **environment},
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.kill()
        process.communicate()


def finish(process: subprocess.Popen[str]) -> tuple[int, list[dict[str, Any]], list[dict[str, Any]]]:
    """Return exit status, the printed statuses and the log."""
    out, err = process.communicate(timeout=60)
    return process.returncode, [json.loads(line) for line in out.splitlines()], _json_lines(err)


def _json_lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines() if line.startswith("{")]


def write_frames(folder: Path, count: int, size: tuple[int, int] = (16, 32)) -> None:
    for number in range(count):
        write_rgb(folder / f"f.{number:04d}.exr", np.full((*size, 3), 1 + number, np.float16))


def running(server: PublishServer) -> bool:
    return len(server.frames) >= 3


def test_recording_is_delivered_whole_and_the_worker_ends(tmp_path: Path) -> None:
    write_frames(tmp_path, 40)
    with PublishServer() as server, worker(server, f"exr:{tmp_path}?realtime=0", "--filter", "none") as process:
        code, statuses, log = finish(process)
        server.wait_for(lambda s: s.statuses[-1].state == "ended")
    assert code == 0
    assert [frame.source_frame for frame in server.frames] == [f"f.{n:04d}.exr" for n in range(40)]
    assert [frame.seq for frame in server.frames] == list(range(40))
    assert len({frame.session for frame in server.frames}) == 1
    assert statuses[-1]["state"] == "ended"
    assert statuses[-1]["frames_published"] == 40
    assert statuses[-1]["interval_seconds"] > 0
    assert set(statuses[-1]["stage_ms"]) == {
        *("source", "merge", "map", "downsample", "project", "window", "filter", "publish")
    }
    assert {entry["stream"] for entry in log} == {"test"}
    assert log[-1]["event"] == "ended"
    assert log[-1]["frames_in"] == 40


@pytest.mark.parametrize("signal_number", [signal.SIGTERM, signal.SIGINT])
def test_stopping_in_order(signal_number: signal.Signals) -> None:
    with PublishServer() as server, worker(server, "synthetic:room?width=64") as process:
        server.wait_for(running)
        process.send_signal(signal_number)
        code, statuses, _ = finish(process)
        server.wait_for(lambda s: s.statuses[-1].state == "stopped")
    assert code == 0
    assert statuses[0]["state"] == "starting"
    assert statuses[-1]["state"] == "stopped"
    assert server.backdrops
    announce = server.announces[0]
    assert announce.pid == process.pid
    assert StreamSettings.model_validate(announce.settings).source == "synthetic:room?width=64"


def test_stopping_while_a_lossless_stream_waits_for_its_server(tmp_path: Path) -> None:
    write_frames(tmp_path, 3)
    with PublishServer() as server:
        pass
    with worker(server, f"exr:{tmp_path}?realtime=0&loop=1") as process:
        assert process.stdout is not None
        for line in process.stdout:
            if json.loads(line)["last_error"]:
                break
        process.send_signal(signal.SIGTERM)
        code, statuses, _ = finish(process)
    assert code == 0
    assert statuses[-1]["state"] == "stopped"


def test_frames_come_again_after_the_server_was_killed() -> None:
    with PublishServer() as server, worker(server, "synthetic:room?width=64") as process:
        server.wait_for(running)
        port = server.port
        server.stop()
        with PublishServer(port=port) as again:
            again.wait_for(lambda s: running(s) and any(status.reconnects == 1 for status in s.statuses))
            assert again.frames[0].session == server.frames[0].session
            assert again.frames[0].seq > server.frames[-1].seq
            process.terminate()
            assert process.wait(20) == 0


def test_worker_killed_outright_is_replaced_by_one_with_another_session() -> None:
    with PublishServer() as server:
        with worker(server, "synthetic:room?width=64") as process:
            server.wait_for(running)
            process.kill()
            process.wait(20)
        before = len(server.frames)
        with worker(server, "synthetic:room?width=64"):
            server.wait_for(lambda s: len(s.frames) > before + 3 and s.frames[-1].session != s.frames[0].session)


def test_refused_worker_ends_with_the_reason() -> None:
    with PublishServer(token="secret", close_code=CLOSE_UNAUTHORIZED) as server:
        with worker(server, "synthetic:room", "--token", "wrong") as process:
            code, statuses, log = finish(process)
        assert code == 3
        assert "the token is wrong" in [entry.get("reason") for entry in log]
        assert {entry["stream"] for entry in log} == {"test"}
        assert log[-1]["event"] == statuses[-1]["state"] == "failed"
        assert "ended" not in [status["state"] for status in statuses]
        with worker(server, "synthetic:room?width=64", LIGHTWELL_TOKEN="secret"):
            server.wait_for(running)


def test_source_that_cannot_be_opened_is_reported_to_the_server(tmp_path: Path) -> None:
    with PublishServer() as server, worker(server, f"exr:{tmp_path}") as process:
        _, err = process.communicate(timeout=60)
        server.wait_for(lambda s: bool(s.statuses) and s.statuses[-1].state == "failed")
    assert process.returncode == 1
    assert "holds no *.exr file" in err.splitlines()[-1]
    assert "Traceback" not in err
    assert "holds no *.exr file" in server.statuses[-1].last_error


def test_settings_come_from_the_environment_and_options_win() -> None:
    settings = StreamSettings.model_validate(
        {"source": "synthetic:room?width=64", "bands": 3, "filter": {"kind": "alpha", "alpha": 2}}
    )
    environment = {"LIGHTWELL_STREAM_SETTINGS": settings.model_dump_json()}
    with PublishServer() as server, worker(server, None, "--alpha", "5", "--forward", "1,0,0", **environment):
        server.wait_for(running)
    announced = StreamSettings.model_validate(server.announces[0].settings)
    assert (announced.bands, announced.filter.kind, announced.filter.alpha) == (3, "alpha", 5.0)
    assert announced.mapping.forward == (1.0, 0.0, 0.0)
    assert server.frames[-1].bands == 3


def test_settings_change_while_the_stream_runs() -> None:
    source = "synthetic:room?width=64"
    with PublishServer() as server, worker(server, source):
        server.wait_for(running)
        changed = {"source": source, "bands": 2, "resolution": 16, "window": {"kind": "hann"}}
        server.configure({**changed, "filter": {"kind": "none"}, "backdrop": {"width": 32, "fps": 30}})
        server.wait_for(lambda s: s.frames[-1].bands == 2 and s.frames[-1].window.kind == "hann")
        server.wait_for(lambda s: bool(s.backdrops) and s.backdrops[-1].width == 32)

        for refused in ({**changed, "source": "synthetic:room"}, {**changed, "bands": 99}):
            server.configure(refused)
            server.wait_for(lambda s: "settings refused" in s.statuses[-1].last_error)
            server.configure(changed)
            server.wait_for(lambda s: s.statuses[-1].last_error == "")
    seqs = [frame.seq for frame in server.frames]
    assert seqs == list(range(len(seqs)))
    assert len({frame.session for frame in server.frames}) == 1


def test_welcome_settings_win_over_announced_ones() -> None:
    source = "synthetic:room?width=64"
    with PublishServer(welcome_settings={"source": source, "bands": 4}) as server, worker(server, source):
        server.wait_for(lambda s: bool(s.frames) and s.frames[-1].bands == 4)


@pytest.mark.parametrize(("welcome", "changed"), [({"enabled": False}, False), ({"bands": 4}, True)])
def test_only_settings_that_change_the_stream_are_logged_as_changed(welcome: dict[str, object], changed: bool) -> None:
    source = "synthetic:room?width=64"
    with (
        PublishServer(welcome_settings={"source": source, **welcome}) as server,
        worker(server, source) as process,
    ):
        server.wait_for(running)
        process.terminate()
        _, _, log = finish(process)
    assert ("settings changed" in [entry["event"] for entry in log]) == changed


def test_folder_of_bad_frames_keeps_its_rate(tmp_path: Path) -> None:
    """Done-when 8: each kind of bad frame among good ones, looping."""
    fps = 60
    write_frames(tmp_path, 30)
    whole = (tmp_path / "f.0003.exr").read_bytes()
    (tmp_path / "f.0003.exr").write_bytes(whole[: len(whole) // 2])
    (tmp_path / "f.0007.exr").write_bytes(b"")
    (tmp_path / "f.0011.exr").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(200))
    write_rgb(tmp_path / "f.0015.exr", np.ones((8, 16, 3), np.float16))
    spoilt = np.ones((16, 32, 3), np.float32)
    spoilt[0, 0] = (np.nan, np.inf, -1.0)
    write_rgb(tmp_path / "f.0019.exr", spoilt)
    bad = {3, 7, 11, 15}

    with PublishServer() as server, worker(server, f"exr:{tmp_path}?fps={fps}&loop=1") as process:
        server.wait_for(lambda s: bool(s.statuses) and s.statuses[-1].frames_skipped >= 3 * len(bad), timeout=60)
        process.terminate()
        code, statuses, log = finish(process)
    assert code == 0

    # The stream keeps its rate: every good frame was captured at its place in the rhythm, none is slower for a bad one.
    assert _positions(server.frames, fps) == [_number(frame) for frame in server.frames]
    assert not bad & {_number(frame) for frame in server.frames}

    # The counters say what happened.
    last = StreamStatus(**{key: value for key, value in statuses[-1].items() if key != "type"})
    assert last.frames_skipped >= 3 * len(bad)
    assert last.frames_in - last.frames_skipped >= last.frames_published
    spoilt_frames = [frame for frame in server.frames if _number(frame) == 19]
    assert spoilt_frames
    assert all((f.quality.nan, f.quality.infinite, f.quality.negative) == (1, 1, 1) for f in spoilt_frames)
    assert last.nan_samples == last.infinite_samples == last.negative_samples >= len(spoilt_frames)
    assert all(np.isfinite(np.frombuffer(frame.coefficients, "<f4")).all() for frame in server.frames)

    # The log names each file once, with a reason.
    skipped = [entry for entry in log if entry["event"] == "frame skipped"]
    assert sorted(entry["frame"] for entry in skipped) == [f"f.{number:04d}.exr" for number in sorted(bad)]
    assert all(entry["reason"] and entry["stage"] == "source" for entry in skipped)
    assert last.last_error.startswith("f.00")


def _number(frame: Frame) -> int:
    return int(frame.source_frame[2:6])


def _positions(frames: list[Frame], fps: int) -> list[int]:
    """Return which of the thirty frames was due at each frame's capture time, by the first one's."""
    start_ns = frames[0].capture_time_ns - _number(frames[0]) * 1e9 / fps
    return [round((frame.capture_time_ns - start_ns) * fps / 1e9) % 30 for frame in frames]
