"""Adaptive grids: within the tolerance, continuous, and no larger than they need to be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support.reference_adaptive import adaptive_light, make_bumpy

from lightwell.field.adapt import adapt, compare, mean_square
from lightwell.field.adaptive import AdaptiveGrid
from lightwell.field.atlas import atlas_bytes, make_atlas
from lightwell.field.bricks import STEPS, Layout
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.field.tiles import unpack_tiles

SIZES = st.tuples(*[st.sampled_from([1, 2, 3, 5, 6, 8, 9, 13, 17, 22])] * 3)
TOLERANCES = st.sampled_from([0.01, 0.1, 0.3, 1.0])


def _points(grid: AdaptiveGrid, count: int, seed: int = 0) -> Any:
    """Return points all over the grid, many of them on faces, edges and corners of leaves."""
    generator = np.random.default_rng(seed)
    places = generator.uniform(-1, grid.spec.resolution, (count, 3))
    on_nodes = generator.random((count, 3)) < 0.4
    places = np.where(on_nodes, np.round(places), places)
    return np.array(grid.spec.lower) + (places + 0.5) * grid.spec.voxel


@settings(max_examples=40, deadline=None)
@given(resolution=SIZES, tolerance=TOLERANCES, seed=st.integers(0, 99), noise=st.sampled_from([0.0, 0.2]))
def test_sampling_agrees_with_looking_through_all_leaves(
    resolution: tuple[int, int, int], tolerance: float, seed: int, noise: float
) -> None:
    grid = adapt(make_bumpy(resolution, seed, noise=noise), tolerance)
    points = _points(grid, 30, seed)
    found = grid.sample(points)
    for index, point in enumerate(points):
        coefficients, coverage = adaptive_light(grid, point)
        np.testing.assert_allclose(found.coefficients[index], coefficients, rtol=1e-5, atol=1e-5)
        assert found.coverage[index] == pytest.approx(coverage, abs=1e-5)


@settings(max_examples=60, deadline=None)
@given(resolution=SIZES, tolerance=TOLERANCES, seed=st.integers(0, 99), noise=st.sampled_from([0.0, 0.2]))
def test_every_cell_is_within_the_tolerance(
    resolution: tuple[int, int, int], tolerance: float, seed: int, noise: float
) -> None:
    regular = make_bumpy(resolution, seed, noise=noise)
    grid = adapt(regular, tolerance)
    found = grid.sample(regular.spec.centres()).coefficients
    errors = np.sqrt(((found - regular.coefficients) ** 2).sum(axis=(-1, -2)))
    assert errors.max() <= tolerance * np.sqrt(mean_square(regular.coefficients)) * (1 + 1e-6)
    difference = compare(regular, grid)
    assert difference.largest <= tolerance * (1 + 1e-6)
    assert difference.rms <= difference.largest
    covered = grid.to_regular().coverage
    assert covered.min() >= 0
    assert covered.max() <= 1 + 1e-6
    # Each leaf covers the aligned box that its level says, and no other does.
    for brick, level in enumerate(grid.levels):
        where = np.nonzero(grid.pages == brick)
        for axis, blocks in enumerate(where):
            span = int(grid.layout.spans(int(level))[2 - axis])
            assert blocks.min() % span == 0
            assert blocks.max() - blocks.min() < span
        boxes = [int(blocks.max() - blocks.min()) + 1 for blocks in where]
        assert len(where[0]) == np.prod(boxes)


@settings(max_examples=40, deadline=None)
@given(resolution=SIZES, tolerance=TOLERANCES, seed=st.integers(0, 99))
def test_the_field_is_continuous_across_leaves(resolution: tuple[int, int, int], tolerance: float, seed: int) -> None:
    """On both sides of every face between blocks, at places that are no nodes along the face."""
    grid = adapt(make_bumpy(resolution, seed, noise=0.3), tolerance)
    generator = np.random.default_rng(seed)
    scale = float(np.abs(grid.coefficients).max())
    for axis in range(3):
        faces = np.arange(STEPS, resolution[axis] - 1, STEPS)
        if not faces.size:
            continue
        places = generator.uniform(0, np.array(resolution) - 1, (200, 3))
        places[:, axis] = generator.choice(faces, 200)
        step = np.zeros(3)
        step[axis] = 1e-7
        below, above = (
            grid.sample(np.array(grid.spec.lower) + (places + sign * step + 0.5) * grid.spec.voxel) for sign in (-1, 1)
        )
        np.testing.assert_allclose(below.coefficients, above.coefficients, atol=2e-5 * scale)
        np.testing.assert_allclose(below.coverage, above.coverage, atol=2e-5)


def test_leaves_are_small_only_where_the_light_changes() -> None:
    regular = make_bumpy((33, 33, 33), 3, sharp=400.0)
    grid = adapt(regular, 0.05)
    assert len(grid.leaves) == 4
    assert sum(count > 0 for count in grid.leaves) >= 3
    strength = np.sqrt(((regular.coefficients - regular.coefficients.mean(axis=(0, 1, 2))) ** 2).sum(axis=(-1, -2)))
    peak = np.unravel_index(strength.argmax(), strength.shape)
    assert grid.levels[grid.pages[tuple(np.minimum(np.array(peak) // STEPS, 7))]] == 0
    assert grid.memory_bytes() < 0.5 * regular.memory_bytes()


@pytest.mark.parametrize("resolution", [(1, 1, 1), (1, 7, 30), (16, 16, 16), (33, 20, 5), (64, 9, 1)])
def test_what_one_brick_can_say_is_one_brick(resolution: tuple[int, int, int]) -> None:
    spec = GridSpec((0, 0, 0), (1, 2, 3), resolution)
    x, y, z = np.moveaxis(spec.centres(), -1, 0)
    for field in (np.ones(spec.shape), 1 + x - 2 * y * z + x * y * z, np.zeros(spec.shape)):
        coefficients = np.broadcast_to(field[..., None, None], (*spec.shape, 4, 3)).astype(np.float32)
        grid = adapt(Grid(spec, coefficients, np.ones(spec.shape, np.float32)), 1e-4)
        assert grid.leaves[-1] == len(grid.levels) == 1
        np.testing.assert_allclose(grid.to_regular().coefficients, coefficients, atol=1e-4)


def test_a_small_tolerance_gives_the_regular_grid_back_exactly() -> None:
    regular = make_bumpy((11, 6, 9), noise=1.0)
    grid = adapt(regular, 1e-6)
    assert grid.leaves[0] == len(grid.levels)
    np.testing.assert_array_equal(grid.to_regular().coefficients, regular.coefficients)
    np.testing.assert_array_equal(grid.to_regular().coverage, regular.coverage)
    assert len(grid.coefficients) == 11 * 6 * 9
    assert grid.memory_bytes() > regular.memory_bytes()
    points = _points(grid, 200)
    np.testing.assert_allclose(grid.sample(points).coefficients, regular.sample(points).coefficients, atol=1e-5)


def test_gradients_are_those_of_its_own_interpolation() -> None:
    grid = adapt(make_bumpy((17, 13, 9), noise=0.2), 0.3)
    points = np.random.default_rng(3).uniform((-0.9, 0.2, 2.2), (0.9, 2.8, 3.8), (50, 3))
    slopes = grid.sample(points, gradients=True).gradients
    assert slopes is not None
    for axis in range(3):
        step = np.zeros(3)
        step[axis] = 1e-6
        change = (grid.sample(points + step).coefficients - grid.sample(points - step).coefficients) / 2e-6
        assert np.median(np.abs(change - slopes[..., axis])) < 1e-7
    flat = adapt(make_bumpy((1, 9, 9)), 0.1).sample([[0.0, 1.0, 3.0], [0.0, -5.0, 3.0]], gradients=True).gradients
    assert flat is not None
    assert (flat[..., 0] == 0).all()
    assert (flat[1, ..., 1] == 0).all()


def test_outside_and_what_cannot_be() -> None:
    regular = make_bumpy((8, 8, 8))
    grid = adapt(regular, 0.1)
    far = np.array([[5.0, 0.1, 2.1], [0.5, 0.5, 2.5]])
    assert np.isfinite(grid.sample(far).coefficients).all()
    assert np.isnan(grid.sample(far, outside="nan", gradients=True).coefficients[0]).all()
    assert grid.sample(far[0], bands=1).coefficients.shape == (1, 3)
    with pytest.raises(ValueError, match=r"\(5, 0.1, 2.1\) lies outside"):
        grid.sample(far, outside="error")
    with pytest.raises(ValueError, match="finite"):
        grid.sample([[np.nan, 0, 0]])
    with pytest.raises(ValueError, match="2 bands, not 3"):
        grid.sample(far, bands=3)
    for tolerance in (0.0, -1.0, np.nan, np.inf):
        with pytest.raises(ValueError, match="must be positive"):
            adapt(regular, tolerance)
    regular.coefficients[0, 0, 0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        adapt(regular, 0.1)


def test_the_atlas_says_the_same_by_the_formulas_of_its_layout() -> None:
    """What a shader does, in NumPy: page, level, slot, and the hardware's filter at the texture coordinate."""
    grid = adapt(make_bumpy((22, 13, 1), noise=0.1), 0.2)
    atlas = make_atlas(grid)
    assert atlas.tiles.nbytes == atlas_bytes(grid)
    texels = unpack_tiles(atlas.tiles, 4, atlas.scale)
    blocks, depths = grid.layout.blocks, grid.layout.depths
    nodes = np.array(grid.layout.brick_shape[::-1])
    points = _points(grid, 100)
    found = grid.sample(points).coefficients
    for index, point in enumerate(points):
        p = np.clip(grid.spec.to_cells(point) - 0.5, 0, np.array(grid.spec.resolution) - 1)
        block = np.minimum(np.floor(p / 4).astype(int), blocks - 1)
        brick = int(grid.pages[tuple(block[::-1])])
        span = 2 ** np.minimum(grid.levels[brick], depths)
        local = p / span - block // span * 4
        nx, ny, _ = atlas.slots
        slot = np.array([brick % nx, brick // nx % ny, brick // (nx * ny)])
        texel = slot * nodes + local  # minus the ½ of texel centres
        hats = [np.maximum(0, 1 - np.abs(texel[axis] - np.arange(texels.shape[2 - axis]))) for axis in range(3)]
        value = np.einsum("z,y,x,zyxkc->kc", hats[2], hats[1], hats[0], texels)
        np.testing.assert_allclose(value, found[index], atol=2e-3 * float(np.abs(grid.coefficients).max()))


def test_layouts() -> None:
    layout = Layout((64, 9, 1))
    assert layout.blocks.tolist() == [16, 2, 1]
    assert layout.depths.tolist() == [4, 1, 0]
    assert (layout.top, layout.page_shape, layout.brick_shape) == (4, (1, 2, 16), (1, 5, 5))
    assert layout.spans(3).tolist() == [8, 2, 1]
    assert layout.nodes(0).tolist() == [65, 9, 1]
    assert layout.nodes(4).tolist() == [5, 5, 1]
