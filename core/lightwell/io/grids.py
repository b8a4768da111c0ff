"""Grids on disk: Zarr v3 groups that Python and the browser read.

``coefficients`` (z, y, x, bands², 3), ``coverage`` and ``samples`` (z, y, x), ``gradients`` (z, y, x, bands², 3, 3)
where there are any, and ``gpu_tiles`` (tiles, z, y, x, 4) of `lightwell.field.tiles`. Nothing depends on the time of
writing: the same grid is the same bytes.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.errors import BaseZarrError

from lightwell._version import __version__
from lightwell.conventions import coefficient_count
from lightwell.errors import LightwellError
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.field.tiles import LARGEST_HALF, pack_tiles

FORMAT = "lightwell.grid.v1"
CHUNK_CELLS = 32


class GridError(LightwellError):
    """A grid cannot be read or written: names the folder, what is wrong and the remedy."""


def write_grid(path: Path, grid: Grid, precision: Literal["float32", "float16"] = "float32") -> None:
    """Write a grid to a new folder, which appears whole or not at all.

    Raises
    ------
    GridError
        Where coefficients are not finite, do not fit into halves with ``precision`` = ``float16``, or the folder cannot
        be written.
    """
    if not np.isfinite(grid.coefficients).all():
        raise GridError(f"{path.name}: some coefficients are not finite; the capture holds samples that are not")
    largest = float(np.abs(grid.coefficients).max(initial=0.0))
    if precision == "float16" and largest > LARGEST_HALF:
        raise GridError(
            f"{path.name}: coefficients up to {largest:.4g} do not fit into float16 (65504): use precision float32, or "
            "lower the capture's gain"
        )
    tiles, scale = pack_tiles(grid.coefficients)
    arrays: dict[str, tuple[NDArray[Any], tuple[int, ...]]] = {
        "coefficients": (grid.coefficients.astype(precision), _chunks(grid.coefficients.shape)),
        "coverage": (grid.coverage, grid.coverage.shape),
        "gpu_tiles": (tiles, (1, *tiles.shape[1:])),
    }
    if grid.samples is not None:
        arrays["samples"] = (grid.samples, grid.samples.shape)
    if grid.gradients is not None:
        arrays["gradients"] = (grid.gradients.astype(precision), _chunks(grid.gradients.shape))
    spec = grid.spec
    attributes = {
        "format": FORMAT,
        "lower_m": list(spec.lower),
        "upper_m": list(spec.upper),
        "voxel_m": spec.voxel.tolist(),
        "resolution": list(spec.resolution),
        "bands": grid.bands,
        "convention": "lightwell",
        "units": "relative",
        "window": "none",
        "gpu_tiles_scale": scale,
        "code_version": __version__,
        **grid.attributes,
    }
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        group = zarr.open_group(partial, mode="w", zarr_format=3, attributes=attributes)
        for name, (values, chunks) in arrays.items():
            array = group.create_array(name, shape=values.shape, dtype=values.dtype, chunks=chunks, compressors=None)
            array[...] = values
        if path.exists():
            shutil.rmtree(path)
        partial.rename(path)
    except OSError as error:
        raise GridError(f"{path}: cannot be written: {error.strerror}; free space or give another folder") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _chunks(shape: tuple[int, ...]) -> tuple[int, ...]:
    return (*(min(size, CHUNK_CELLS) for size in shape[:3]), *shape[3:])


def open_grid(path: Path) -> Grid:
    """Read a grid.

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
        if attributes.get("format") != FORMAT:
            raise GridError(f"{path}: is a Zarr group, but no {FORMAT}")
        spec = GridSpec(
            tuple(attributes["lower_m"]),
            tuple(attributes["upper_m"]),
            tuple(attributes["resolution"]),
        )
        bands = int(attributes["bands"])
        arrays = {
            name: np.asarray(group[name][...], np.float32)  # type: ignore[index]
            for name in ("coefficients", "coverage", "samples", "gradients")
            if name in group
        }
    except (BaseZarrError, OSError, KeyError, ValueError, TypeError) as error:
        raise GridError(f"{path}: is a damaged grid: {error}; make it anew") from None
    expected = (*spec.shape, coefficient_count(bands), 3)
    for name, values in arrays.items():
        wanted = {"coefficients": expected, "gradients": (*expected, 3)}.get(name, spec.shape)
        if values.shape != wanted:
            raise GridError(f"{path}: {name} has the shape {values.shape}, not {wanted}; make the grid anew")
    if "coefficients" not in arrays or not np.isfinite(arrays["coefficients"]).all():
        raise GridError(f"{path}: coefficients are missing or not finite; make the grid anew")
    return Grid(
        spec,
        arrays["coefficients"],
        arrays.get("coverage", np.zeros(spec.shape, np.float32)),
        arrays.get("samples"),
        arrays.get("gradients"),
        attributes,
    )
