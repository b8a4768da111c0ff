"""``lightwell ingest``: one capture-ingest worker, on this or another machine."""

from __future__ import annotations

import json as json_module
import os
import sys
from pathlib import Path
from typing import Annotated, Any, Literal, TextIO

import typer
from pydantic import BaseModel, ValidationError
from typer.models import OptionInfo

from lightwell.conventions import Units
from lightwell.errors import LightwellError
from lightwell.settings import (
    BackdropSettings,
    FilterKind,
    FilterSettings,
    GradientsSettings,
    MappingName,
    MappingSettings,
    ProjectionWeights,
    ProxyKind,
    StreamSettings,
    WindowKind,
    WindowSettings,
)
from lightwell_workers.ingest.log import LogFormat, LogLevel


def _help(model: type[BaseModel], field: str) -> str:
    info = model.model_fields[field]
    default = "" if info.default is None or info.is_required() else f" (default {info.default})"
    return f"{info.description}{default}"


def _option(model: type[BaseModel], field: str, *names: str) -> OptionInfo:
    option: OptionInfo = typer.Option(*names, help=_help(model, field), show_default=False)
    return option


def ingest(
    context: typer.Context,
    stream: Annotated[str, typer.Option(help="name of the stream")],
    source: Annotated[str | None, typer.Argument(help=_help(StreamSettings, "source"))] = None,
    server: Annotated[str, typer.Option(help="URL of the server")] = "http://127.0.0.1:8400",
    token: Annotated[str | None, typer.Option(envvar="LIGHTWELL_TOKEN", help="the server's token")] = None,
    uploads: Annotated[
        Path | None,
        typer.Option(envvar="LIGHTWELL_UPLOADS", help="folder of the server's uploads, for upload: sources"),
    ] = None,
    settings: Annotated[
        str | None,
        typer.Option(envvar="LIGHTWELL_STREAM_SETTINGS", help="settings as JSON; the other options change single ones"),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="print one status a line as JSON, and log as JSON")] = False,
    log_format: Annotated[LogFormat, typer.Option(help="auto: text on a terminal, else JSON")] = "auto",
    log_level: Annotated[LogLevel, typer.Option(help="what is worth a line")] = "info",
    # how the picture covers the sphere
    mapping: Annotated[MappingName | None, _option(MappingSettings, "kind", "--mapping")] = None,
    forward: Annotated[str | None, _option(MappingSettings, "forward", "--forward")] = None,
    up: Annotated[str | None, _option(MappingSettings, "up", "--up")] = None,
    fov_degrees: Annotated[float | None, _option(MappingSettings, "fov_degrees")] = None,
    fisheye: Annotated[Literal["equidistant", "equisolid"] | None, _option(MappingSettings, "fisheye")] = None,
    sphere_radius_m: Annotated[float | None, _option(MappingSettings, "sphere_radius_m")] = None,
    sphere_distance_m: Annotated[float | None, _option(MappingSettings, "sphere_distance_m")] = None,
    disc: Annotated[str | None, _option(MappingSettings, "disc")] = None,
    blind: Annotated[Literal["fill", "zero"] | None, _option(MappingSettings, "blind")] = None,
    # from pictures to coefficients
    bands: Annotated[int | None, _option(StreamSettings, "bands")] = None,
    resolution: Annotated[int | None, _option(StreamSettings, "resolution")] = None,
    downsample: Annotated[Literal["area", "gaussian"] | None, _option(StreamSettings, "downsample")] = None,
    weights: Annotated[ProjectionWeights | None, _option(StreamSettings, "weights")] = None,
    gain: Annotated[float | None, _option(StreamSettings, "gain")] = None,
    units: Annotated[Units | None, _option(StreamSettings, "units")] = None,
    negatives: Annotated[Literal["keep", "clamp"] | None, _option(StreamSettings, "negatives")] = None,
    # window
    window: Annotated[WindowKind | None, _option(WindowSettings, "kind", "--window")] = None,
    window_target: Annotated[
        Literal["radiance", "irradiance"] | None, _option(WindowSettings, "target", "--window-target")
    ] = None,
    window_width: Annotated[float | None, _option(WindowSettings, "width", "--window-width")] = None,
    window_smoothing_seconds: Annotated[
        float | None, _option(WindowSettings, "smoothing_seconds", "--window-smoothing-seconds")
    ] = None,
    # filter
    filter_kind: Annotated[FilterKind | None, _option(FilterSettings, "kind", "--filter")] = None,
    tau_seconds: Annotated[float | None, _option(FilterSettings, "tau_seconds")] = None,
    hold: Annotated[Literal["zero", "first"] | None, _option(FilterSettings, "hold")] = None,
    alpha: Annotated[float | None, _option(FilterSettings, "alpha")] = None,
    min_cutoff_hz: Annotated[float | None, _option(FilterSettings, "min_cutoff_hz")] = None,
    beta: Annotated[float | None, _option(FilterSettings, "beta")] = None,
    process_noise: Annotated[float | None, _option(FilterSettings, "process_noise")] = None,
    measurement_noise: Annotated[float | None, _option(FilterSettings, "measurement_noise")] = None,
    cut_threshold: Annotated[float | None, _option(FilterSettings, "cut_threshold")] = None,
    max_gap_seconds: Annotated[float | None, _option(FilterSettings, "max_gap_seconds")] = None,
    # gradients
    position: Annotated[str | None, _option(StreamSettings, "position_m", "--position")] = None,
    proxy: Annotated[ProxyKind | None, _option(GradientsSettings, "proxy", "--proxy")] = None,
    proxy_radius_m: Annotated[float | None, _option(GradientsSettings, "radius_m", "--proxy-radius-m")] = None,
    proxy_centre: Annotated[str | None, _option(GradientsSettings, "centre_m", "--proxy-centre")] = None,
    box_lower: Annotated[str | None, _option(GradientsSettings, "box_lower_m", "--box-lower")] = None,
    box_upper: Annotated[str | None, _option(GradientsSettings, "box_upper_m", "--box-upper")] = None,
    proxy_mesh: Annotated[str | None, _option(GradientsSettings, "mesh", "--proxy-mesh")] = None,
    proxy_mesh_up: Annotated[Literal["y", "z"] | None, _option(GradientsSettings, "mesh_up", "--proxy-mesh-up")] = None,
    proxy_depth: Annotated[str | None, _option(GradientsSettings, "depth", "--proxy-depth")] = None,
    # backdrop
    backdrop: Annotated[bool | None, _option(BackdropSettings, "enabled", "--backdrop/--no-backdrop")] = None,
    backdrop_fps: Annotated[float | None, _option(BackdropSettings, "fps", "--backdrop-fps")] = None,
    backdrop_width: Annotated[int | None, _option(BackdropSettings, "width", "--backdrop-width")] = None,
    backdrop_quality: Annotated[int | None, _option(BackdropSettings, "quality", "--backdrop-quality")] = None,
) -> None:
    """Capture light from SOURCE, turn it into coefficients and publish them as a stream.

    Exit status: 0 when the recording is through or the worker was asked to stop, 1 when the source failed, 3 when the
    server refuses the worker.
    """
    import msgspec

    from lightwell.wire import StreamStatus
    from lightwell_workers.ingest.log import configure_logging
    from lightwell_workers.ingest.worker import run_worker

    changes: dict[str, Any] = {
        "source": source,
        "bands": bands,
        "resolution": resolution,
        "downsample": downsample,
        "weights": weights,
        "gain": gain,
        "units": units,
        "negatives": negatives,
        "mapping": {
            "kind": mapping,
            "forward": _vector("--forward", forward),
            "up": _vector("--up", up),
            "fov_degrees": fov_degrees,
            "fisheye": fisheye,
            "sphere_radius_m": sphere_radius_m,
            "sphere_distance_m": sphere_distance_m,
            "disc": _vector("--disc", disc),
            "blind": blind,
        },
        "window": {
            "kind": window,
            "target": window_target,
            "width": window_width,
            "smoothing_seconds": window_smoothing_seconds,
        },
        "filter": {
            "kind": filter_kind,
            "tau_seconds": tau_seconds,
            "hold": hold,
            "alpha": alpha,
            "min_cutoff_hz": min_cutoff_hz,
            "beta": beta,
            "process_noise": process_noise,
            "measurement_noise": measurement_noise,
            "cut_threshold": cut_threshold,
            "max_gap_seconds": max_gap_seconds,
        },
        "position_m": _vector("--position", position),
        "gradients": {
            "proxy": proxy,
            "radius_m": proxy_radius_m,
            "centre_m": _vector("--proxy-centre", proxy_centre),
            "box_lower_m": _vector("--box-lower", box_lower),
            "box_upper_m": _vector("--box-upper", box_upper),
            "mesh": proxy_mesh,
            "mesh_up": proxy_mesh_up,
            "depth": proxy_depth,
        },
        "backdrop": {
            "enabled": backdrop,
            "fps": backdrop_fps,
            "width": backdrop_width,
            "quality": backdrop_quality,
        },
    }

    output = _take_standard_output()

    def print_status(status: StreamStatus) -> None:
        print(msgspec.json.encode(status).decode(), file=output, flush=True)

    configure_logging(stream, log_format="json" if json else log_format, level=log_level)
    said_by = context.get_parameter_source("settings")
    place = "LIGHTWELL_STREAM_SETTINGS" if said_by is not None and said_by.name == "ENVIRONMENT" else "--settings"
    chosen = stream_settings(settings, changes, place)
    said = print_status if json else None
    sys.exit(run_worker(chosen, stream, server, token, on_status=said, uploads=uploads))


