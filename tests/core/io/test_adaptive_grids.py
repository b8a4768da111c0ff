"""Adaptive grids on disk: read by what reads regular ones, exported to the same programs."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zarr
from tests.support.reference_adaptive import make_bumpy

from lightwell.field.adapt import adapt
from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.atlas import make_atlas
from lightwell.io.adaptive import write_adaptive_grid
from lightwell.io.export import export_grid, ktx2, three
from lightwell.io.grids import GridError, open_grid, write_grid
from lightwell.io.plots import plot_grid
from lightwell.io.preview import preview_png

POINTS = np.random.default_rng(0).uniform((-1, 0, 2), (1, 3, 4), (50, 3))


def _adaptive(scale: float = 1.0) -> AdaptiveGrid:
    grid = make_bumpy((34, 17, 5), sharp=60.0)
    grid.coefficients[...] *= np.float32(scale)
    grid.attributes.update(units="W.sr-1.m-2", capture={"name": "hall"})
    return adapt(grid, 0.1)


def _files(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_round_trip_and_the_same_bytes(tmp_path: Path) -> None:
    grid = _adaptive()
    assert sum(count > 0 for count in grid.leaves) > 1
    write_adaptive_grid(tmp_path / "a.zarr", grid)
    found = open_grid(tmp_path / "a.zarr")
    assert isinstance(found, AdaptiveGrid)
    assert (found.spec, found.bands, found.tolerance, found.leaves) == (grid.spec, 2, 0.1, grid.leaves)
    for gradients in (False, True):
        ours, theirs = grid.sample(POINTS, gradients=gradients), found.sample(POINTS, gradients=gradients)
        for one, other in zip(ours, theirs, strict=True):
            np.testing.assert_array_equal(one, other)
    assert found.attributes["units"] == "W.sr-1.m-2"
    assert found.attributes["capture"] == {"name": "hall"}
    assert found.attributes["resolution"] == [34, 17, 5]
    write_adaptive_grid(tmp_path / "b.zarr", adapt(make_bumpy((34, 17, 5), sharp=60.0), 0.1))
    write_adaptive_grid(tmp_path / "c.zarr", adapt(make_bumpy((34, 17, 5), sharp=60.0), 0.1))
    assert _files(tmp_path / "b.zarr") == _files(tmp_path / "c.zarr")
    assert not list(tmp_path.glob("*.partial"))


def test_a_grid_written_in_the_other_form_is_of_that_form(tmp_path: Path) -> None:
    write_adaptive_grid(tmp_path / "a.zarr", _adaptive())
    write_grid(tmp_path / "r.zarr", open_grid(tmp_path / "a.zarr").to_regular())
    regular = open_grid(tmp_path / "r.zarr")
    assert regular.attributes["format"] == "lightwell.grid.v1"
    assert "tolerance" not in regular.attributes
    np.testing.assert_array_equal(regular.coefficients, _adaptive().to_regular().coefficients)
    write_adaptive_grid(tmp_path / "again.zarr", adapt(regular.to_regular(), 0.1))
    assert "gpu_tiles_scale" not in open_grid(tmp_path / "again.zarr").attributes


def test_halves(tmp_path: Path) -> None:
    with pytest.raises(GridError, match=r"do not fit into float16 .* precision float32"):
        write_adaptive_grid(tmp_path / "a.zarr", _adaptive(1e6), "float16")
    write_adaptive_grid(tmp_path / "a.zarr", _adaptive(1e6))
    group: Any = zarr.open_group(tmp_path / "a.zarr", mode="r")
    assert np.isfinite(group["gpu_bricks"][...]).all()
    assert group.attrs["gpu_bricks_scale"] > 1
    write_adaptive_grid(tmp_path / "h.zarr", _adaptive(), "float16")
    group = zarr.open_group(tmp_path / "h.zarr", mode="r")
    assert group["coefficients"].dtype == np.float16
    np.testing.assert_array_equal(group["gpu_bricks"][...], make_atlas(_adaptive()).tiles)
    found = open_grid(tmp_path / "h.zarr").sample(POINTS).coefficients
    np.testing.assert_allclose(found, _adaptive().sample(POINTS).coefficients, rtol=2e-3, atol=2e-3)
    broken = _adaptive()
    broken.coefficients[0, 0, 0] = np.nan
    with pytest.raises(GridError, match="not finite"):
        write_adaptive_grid(tmp_path / "n.zarr", broken)


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("pages", 9999, "pages has 0 … 9999"),
        ("nodes", -1, "nodes has -1"),
        ("levels", 77, "77, not 0 … 4"),
    ],
)
def test_an_index_that_leads_out_of_an_array_is_refused(tmp_path: Path, name: str, value: int, message: str) -> None:
    write_adaptive_grid(tmp_path / "a.zarr", _adaptive())
    group: Any = zarr.open_group(tmp_path / "a.zarr", mode="r+")
    group[name][(0,) * group[name].ndim] = value
    with pytest.raises(GridError, match=message):
        open_grid(tmp_path / "a.zarr")


@pytest.mark.parametrize("change", [{"steps": 8}, {"resolution": [34, 17, 9]}, {"bands": 3}, {"bands": None}])
def test_damaged_attributes_are_refused(tmp_path: Path, change: dict[str, Any]) -> None:
    write_adaptive_grid(tmp_path / "a.zarr", _adaptive())
    zarr.open_group(tmp_path / "a.zarr", mode="r+").attrs.update(change)
    with pytest.raises(GridError, match=r"a\.zarr: .*make (the grid|it) anew"):
        open_grid(tmp_path / "a.zarr")


def test_exports_and_pictures(tmp_path: Path) -> None:
    grid = _adaptive()
    export_grid(grid, "npz", tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        names = ("pages", "levels", "nodes", "coefficients", "coverage")
        again = AdaptiveGrid(grid.spec, **{name: file[name] for name in names}, tolerance=grid.tolerance)
        np.testing.assert_array_equal(file["resolution"], grid.spec.resolution)
    np.testing.assert_array_equal(again.sample(POINTS).coefficients, grid.sample(POINTS).coefficients)
    (path,) = export_grid(grid, "ktx2", tmp_path / "a.ktx2")
    assert path.read_bytes() == ktx2(grid.to_regular())
    data, document = export_grid(grid, "three", tmp_path / "a.bin")
    assert data.read_bytes() == three(grid.to_regular())[0]
    assert document.stat().st_size > 100
    assert preview_png(grid) == preview_png(grid.to_regular())
    assert plot_grid(grid).startswith(b"\x89PNG")
