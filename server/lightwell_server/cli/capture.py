"""``lightwell capture``: simulate, import, inspect and thin out captures."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from lightwell.conventions import Units
from lightwell.settings import MappingName
from lightwell_server.cli.connection import JSON
from lightwell_server.cli.output import progress_bar
from lightwell_server.cli.placing import MOST, PLACES_OUT, PLACES_PLOT, TOLERANCE, check_places_out, propose

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from pydantic import ValidationError

    from lightwell.errors import LightwellError
    from lightwell.io.captures import Capture

capture_commands = typer.Typer(help="Sequences of tracked light probes.", no_args_is_help=True)

SAMPLED_FRAMES = 32
SAMPLED_DIRECTIONS = 16
LEAST_EXTENT_M = 1e-6


@capture_commands.command("simulate")
def simulate(
    directory: Path = typer.Argument(help="New folder."),
    scene: Literal["scene1", "scene2", "cube", "constant", "distant"] = typer.Option(
        "scene1", help="scene1, scene2: those of paper 000; cube: an area light above a cube; the rest do not vary."
    ),
    probes: int = typer.Option(500, min=1, max=100_000, help="How many (the paper: 4397 and 8454, of 26,000–29,000)."),
    size: int = typer.Option(250, min=8, max=4096, help="Height of a frame, pixels."),
    probe: Literal["mirror-sphere", "latlong"] = typer.Option("mirror-sphere", help="Real sphere, or ideal probe."),
    sphere_radius_m: float = typer.Option(0.0458, help="Radius of the sphere, metres."),
    sphere_distance_m: float = typer.Option(1.25, help="Camera to centre of the sphere, metres."),
    layout: Literal["random", "planes", "raster"] = typer.Option("random", help="Where probes stand."),
    planes: int = typer.Option(3, min=1, help="With --layout planes: how many."),
    rotating: bool = typer.Option(False, "--rotating", help="Turn each probe differently."),
    samples: int = typer.Option(2, min=1, max=16, help="Rays along each side of a pixel."),
    seed: int = typer.Option(0, min=0, help="The same seed gives the same capture."),
    compression: str = typer.Option("none", help="Of the EXR frames: none, zstd, zip, …"),
    angular: bool = typer.Option(False, "--angular", help="Write the samples in angular order instead of frames."),
    json: bool = JSON,
) -> None:
    """Record the paper's rig virtually: a room whose light is known exactly."""
    from lightwell.errors import LightwellError
    from lightwell.io.exr import COMPRESSIONS
    from lightwell.io.simulate import RigSettings, simulate_capture
    from lightwell.synthetic.scene import PRESETS

    if compression not in COMPRESSIONS:
        raise LightwellError(f"--compression: {compression!r} is none of {', '.join(sorted(COMPRESSIONS))}")
    for option, value in (("--sphere-radius-m", sphere_radius_m), ("--sphere-distance-m", sphere_distance_m)):
        if not 1e-6 <= value <= 1e6:
            raise LightwellError(f"{option}: {value:g}: must lie between 1e-6 and 1e6 metres")
    if angular and rotating:
        raise LightwellError("--angular: needs probes that are not turned: leave out --rotating")
    rig = RigSettings(
        probes=probes,
        size=size,
        probe=probe,
        sphere_radius_m=sphere_radius_m,
        sphere_distance_m=sphere_distance_m,
        layout=layout,
        planes=planes,
        rotating=rotating,
        samples=samples,
        seed=seed,
        compression=compression,
    )
    with progress_bar("simulating") as report:
        simulate_capture(directory, PRESETS[scene], rig, report, angular=angular)
    _tell(directory, probes, f"{probes} probes of {scene}", json)


def _tell(directory: Path, probes: int, words: str, json: bool) -> None:
    """Say what has been written."""
    document = json_module.dumps({"capture": str(directory), "probes": probes})
    print(document if json else f"{directory}: {words}")