def _take_standard_output() -> TextIO:
    """Return standard output, and keep everybody else off it.

    OpenEXR writes a warning there for each damaged file it meets. The log names such a file, once.
    """
    output = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)
    return output


def stream_settings(document: str | None, changes: dict[str, Any], place: str = "--settings") -> StreamSettings:
    """Return the settings of a JSON ``document`` (None: the defaults) with those ``changes`` that are not None.

    Raises
    ------
    LightwellError
        Names the setting that is missing, unknown or out of bounds; ``place`` is where the document comes from.
    """
    from lightwell.settings import complaint

    try:
        before = {} if document is None else json_module.loads(document)
    except json_module.JSONDecodeError as error:
        raise LightwellError(f"{place} is no JSON: {error}") from None
    if not isinstance(before, dict):
        raise LightwellError(f'{place} = {document}: must be an object, such as {{"bands": 3}}')
    try:
        return StreamSettings.model_validate(_changed(before, changes))
    except ValidationError as error:
        first = error.errors()[0]
        if first["type"] == "missing" and first["loc"] == ("source",):
            raise LightwellError("name a source: exr:FOLDER, video:FILE or synthetic:room") from None
        where = "setting" if _says(changes, first["loc"]) else f"{place}:"
        name = ".".join(str(part) for part in first["loc"])
        raise LightwellError(f"{where} {name} {complaint(first)}") from None


def _changed(before: dict[str, Any], changes: dict[str, Any]) -> dict[str, Any]:
    after = dict(before)
    for name, value in changes.items():
        if isinstance(value, dict):
            inner = before.get(name, {})
            after[name] = _changed(inner, value) if isinstance(inner, dict) else inner
        elif value is not None:
            after[name] = value
    return after


def _says(changes: dict[str, Any], path: tuple[int | str, ...]) -> bool:
    """Return whether the options give the value at ``path``, or the list that it belongs to."""
    value: Any = changes
    for key in path:
        if not isinstance(value, dict):
            break
        value = value.get(key)
    return value is not None and not isinstance(value, dict)


def _vector(option: str, text: str | None) -> tuple[float, ...] | None:
    if text is None:
        return None
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError:
        raise LightwellError(f"{option} {text!r}: give numbers with commas between them, such as 0,0,-1") from None
