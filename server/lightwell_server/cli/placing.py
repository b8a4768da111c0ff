"""What ``lightwell grid place`` and ``lightwell capture place`` share: placing samples, and saying what it saves."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lightwell_server.cli.output import progress_bar, write_picture

if TYPE_CHECKING:
    from lightwell.field.grid import Grid
    from lightwell.gradients.placement import Field

TOLERANCE = typer.Option(0.05, min=1e-4, max=2, help="Largest error anywhere, relative to the rms coefficient vector.")
MOST = typer.Option(64, min=1, max=1000, help="Give up after this many samples.")
PLACES_OUT = typer.Option(None, "--out", help="Write the positions: .csv (x_m,y_m,z_m) or .json.")
PLACES_PLOT = typer.Option(None, "--plot", help="Write a picture of the positions and how the error falls: PNG.")


def check_places_out(out: Path | None) -> None:
    """Raise `LightwellError` where the file to write is of another kind."""
    from lightwell.errors import LightwellError

    if out is not None and out.suffix not in (".csv", ".json"):
        raise LightwellError(f"--out: {out}: must end in .csv or .json")


def propose(
    name: dict[str, str],
    field: Field,
    tolerance: float,
    most: int,
    out: Path | None,
    plot: Path | None,
    json: bool,
    grid: Grid | None = None,
) -> None:
    """Place samples with and without gradients, compare them with lattices of a grid, print and write the result."""
    from lightwell.gradients.placement import place_lattice, place_samples

    with progress_bar("placing") as report:

        def run(gradients: bool, before: int) -> Any:  # noqa: ANN401
            def tell(count: int, error: float) -> None:
                del error
                report(before + count, 2 * most)

            return place_samples(field, tolerance, gradients=gradients, most=most, report=tell)

        placed, plain = run(True, 0), run(False, most)
    ways = {
        "placed, with gradients": (len(placed.indices), placed.error),
        "placed, without": (len(plain.indices), plain.error),
    }
    if grid is not None:
        halves, trilinear = (place_lattice(grid, field, tolerance, gradients=gradients) for gradients in (True, False))
        ways["regular lattice, half gradients"] = halves.samples, halves.error
        ways["regular lattice, trilinear"] = trilinear.samples, trilinear.error
    positions = field.positions[placed.indices]
    document = {
        **name,
        "tolerance": tolerance,
        "places_compared": len(field.positions),
        "positions_m": positions.round(6).tolist(),
        "ways": [
            {"way": way, "samples": count, "error": round(worst, 6), "within_tolerance": worst <= tolerance}
            for way, (count, worst) in ways.items()
        ],
    }
    if out is not None:
        _write(out, document)
    if plot is not None:
        from lightwell.io.plots import plot_placement

        bounds = (grid.spec.lower, grid.spec.upper) if grid is not None else None
        histories = {"with gradients": placed.history, "without": plain.history}
        write_picture(plot, plot_placement(positions, field.positions, bounds, histories, tolerance))
    if json:
        print(json_module.dumps(document))
        return
    print(f"{'':32} samples  largest error")
    for way, (count, worst) in ways.items():
        missed = "" if worst <= tolerance else f"  (more would be needed for {tolerance:g})"
        print(f"{way:32} {count:7}  {worst:.4f}{missed}")
    if out is None:
        for x, y, z in positions:
            print(f"{x:.4f},{y:.4f},{z:.4f}")


def _write(out: Path, document: dict[str, Any]) -> None:
    text = json_module.dumps(document, indent=1) + "\n"
    if out.suffix == ".csv":
        text = "x_m,y_m,z_m\n" + "".join(f"{x:g},{y:g},{z:g}\n" for x, y, z in document["positions_m"])
    write_picture(out, text.encode())