@capture_commands.command("import")
def import_frames(
    frames: Path = typer.Argument(help="Folder of EXR frames."),
    out: Path = typer.Option(..., help="New folder of the capture."),
    poses: Path = typer.Option(..., help="CSV (frame,time_ns,x_m,y_m,z_m,qx,qy,qz,qw), or a TUM trajectory."),
    format: Literal["auto", "csv", "tum"] = typer.Option("auto", help="Of the poses; auto: by the suffix .csv."),
    fps: float | None = typer.Option(None, min=0.001, help="TUM: frames per second, where the frames hold no times."),
    start_seconds: float | None = typer.Option(None, help="TUM: time of the first frame (default: of the first pose)."),
    max_gap_seconds: float = typer.Option(0.02, min=0, help="TUM: largest distance in time of a frame to its pose."),
    mapping: MappingName = typer.Option("mirror-sphere", help="How a frame covers the sphere."),
    forward: str = typer.Option("0,0,-1", metavar="X,Y,Z", help="Where the unturned camera looks."),
    up: str = typer.Option("0,1,0", metavar="X,Y,Z", help="Where the top of its picture points."),
    fov_degrees: float | None = typer.Option(None, help="Field of view across the width, degrees."),
    sphere_radius_m: float | None = typer.Option(None, help="Radius of the sphere, metres."),
    sphere_distance_m: float | None = typer.Option(None, help="Camera to centre of the sphere, metres."),
    disc: str | None = typer.Option(None, metavar="CX,CY,R", help="The probe's disc in pixels, where not centred."),
    gain: float = typer.Option(1.0, help="Factor from sample to radiance."),
    units: Units = typer.Option("relative", help="Of radiance after the gain."),
    name: str = typer.Option("", help="What to call it."),
    copy: bool = typer.Option(False, "--copy", help="Copy the frames instead of linking them."),
    json: bool = JSON,
) -> None:
    """Make a capture from a folder of EXR frames and the poses of a tracker."""
    from pydantic import ValidationError

    from lightwell.io.importing import ImportSettings, import_capture
    from lightwell.settings import MappingSettings
    from lightwell_server.cli.grid import parse_vector

    try:
        settings = MappingSettings(
            kind=mapping,
            forward=parse_vector("--forward", forward),
            up=parse_vector("--up", up),
            fov_degrees=fov_degrees,
            sphere_radius_m=sphere_radius_m,
            sphere_distance_m=sphere_distance_m,
            disc=None if disc is None else parse_vector("--disc", disc),
        )
    except ValidationError as error:
        raise _wrong_option(error) from None
    tum = format == "tum" or (format == "auto" and poses.suffix.lower() != ".csv")
    plan = ImportSettings(
        settings,
        gain=gain,
        units=units,
        name=name,
        tum=tum,
        fps=fps,
        start_seconds=start_seconds,
        max_gap_seconds=max_gap_seconds,
        copy=copy,
    )
    with progress_bar("importing") as report:
        count = import_capture(frames, poses, out, plan, report)
    _tell(out, count, f"{count} probes", json)


def _wrong_option(error: ValidationError) -> LightwellError:
    """Return what is wrong with a setting, by the name of its option."""
    from lightwell.errors import LightwellError

    first = error.errors()[0]
    option = "--" + str(first["loc"][0]).replace("_", "-")
    return LightwellError(f"{option}: {first['msg'].lower()}, not {first['input']}")


