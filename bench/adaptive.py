"""Adaptive grids of both scenes of paper 000 against regular ones: memory and error at several tolerances.

The probes are as many as the paper's; their frames are smaller (64×64), so that the bench takes a minute or two. Memory
is that of coefficients, coverage and tables, on the GPU that of the half-float textures. Errors are rms errors against
the exact field, relative to the rms coefficient vector; differences from the regular grid likewise.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.jobs import job_queue, wait_for
from bench.report import Row, row
from lightwell.field.adapt import adapt, compare
from lightwell.field.atlas import atlas_bytes
from lightwell.field.grid import Grid
from lightwell.field.spec import Floats
from lightwell.field.tiles import tile_count
from lightwell.io.grids import open_grid
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.jobs.queue import Queue

SCENES = (("scene1", 4397, 64), ("scene2", 8454, 32))
"""Name, probes and cells along each axis, as in the paper."""
TOLERANCES = (0.3, 0.2, 0.1, 0.05, 0.02)
SIZE = 64
COMPARED_CELLS = 2048
TEXEL_BYTES = 8


def run() -> list[Row]:
    """Return memory and errors; baseline: the regular grid's."""
    rows: list[Row] = []
    with job_queue() as (queue, data, _):
        for scene, probes, cells in SCENES:
            capture = data / scene
            simulate_capture(capture, PRESETS[scene], RigSettings(probes=probes, size=SIZE), angular=True)
            rows += _measure(scene, _regular(queue, capture, cells))
    return rows


def _regular(queue: Queue, capture: Path, cells: int) -> Grid:
    job = queue.submit("ilf-grid", {"capture": str(capture), "resolutions": cells, "compare": False})[0].id
    return open_grid(wait_for(queue, job) / "grid.zarr").to_regular()


def _measure(scene: str, grid: Grid) -> list[Row]:
    chosen = np.linspace(0, grid.spec.cells - 1, COMPARED_CELLS).round().astype(np.intp)
    exact = PRESETS[scene].coefficients(grid.spec.centres().reshape(-1, 3)[chosen], grid.bands)
    regular = _error(grid, chosen, exact)
    textures = tile_count(grid.coefficients.shape[3]) * grid.spec.cells * TEXEL_BYTES
    rows = []
    for tolerance in TOLERANCES:
        started = time.perf_counter()
        adaptive = adapt(grid, tolerance)
        seconds = time.perf_counter() - started
        difference = compare(grid, adaptive)
        name = f"{scene}, {grid.spec.resolution[0]}³, {tolerance:g}"
        rows += [
            row(f"{name}: memory", adaptive.memory_bytes() / 1e6, "MB", grid.memory_bytes() / 1e6),
            row(f"{name}: textures", atlas_bytes(adaptive) / 1e6, "MB", textures / 1e6),
            row(f"{name}: error", _error(adaptive.to_regular(), chosen, exact), "", regular),
            row(f"{name}: rms difference", difference.rms, ""),
            row(f"{name}: largest difference", difference.largest, ""),
            row(f"{name}: time to make", seconds, "s"),
            *(row(f"{name}: leaves of level {level}", count, "") for level, count in enumerate(adaptive.leaves)),
        ]
    return rows


def print_report(title: str, rows: list[Row]) -> None:
    """Print a line for each grid."""
    grids: dict[str, dict[str, Row]] = {}
    for item in rows:
        grid, _, figure = item["name"].partition(": ")
        grids.setdefault(grid, {})[figure] = item
    table = Table(title=title, title_justify="left")
    headings = (
        "scene, cells, tolerance",
        "MB",
        "of regular",
        "textures",
        "error",
        "of regular",
        "rms diff.",
        "largest",
    )
    for heading in (*headings, "leaves, fine to coarse", "s"):
        table.add_column(heading, justify="left" if heading.startswith(("scene", "leaves")) else "right")
    for grid, figures in grids.items():
        leaves = "/".join(f"{item['value']:.0f}" for figure, item in figures.items() if figure.startswith("leaves"))
        memory, textures, error = (figures[name] for name in ("memory", "textures", "error"))
        table.add_row(
            grid,
            f"{memory['value']:.3g}",
            f"{memory['ratio']:.3f}",
            f"{textures['ratio']:.3f}",
            f"{error['value']:.4f}",
            f"{error['ratio']:.2f}",
            f"{figures['rms difference']['value']:.4f}",
            f"{figures['largest difference']['value']:.4f}",
            leaves,
            f"{figures['time to make']['value']:.1f}",
        )
    Console(file=sys.stdout, width=140).print(table)


def _error(grid: Grid, chosen: np.ndarray[tuple[int], np.dtype[np.intp]], exact: Floats) -> float:
    found = grid.coefficients.reshape(-1, *grid.coefficients.shape[3:])[chosen]
    return float(np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum()))
