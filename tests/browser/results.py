"""Finished jobs that were never queued: their results, where the server looks for them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tests.browser.publisher import distant_light
from tests.browser.server import ServerProcess

from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.io.adaptive import write_adaptive_grid
from lightwell.io.grids import open_grid, write_grid
from lightwell_workers.jobs.directory import JobDirectory


def put_results(server: ServerProcess, job: str, files: Mapping[str, bytes]) -> None:
    """Give the server a finished job with these files."""
    directory = JobDirectory(server.directory / "data" / "jobs", job)
    results = directory.path / "results"
    results.mkdir(parents=True)
    for name, data in files.items():
        (results / name).write_bytes(data)
    directory.publish(results)


def put_grid(server: ServerProcess, job: str, grid: Grid) -> tuple[str, Grid]:
    """Give the server a finished grid; return its id, and the grid as it reads it."""
    directory = JobDirectory(server.directory / "data" / "jobs", job)
    results = directory.path / "results"
    results.mkdir(parents=True)
    write_grid(results / "grid.zarr", grid)
    directory.publish(results)
    opened = open_grid(directory.artifacts / "grid.zarr")
    assert isinstance(opened, Grid)
    return f"{job}.grid", opened


def put_adaptive(server: ServerProcess, job: str, grid: AdaptiveGrid) -> tuple[str, AdaptiveGrid]:
    """The same of an adaptive grid."""
    directory = JobDirectory(server.directory / "data" / "jobs", job)
    results = directory.path / "results"
    results.mkdir(parents=True)
    write_adaptive_grid(results / "adaptive.zarr", grid)
    directory.publish(results)
    opened = open_grid(directory.artifacts / "adaptive.zarr")
    assert isinstance(opened, AdaptiveGrid)
    return f"{job}.adaptive", opened


def put_group(server: ServerProcess, job: str, attributes: Mapping[str, object]) -> str:
    """Give the server a Zarr group that is called a grid, with these attributes and nothing in it; return its id."""
    document = {"zarr_format": 3, "node_type": "group", "attributes": attributes}
    directory = JobDirectory(server.directory / "data" / "jobs", job)
    folder = directory.path / "results" / "grid.zarr"
    folder.mkdir(parents=True)
    (folder / "zarr.json").write_text(json.dumps(document))
    directory.publish(Path(directory.path, "results"))
    return f"{job}.grid"


def lit_and_dark(resolution: tuple[int, int, int] = (12, 10, 6), bands: int = 5) -> Grid:
    """A field that falls from bright at low x to dark at high x, and whose light turns from above to the side."""
    spec = GridSpec((-1.5, -1.0, 0.0), (1.5, 1.0, 1.2), resolution)
    x, y, _ = np.moveaxis(spec.centres(), -1, 0)
    share = (x - spec.lower[0]) / (spec.upper[0] - spec.lower[0])
    brightness = np.exp(-3.0 * share)[..., None, None]
    turn = ((y - spec.lower[1]) / (spec.upper[1] - spec.lower[1]))[..., None, None]
    above: NDArray[np.float64] = distant_light((0.2, -0.5, 1.0)) * [1.0, 0.9, 0.75]
    aside = distant_light((-1.0, -0.4, 0.4)) * [0.7, 0.85, 1.0]
    field = brightness * ((1 - turn) * above + turn * aside)
    coefficients = np.asarray(field[..., : bands * bands, :], np.float32)
    return Grid(spec, coefficients, np.ones(spec.shape, np.float32))