@capture_commands.command("info")
def info(
    directory: Path = typer.Argument(help="Folder of a capture."),
    plot: Path | None = typer.Option(None, help="Write a picture of the positions: PNG."),
    json: bool = JSON,
) -> None:
    """Check a capture and describe it: counts, bounds, density, dynamic range."""
    import numpy as np

    from lightwell.io.captures import open_capture
    from lightwell_server.cli.output import write_picture

    capture = open_capture(directory)
    positions = capture.poses.positions
    lower, upper = capture.bounds
    size = upper - lower
    spread = size[size > LEAST_EXTENT_M]
    summary: dict[str, Any] = {
        "capture": str(directory),
        "name": capture.info.name,
        "probes": capture.count,
        "width": capture.info.width,
        "height": capture.info.height,
        "mapping": capture.info.mapping.kind,
        "rotating": capture.rotating,
        "sorted": capture.sorted_samples is not None,
        "simulated": capture.info.scene is not None,
        "lower_m": lower.tolist(),
        "upper_m": upper.tolist(),
        "distinct_per_axis": [len(np.unique(positions[:, axis].round(4))) for axis in range(3)],
        "mean_spacing_m": float((spread.prod() / capture.count) ** (1 / spread.size)) if spread.size else None,
        "probes_per_m": [float(capture.count / extent) if extent > LEAST_EXTENT_M else None for extent in size],
        "samples_per_kernel": {str(cells): round(7.07 * capture.count / cells**2, 1) for cells in (8, 16, 32, 64)},
        "digest": capture.digest,
    }
    if capture.info.mapping.kind == "mirror-sphere":
        radius, distance = capture.info.mapping.sphere_radius_m, capture.info.mapping.sphere_distance_m
        if radius and distance:
            summary["blind_half_angle_degrees"] = float(np.degrees(np.arcsin(radius / distance)))
    summary["luminance"] = _range(_luminance(capture))
    if plot is not None:
        from lightwell.io.plots import plot_positions

        write_picture(plot, plot_positions(positions))
    if json:
        print(json_module.dumps(summary))
        return
    for name, value in summary.items():
        print(f"{name:26} {value}")


def _luminance(capture: Capture) -> NDArray[np.float64]:
    """Return the luminance of some of a capture's samples: of some frames, or of some directions of all probes."""
    import numpy as np

    from lightwell.conventions import LUMINANCE
    from lightwell.io.angular import AngularStore

    if capture.sorted_samples is not None:
        store = AngularStore.open(capture.sorted_samples)
        places = np.linspace(0, store.directions - 1, SAMPLED_DIRECTIONS).round().astype(int)
        samples: list[NDArray[Any]] = [store.read(place, place + 1).reshape(-1, 3) for place in np.unique(places)]
    else:
        seen = capture.mapping().solid_angles().reshape(-1) > 0
        frames = np.linspace(0, capture.count - 1, SAMPLED_FRAMES).round().astype(int)
        samples = [capture.read_frame(index).reshape(-1, 3)[seen] for index in np.unique(frames)]
    gain = 1.0 if capture.sorted_samples is not None else capture.info.gain
    luminance: NDArray[np.float64] = gain * np.concatenate([part.astype(np.float64) @ LUMINANCE for part in samples])
    return luminance


def _range(luminance: NDArray[np.float64]) -> dict[str, float | int | None]:
    """Return the dynamic range of samples; None where there is nothing to measure it by."""
    import numpy as np

    finite = luminance[np.isfinite(luminance)]
    quantiles = [float(value) for value in np.quantile(finite, [0.01, 0.5, 0.99, 1.0])] if finite.size else [None] * 4
    positive = finite[finite > 0]
    stops = float(np.log2(positive.max() / np.quantile(positive, 0.01))) if positive.size else None
    return {
        **dict(zip(("p1", "median", "p99", "max"), quantiles, strict=True)),
        "stops": stops,
        "negative": int((finite < 0).sum()),
        "not_finite": int(luminance.size - finite.size),
    }


