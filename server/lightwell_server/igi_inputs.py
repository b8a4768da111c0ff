"""What an ``igi-render`` job names of this server, put into its settings when it is submitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lightwell.io.uploads import UPLOAD_ID, UploadKind
from lightwell.job_settings import IgiLightSettings, IgiRenderSettings
from lightwell.wire import unpack_coefficients
from lightwell_server.artifacts import ArtifactNotFoundError, find_artifact
from lightwell_server.services import Services
from lightwell_server.variants import STRIPPED, make_variant
from lightwell_workers.jobs.job import Job
from lightwell_workers.jobs.kind import JobError


def igi_input(parts: Services, settings: IgiRenderSettings, earlier: Job | None) -> IgiRenderSettings:
    """Return settings that need no server: places of files in place of ids, and what a stream shows now.

    ``earlier``: the job of a repeated key, whose light is taken again. What the scene's file says of the renderer is
    put into ``igi``, so that a job shows it.

    Raises
    ------
    LightwellError, Problem
        Where there is no such thing, or it may not be used.
    """
    from lightwell_workers.jobs.igi_scene import scene_of  # with the renderer: .3 s that only such a job pays

    light = settings.light
    changes: dict[str, Any] = {}
    if light.map is not None:
        changes["map"] = str(file_of(parts, light.map, "map", "light.map"))
    if light.frames is not None:
        changes["frames"] = str(parts.captures.allowed(light.frames))
    if light.grid is not None:
        changes["grid"] = tuple(_grid(parts, named) for named in light.grid)
    placed = settings.model_copy(
        update={
            "scene": str(file_of(parts, settings.scene, "mesh", "scene")),
            "light": light.model_copy(update=changes),
        }
    )
    scene = scene_of(placed)
    stream = None if light.frames is not None or scene.light is None else scene.light.stream
    if stream is not None and light.coefficients is None:
        shown = _snapshot(parts, stream, earlier)
        if light.probe_at is not None:
            shown.pop("probe_at", None)
        placed = placed.model_copy(update={"light": placed.light.model_copy(update=shown)})
    return placed.model_copy(update={"igi": scene.igi})


def file_of(parts: Services, named: str, kind: UploadKind, field: str) -> Path:
    """Return the file that a job names by upload or by path."""
    if not UPLOAD_ID.match(named):
        return parts.captures.allowed(named)
    record = parts.uploads.find(named)
    if record.kind != kind:
        found = {"mesh": "mesh", "map": "light map"}
        raise JobError(f"{field}: the upload {named!r} is the {found[record.kind]} {record.name}; send a {found[kind]}")
    return parts.uploads.path(record)


def _grid(parts: Services, named: str) -> str:
    """Return a grid's id, or the folder of one."""
    if "/" not in named and not named.endswith(".zarr"):
        try:
            find_artifact(parts.jobs.root, named)
        except ArtifactNotFoundError:
            raise JobError(f"light.grid: there is no grid {named!r}; GET /api/v1/grids lists them") from None
        return named
    folder = parts.captures.allowed(named)
    if not folder.is_dir():
        raise JobError(f"light.grid: {named}: is no folder of a grid, such as grid-32.zarr")
    return str(folder)


def _snapshot(parts: Services, stream: str, earlier: Job | None) -> dict[str, Any]:
    if earlier is not None:
        before = IgiLightSettings.model_validate(earlier.settings.get("light", {}))
        return {"coefficients": before.coefficients, "probe_at": before.probe_at}
    channel = parts.catalogue.channel(stream)
    frame = channel.latest
    if frame is None:
        raise JobError(f"light.stream: {stream!r} has had no frame yet: start it, or name another")
    frame = make_variant(frame, STRIPPED)
    return {
        "coefficients": tuple(tuple(map(float, row)) for row in unpack_coefficients(frame.coefficients)),
        "probe_at": frame.position or channel.settings.position_m,
    }
