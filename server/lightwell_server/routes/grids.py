"""``/api/v1/grids``: finished grids, and the light at any point in them."""

from __future__ import annotations

import asyncio
import json
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Query, Request, Response
from numpy.typing import NDArray
from pydantic import BaseModel, Field

from lightwell.conventions import Convention
from lightwell.field.adaptive import AnyGrid
from lightwell.io.adaptive import FORMAT as ADAPTIVE_FORMAT
from lightwell.io.grids import GridError, open_grid
from lightwell.io.preview import preview_png
from lightwell.settings import FARTHEST_M, Vector3
from lightwell.sh.engines import convert
from lightwell_server.artifacts import ArtifactNotFoundError, find_artifact
from lightwell_server.problems import FieldError, Problem
from lightwell_server.routes.access import READ, problems
from lightwell_server.services import services
from lightwell_workers.jobs.directory import Artifact, JobDirectory

router = APIRouter(tags=["grids"])

SUFFIX = ".zarr"
MOST_POINTS = 4096
Rows = list[tuple[float, float, float]]


class GridDocument(BaseModel):
    """One grid."""

    id: str
    job: str
    bytes: int
    sha256: str
    attributes: dict[str, Any] = Field(description="bounds, voxel size, bands, units, source, settings")


class GridSummary(BaseModel):
    """One grid in the list."""

    id: str
    job: str
    path: str
    bytes: int
    sha256: str
    capture: str = Field("", description="name of the capture that it was made from")
    resolution: tuple[int, int, int] | None = Field(None, description="cells along x, y and z")
    bands: int | None = None
    adaptive: bool = False
    finished_ns: int = Field(description="when its job ended, nanoseconds since the Unix epoch")


class PointSample(BaseModel):
    """The light at one point."""

    at: tuple[float, float, float]
    coefficients: Rows = Field(description="bands² rows of [r, g, b]")
    gradients: list[list[tuple[float, float, float]]] | None = Field(
        None, description="per metre: for each coefficient and colour, [d/dx, d/dy, d/dz]"
    )
    coverage: float = Field(description="share of the sphere that was measured there, not repaired")


class GridSample(BaseModel):
    """The light at some points."""

    grid: str
    points: list[PointSample]


@lru_cache(maxsize=4)
def _cached(path: Path, sha256: str) -> AnyGrid:
    del sha256  # tells apart what may lie at the path one after the other
    return open_grid(path)


def _open(root: Path, grid: str) -> AnyGrid:
    try:
        artifact, place = find_artifact(root, grid)
    except ArtifactNotFoundError:
        artifact, place = None, Path()
    if artifact is None or not artifact.path.endswith(SUFFIX):
        raise GridError(f"there is no grid {grid!r}; GET /api/v1/grids lists them")
    return _cached(place, artifact.sha256)


@router.get("/grids", dependencies=READ, responses=problems())
async def list_grids(request: Request) -> list[GridSummary]:
    """List the finished grids, newest first."""
    root = services(request).jobs.root

    def collect() -> list[GridSummary]:
        folders = [path for path in root.iterdir() if (path / "manifest.json").is_file()] if root.is_dir() else []
        found = [
            _summary(directory, item)
            for directory in (JobDirectory(root, path.name) for path in folders)
            for item in directory.read_manifest()
            if item.path.endswith(SUFFIX)
        ]
        return sorted(found, key=lambda grid: (-grid.finished_ns, grid.id))

    return await asyncio.to_thread(collect)


def _summary(directory: JobDirectory, item: Artifact) -> GridSummary:
    """Describe a grid without opening its arrays; what its attributes do not say stays open."""
    summary = GridSummary(
        id=item.id, job=directory.id, path=item.path, bytes=item.bytes, sha256=item.sha256, finished_ns=0
    )
    try:
        summary.finished_ns = directory.manifest.stat().st_mtime_ns
        attributes = json.loads((directory.artifacts / item.path / "zarr.json").read_bytes())["attributes"]
        told = {
            "capture": attributes["capture"]["name"],
            "resolution": attributes["resolution"],
            "bands": attributes["bands"],
            "adaptive": attributes["format"] == ADAPTIVE_FORMAT,
        }
        return GridSummary.model_validate({**summary.model_dump(), **told})
    except (OSError, ValueError, KeyError, TypeError):
        return summary


