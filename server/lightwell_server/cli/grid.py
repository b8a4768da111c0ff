"""``lightwell grid``: look into a finished grid, on disk or on a server."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import typer

from lightwell.conventions import Convention
from lightwell_server.cli.connection import JSON, SERVER, TOKEN, connect
from lightwell_server.cli.placing import MOST, PLACES_OUT, PLACES_PLOT, TOLERANCE, check_places_out, propose

if TYPE_CHECKING:
    from lightwell.field.adaptive import AnyGrid

grid_commands = typer.Typer(help="Look into a finished grid.", no_args_is_help=True)

GRID = typer.Argument(help="Folder of a grid, or its id on a server.")


@grid_commands.command("info")
def info(
    grid: str = GRID,
    plot: Path | None = typer.Option(None, help="Write a picture of its irradiance and coverage: PNG."),
    normal: str = typer.Option("0,0,1", metavar="X,Y,Z", help="With --plot: the normal of the lit surfaces."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Describe a grid."""
    import numpy as np

    from lightwell.field.adaptive import AdaptiveGrid
    from lightwell.gradients.trust import grid_trust_radius

    opened = _open(grid, server, token)
    regular = opened.to_regular()
    spec, coefficients = opened.spec, regular.coefficients
    summary = {
        "grid": grid,
        "form": "adaptive" if isinstance(opened, AdaptiveGrid) else "regular",
        "resolution": list(spec.resolution),
        "lower_m": list(spec.lower),
        "upper_m": list(spec.upper),
        "voxel_m": spec.voxel.tolist(),
        "bands": opened.bands,
        "gradients": regular.gradients is not None,
        "megabytes": round(opened.memory_bytes() / 1e6, 3),
        "rms": float(np.sqrt((coefficients.astype(np.float64) ** 2).sum(axis=(-1, -2)).mean())),
        "coverage_mean": float(regular.coverage.mean()),
        "coverage_least": float(regular.coverage.min()),
        "attributes": opened.attributes,
    }
    # Noise bends too: where a grid has some, the radius is rather too small.
    radius = grid_trust_radius(coefficients, spec.voxel)
    summary["trust_radius_m"] = float(np.median(radius)) if np.isfinite(radius).any() else None
    if isinstance(opened, AdaptiveGrid):
        of_regular = opened.memory_bytes() / regular.memory_bytes()
        summary |= {"tolerance": opened.tolerance, "leaves": opened.leaves, "memory_of_regular": round(of_regular, 4)}
    if plot is not None:
        from lightwell.io.plots import plot_grid
        from lightwell_server.cli.output import write_picture

        write_picture(plot, plot_grid(regular, _direction("--normal", normal)))
    if json:
        print(json_module.dumps(summary))
        return
    for name, value in summary.items():
        if name != "attributes":
            print(f"{name:16} {value}")


@grid_commands.command("sample")
def sample(
    grid: str = GRID,
    at: list[str] = typer.Option(..., metavar="X,Y,Z", help="A point in metres; may be repeated."),
    gradients: bool = typer.Option(False, "--gradients", help="Also the change per metre."),
    convention: Convention = typer.Option("lightwell", help="Axes, signs, order and scale of the coefficients."),
    bands: int | None = typer.Option(None, min=1, max=6, help="At most this many bands."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Print the light at points of a grid."""
    import numpy as np

    from lightwell.errors import LightwellError
    from lightwell_server.routes.grids import describe_samples

    opened = _open(grid, server, token)
    if gradients and convention != "lightwell":
        raise LightwellError("--gradients are given in the lightwell convention only")
    points = np.array([parse_vector("--at", text) for text in at])
    document = describe_samples(
        grid, opened, points, min(bands or opened.bands, opened.bands), convention, gradients
    ).model_dump(exclude_none=True)
    if json:
        print(json_module.dumps(document))
        return
    for point in document["points"]:
        print(f"at {point['at']}  coverage {point['coverage']:.3f}")
        for index, row in enumerate(point["coefficients"]):
            print(f"  {index:2} " + " ".join(f"{value:12.6g}" for value in row))


@grid_commands.command("place")
def place(
    grid: str = GRID,
    tolerance: float = TOLERANCE,
    most: int = MOST,
    out: Path | None = PLACES_OUT,
    plot: Path | None = PLACES_PLOT,
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Propose where to put the fewest probes with gradients that light all of a grid, and what that saves."""
    from lightwell.errors import LightwellError
    from lightwell.gradients.placement import field_of_grid

    check_places_out(out)
    opened = _open(grid, server, token).to_regular()
    try:
        field = field_of_grid(opened)
    except ValueError as error:
        raise LightwellError(f"{grid}: {error}") from None
    propose({"grid": grid}, field, tolerance, most, out, plot, json, opened)


@grid_commands.command("export")
def export(
    grid: str = GRID,
    out: Path = typer.Argument(help="File to write; `three` writes a .json beside its .bin."),
    format: Literal["npz", "three", "ktx2"] = typer.Option("npz", help="npz, three or ktx2."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Write a grid for other programs."""
    from lightwell.io.export import export_grid

    paths = export_grid(_open(grid, server, token), format, out)
    if json:
        files = [{"path": str(path), "bytes": path.stat().st_size} for path in paths]
        print(json_module.dumps({"grid": grid, "format": format, "files": files}))
        return
    for path in paths:
        print(path)


def _open(grid: str, server: str, token: str | None) -> AnyGrid:
    """Open a grid on disk, or fetch it from a server."""
    import tempfile

    from lightwell.io.grids import open_grid

    if Path(grid).exists() or "/" in grid or grid.endswith(".zarr"):
        return open_grid(Path(grid))
    with connect(server, token) as client, tempfile.TemporaryDirectory() as folder:
        client.download(grid, Path(folder) / "grid.zarr")
        return open_grid(Path(folder) / "grid.zarr")


def _direction(option: str, text: str) -> Any:  # noqa: ANN401
    from lightwell.errors import LightwellError

    vector = parse_vector(option, text)
    if not any(vector):
        raise LightwellError(f"{option}: {text!r}: must not be 0,0,0")
    return vector


def parse_vector(option: str, text: str) -> tuple[float, float, float]:
    """Return the numbers of ``x,y,z``; raises `LightwellError` that names the option."""
    import math

    from lightwell.errors import LightwellError

    try:
        x, y, z = (float(part) for part in text.split(","))
    except ValueError:
        raise LightwellError(f"{option}: {text!r}: must be three numbers, x,y,z") from None
    if not all(map(math.isfinite, (x, y, z))):
        raise LightwellError(f"{option}: {text!r}: must be finite")
    return x, y, z
