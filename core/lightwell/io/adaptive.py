"""Adaptive grids on disk: `lightwell.io.grids.open_grid` opens them too.

``pages`` (z, y, x) int32, ``levels`` (bricks) uint8, ``nodes`` (bricks, z, y, x) int32, ``coefficients`` (nodes,
bands², 3) and ``coverage`` (nodes) are those of `lightwell.field.adaptive`; ``gpu_bricks`` (tiles, z, y, x, 4) of
halves is the atlas of `lightwell.field.atlas`, with the attributes ``gpu_slots`` and ``gpu_bricks_scale``.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import coefficient_count
from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.atlas import make_atlas
from lightwell.field.bricks import STEPS, Layout
from lightwell.io.groups import GridError, Precision, common_attributes, read_spec, require_storable, write_group

FORMAT = "lightwell.adaptive-grid.v1"
CHUNK_NODES = 32768
NAMES = ("pages", "levels", "nodes", "coefficients", "coverage")


def write_adaptive_grid(path: Path, grid: AdaptiveGrid, precision: Precision = "float32") -> None:
    """Write an adaptive grid to a new folder, which appears whole or not at all.

    Raises
    ------
    GridError
        Where coefficients are not finite, do not fit into halves with ``precision`` = ``float16``, or the folder cannot
        be written.
    """
    require_storable(path, grid.coefficients, precision)
    atlas = make_atlas(grid)
    count, *rest = grid.coefficients.shape
    attributes = {
        **common_attributes(grid),
        "format": FORMAT,
        "tolerance": grid.tolerance,
        "steps": STEPS,
        "leaves": grid.leaves,
        "gpu_slots": list(atlas.slots),
        "gpu_bricks_scale": atlas.scale,
    }
    write_group(
        path,
        attributes,
        {
            "pages": (grid.pages, grid.pages.shape),
            "levels": (grid.levels, grid.levels.shape),
            "nodes": (grid.nodes, grid.nodes.shape),
            "coefficients": (grid.coefficients.astype(precision), (min(count, CHUNK_NODES), *rest)),
            "coverage": (grid.coverage, grid.coverage.shape),
            "gpu_bricks": (atlas.tiles, (1, *atlas.tiles.shape[1:])),
        },
    )


def adaptive_grid(path: Path, attributes: dict[str, Any], arrays: Mapping[str, NDArray[Any]]) -> AdaptiveGrid:
    """Return the grid of what was read from ``path``: no index of it leads out of an array.

    Raises
    ------
    GridError
        Where arrays do not fit each other.
    KeyError, TypeError, ValueError
        Where something is missing, or is of another kind.
    """
    if attributes["steps"] != STEPS:
        raise GridError(f"{path}: has bricks of {attributes['steps']} steps, not {STEPS}; make the grid anew")
    spec = read_spec(attributes)
    layout = Layout(spec.resolution)
    bricks, count = arrays["levels"].shape[0], arrays["coverage"].shape[0]
    expected = {
        "pages": layout.page_shape,
        "levels": (bricks,),
        "nodes": (bricks, *layout.brick_shape),
        "coefficients": (count, coefficient_count(int(attributes["bands"])), 3),
        "coverage": (count,),
    }
    for name, shape in expected.items():
        if arrays[name].shape != shape:
            raise GridError(f"{path}: {name} has the shape {arrays[name].shape}, not {shape}; make the grid anew")
    for name, end in (("pages", bricks), ("nodes", count), ("levels", layout.top + 1)):
        low, high = (int(value) for value in (arrays[name].min(), arrays[name].max()))
        if low < 0 or high >= end:
            raise GridError(f"{path}: {name} has {low} … {high}, not 0 … {end - 1}; make the grid anew")
    return AdaptiveGrid(
        spec,
        np.ascontiguousarray(arrays["pages"], np.int32),
        np.ascontiguousarray(arrays["levels"], np.uint8),
        np.ascontiguousarray(arrays["nodes"], np.int32),
        np.asarray(arrays["coefficients"], np.float32),
        np.asarray(arrays["coverage"], np.float32),
        float(attributes["tolerance"]),
        attributes,
    )
