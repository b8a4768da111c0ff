"""Write ``page.json``: what Python says of a small grid, its modulation by a live probe, lobes and transfer.

The page's unit tests (``client/src/page.test.ts``) compare their own mathematics with it. Run anew where one of these
changes::

    python -m tests.vectors.page.make_page_vectors
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adapt import adapt
from lightwell.field.adaptive import AnyGrid
from lightwell.field.atlas import make_atlas
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.field.tiles import pack_bends, pack_tiles, unpack_tiles
from lightwell.gradients.interpolate import SampleSet
from lightwell.render import DistantLight, FieldLight
from lightwell.render.light import modulate
from lightwell.render.material import Material
from lightwell.render.shading import Surface, receive
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import phong_zonal

FILE = Path(__file__).with_name("page.json")
EXPONENTS = (1.0, 3.5, 6.0, 10.0, 20.0, 64.0)


def grid_vectors(bands: int, resolution: tuple[int, int, int], scale: float) -> dict[str, Any]:
    """A grid of halves as the browser gets it, and the light at points within and beyond it."""
    rng = np.random.default_rng(bands)
    spec = GridSpec((-1.0, 0.5, -0.25), (2.0, 1.5, 0.75), resolution)
    wild = rng.normal(size=(*spec.shape, bands * bands, 3)).astype(np.float32) * np.float32(scale)
    tiles, factor = pack_tiles(wild)
    grid = Grid(spec, unpack_tiles(tiles, bands * bands, factor), np.ones(spec.shape, np.float32))
    points = [
        *rng.uniform(spec.lower, spec.upper, (8, 3)).tolist(),
        [-9.0, 0.6, 0.1],
        [3.0, 9.0, -4.0],
        list(spec.lower),
    ]
    live = rng.normal(size=(25, 3))
    changed = modulate(FieldLight(grid, most_bands=min(bands, 5)), live)
    return {
        "name": f"{bands} bands, {'x'.join(map(str, resolution))} cells",
        "bands": bands,
        "lower": spec.lower,
        "upper": spec.upper,
        "resolution": resolution,
        "scale": factor,
        "tiles": _halves(tiles),
        "points": points,
        "samples": grid.sample(points).coefficients.tolist(),
        "live": live.tolist(),
        "gain": np.broadcast_to(changed.fields[0].gain, 3).tolist(),
        "residual": changed.residual,
        "rest": changed.rest.tolist(),
    }


def lobe_vectors() -> list[dict[str, Any]]:
    """How much of a Phong lobe is cut off, by quadrature of the lobe itself."""
    u = np.linspace(-1, 1, 200_001)
    rows = []
    for exponent in EXPONENTS:
        lobe = np.maximum(0, u) ** exponent * (exponent + 1) / (2 * np.pi)
        for bands in range(1, 6):
            zonal = phong_zonal(exponent, bands)
            directions = np.stack([np.sqrt(1 - u * u), np.zeros_like(u), u], axis=1)
            basis = evaluate(directions, bands)
            order = np.arange(bands)
            # Coefficients of the lobe about +Z: only those of order 0 are not zero.
            kept = basis[:, order * order + order] @ (zonal * np.sqrt((2 * order + 1) / (4 * np.pi)))
            error = np.sqrt(np.trapezoid((lobe - kept) ** 2, u) / np.trapezoid(lobe**2, u))
            rows.append({"exponent": exponent, "bands": bands, "factors": zonal.tolist(), "error": float(error)})
    return rows


def _halves(tiles: NDArray[np.float16]) -> list[list[int]]:
    return [tile.astype("<f2").view("<u2").ravel().tolist() for tile in tiles]


def _places(spec: GridSpec, rng: np.random.Generator) -> list[list[float]]:
    lower, upper = np.array(spec.lower), np.array(spec.upper)
    inside = rng.uniform(lower, upper, (10, 3))
    return [*inside.tolist(), (lower - 1).tolist(), (upper + 1).tolist(), spec.centres()[0, 0, 0].tolist()]


def _fine(name: str, grid: AnyGrid, attributes: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    points = _places(grid.spec, rng)
    common = {"lower_m": grid.spec.lower, "upper_m": grid.spec.upper, "resolution": grid.spec.resolution}
    return {
        "name": name,
        "attributes": common | {"bands": grid.bands} | attributes,
        "tiles": [],
        "bends": [],
        "pages": [],
        "levels": [],
        "points": points,
        "samples": grid.sample(points).coefficients.tolist(),
    }


def bent_vectors(bands: int, resolution: tuple[int, int, int]) -> dict[str, Any]:
    """A grid with gradients, which are looked up by the half-gradient rule."""
    rng = np.random.default_rng(bands)
    spec = GridSpec((-1.0, 0.5, -0.25), (2.0, 1.5, 0.75), resolution)
    values, bends = rng.normal(size=(2, *spec.shape, bands * bands, 3)).astype(np.float32)
    tiles, scale = pack_tiles(values)
    # The gradients are such that halves hold what is made of them: a grid of its own, of bends that are halves.
    slopes = np.zeros((*spec.shape, bands * bands, 3, 3), np.float32)
    for axis in range(3):
        steps = np.cumsum(bends.astype(np.float16).astype(np.float32), axis=2 - axis)
        slopes[..., axis] = -2 * steps / np.float32(spec.voxel[axis])
    packed, bend_scale = pack_bends(slopes, spec.voxel)
    kept = unpack_tiles(tiles, bands * bands, scale)
    grid = Grid(spec, kept, np.ones(spec.shape, np.float32), None, slopes)
    attributes = {"format": "lightwell.grid.v1", "gpu_tiles_scale": scale, "gpu_bends_scale": bend_scale}
    name = f"gradients, {bands} bands, {'x'.join(map(str, resolution))} cells"
    return _fine(name, grid, attributes, rng) | {"tiles": _halves(tiles), "bends": _halves(packed)}


def adaptive_vectors(resolution: tuple[int, int, int]) -> dict[str, Any]:
    """An adaptive grid of bricks of several sizes."""
    rng = np.random.default_rng(7)
    spec = GridSpec((-1.0, 0.5, -0.25), (2.0, 1.5, 0.75), resolution)
    x, y, z = np.moveaxis(spec.centres(), -1, 0)
    base, slope = rng.normal(size=(2, 4, 3))
    values = base + slope * (np.exp(-30 * (x + 1) ** 2 - 9 * z**2) + 0.01 * y)[..., None, None]
    found = adapt(Grid(spec, values.astype(np.float32), np.ones(spec.shape, np.float32)), 0.05)
    grid = replace(found, coefficients=found.coefficients.astype(np.float16).astype(np.float32))
    atlas = make_atlas(grid)
    attributes = {
        "format": "lightwell.adaptive-grid.v1",
        "gpu_bricks_scale": atlas.scale,
        "gpu_slots": atlas.slots,
    }
    own = {
        "tiles": _halves(atlas.tiles),
        "pages": grid.pages.ravel().tolist(),
        "levels": grid.levels.tolist(),
    }
    return _fine(f"adaptive, {'x'.join(map(str, resolution))} cells", grid, attributes, rng) | own


def group_vectors() -> list[dict[str, Any]]:
    """Gains of light groups: known lamps that were dimmed, twins, one that is off, and light that is none of them."""
    rng = np.random.default_rng(9)
    spec = GridSpec((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), (1, 1, 1))
    lamps = rng.normal(size=(4, 25, 3)) + evaluate(np.eye(3)[[0, 1, 2, 0]] * [[1], [1], [1], [-1]], 5)[..., None]
    lamps = lamps.astype(np.float32).astype(np.float64)
    dimmed = np.array([[0.5, 0.4, 0.3], [2.0, 1.0, 0.0], [1.0, 1.0, 1.0], [0.0, 0.2, 3.0]])
    cases = {
        "as captured": (lamps, lamps.sum(axis=0)),
        "dimmed": (lamps, np.einsum("gc,gkc->kc", dimmed, lamps)),
        "nearly": (lamps[:3], np.einsum("gc,gkc->kc", dimmed[:3], lamps[:3]) + 0.02 * rng.normal(size=(25, 3))),
        "twins": (lamps[[0, 0, 1]], 2 * lamps[0] + 0.5 * lamps[1]),
        "negative": (lamps[:2], lamps[0] - 0.001 * lamps[1]),
        "unknown": (lamps[:2], lamps[0] + lamps[2]),
        "dark": (lamps[:2], np.zeros((25, 3))),
    }
    rows = []
    for name, (groups, live) in cases.items():
        grids = [
            Grid(spec, group[None, None, None].astype(np.float32), np.ones(spec.shape, np.float32)) for group in groups
        ]
        single = live.astype(np.float32).astype(np.float64)
        changed = modulate([FieldLight(grid) for grid in grids], single)
        rows.append(
            {
                "name": name,
                "groups": groups.reshape(len(groups), -1).tolist(),
                "live": single.ravel().tolist(),
                "gains": [np.asarray(field.gain).tolist() for field in changed.fields],
                "method": changed.method,
                "residual": changed.residual,
                "rest": changed.rest.ravel().tolist(),
            }
        )
    return rows


def shading_vectors() -> list[dict[str, Any]]:
    """Irradiance, and Phong lobe about the mirror direction, of normals and views that are given."""
    rng = np.random.default_rng(4)
    coefficients = rng.normal(size=(25, 3))
    normals, views = (rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in rng.normal(size=(2, 6, 3)))
    surface = Surface(np.zeros((6, 3)), normals, views, np.ones((6, 3)), None)
    rows = []
    for exponent in EXPONENTS[:4]:
        received = receive(DistantLight(coefficients), surface, Material(gloss=1.0, exponent=exponent))
        rows.append(
            {
                "exponent": exponent,
                "coefficients": coefficients.tolist(),
                "normals": normals.tolist(),
                "views": views.tolist(),
                "irradiance": received.irradiance.tolist(),
                "lobe": received.lobe.tolist(),
            }
        )
    return rows


SETS = {
    "one": [(0.2, -0.1, 0.4)],
    "two": [(-0.5, 0.0, 0.4), (0.5, 0.1, 0.5)],
    "three": [(-0.5, 0.0, 0.4), (0.5, 0.1, 0.5), (0.0, 0.7, 0.3)],
    "three on a line": [(-0.5, 0.0, 0.4), (0.5, 0.0, 0.4), (0.1, 0.0, 0.4)],
    "four in a plane": [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (0.0, 1.0, 0.0)],
    "five": [(0.0, 0.0, 0.0), (1.0, 0.1, 0.0), (0.1, 1.0, 0.0), (0.0, 0.1, 1.0), (0.9, 0.8, 0.7)],
    "corners of a cube": [(x, y, z) for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)],
}


def sample_vectors() -> list[dict[str, Any]]:
    """Light between and near samples with gradients, without, and where samples 0, 3, … have none.

    Far away the step is cut short.
    """
    rng = np.random.default_rng(11)
    rows = []
    for name, positions in SETS.items():
        coefficients = rng.normal(size=(len(positions), 4, 3)).astype(np.float32).astype(np.float64)
        coefficients[:, 0] = np.abs(coefficients[:, 0])
        gradients = 0.5 * rng.normal(size=(*coefficients.shape, 3)).astype(np.float32).astype(np.float64)
        middle = np.mean(positions, axis=0)
        points = [
            *(middle + 0.5 * rng.normal(size=(12, 3))),
            middle,
            np.array(positions[-1]),
            np.add(middle, (9, -9, 9)),
        ]
        whole = SampleSet(positions, coefficients, gradients).at(points)
        plain = SampleSet(positions, coefficients).at(points)
        every_third = [None if k % 3 == 0 else one for k, one in enumerate(gradients)]
        partly = SampleSet(positions, coefficients, every_third).at(points)
        rows.append(
            {
                "name": name,
                "positions": positions,
                "coefficients": coefficients.reshape(len(positions), -1).tolist(),
                "gradients": gradients.reshape(len(positions), -1).tolist(),
                "points": np.array(points).tolist(),
                "light": whole.reshape(len(points), -1).tolist(),
                "plain": plain.reshape(len(points), -1).tolist(),
                "partly": partly.reshape(len(points), -1).tolist(),
            }
        )
    return rows


def make() -> dict[str, Any]:
    """Return all vectors."""
    return {
        "grids": [
            grid_vectors(5, (3, 2, 4), 1.0),
            grid_vectors(6, (2, 3, 2), 1.0),
            grid_vectors(3, (4, 1, 2), 3e5),
            grid_vectors(4, (2, 2, 2), 1.0),
            grid_vectors(1, (1, 1, 1), 1.0),
        ],
        "bent": [bent_vectors(2, (3, 4, 2)), bent_vectors(3, (1, 3, 2))],
        "adaptive": [adaptive_vectors((18, 7, 11)), adaptive_vectors((9, 1, 5))],
        "groups": group_vectors(),
        "samples": sample_vectors(),
        "lobes": lobe_vectors(),
        "shading": shading_vectors(),
    }


if __name__ == "__main__":
    FILE.write_text(json.dumps(make(), separators=(",", ":")) + "\n", encoding="utf-8")
