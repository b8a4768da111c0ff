"""``lightwell project``: one picture of a light probe into spherical-harmonic coefficients."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from lightwell.conventions import DEFAULT_BANDS, MAX_BANDS, Convention
from lightwell.settings import MappingName, ProjectionWeights, ProxyKind, WindowKind
from lightwell_server.cli.output import quiet_libraries

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from lightwell.probe.samples import SampleCounts
    from lightwell.settings import MappingSettings
    from lightwell_workers.ingest.frame import Pixels
    from lightwell_workers.ingest.stages.gradients import Slope

BAR_WIDTH = 24


def project(
    image: Path = typer.Argument(help="OpenEXR or Radiance picture, linear RGB."),
    mapping: MappingName = typer.Option("latlong", help="How the picture covers the sphere."),
    bands: int = typer.Option(DEFAULT_BANDS, min=1, max=MAX_BANDS, help="SH bands: bands² coefficients."),
    window: WindowKind = typer.Option("none", help="Window against ringing."),
    convention: Convention = typer.Option("lightwell", help="Axes, signs, order and scale of the coefficients."),
    forward: str = typer.Option("0,0,-1", metavar="X,Y,Z", help="World direction in which the camera looks."),
    up: str = typer.Option("0,1,0", metavar="X,Y,Z", help="World direction in which the picture's top points."),
    fov_degrees: float | None = typer.Option(None, help="Field of view across the picture's width, in degrees."),
    sphere_radius_m: float | None = typer.Option(None, help="Radius of the mirror sphere, metres."),
    sphere_distance_m: float | None = typer.Option(None, help="Camera to centre of the mirror sphere, metres."),
    disc: str | None = typer.Option(None, metavar="CX,CY,R", help="The probe's disc in pixels, where not centred."),
    fisheye: Literal["equidistant", "equisolid"] = typer.Option("equidistant", help="Projection of the fisheye lens."),
    blind: Literal["fill", "zero"] = typer.Option(
        "fill", help="What the probe cannot see: filled from its rim, or dark."
    ),
    weights: ProjectionWeights = typer.Option("solid-angle", help="Quadrature; paper and fejer are for latlong."),
    resolution: int = typer.Option(0, min=0, help="Width in pixels to downsample to first; 0: the whole picture."),
    proxy: ProxyKind = typer.Option("none", help="What stands for the surroundings; prints gradients too."),
    position: str | None = typer.Option(None, metavar="X,Y,Z", help="Where the probe stands, world metres."),
    proxy_radius_m: float | None = typer.Option(None, help="Sphere: its radius, metres."),
    proxy_centre: str | None = typer.Option(None, metavar="X,Y,Z", help="Sphere: its centre (default: the probe)."),
    box_lower: str | None = typer.Option(None, metavar="X,Y,Z", help="Box: its lower corner, world metres."),
    box_upper: str | None = typer.Option(None, metavar="X,Y,Z", help="Box: its upper corner, world metres."),
    proxy_mesh: str | None = typer.Option(None, help="Mesh: file of the room, world metres."),
    proxy_mesh_up: Literal["y", "z"] = typer.Option("y", help="Mesh: which of the file's axes points up."),
    proxy_depth: str | None = typer.Option(None, help="Depth: EXR of the picture's size, metres along each ray."),
    json: bool = typer.Option(False, "--json", help="Print one JSON document."),
) -> None:
    """Project the light in IMAGE onto spherical harmonics."""
    from pydantic import ValidationError

    from lightwell.conventions import degree_of_index
    from lightwell.errors import MappingError
    from lightwell.io.pictures import read_picture
    from lightwell.probe.downsample import Downsampler
    from lightwell.probe.factory import make_mapping
    from lightwell.probe.projection import projector
    from lightwell.probe.samples import count_samples, repair
    from lightwell.settings import MappingSettings, WindowSettings
    from lightwell.sh.engines import convert
    from lightwell.sh.window import WindowStage

    try:
        settings = MappingSettings(
            kind=mapping,
            forward=_numbers("--forward", forward),
            up=_numbers("--up", up),
            fov_degrees=fov_degrees,
            fisheye=fisheye,
            sphere_radius_m=sphere_radius_m,
            sphere_distance_m=sphere_distance_m,
            disc=None if disc is None else _numbers("--disc", disc),
            blind=blind,
        )
    except ValidationError as error:
        first = error.errors()[0]
        option = "--" + str(first["loc"][0]).replace("_", "-")
        raise MappingError(f"{option}: {first['msg'].lower()}, not {first['input']}") from None
    with quiet_libraries():
        picture = read_picture(image)
    counts = count_samples(picture.pixels)
    pixels = repair(picture.pixels)
    geometry = make_mapping(settings, *pixels.shape[:2])
    if resolution:
        reduce = Downsampler(geometry, resolution)
        pixels, geometry = reduce(pixels), reduce.mapping
    coefficients = projector(geometry, bands, weights, blind).project(pixels)
    coefficients, window_weights, strength = WindowStage(WindowSettings(kind=window), bands).update(coefficients, 0)
    slope = None
    if proxy != "none":
        measures = {
            "proxy": proxy,
            "radius_m": proxy_radius_m,
            "centre_m": _maybe("--proxy-centre", proxy_centre),
            "box_lower_m": _maybe("--box-lower", box_lower),
            "box_upper_m": _maybe("--box-upper", box_upper),
            "mesh": proxy_mesh,
            "mesh_up": proxy_mesh_up,
            "depth": proxy_depth,
        }
        slope = _slope(image, picture.pixels, settings, bands, measures, _maybe("--position", position))
        slope.gradients[:] *= window_weights[degree_of_index(bands), None, None]
    if json:
        _print_json(
            {
                "bands": bands,
                "convention": convention,
                "units": "relative",
                "window": window,
                "mapping": mapping,
                "coefficients": convert(coefficients, convention).tolist(),
                **({} if slope is None else _describe_slope(slope, convention)),
            }
        )
    else:
        _print_table(coefficients, convention)
        if slope is not None:
            _print_slope(slope, convention)
        if strength:
            typer.echo(f"The window's strength is λ = {strength:.4g}.")
    notes = [_sample_note(counts, pixels_total=picture.pixels.size), _mapping_note(settings, *picture.pixels.shape[:2])]
    for note in filter(None, notes):
        typer.echo(note, err=json)


def _slope(
    image: Path,
    pixels: Pixels,
    mapping: MappingSettings,
    bands: int,
    measures: dict[str, Any],
    position: tuple[float, float, float] | None,
) -> Slope:
    """Return the gradients of a picture; raises `LightwellError` where the proxy cannot be used."""
    from pydantic import ValidationError

    from lightwell.errors import LightwellError, ProxyError
    from lightwell.probe.samples import repair
    from lightwell.settings import StreamSettings
    from lightwell_workers.ingest.frame import Frame
    from lightwell_workers.ingest.stages.reduce import reduce_frame

    document = {"source": str(image), "mapping": mapping, "bands": bands}
    document |= {"position_m": position, "gradients": {key: item for key, item in measures.items() if item is not None}}
    try:
        settings = StreamSettings.model_validate(document)
    except ValidationError as error:
        first = error.errors()[0]
        raise LightwellError(f"--proxy: {'.'.join(map(str, first['loc']))}: {first['msg']}") from None
    frame = Frame(pixels=repair(pixels), name=image.name, capture_time_ns=0, ingest_time_ns=0)
    slope = reduce_frame(frame, settings).slope
    if slope is None:
        raise ProxyError("--proxy-depth: names no file of this picture")
    return slope


def _describe_slope(slope: Slope, convention: Convention) -> dict[str, Any]:
    import math

    from lightwell.sh.engines import convert_gradients

    radius = slope.trust_radius_m
    return {
        "gradients": convert_gradients(slope.gradients, convention).tolist(),
        "trust_radius_m": radius if math.isfinite(radius) else None,
    }


def _print_slope(slope: Slope, convention: Convention) -> None:
    """Print the change of the luminance of each coefficient, and how far it holds."""
    from rich.console import Console
    from rich.table import Table

    from lightwell.conventions import LUMINANCE
    from lightwell.sh.engines import convert_gradients

    shown = convert_gradients(slope.gradients, convention)
    table = Table(title="change per metre (luminance)", title_justify="left")
    for heading in ("coefficient", "d/dx", "d/dy", "d/dz"):
        table.add_column(heading, justify="right")
    for index, change in enumerate((shown * LUMINANCE[:, None]).sum(axis=1)):
        table.add_row(str(index), *(f"{value:.5g}" for value in change))
    console = Console(soft_wrap=True)
    console.print(table)
    console.print(f"Right to about 10 % within {slope.trust_radius_m:.3g} m of the probe")


def _maybe(option: str, text: str | None) -> tuple[float, float, float] | None:
    return None if text is None else _numbers(option, text)


def _numbers(option: str, text: str) -> tuple[float, float, float]:
    """Return three numbers that are separated by commas."""
    from lightwell.errors import MappingError

    try:
        first, second, third = (float(part) for part in text.split(","))
    except ValueError:
        raise MappingError(f"{option}: three numbers with commas between them are needed, not {text!r}") from None
    return first, second, third


def _print_json(document: dict[str, Any]) -> None:
    import json

    typer.echo(json.dumps(document))


def _sample_note(counts: SampleCounts, pixels_total: int) -> str:
    """Return one line on the samples that are no plain light, or nothing."""
    parts = [
        (counts.nan, "NaN (taken as 0)"),
        (counts.infinite, "infinite (taken as 65504, or as 0 where negative)"),
        (counts.negative, "negative (kept)"),
        (counts.saturated, "at or above the largest half, 65504"),
    ]
    said = ", ".join(f"{count} {what}" for count, what in parts if count)
    return f"Of {pixels_total} samples: {said}." if said else ""


def _mapping_note(settings: MappingSettings, height: int, width: int) -> str:
    """Return one line where the mapping and what else is known do not look as if they belonged together, or nothing."""
    if settings.kind == "latlong" and width != 2 * height:
        return f"A lat-long picture is twice as wide as high; this one is {width}×{height}: is --mapping right?"
    if settings.kind in ("latlong", "octahedral", "cube") and settings != settings.model_validate(
        {"kind": settings.kind}
    ):
        return f"Options of a camera or a disc mean nothing to --mapping {settings.kind}; they are not used."
    if settings.kind == "fisheye" and settings.disc is None and width > height:
        return "The image circle is taken to be as wide as the picture: name it with --disc where it is not."
    return ""


def _print_table(coefficients: NDArray[np.float64], convention: Convention) -> None:
    """Print the coefficients with bars, then what they say about the light."""
    import numpy as np
    from rich.console import Console
    from rich.table import Table

    from lightwell.conventions import bands_of_count, degree_of_index, order_of_index
    from lightwell.sh.dominant import split_dominant
    from lightwell.sh.engines import convert

    console = Console(soft_wrap=True)
    shown = convert(coefficients, convention)
    bands = bands_of_count(len(shown))
    table = Table(title=f"{bands} bands, {convention} convention", title_justify="left")
    for heading in ("l", "m", "R", "G", "B"):
        table.add_column(heading, justify="right")
    table.add_column("")
    # Every convention keeps the order of degrees and lists the orders of a degree from −l to l.
    largest = max(float(np.abs(shown).max()), 1e-300)
    for degree, order, rgb in zip(degree_of_index(bands), order_of_index(bands), shown, strict=True):
        length = round(float(np.abs(rgb).max()) / largest * BAR_WIDTH)
        sign = "red" if float(rgb[np.argmax(np.abs(rgb))]) < 0 else "green"
        bar = f"[{sign}]{'█' * length}[/{sign}]"
        table.add_row(str(degree), str(order), *(f"{value:.5g}" for value in rgb), bar)
    console.print(table)
    split = split_dominant(coefficients)
    console.print(f"Mean radiance   {_rgb(coefficients[0] / np.sqrt(4 * np.pi))}")
    console.print(f"Dominant light  towards {_rgb(split.direction)}, irradiance {_rgb(split.irradiance)}")
    console.print(f"Ambient         {_rgb(split.ambient)}")


def _rgb(values: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:.4g}" for value in values) + ")"
