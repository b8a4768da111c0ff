"""Both scenes of paper 000: error of the grid against the exact field at 8³, 16³, 32³ and 64³, in one pass.

The probes are as many as the paper's; their frames are smaller (64×64), so that the bench takes a minute or two.
"""

from __future__ import annotations

import json
from pathlib import Path

from bench.jobs import job_queue, wait_for
from bench.report import Row, row
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.jobs.queue import Queue

SCENES = (("scene1", 4397), ("scene2", 8454))
CELLS = [8, 16, 32, 64]
SIZE = 64


def run() -> list[Row]:
    """Return the errors, relative to the rms coefficient vector; baseline: without the viewpoint's correction."""
    rows: list[Row] = []
    with job_queue() as (queue, data, _):
        for scene, probes in SCENES:
            capture = data / scene
            simulate_capture(capture, PRESETS[scene], RigSettings(probes=probes, size=SIZE))
            corrected, plain = (_errors(queue, capture, viewpoint) for viewpoint in ("correct", "ignore"))
            rows += [
                row(f"{scene}, {probes} probes, {cells}³", error, "", other)
                for cells, error, other in zip(CELLS, corrected, plain, strict=True)
            ]
    return rows


def _errors(queue: Queue, capture: Path, viewpoint: str) -> list[float]:
    settings = {"capture": str(capture), "resolutions": CELLS, "viewpoint": viewpoint}
    job = queue.submit("ilf-grid", settings)[0].id
    report = json.loads((wait_for(queue, job) / "report.json").read_text())
    return [grid["error_relative"] for grid in report["grids"]]
