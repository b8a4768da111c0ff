"""The grids of paper 000 at full size, through the real queue: sorting, resampling, memory, and the limit to approach.

Simulates both scenes (4,397 and 8,454 probes of 250×250), submits the jobs to an executor and reads their stages from
the job's own log. The baseline of the resampling is the bare matrix product of the same multiply–adds. On a machine
that others use too, core time (of all the job's processes) says more than the clock.
"""

from __future__ import annotations

import json
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil
from threadpoolctl import threadpool_limits

from bench.jobs import job_queue, wait_for
from bench.report import Row, row
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.jobs.queue import Queue

BANDS = 5
SCENES = (("scene1", 4397, 64, 45 * 60.0, 4 * 3600.0), ("scene2", 8454, 32, 105 * 60.0, 3600.0))
"""Name, probes, cells along each axis, and the paper's seconds for sorting and for resampling."""
BLOCK = 256
COLUMNS = 6144


def _multiply(count: int) -> float:
    """Do ``count`` blocks of the product on one thread; return its core time."""
    rows = np.random.default_rng(0).random((BANDS * BANDS, BLOCK), np.float32)
    radiance = np.random.default_rng(1).random((BLOCK, COLUMNS), np.float32)
    out = np.empty((BANDS * BANDS, COLUMNS), np.float32)
    with threadpool_limits(1):
        started = time.process_time()
        for _ in range(count):
            np.matmul(rows, radiance, out=out)
        return time.process_time() - started


class _Product(NamedTuple):
    """The bare float32 matrix product on all cores."""

    seconds: float
    core_seconds: float


def _bare_product(directions: int, cells: int) -> _Product:
    """Time a tenth of the product."""
    processes = os.cpu_count() or 1
    whole = directions / BLOCK * cells * 3 / COLUMNS
    blocks = max(1, round(whole / 10 / processes))
    with ProcessPoolExecutor(processes) as pool:
        list(pool.map(_multiply, [1] * processes))
        started = time.perf_counter()
        core_seconds = sum(pool.map(_multiply, [blocks] * processes))
        share = whole / (blocks * processes)
        return _Product((time.perf_counter() - started) * share, core_seconds * share)


class _Watch(threading.Thread):
    """Follows a process and all below it: memory, and core time by the stage that the job is in."""

    def __init__(self, pid: int, stage: Callable[[], str]) -> None:
        super().__init__(daemon=True)
        self._process = psutil.Process(pid)
        self._stage = stage
        self.stop = threading.Event()
        self.largest = 0
        self.together = 0
        self.core_seconds: dict[str, float] = {}

    def run(self) -> None:
        before: dict[int, float] = {}
        while not self.stop.wait(0.1):
            try:
                family = [self._process, *self._process.children(recursive=True)]
                sizes = [process.memory_info().rss for process in family]
                used = {process.pid: sum(process.cpu_times()[:2]) for process in family}
            except psutil.NoSuchProcess:
                continue
            self.largest = max(self.largest, *sizes)
            self.together = max(self.together, sum(sizes))
            stage = self._stage()
            spent = sum(seconds - before.get(pid, seconds) for pid, seconds in used.items())
            self.core_seconds[stage] = self.core_seconds.get(stage, 0.0) + spent
            before = used


def run() -> list[Row]:
    """Return the figures."""
    rows: list[Row] = []
    with job_queue() as (queue, data, executor):
        for scene, probes, cells, paper_sort, paper_resample in SCENES:
            rows += _measure(queue, data, executor, scene, probes, cells, paper_sort, paper_resample)
    return rows


def _measure(
    queue: Queue, data: Path, pid: int, scene: str, probes: int, cells: int, paper_sort: float, paper_resample: float
) -> list[Row]:
    capture = data / "captures" / scene
    capture.parent.mkdir(exist_ok=True)
    started = time.perf_counter()
    simulate_capture(capture, PRESETS[scene], RigSettings(probes=probes, samples=1))
    simulated = time.perf_counter() - started
    settings = {"capture": str(capture), "resolutions": cells}
    job = queue.submit("ilf-grid", settings)[0].id

    def stage() -> str:
        progress = queue.get(job).progress
        return "prepare" if progress is None else progress.stage

    watch = _Watch(pid, stage)
    watch.start()
    artifacts = wait_for(queue, job)
    watch.stop.set()
    watch.join()
    seconds = {"sort": 0.0, "resample": 0.0, "finish": 0.0}
    for _, event in queue.events(job):
        if event.get("message") == "step done":
            seconds[event["step"].split()[0]] += event["seconds"]
    report = json.loads((artifacts / "report.json").read_text())
    bare = _bare_product(report["directions"], cells**3)
    core = watch.core_seconds
    queue.delete(job)
    for path in capture.rglob("*.exr"):
        path.unlink()
    name = f"{scene}, {probes} probes, {cells}³"
    return [
        row(f"{name}: simulate", simulated, "s"),
        row(f"{name}: sort (baseline: the paper's)", seconds["sort"], "s", paper_sort),
        row(f"{name}: resample (baseline: the paper's)", seconds["resample"], "s", paper_resample),
        row(f"{name}: resample (baseline: bare matrix product)", seconds["resample"], "s", bare.seconds),
        row(f"{name}: sort, core time", core["sort"], "s"),
        row(f"{name}: resample, core time (baseline: bare product's)", core["resample"], "s", bare.core_seconds),
        row(f"{name}: finish", seconds["finish"], "s"),
        row(f"{name}: largest process", watch.largest / 1e9, "GB"),
        row(f"{name}: all processes", watch.together / 1e9, "GB"),
        row(f"{name}: relative rms error against the exact field", report["error_relative"], ""),
    ]