@router.get("/grids/{grid}", dependencies=READ, responses=problems(404))
async def get_grid(request: Request, grid: str) -> GridDocument:
    """Describe one grid."""
    root = services(request).jobs.root
    opened = await asyncio.to_thread(_open, root, grid)
    artifact, _ = find_artifact(root, grid)
    return GridDocument(
        id=grid,
        job=grid.partition(".")[0],
        bytes=artifact.bytes,
        sha256=artifact.sha256,
        attributes=opened.attributes,
    )


@router.get("/grids/{grid}/sample", dependencies=READ, responses=problems(404, 422))
async def sample_grid(
    request: Request,
    grid: str,
    at: Annotated[
        list[str], Query(min_length=1, max_length=MOST_POINTS, description="x,y,z in metres; may be repeated")
    ],
    gradients: Annotated[bool, Query(description="also the change per metre")] = False,
    convention: Convention = "lightwell",
    bands: Annotated[int | None, Query(ge=1, le=6, description="at most this many bands")] = None,
) -> GridSample:
    """Return the light at points: trilinear, with the half-gradient rule where the grid has gradients."""
    points = np.array([read_point("at", text) for text in at])
    opened = await asyncio.to_thread(_open, services(request).jobs.root, grid)
    if gradients and convention != "lightwell":
        raise _bad("gradients", "true: are given in convention=lightwell only")
    wanted = min(bands or opened.bands, opened.bands)
    return await asyncio.to_thread(describe_samples, grid, opened, points, wanted, convention, gradients)


def describe_samples(
    name: str,
    grid: AnyGrid,
    points: NDArray[np.float64],
    bands: int,
    convention: Convention,
    gradients: bool,
) -> GridSample:
    """Return what ``grid sample`` says of points ``(n, 3)``."""
    samples = grid.sample(points, gradients=gradients, bands=bands)
    return GridSample(
        grid=name,
        points=[
            PointSample(
                at=tuple(points[index].tolist()),
                coefficients=convert(samples.coefficients[index], convention).tolist(),
                gradients=None if samples.gradients is None else samples.gradients[index].tolist(),
                coverage=float(samples.coverage[index]),
            )
            for index in range(len(points))
        ],
    )


@router.get("/grids/{grid}/preview", dependencies=READ, response_class=Response, responses=problems(404, 422))
async def preview_grid(
    request: Request, grid: str, normal: Annotated[str, Query(description="x,y,z of the lit surface")] = "0,0,1"
) -> Response:
    """Return a PNG: the irradiance on surfaces with this normal in the grid's three middle slices."""
    direction = _read_direction("normal", normal)
    opened = await asyncio.to_thread(_open, services(request).jobs.root, grid)
    return Response(await asyncio.to_thread(preview_png, opened, direction), media_type="image/png")


@router.get("/grids/{grid}/plot", dependencies=READ, response_class=Response, responses=problems(404, 422))
async def plot_grid_slices(
    request: Request, grid: str, normal: Annotated[str, Query(description="x,y,z of the lit surface")] = "0,0,1"
) -> Response:
    """Return a PNG with axes and scales: irradiance on surfaces with this normal, and coverage, in three slices."""
    direction = _read_direction("normal", normal)
    opened = await asyncio.to_thread(_open, services(request).jobs.root, grid)
    return Response(await asyncio.to_thread(_plot, opened, direction), media_type="image/png")


def _plot(grid: AnyGrid, normal: Vector3) -> bytes:
    from lightwell.io.plots import plot_grid  # matplotlib takes half a second to import

    return plot_grid(grid, normal)


def read_point(field: str, text: str) -> Vector3:
    """Return the place ``x,y,z``; raises the 422 problem that names the field where it is none."""
    place = _read_numbers(field, text)
    if max(map(abs, place)) > FARTHEST_M:
        raise _bad(field, f"{text!r}: must lie within {FARTHEST_M:g} m of the origin")
    return place


def _read_direction(field: str, text: str) -> Vector3:
    """Return the direction ``x,y,z``, of any length but none; raises as `read_point`."""
    direction = _read_numbers(field, text)
    if not any(direction):
        raise _bad(field, f"{text!r}: must not be 0,0,0")
    return direction


def _read_numbers(field: str, text: str) -> Vector3:
    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise _bad(field, f"{text!r}: must be three numbers, x,y,z") from None
    if not np.isfinite([x, y, z]).all():
        raise _bad(field, f"{text!r}: must be finite")
    return x, y, z


def _bad(field: str, message: str) -> Problem:
    return Problem(422, "invalid-input", f"{field}: {message}", errors=[FieldError(field=field, message=message)])
