"""Grids on disk and their exports."""

from __future__ import annotations

import json
import struct
import subprocess
from pathlib import Path

import numpy as np
import pytest
import zarr

from lightwell.field.gradient import central_differences
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.field.tiles import pack_bends, pack_tiles, tile_count, unpack_tiles
from lightwell.io.export import export_grid, ktx2, three
from lightwell.io.grids import GridError, open_grid, write_grid
from lightwell.io.plots import plot_grid, plot_positions
from lightwell.io.preview import preview_png

ROOT = Path(__file__).parents[3]


def _grid(bands: int = 5, scale: float = 1.0, *, gradients: bool = False) -> Grid:
    spec = GridSpec((-1, 0, 2), (1, 3, 4), (4, 3, 5))
    coefficients = (scale * np.random.default_rng(0).normal(size=(*spec.shape, bands**2, 3))).astype(np.float32)
    slopes = central_differences(coefficients, spec.voxel) if gradients else None
    return Grid(spec, coefficients, np.full(spec.shape, 0.75, np.float32), None, slopes)


@pytest.mark.parametrize("gradients", [False, True])
def test_round_trip(tmp_path: Path, gradients: bool) -> None:
    grid = _grid(gradients=gradients)
    write_grid(tmp_path / "g.zarr", grid)
    found = open_grid(tmp_path / "g.zarr")
    assert isinstance(found, Grid)
    np.testing.assert_array_equal(found.coefficients, grid.coefficients)
    assert (found.spec, found.bands, found.gradients is not None) == (grid.spec, 5, gradients)
    group = zarr.open_group(tmp_path / "g.zarr", mode="r")
    assert group["coefficients"].shape == (5, 3, 4, 25, 3)  # type: ignore[union-attr]
    assert group["gpu_tiles"].shape == (19, 5, 3, 4, 4)  # type: ignore[union-attr]
    assert group.attrs["voxel_m"] == [0.5, 1.0, 0.4]
    assert ("gpu_bends" in group, "gpu_bends_scale" in group.attrs) == (gradients, gradients)
    if gradients:
        assert group["gpu_bends"].shape == (57, 5, 3, 4, 4)  # type: ignore[union-attr]


def test_the_same_grid_is_the_same_bytes(tmp_path: Path) -> None:
    contents = []
    for name in ("a.zarr", "b.zarr"):
        write_grid(tmp_path / name, _grid(gradients=True))
        folder = tmp_path / name
        contents.append({path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()})
    assert contents[0] == contents[1]


