"""Both scenes of paper 000: error of the grid against the exact field at 8³, 16³, 32³ and 64³, in one pass.

The probes are as many as the paper's; their frames are smaller (64×64), so that the bench takes a minute or two.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from bench.report import Row, row
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.job_settings import JobsSettings
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.jobs.queue import Queue

SCENES = (("scene1", 4397), ("scene2", 8454))
CELLS = [8, 16, 32, 64]
SIZE = 64


def run() -> list[Row]:
    """Return the errors, relative to the rms coefficient vector; baseline: without the viewpoint's correction."""
    rows: list[Row] = []
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        command = [sys.executable, "-m", "lightwell_server.cli", "work", "--data", folder, "--log-level", "error"]
        with subprocess.Popen(command, stdin=subprocess.DEVNULL) as executor:
            try:
                queue = Queue(JobsSettings(), data)
                for scene, probes in SCENES:
                    capture = data / scene
                    simulate_capture(capture, PRESETS[scene], RigSettings(probes=probes, size=SIZE))
                    corrected, plain = (_errors(queue, capture, viewpoint) for viewpoint in ("correct", "ignore"))
                    rows += [
                        row(f"{scene}, {probes} probes, {cells}³", error, "", other)
                        for cells, error, other in zip(CELLS, corrected, plain, strict=True)
                    ]
                queue.close()
            finally:
                executor.terminate()
    return rows


def _errors(queue: Queue, capture: Path, viewpoint: str) -> list[float]:
    settings = {"capture": str(capture), "resolutions": CELLS, "viewpoint": viewpoint}
    job = queue.submit("ilf-grid", settings)[0].id
    while queue.get(job).state not in ("succeeded", "failed"):
        time.sleep(0.2)
    if (error := queue.get(job).error) is not None:
        raise RuntimeError(error)
    report = json.loads((queue.root / job / "artifacts" / "report.json").read_text())
    return [grid["error_relative"] for grid in report["grids"]]
