"""Fan-out: 300 subscribers at 30 frames a second on one server process, with a stalled and a restless one among them.

Four processes: the server (as ``lightwell serve`` runs it), a publisher, and two that hold the subscribers and record
when each message arrived. Latency is from the worker's send to the arrival at the subscriber, over all subscribers.
"""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from urllib.parse import urlsplit

import httpx
import msgspec
import numpy as np
import psutil
import uvloop
from websockets.asyncio.client import connect
from websockets.sync.client import connect as connect_blocking
from websockets.typing import Subprotocol

from bench.report import Row, row
from lightwell.wire import (
    SUBPROTOCOL,
    Announce,
    Frame,
    Hello,
    Missed,
    Quality,
    WindowUsed,
    decode_live,
    encode,
    pack_coefficients,
)

SUBSCRIBERS = 300
FPS = 30
BANDS = 5
SECONDS = 60.0
SETTLE_SECONDS = 3.0
LOAD_PROCESSES = 2
AIM_FPS, AIM_P99_MS = 29.0, 100.0
PROTOCOL = [Subprotocol(SUBPROTOCOL)]


class LoadReport(msgspec.Struct):
    """What one load process saw."""

    fps: list[float]
    latency_ms: list[float]
    """Percentiles 0 … 100, and 99.9 last."""
    missed: int
    count: int


def run(seconds: float = SECONDS, subscribers: int = SUBSCRIBERS) -> list[Row]:
    """Return the figures; the aims of the project stand as baselines."""
    stop = threading.Event()
    restless: list[float] = []
    with _server() as (url, process):
        helpers = [
            threading.Thread(target=_publish, args=(url, stop)),
            threading.Thread(target=_stay_stalled, args=(url, stop)),
            threading.Thread(target=_come_and_go, args=(url, stop, restless)),
        ]
        for helper in helpers:
            helper.start()
        loads = [_start_load(url, subscribers // LOAD_PROCESSES, seconds) for _ in range(LOAD_PROCESSES)]
        time.sleep(SETTLE_SECONDS)
        memory, processor = _watch(process, seconds)
        reports = [_finish_load(load) for load in loads]
        stalled = _metric(url, "lightwell_subscribers_stalled_total")
        stop.set()
        for helper in helpers:
            helper.join()
    latencies = np.array([report.latency_ms for report in reports])
    rates = [rate for report in reports for rate in report.fps]
    half = len(memory) // 2
    return [
        row("subscribers", len(rates), "", subscribers),
        row("frames per second, slowest subscriber", min(rates), "1/s", AIM_FPS),
        row("frames per second, median", float(np.median(rates)), "1/s", FPS),
        row("latency, median", float(latencies[:, 50].mean()), "ms"),
        row("latency, p99", float(latencies[:, 99].max()), "ms", AIM_P99_MS),
        row("latency, p99.9", float(latencies[:, 101].max()), "ms"),
        row("latency, longest", float(latencies[:, 100].max()), "ms"),
        row("frames missed, of all sent", sum(r.missed for r in reports) / sum(r.count for r in reports), ""),
        row(
            "memory of the server, second half", float(np.median(memory[half:])), "MiB", float(np.median(memory[:half]))
        ),
        row("memory of the server, growth", memory[-1] - memory[0], "MiB"),
        row("processor time of the server", processor, "% of one core"),
        row("subscribers that stalled and were cut off", stalled, ""),
        row("subscribers that came and went", len(restless), ""),
    ]


@contextlib.contextmanager
def _server() -> Iterator[tuple[str, psutil.Process]]:
    """Run ``lightwell serve`` on a free port."""
    with TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, "-m", "lightwell_server.supervised", "serve", "--port", "0", "--data", folder],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=folder,
        )
        try:
            assert process.stdout is not None
            yield process.stdout.readline().split()[-1], psutil.Process(process.pid)
        finally:
            process.terminate()
            process.communicate()


def _socket_url(url: str, end: str) -> str:
    return f"ws://{urlsplit(url).netloc}/api/v1/streams/bench/{end}"


