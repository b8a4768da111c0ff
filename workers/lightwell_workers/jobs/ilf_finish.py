"""The end of an ``ilf-grid`` job: from sums to grids, a report and a picture."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from lightwell.conventions import degree_of_index
from lightwell.field.gradient import central_differences, project_in_place
from lightwell.field.grid import Grid
from lightwell.field.spec import Floats
from lightwell.field.sums import FieldSums
from lightwell.io.files import write_atomically
from lightwell.io.grids import write_grid
from lightwell.io.preview import preview_png
from lightwell.sh.window import fixed_window, laplacian_window, weakest_strength
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.ilf_adaptive import write_adaptive
from lightwell_workers.jobs.ilf_compare import relative_error, relative_gradient_error
from lightwell_workers.jobs.ilf_plan import Field, capture_attributes

WINDOW_CELLS = 4096


def finish(field: Field, sums: list[FieldSums], context: JobContext) -> None:
    """Write the grids, ``report.json`` and ``preview.png`` to the job's results."""
    several = len(sums) > 1
    reports = []
    for index, one in enumerate(sums):
        context.progress("finish", index, len(sums))
        grid, report = _make_grid(field, one, context)
        resolution = "x".join(str(count) for count in one.spec.resolution)
        name = f"grid-{resolution}.zarr" if several else "grid.zarr"
        write_grid(context.results / name, grid, field.settings.precision)
        reports.append({"grid": name, **report})
        if (tolerance := field.settings.adaptive_tolerance) is not None:
            path = context.results / name.replace("grid", "adaptive")
            reports[-1]["adaptive"] = write_adaptive(path, field, grid, tolerance, context)
        if index == 0:
            write_atomically(context.results / "preview.png", preview_png(grid))
    report = {
        "probes": field.capture.count,
        "directions": field.directions,
        "rotating": field.rotating,
        **{key: value for key, value in reports[0].items() if key == "error_relative"},
        "grids": reports,
    }
    write_atomically(context.results / "report.json", (json.dumps(report, indent=1) + "\n").encode())
    context.progress("finish", len(sums), len(sums))


def _make_grid(field: Field, sums: FieldSums, context: JobContext) -> tuple[Grid, dict[str, Any]]:
    settings = field.settings
    coefficients = sums.coefficients
    solid_angle = float(field.buckets.weights.sum())
    if sums.dark > 1e-6 * solid_angle:
        context.log("some directions have no sample near the grid", level="warning", share=sums.dark / solid_angle)
    report: dict[str, Any] = {
        "resolution": list(sums.spec.resolution),
        "samples_per_kernel": float(sums.samples.mean() / solid_angle),
        "repaired_share": max(0.0, float(1 - sums.coverage.mean() / solid_angle)),
        "dark_share": sums.dark / solid_angle,
    }
    if settings.compare and field.capture.info.scene is not None:
        report["error_relative"] = relative_error(field, sums.spec, sums.coefficients)
    gradients = sums.gradients
    if settings.gradients == "central":
        gradients = central_differences(coefficients, sums.spec.voxel)
    if gradients is not None and settings.gradient_projection:
        # Before the window: it is unwindowed light that obeys.
        report["gradients_forbidden_share"] = project_in_place(gradients)
    weights = _window(field, coefficients)
    factors = weights[degree_of_index(settings.bands)][:, None].astype(np.float32)
    coefficients *= factors
    if gradients is not None:
        gradients *= factors[:, None]
    if gradients is not None and settings.compare and field.capture.info.scene is not None:
        report["gradients_error_relative"] = relative_gradient_error(field, sums.spec, gradients, weights)
    grid = Grid(
        sums.spec,
        coefficients,
        np.minimum(sums.coverage / np.float32(solid_angle), np.float32(1)),
        (sums.samples / np.float32(solid_angle)).astype(np.float32),
        gradients,
        {
            **capture_attributes(field),
            "window": settings.window.kind,
            "window_weights": weights.tolist(),
            "settings": settings.model_dump(mode="json", exclude={"capture"}),
        },
    )
    return grid, report


def _window(field: Field, coefficients: np.ndarray[Any, np.dtype[np.float32]]) -> Floats:
    """Return the factor of each degree ``(bands,)``; auto: the weakest that is enough for cells all over the grid."""
    settings, bands = field.settings.window, field.settings.bands
    if settings.kind != "auto":
        return fixed_window(settings.kind, bands, settings.width, settings.target)
    flat = coefficients.reshape(-1, *coefficients.shape[3:])
    strength = 0.0
    for cell in flat[:: max(1, len(flat) // WINDOW_CELLS)].astype(np.float64):
        strength = max(strength, weakest_strength(cell, settings.target, at_least=strength))
    return laplacian_window(strength, bands)