@capture_commands.command("reduce")
def reduce(
    directory: Path = typer.Argument(help="Folder of a capture."),
    out: Path = typer.Option(..., help="New folder."),
    tolerance: float = typer.Option(0.02, min=0, help="Drop a probe that differs by less from its neighbours."),
    max_distance_m: float | None = typer.Option(None, help="Largest gap that dropping may leave, metres."),
    json: bool = JSON,
) -> None:
    """Drop the probes that look like their neighbours (the job `capture-reduce` does the same)."""
    from pydantic import ValidationError

    from lightwell.errors import LightwellError
    from lightwell.io.captures import open_capture
    from lightwell.job_settings import CaptureReduceSettings
    from lightwell_workers.jobs.capture_reduce import reduce_capture, require_frames, write_reduced

    if out.exists():
        raise LightwellError(f"{out}: exists; give another folder with --out")
    try:
        settings = CaptureReduceSettings(capture=str(directory), tolerance=tolerance, max_distance_m=max_distance_m)
    except ValidationError as error:
        raise _wrong_option(error) from None
    capture = require_frames(open_capture(directory))
    with progress_bar("comparing") as report:
        decisions = reduce_capture(capture, settings, 0, capture.count, None, report)
    summary = write_reduced(capture, decisions, out)
    if json:
        print(json_module.dumps(summary))
        return
    print(
        f"{out}: kept {summary['kept']} of {summary['probes']} probes; those dropped differ from the one kept before "
        f"them by {summary['difference_mean']:.2%} on the average, {summary['difference_max']:.2%} at most"
    )


@capture_commands.command("place")
def place(
    directory: Path = typer.Argument(help="Folder of a capture with frames."),
    tolerance: float = TOLERANCE,
    most: int = MOST,
    probes: int = typer.Option(1000, min=5, max=5000, help="Look at so many of its probes, all over it."),
    bands: int = typer.Option(5, min=1, max=6, help="SH bands."),
    out: Path | None = PLACES_OUT,
    plot: Path | None = PLACES_PLOT,
    json: bool = JSON,
) -> None:
    """Propose which of a capture's places would have been enough for probes with gradients, and what that saves."""
    import numpy as np

    from lightwell.errors import LightwellError
    from lightwell.gradients.placement import field_of_probes
    from lightwell.io.captures import open_capture
    from lightwell.io.probes import probe_coefficients

    check_places_out(out)
    capture = open_capture(directory)
    chosen = np.unique(np.linspace(0, capture.count - 1, min(probes, capture.count)).round().astype(int))
    with progress_bar("projecting") as report:
        coefficients = probe_coefficients(capture, chosen.tolist(), bands, report)
    try:
        field = field_of_probes(capture.poses.positions[chosen], coefficients)
    except ValueError as error:
        raise LightwellError(f"{directory}: {error}") from None
    propose({"capture": str(directory)}, field, tolerance, most, out, plot, json)


@capture_commands.command("truth")
def truth(
    directory: Path = typer.Argument(help="Folder of a simulated capture."),
    at: list[str] = typer.Option(..., metavar="X,Y,Z", help="A point in metres; may be repeated."),
    bands: int = typer.Option(5, min=1, max=8, help="SH bands."),
    json: bool = JSON,
) -> None:
    """Print the exact coefficients of a simulated capture's light at points."""
    import numpy as np

    from lightwell.errors import LightwellError
    from lightwell.io.captures import open_capture
    from lightwell.synthetic.scene import scene_from_json
    from lightwell_server.cli.grid import parse_vector

    info = open_capture(directory).info
    if info.scene is None:
        raise LightwellError(f"{directory}: is no simulated capture: its exact light is not known")
    points = np.array([parse_vector("--at", text) for text in at])
    exact = scene_from_json(info.scene).coefficients(points, bands)
    document = {
        "capture": str(directory),
        "points": [
            {"at": point.tolist(), "coefficients": rows.tolist()} for point, rows in zip(points, exact, strict=True)
        ],
    }
    if json:
        print(json_module.dumps(document))
        return
    for point, rows in zip(points, exact, strict=True):
        print(f"at {point.tolist()}")
        for index, row in enumerate(rows):
            print(f"  {index:2} " + " ".join(f"{value:12.6g}" for value in row))
