"""What all forms of grids have in common on disk: Zarr v3 groups that appear whole or not at all.

Nothing depends on the time of writing: the same grid is the same bytes.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import zarr
from numpy.typing import NDArray

from lightwell._version import __version__
from lightwell.errors import LightwellError
from lightwell.field.adaptive import AnyGrid
from lightwell.field.spec import GridSpec
from lightwell.field.tiles import LARGEST_HALF

Precision = Literal["float32", "float16"]
Chunked = tuple[NDArray[Any], tuple[int, ...]]
"""An array and the shape of its chunks."""

OF_A_FORM = (
    "format",
    "gpu_tiles_scale",
    "gpu_bends_scale",
    "tolerance",
    "steps",
    "leaves",
    "gpu_slots",
    "gpu_bricks_scale",
)
"""Attributes that one form of grids has and the other must not inherit."""


class GridError(LightwellError):
    """A grid cannot be read or written: names the folder, what is wrong and the remedy."""


def require_storable(path: Path, values: NDArray[np.float32], precision: Precision, what: str = "coefficients") -> None:
    """Raise `GridError` where coefficients or gradients are not finite, or do not fit into halves and should."""
    if not np.isfinite(values).all():
        raise GridError(f"{path.name}: some {what} are not finite; the capture holds samples that are not")
    largest = float(np.abs(values).max(initial=0.0))
    if precision == "float16" and largest > LARGEST_HALF:
        raise GridError(
            f"{path.name}: {what} up to {largest:.4g} do not fit into float16 (65504): use precision float32, or "
            "lower the capture's gain"
        )


def common_attributes(grid: AnyGrid) -> dict[str, Any]:
    """Return a grid's own attributes, without those of the form that it was read from, and what all forms say."""
    spec = grid.spec
    own = {name: value for name, value in grid.attributes.items() if name not in OF_A_FORM}
    return {
        "units": "relative",
        "window": "none",
        **own,
        "lower_m": list(spec.lower),
        "upper_m": list(spec.upper),
        "voxel_m": spec.voxel.tolist(),
        "resolution": list(spec.resolution),
        "bands": grid.bands,
        "convention": "lightwell",
        "code_version": __version__,
    }


def read_spec(attributes: Mapping[str, Any]) -> GridSpec:
    """Return the regular grid that attributes describe. Raises ``KeyError``, ``TypeError`` or ``ValueError``."""
    return GridSpec(tuple(attributes["lower_m"]), tuple(attributes["upper_m"]), tuple(attributes["resolution"]))


def write_group(path: Path, attributes: dict[str, Any], arrays: Mapping[str, Chunked]) -> None:
    """Write a group to a new folder. Raises `GridError` where it cannot be written."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        group = zarr.open_group(partial, mode="w", zarr_format=3, attributes=attributes)
        for name, (values, chunks) in arrays.items():
            # What is missing reads as NaN, so that a file that was lost is not taken for darkness. Every file is
            # written, also where it is all zeros: browsers read files, and know of no default.
            array = group.create_array(
                name,
                shape=values.shape,
                dtype=values.dtype,
                chunks=chunks,
                compressors=None,
                fill_value=float("nan") if values.dtype.kind == "f" else 0,
                config={"write_empty_chunks": True},
            )
            array[...] = values
        if path.exists():
            shutil.rmtree(path)
        partial.rename(path)
    except OSError as error:
        raise GridError(f"{path}: cannot be written: {error.strerror}; free space or give another folder") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