def _publish(url: str, stop: threading.Event) -> None:
    """Publish at a steady rate."""
    rng = np.random.default_rng(1)
    with connect_blocking(_socket_url(url, "publish"), subprotocols=PROTOCOL, compression=None) as worker:
        settings = {"source": "synthetic:room"}
        worker.send(encode(Announce(stream="bench", session="s", worker_version="0", settings=settings)))
        worker.recv()
        start = time.perf_counter()
        sequence = 0
        while not stop.wait(max(start + sequence / FPS - time.perf_counter(), 0)):
            now = time.time_ns()
            frame = Frame(
                stream="bench",
                session="s",
                seq=sequence,
                capture_time_ns=now,
                ingest_time_ns=now,
                publish_time_ns=now,
                bands=BANDS,
                coefficients=pack_coefficients(rng.standard_normal((BANDS**2, 3))),
                window=WindowUsed(kind="none", weights=[1.0] * BANDS),
                quality=Quality(stage_ms={"project": 1.0}),
            )
            frame.publish_time_ns = time.time_ns()
            worker.send(encode(frame))
            sequence += 1


def _metric(url: str, name: str) -> float:
    """Return a metric of the one stream."""
    lines = httpx.get(f"{url}/metrics").text.splitlines()
    return next(float(line.split()[-1]) for line in lines if line.startswith(f"{name}{{"))


def _raw_subscriber(url: str) -> socket.socket:
    """Return a socket that has asked for the stream."""
    parts = urlsplit(url)
    peer = socket.socket()
    peer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    peer.connect((parts.hostname, parts.port))
    peer.sendall(
        f"GET /api/v1/streams/bench/live HTTP/1.1\r\nHost: {parts.netloc}\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n".encode()
    )
    return peer


def _stay_stalled(url: str, stop: threading.Event) -> None:
    """Subscribe and read nothing; come back when cut off."""
    while not stop.wait(1.0):
        with _raw_subscriber(url):
            stop.wait(20.0)


def _come_and_go(url: str, stop: threading.Event, visits: list[float]) -> None:
    """Subscribe and vanish, once a second, every other time without a word; note when."""
    while not stop.wait(1.0):
        visits.append(time.time())
        if len(visits) % 2:
            _raw_subscriber(url).close()
            continue
        with connect_blocking(_socket_url(url, "live"), subprotocols=PROTOCOL, compression=None) as light:
            light.recv()


def _watch(process: psutil.Process, seconds: float) -> tuple[list[float], float]:
    """Return the resident memory each second, MiB, and the processor time used, per cent of one core."""
    before, start = sum(process.cpu_times()[:2]), time.perf_counter()
    memory = []
    while time.perf_counter() - start < seconds:
        memory.append(process.memory_info().rss / 2**20)
        time.sleep(1.0)
    used = sum(process.cpu_times()[:2]) - before
    return memory, 100.0 * used / (time.perf_counter() - start)


def _start_load(url: str, subscribers: int, seconds: float) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "bench.fanout", url, str(subscribers), str(seconds)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parent.parent)


def _finish_load(process: subprocess.Popen[str]) -> LoadReport:
    output, _ = process.communicate()
    return msgspec.json.decode(output, type=LoadReport)


async def _load(url: str, subscribers: int, seconds: float) -> LoadReport:
    """Hold many subscribers and record what they get."""
    begin = time.perf_counter() + SETTLE_SECONDS
    results = await asyncio.gather(*(_subscriber(url, begin, begin + seconds) for _ in range(subscribers)))
    latencies = np.concatenate([np.array(latency) for _, latency, _ in results])
    return LoadReport(
        fps=[rate for rate, _, _ in results],
        latency_ms=np.percentile(latencies, [*range(101), 99.9]).tolist(),
        missed=sum(missed for _, _, missed in results),
        count=len(latencies),
    )


async def _subscriber(url: str, begin: float, end: float) -> tuple[float, list[float], int]:
    """Return one subscriber's frames per second, latencies in milliseconds and missed frames."""
    latencies: list[float] = []
    missed = 0
    async with connect(_socket_url(url, "live"), subprotocols=PROTOCOL, compression=None) as light:
        async for data in light:
            now = time.perf_counter()
            if now >= end:
                break
            message = decode_live(data if isinstance(data, bytes) else data.encode())
            if now < begin or isinstance(message, Hello):
                continue
            if isinstance(message, Frame):
                latencies.append((time.time_ns() - message.publish_time_ns) / 1e6)
            elif isinstance(message, Missed):
                missed += message.count
    return len(latencies) / (end - begin), latencies, missed


if __name__ == "__main__":
    arguments = sys.argv[1:]
    report = uvloop.run(_load(arguments[0], int(arguments[1]), float(arguments[2])))
    sys.stdout.write(msgspec.json.encode(report).decode())
