"""What an ``igi-render`` job names of this server, put into its settings when it is submitted."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.gradients.interpolate import SampleSet
from lightwell.io.uploads import UPLOAD_ID, UploadKind
from lightwell.job_settings import IgiLightSettings, IgiRenderSettings
from lightwell.scene_settings import SceneLightSettings
from lightwell.settings import Vector3
from lightwell.wire import Frame, unpack_coefficients, unpack_gradients
from lightwell_server.artifacts import ArtifactNotFoundError, find_artifact
from lightwell_server.fields import sample_set
from lightwell_server.hub import Channel
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
    from lightwell_workers.jobs.igi_scene import scene_of, size_of  # with the renderer: .3 s that only such a job pays

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
    source = scene.light
    if source is not None and source.file is None and light.coefficients is None:
        if source.field is not None or source.gradients:
            shown = _before(earlier) or _amid(parts, source, size_of(placed, parts.captures.roots).middle)
        elif source.stream is not None:
            shown = _before(earlier) or _snapshot(parts, source.stream)
        else:
            shown = {}
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


def _snapshot(parts: Services, stream: str) -> dict[str, Any]:
    """Return what a stream shows now, and where its probe stands."""
    channel, frame = _shown(parts, stream)
    frame = make_variant(frame, STRIPPED)
    return _light(unpack_coefficients(frame.coefficients)) | {"probe_at": frame.position or channel.settings.position_m}


def _amid(parts: Services, source: SceneLightSettings, middle: Vector3) -> dict[str, Any]:
    """Return what arrives now in the middle of the scene, of a field of streams or beside one probe."""
    if source.field is not None:
        members = parts.fields.survey(source.field)
        try:
            samples = sample_set(members, None, gradients=source.gradients is not False)
        except ValueError:
            reasons = "; ".join(f"{one.told.stream}: {one.told.problem}" for one in members)
            raise JobError(f"light.field: no stream of {source.field!r} gives light now: {reasons}") from None
    else:
        assert source.stream is not None
        channel, frame = _shown(parts, source.stream)
        if frame.gradients is None:
            raise JobError(
                f"light.gradients: the stream {source.stream!r} has none: give it a proxy in its settings"
                " ([gradients]), or leave this out"
            )
        place = source.probe_at or frame.position or channel.settings.position_m or (0.0, 0.0, 0.0)
        samples = SampleSet(
            [place], unpack_coefficients(frame.coefficients)[None], unpack_gradients(frame.gradients)[None]
        )
    return _light(samples.at(np.array([middle]))[0])


def _shown(parts: Services, stream: str) -> tuple[Channel, Frame]:
    channel = parts.catalogue.channel(stream)
    if channel.latest is None:
        raise JobError(f"light.stream: {stream!r} has had no frame yet: start it, or name another")
    return channel, channel.latest


def _light(coefficients: NDArray[np.floating]) -> dict[str, Any]:
    return {"coefficients": tuple(tuple(map(float, row)) for row in coefficients)}


def _before(earlier: Job | None) -> dict[str, Any]:
    """Return the light that the job of the same key has; nothing where there is none."""
    if earlier is None:
        return {}
    light = IgiLightSettings.model_validate(earlier.settings.get("light", {}))
    return {} if light.coefficients is None else {"coefficients": light.coefficients, "probe_at": light.probe_at}