def test_half_range_is_checked(tmp_path: Path) -> None:
    bright = _grid(scale=1e6)
    with pytest.raises(GridError, match=r"do not fit into float16 .* precision float32"):
        write_grid(tmp_path / "g.zarr", bright, "float16")
    steep = _grid(gradients=True)
    assert steep.gradients is not None
    steep.gradients[0, 0, 0, 0, 0, 0] = -7e4
    with pytest.raises(GridError, match=r"gradients up to 7e\+04 do not fit into float16"):
        write_grid(tmp_path / "g.zarr", steep, "float16")
    write_grid(tmp_path / "g.zarr", bright)
    group = zarr.open_group(tmp_path / "g.zarr", mode="r")
    tiles = np.asarray(group["gpu_tiles"][...])  # type: ignore[index]
    assert np.isfinite(tiles).all()
    found = unpack_tiles(tiles, 25, float(group.attrs["gpu_tiles_scale"]))  # type: ignore[arg-type]
    np.testing.assert_allclose(found, bright.coefficients, rtol=1e-3, atol=50)
    write_grid(tmp_path / "h.zarr", _grid(), "float16")
    np.testing.assert_allclose(open_grid(tmp_path / "h.zarr").coefficients, _grid().coefficients, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("resolution", [(4, 3, 5), (1, 4, 2), (2, 1, 1)])
def test_bends_make_the_half_gradient_rule_out_of_a_trilinear_filter(resolution: tuple[int, int, int]) -> None:
    """As a shader does it: one trilinear look-up, and one look-up an axis in the middle of the lower node."""
    rng = np.random.default_rng(3)
    spec = GridSpec((-1, 0, 2), (1, 3, 4), resolution)
    values = rng.normal(size=(*spec.shape, 9, 3)).astype(np.float32)
    slopes = rng.normal(size=(*values.shape, 3)).astype(np.float32)
    grid = Grid(spec, values, np.ones(spec.shape, np.float32), None, slopes)
    tiles, scale = pack_bends(slopes, spec.voxel)
    bends = [Grid(spec, unpack_tiles(part, 9, scale), np.ones(spec.shape, np.float32)) for part in np.split(tiles, 3)]
    points = rng.uniform(np.subtract(spec.lower, 0.2), np.add(spec.upper, 0.2), (200, 3))
    places = np.clip(spec.to_cells(points) - 0.5, 0, np.array(resolution) - 1)
    low = np.maximum(np.minimum(np.floor(places), np.array(resolution) - 2), 0)
    fraction = places - low
    total = Grid(spec, values, np.ones(spec.shape, np.float32)).sample(points).coefficients
    for axis, bend in enumerate(bends):
        at = places.copy()
        at[:, axis] = low[:, axis]
        found = bend.sample((at + 0.5) * spec.voxel + spec.lower).coefficients
        total = total + (fraction[:, axis] * (1 - fraction[:, axis]))[:, None, None] * found
    np.testing.assert_allclose(total, grid.sample(points).coefficients, atol=1e-3)


def test_steep_bends_have_a_scale() -> None:
    slopes = np.zeros((1, 1, 2, 1, 3, 3), np.float32)
    slopes[0, 0, 0, ..., 0] = 2.0**20
    tiles, scale = pack_bends(slopes, np.array([2.0, 1.0, 1.0]))
    assert scale == 32
    assert unpack_tiles(tiles[:1], 1, scale)[0, 0, 0, 0, 0] == 2.0**20


@pytest.mark.parametrize("bands", range(1, 7))
def test_tiles_of_all_bands(bands: int) -> None:
    coefficients = np.random.default_rng(bands).random((2, 3, 4, bands**2, 3)).astype(np.float32)
    tiles, scale = pack_tiles(coefficients)
    assert tiles.shape[0] == tile_count(bands**2)
    np.testing.assert_allclose(unpack_tiles(tiles, bands**2, scale), coefficients, rtol=1e-3, atol=1e-7)


def test_damaged_grids_are_refused(tmp_path: Path) -> None:
    with pytest.raises(GridError, match="is no grid"):
        open_grid(tmp_path)
    write_grid(tmp_path / "g.zarr", _grid())
    chunk = next(path for path in (tmp_path / "g.zarr" / "coefficients" / "c").rglob("*") if path.is_file())
    chunk.write_bytes(chunk.read_bytes()[:-8])
    with pytest.raises(GridError, match="damaged"):
        open_grid(tmp_path / "g.zarr")
    write_grid(tmp_path / "dark.zarr", _grid(scale=0))
    assert not open_grid(tmp_path / "dark.zarr").sample([0.0, 0.0, 0.0]).coefficients.any()
    for name in ("coefficients", "coverage"):
        write_grid(tmp_path / "lost.zarr", _grid())
        next(path for path in (tmp_path / "lost.zarr" / name / "c").rglob("*") if path.is_file()).unlink()
        with pytest.raises(GridError, match=f"{name} are missing or not finite"):
            open_grid(tmp_path / "lost.zarr")
    broken = _grid()
    broken.coefficients[0, 0, 0, 0, 0] = np.nan
    with pytest.raises(GridError, match="not finite"):
        write_grid(tmp_path / "n.zarr", broken)


def test_npz(tmp_path: Path) -> None:
    export_grid(_grid(gradients=True), "npz", tmp_path / "g.npz")
    with np.load(tmp_path / "g.npz") as file:
        np.testing.assert_array_equal(file["coefficients"], _grid().coefficients)
        assert set(file.files) == {"coefficients", "coverage", "lower_m", "upper_m", "gradients"}


def test_three_atlas_has_the_layout_of_light_probe_grid(tmp_path: Path) -> None:
    grid = _grid()
    paths = export_grid(grid, "three", tmp_path / "g.bin")
    document = json.loads(paths[1].read_text())
    width, height, depth = document["size"]
    atlas = np.frombuffer(paths[0].read_bytes(), "<f2").reshape(depth, height, width, 4)
    nz = document["resolution"][2]
    assert depth == 7 * (nz + 2)
    # Three's cell (ix, iy, iz) is ours at x = ix, z = iy, y = last − iz; its axes are (x, z, −y).
    ix, iy, iz = 2, 4, 1
    texels = [atlas[volume * (nz + 2) + 1 + iz, iy, ix] for volume in range(7)]
    values = np.concatenate(texels)[:27].reshape(9, 3).astype(np.float32)
    ours = grid.coefficients[iy, nz - 1 - iz, ix]
    np.testing.assert_allclose(values[0], ours[0], rtol=2e-3)
    # Index 1, 2, 3 are y, z, x of each: three's y is our z, three's z our −y.
    np.testing.assert_allclose(values[1], ours[2], rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(values[2], -ours[1], rtol=2e-3, atol=1e-3)
    np.testing.assert_allclose(values[3], ours[3], rtol=2e-3, atol=1e-3)
    np.testing.assert_array_equal(atlas[0], atlas[1])
    assert three(grid)[1]["min"] == [-1, 2, -3]


def test_ktx2_is_read_by_another_parser(tmp_path: Path) -> None:
    grid = _grid()
    path = tmp_path / "g.ktx2"
    path.write_bytes(ktx2(grid))
    parser = ROOT / "client/node_modules/three/examples/jsm/libs/ktx-parse.module.js"
    if not parser.exists():
        pytest.skip("client/node_modules is made by script/npm")
    program = (
        f"import {{ read }} from '{parser.as_posix()}'; import fs from 'fs';"
        f"const k = read(new Uint8Array(fs.readFileSync('{path.as_posix()}')));"
        "const text = new TextDecoder().decode(k.keyValue.LightwellBands).replaceAll('\\0', '');"
        "console.log(JSON.stringify([k.vkFormat, k.pixelWidth, k.pixelHeight, k.pixelDepth,"
        " k.levels[0].levelData.length, k.dataFormatDescriptor[0].samples.length, text]))"
    )
    answer = subprocess.run(["node", "--input-type=module", "-e", program], capture_output=True, text=True, check=True)
    assert json.loads(answer.stdout) == [97, 4, 3, 5 * 19, 19 * 5 * 3 * 4 * 8, 4, "5"]
    level = struct.unpack_from("<3Q", path.read_bytes(), 80)
    assert level[0] % 8 == 0


def test_pictures() -> None:
    for picture in (
        preview_png(_grid()),
        plot_grid(_grid(bands=2), (1.0, 0.0, 0.0)),
        plot_positions(np.random.default_rng(0).random((20, 3))),
    ):
        assert picture.startswith(b"\x89PNG")
