"""The adaptive grid that an ``ilf-grid`` job writes beside a regular one, and what it costs and saves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lightwell.field.adapt import adapt, compare
from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.atlas import atlas_bytes
from lightwell.field.grid import Grid
from lightwell.field.tiles import tile_count
from lightwell.io.adaptive import write_adaptive_grid
from lightwell.io.grids import open_grid
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.ilf_compare import relative_error
from lightwell_workers.jobs.ilf_plan import Field

TEXEL_BYTES = 8


def write_adaptive(path: Path, field: Field, grid: Grid, tolerance: float, context: JobContext) -> dict[str, Any]:
    """Write the adaptive form of a grid to ``path``; return and log how it compares with the regular one.

    What is compared is what was written, rounded to halves where the job stores these.
    """
    precision = field.settings.precision
    with threadpool_limits(1):  # sums of the matrix products in one order, whatever the machine
        adaptive = adapt(grid, tolerance, context.check)
    write_adaptive_grid(path, adaptive, precision)
    stored = open_grid(path)
    assert isinstance(stored, AdaptiveGrid)
    difference = compare(grid, stored)
    gpu, regular_gpu = atlas_bytes(stored), tile_count(grid.coefficients.shape[3]) * grid.spec.cells * TEXEL_BYTES
    report: dict[str, Any] = {
        "grid": path.name,
        "tolerance": tolerance,
        "bytes": stored.memory_bytes(precision),
        "bytes_regular": grid.memory_bytes(precision),
        "ratio": stored.memory_bytes(precision) / grid.memory_bytes(precision),
        "gpu_bytes": gpu,
        "gpu_bytes_regular": regular_gpu,
        "gpu_ratio": gpu / regular_gpu,
        "leaves": stored.leaves,
        "difference_rms": difference.rms,
        "difference_largest": difference.largest,
        "coverage_difference_largest": difference.coverage,
    }
    if field.settings.compare and field.capture.info.scene is not None:
        window = np.array(grid.attributes["window_weights"])
        report["error_relative"] = relative_error(field, grid.spec, stored.to_regular().coefficients, window)
        report["error_relative_regular"] = relative_error(field, grid.spec, grid.coefficients, window)
    context.log("adaptive grid", **report)
    if report["ratio"] >= 1:
        context.log(
            "the adaptive grid takes more memory than the regular one: raise adaptive_tolerance",
            level="warning",
            grid=path.name,
            ratio=report["ratio"],
        )
    return report
