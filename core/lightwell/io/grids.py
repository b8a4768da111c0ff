"""Grids on disk: Zarr v3 groups that Python and the browser read.

A regular grid has ``coefficients`` (z, y, x, bands², 3), ``coverage`` and ``samples`` (z, y, x), ``gradients`` (z, y,
x, bands², 3, 3) where there are any, and for browsers ``gpu_tiles`` (tiles, z, y, x, 4) and, of gradients,
``gpu_bends`` (3 tiles, z, y, x, 4) of `lightwell.field.tiles`. Adaptive grids are written by `lightwell.io.adaptive`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.errors import BaseZarrError

from lightwell.conventions import coefficient_count
from lightwell.field.adaptive import AnyGrid
from lightwell.field.grid import Grid
from lightwell.field.tiles import pack_bends, pack_tiles
from lightwell.io.adaptive import FORMAT as ADAPTIVE_FORMAT
from lightwell.io.adaptive import NAMES as ADAPTIVE_NAMES
from lightwell.io.adaptive import adaptive_grid
from lightwell.io.groups import (
    Chunked,
    GridError,
    Precision,
    common_attributes,
    read_spec,
    require_storable,
    write_group,
)

FORMAT = "lightwell.grid.v1"
CHUNK_CELLS = 32

__all__ = ["GridError", "open_grid", "write_grid"]


def write_grid(path: Path, grid: Grid, precision: Precision = "float32") -> None:
    """Write a regular grid to a new folder, which appears whole or not at all.

    Raises
    ------
    GridError
        Where coefficients are not finite, do not fit into halves with ``precision`` = ``float16``, or the folder cannot
        be written.
    """
    require_storable(path, grid.coefficients, precision)
    tiles, scale = pack_tiles(grid.coefficients)
    own: dict[str, Any] = {"format": FORMAT, "gpu_tiles_scale": scale}
    arrays: dict[str, Chunked] = {
        "coefficients": (grid.coefficients.astype(precision), _chunks(grid.coefficients.shape)),
        "coverage": (grid.coverage, grid.coverage.shape),
        "gpu_tiles": (tiles, (1, *tiles.shape[1:])),
    }
    if grid.samples is not None:
        arrays["samples"] = (grid.samples, grid.samples.shape)
    if grid.gradients is not None:
        require_storable(path, grid.gradients, precision, "gradients")
        arrays["gradients"] = (grid.gradients.astype(precision), _chunks(grid.gradients.shape))
        bends, own["gpu_bends_scale"] = pack_bends(grid.gradients, grid.spec.voxel)
        arrays["gpu_bends"] = (bends, (1, *bends.shape[1:]))
    attributes = {**common_attributes(grid), **own}
    write_group(path, attributes, arrays)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    return (*(min(size, CHUNK_CELLS) for size in shape[:3]), *shape[3:])


def open_grid(path: Path) -> AnyGrid:
    """Read a grid of either form.

    Raises
    ------
    GridError
        Where there is none, or it is damaged.
    """
    if not (path / "zarr.json").is_file():
        raise GridError(f"{path}: is no grid: a Zarr v3 group has a zarr.json")
    try:
        group = zarr.open_group(path, mode="r", zarr_format=3)
        attributes: dict[str, Any] = dict(group.attrs)
        form = attributes.get("format")
        if form not in (FORMAT, ADAPTIVE_FORMAT):
            raise GridError(f"{path}: is a Zarr group, but no {FORMAT} or {ADAPTIVE_FORMAT}")
        adaptive = form == ADAPTIVE_FORMAT
        names = ADAPTIVE_NAMES if adaptive else ("coefficients", "coverage", "samples", "gradients")
        arrays = {name: np.asarray(group[name][...]) for name in names if name in group}  # type: ignore[index]
        for name in ("coefficients", *arrays):
            if name not in arrays or (arrays[name].dtype.kind == "f" and not np.isfinite(arrays[name]).all()):
                raise GridError(f"{path}: {name} are missing or not finite; make the grid anew")
        return adaptive_grid(path, attributes, arrays) if adaptive else _regular_grid(path, attributes, arrays)
    except (BaseZarrError, OSError, KeyError, ValueError, TypeError) as error:
        raise GridError(f"{path}: is a damaged grid: {error}; make it anew") from None


def _regular_grid(path: Path, attributes: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Grid:
    spec = read_spec(attributes)
    expected = (*spec.shape, coefficient_count(int(attributes["bands"])), 3)
    for name, values in arrays.items():
        wanted = {"coefficients": expected, "gradients": (*expected, 3)}.get(name, spec.shape)
        if values.shape != wanted:
            raise GridError(f"{path}: {name} has the shape {values.shape}, not {wanted}; make the grid anew")
    floats = {name: np.asarray(values, np.float32) for name, values in arrays.items()}
    return Grid(
        spec,
        floats["coefficients"],
        floats.get("coverage", np.zeros(spec.shape, np.float32)),
        floats.get("samples"),
        floats.get("gradients"),
        attributes,
    )
