"""The commands serve, watch, doctor and demo, as processes."""

from __future__ import annotations

import io
import json
import signal
import socket
import subprocess
import sys
from collections import deque
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from rich.console import Console
from tests.support.publisher import Publisher, make_frame
from tests.support.server import running_server, server_process, wait_until

from lightwell.conventions import LUMINANCE
from lightwell_client import LightFrame, LightStream
from lightwell_server.cli.watch import _table, frame_rate, mean_irradiance, sparkline


def lightwell(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "lightwell_server.cli", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=False, cwd=cwd, timeout=100)


def test_serve_answers_and_stops_in_order(tmp_path: Path) -> None:
    with server_process(tmp_path) as (url, process):
        assert httpx.get(f"{url}/healthz").status_code == 200
        process.send_signal(signal.SIGTERM)
        assert process.wait(30) == -signal.SIGTERM
        with pytest.raises(httpx.ConnectError):
            httpx.get(f"{url}/healthz")


def test_a_port_in_use_is_one_clear_line(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = lightwell("serve", "--port", str(port), "--data", str(tmp_path), cwd=tmp_path)
    assert result.returncode == 1
    assert result.stderr == (
        f"lightwell: port {port} of 127.0.0.1 is in use: stop what uses it, or give another --port\n"
    )


def test_mistakes_in_the_file_are_lines_without_a_traceback(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    file.write_text("[server]\nport = -1\n")
    result = lightwell("serve", "--config", str(file))
    assert (result.returncode, result.stdout) == (1, "")
    assert result.stderr == f"lightwell: {file}: server.port = -1: must be greater than or equal to 0\n"


def test_a_data_folder_that_cannot_be_used_is_a_line(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = lightwell("serve", "--port", "0", "--data", str(tmp_path / "file"), cwd=tmp_path)
    assert result.returncode == 1
    assert "cannot be opened" in result.stderr
    assert "Traceback" not in result.stderr


def test_watch_prints_one_message_a_line(server: str) -> None:
    with Publisher(server) as worker:
        worker.publish()
        result = lightwell(
            "watch", "probe", "--server", server, "--count", "1", "--json", "--convention", "three", "--bands", "2"
        )
    assert result.returncode == 0, result.stderr
    (line,) = result.stdout.splitlines()
    message: dict[str, Any] = json.loads(line)
    assert (message["stream"], message["seq"], message["missed"], message["from_hello"]) == ("probe", 0, 0, True)
    assert (message["bands"], message["convention"], message["units"]) == (2, "three", "relative")
    assert (message["window"], message["mapping"]) == ("none", "latlong")
    assert message["publish_time_ns"] >= message["capture_time_ns"]
    coefficients = np.array(message["coefficients"])
    assert coefficients.shape == (4, 3)
    assert np.float32(coefficients).tolist() == coefficients.tolist()


def test_watch_shows_a_table(server: str) -> None:
    with Publisher(server) as worker:
        worker.publish()
        result = lightwell("watch", "probe", "--server", server, "--count", "1")
    assert result.returncode == 0, result.stderr
    assert "stream probe" in result.stdout
    assert "irradiance" in result.stdout
    assert "latency" not in result.stdout  # the hello's frame says nothing about it


def test_watch_says_why_it_is_refused(server: str) -> None:
    result = lightwell("watch", "nowhere", "--server", server)
    assert result.returncode == 1
    assert result.stderr == "lightwell: nowhere: there is no stream 'nowhere'; there are: none yet\n"
    result = lightwell("watch", "probe", "--convention", "maya")
    assert result.returncode == 2
    assert "must be one of lightwell, three" in " ".join(result.stderr.replace("│", " ").split())


@pytest.mark.parametrize("server", ["localhost:8400", "htp://x"])
def test_watch_takes_only_urls(server: str) -> None:
    result = lightwell("watch", "probe", "--server", server)
    assert result.returncode == 1
    (line,) = result.stderr.splitlines()
    assert line.startswith(f"lightwell: --server: server {server!r} is no URL such as http://")


def test_watch_says_why_there_is_no_connection() -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        url = f"http://127.0.0.1:{free.getsockname()[1]}"
    command = [sys.executable, "-m", "lightwell_server.cli", "watch", "probe", "--json", "--server", url]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        line = process.stderr.readline()
        process.send_signal(signal.SIGINT)
    assert line.startswith("lightwell: no connection: ")
    assert "Connect call failed" in line
    with LightStream("probe", url) as light:
        wait_until(lambda: light.last_error)
        output = io.StringIO()
        Console(width=120, file=output).print(_table(light, deque()))
    assert "Connect call failed" in output.getvalue()


def test_doctor_finds_this_machine_well(tmp_path: Path) -> None:
    result = lightwell("doctor", "--json", "--data", str(tmp_path))
    report = json.loads(result.stdout)
    findings = {check["name"]: check for check in report["checks"]}
    assert report["ok"], findings
    assert result.returncode == 0
    assert set(findings) >= {"Python", "packages", "numba", "EXR", "video", "web page", "Chromium", "port", "data"}
    assert "zstd" in findings["EXR"]["detail"]
    assert "no camera drivers" in findings["sources"]["detail"]


def test_doctor_names_the_remedy(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        result = lightwell("doctor", "--port", str(port), "--data", str(tmp_path))
    assert f"✗ port: {port}: Address already in use" in result.stdout
    assert f"  → stop what uses port {port}, or serve with another --port" in result.stdout
    assert result.returncode == 0  # another port will do


def test_doctor_refuses_a_file_for_the_data(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("")
    result = lightwell("doctor", "--data", str(file))
    assert f"✗ data: {file}: cannot be written to: Not a directory" in result.stdout
    assert result.returncode == 1


@pytest.mark.slow
def test_demo_runs_the_whole_system(tmp_path: Path) -> None:
    result = lightwell("demo", "--once", "--json", "--data", str(tmp_path), cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary["ok"] is True
    (job,) = summary["jobs"]
    assert (job["kind"], job["state"]) == ("ilf-grid", "succeeded")
    assert 0 < job["error_relative"] < 0.2
    streams = {stream["name"]: stream for stream in summary["streams"]}
    assert set(streams) == {"sunset-walk", "mirror-sphere", "room", "room-side"}
    for stream in streams.values():
        assert stream["frames"] >= 2
        assert stream["fps"] > 0
        assert stream["missed"] >= 0
        assert stream["latency_ms"]["p99"] >= stream["latency_ms"]["p50"] > 0
        assert np.array(stream["coefficients"]).shape == (9, 3)
        assert np.isfinite(stream["coefficients"]).all()
        assert stream["coefficients"][0][0] > 0


def test_constant_light_has_the_irradiance_pi() -> None:
    frame = make_frame(coefficients=make_frame(bands=1).coefficients, bands=1)
    light = LightFrame.from_wire(frame, mapping="", received_time_ns=0, missed=0)
    for convention, first in (("three", np.sqrt(4 * np.pi)), ("unity", 1.0)):
        constant = np.full((1, 3), first, np.float32)
        values = {"coefficients": constant, "convention": convention}
        assert mean_irradiance(LightFrame(**vars(light) | values)) == pytest.approx(np.pi)
    assert LUMINANCE.sum() == pytest.approx(1)


def test_sparkline_and_frame_rate() -> None:
    assert sparkline([0, 1, 2, 3, 4, 5, 6, 7]) == "▁▂▃▄▅▆▇█"
    assert sparkline([3, 3]) == "▁▁"
    assert sparkline([0, float("inf")]) == "▁▁"
    assert frame_rate([0, 10**9, 2 * 10**9]) == 1.0
    assert frame_rate([5]) == 0.0


def test_listening_on_the_network_warns(tmp_path: Path) -> None:
    with running_server(tmp_path, server={"host": "0.0.0.0"}) as url:
        assert url.startswith("http://127.0.0.1:")
        assert httpx.get(f"{url}/healthz").status_code == 200
