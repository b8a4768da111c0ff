"""Frames per second from EXR files to published messages, and milliseconds per stage, next to paper 003's Table 2.

The projection alone is then held against reading the frame, plain NumPy and ducc0 (`bench.projection`).
"""

from __future__ import annotations

import asyncio
import multiprocessing
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from websockets.asyncio.server import ServerConnection, serve
from websockets.typing import Subprotocol

from bench import projection
from bench.report import Row, print_table, row
from lightwell.io.exr import read_rgb, write_rgb
from lightwell.settings import StreamSettings
from lightwell.wire import SUBPROTOCOL, Announce, Frame, StreamStatus, Welcome, decode_worker, encode
from lightwell_workers.ingest.log import configure_logging
from lightwell_workers.ingest.samples import map_path
from lightwell_workers.ingest.worker import run_worker

SIZES = ((2400, 1700), (1628, 814), (814, 407), (407, 203), (203, 101), (101, 50), (50, 25))
PAPER_FPS = {(1628, 814): 9, (814, 407): 24, (407, 203): 40, (203, 101): 44, (101, 50): 55, (50, 25): 64}
"""Table 2 of paper 003: the whole chain, with rendering, on the authors' machine."""

COMPRESSIONS = ("none", "zstd")
FILES = 8
"""Different frames on disk; each is played many times, from the page cache."""
FRAMES = {2400: 240, 1628: 480}
WARM_UP = 20
"""Frames before the clock starts: kernels are loaded and tables are made."""


def run() -> list[Row]:
    """Play each recording as fast as possible through a whole worker to a sink in another process."""
    configure_logging("bench", log_format="json", level="error")
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as scratch:
        for width, height in SIZES:
            for compression in COMPRESSIONS:
                folder = Path(scratch) / f"{width}-{compression}"
                _record(folder, width, height, compression, FRAMES.get(width, 800))
                rows += _play(folder, width, height, compression)
    return rows + projection.run()


def print_report(name: str, rows: list[Row]) -> None:
    """Print one line a recording with its stages side by side, then the comparison of the projection."""
    stages = [item["name"].partition(": ")[2] for item in rows if item["name"].startswith("2400x1700 half none: ")]
    table = Table(title=name, title_justify="left")
    for heading in ("frames", "fps", "paper 003", "ratio", *(f"{stage} ms" for stage in stages)):
        table.add_column(heading, justify="left" if heading == "frames" else "right")
    values = {item["name"]: item["value"] for item in rows}
    played = [item for item in rows if item["unit"] == "fps"]
    for item in played:
        paper = (f"{item['baseline']:g}", f"{item['ratio']:.1f}") if "baseline" in item else ("", "")
        milliseconds = [f"{values[item['name'] + ': ' + stage]:.2f}" for stage in stages]
        table.add_row(item["name"], f"{item['value']:.0f}", *paper, *milliseconds)
    Console(width=max(140, Console().width)).print(table)
    print_table("projection", rows[len(played) * (1 + len(stages)) :])


def _record(folder: Path, width: int, height: int, compression: str, frames: int) -> None:
    """Write a real map with photon noise: noise, not a smooth upsampled map, is what a compressor meets."""
    folder.mkdir()
    original = read_rgb(map_path("esplanade")).pixels.astype(np.float32)
    picture = np.asarray(cv2.resize(original, (width, height)), dtype=np.float32)
    generator = np.random.default_rng(1)
    for number in range(FILES):
        noise = np.asarray(generator.standard_normal(picture.shape, dtype=np.float32))
        write_rgb(folder / f"{number}.source.exr", _noisy(picture, noise), compression)
    for number in range(frames):
        (folder / f"frame.{number:04d}.exr").symlink_to(folder / f"{number % FILES}.source.exr")


def _noisy(picture: NDArray[np.float32], noise: NDArray[np.float32]) -> NDArray[np.float16]:
    return (picture + 0.01 * np.sqrt(np.maximum(picture, 0)) * noise).astype(np.float16)


def _play(folder: Path, width: int, height: int, compression: str) -> list[Row]:
    statuses: list[StreamStatus] = []
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    sink = spawn.Process(target=_run_sink, args=(theirs,), daemon=True)
    sink.start()
    theirs.close()  # ours is then at its end when the sink is
    source = f"exr:{folder}/frame.%04d.exr?realtime=0"
    run_worker(StreamSettings(source=source), "bench", f"http://127.0.0.1:{ours.recv()}", on_status=statuses.append)
    fps: float = ours.recv()
    sink.join()
    name = f"{width}x{height} half {compression}"
    stages = [row(f"{name}: {stage}", ms, "ms") for stage, ms in statuses[-1].stage_ms.items()]
    return [row(name, fps, "fps", PAPER_FPS.get((width, height))), *stages]


def _run_sink(pipe: Connection) -> None:
    """Be the server, in a process of its own: welcome one worker, and time when its frames arrive."""
    asyncio.run(_sink(pipe))


async def _sink(pipe: Connection) -> None:
    arrivals: list[float] = []
    ended = asyncio.Event()

    async def take(connection: ServerConnection) -> None:
        async for data in connection:
            message = decode_worker(bytes(data) if not isinstance(data, str) else data.encode())
            if isinstance(message, Announce):
                await connection.send(encode(Welcome(settings=message.settings, server_session="bench")))
            elif isinstance(message, Frame):
                arrivals.append(time.perf_counter())
        ended.set()

    async with serve(take, "127.0.0.1", 0, subprotocols=[Subprotocol(SUBPROTOCOL)], compression=None) as server:
        pipe.send(server.sockets[0].getsockname()[1])
        await ended.wait()
    pipe.send((len(arrivals) - 1 - WARM_UP) / (arrivals[-1] - arrivals[WARM_UP]))
