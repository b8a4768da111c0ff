"""Gathering against its slow reference."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.igi_scenes import placed
from tests.support.reference_igi import gathered

from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import box
from lightwell.igi import gather as module
from lightwell.igi.gather import Gatherer
from lightwell.igi.lights import CAPTURED, DIRECTIONAL, NONE, POINT, SURFACE, LightSets, arrange, join, make_lights
from lightwell.render.light import FieldLight


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def some_sets(pattern: tuple[int, int], seed: int, each: int = 40) -> LightSets:
    """Lights of every kind round the unit cube; the common ones are whole in every set."""
    random = np.random.default_rng(seed)

    def places(count: int) -> np.ndarray:
        return random.uniform(-3, 3, (count, 3))

    def axes(count: int) -> np.ndarray:
        return unit(random.normal(size=(count, 3)))

    direct = [
        make_lights(SURFACE, places(each), axes(each), random.random((each, 3)), least=9 * random.random(each)),
        make_lights(DIRECTIONAL, places(each), axes(each), random.random((each, 3))),
        make_lights(CAPTURED, places(each), axes(each), random.random((each, 3))),
    ]
    bounced = make_lights(SURFACE, places(each), axes(each), random.random((each, 3)), direct=False)
    common = join(
        [
            make_lights(POINT, places(1), axes(1), random.random((1, 3))),
            make_lights(POINT, places(2), axes(2), random.random((2, 3)), falloff=(2.0, -0.5)),
        ]
    )
    return arrange([*direct, bounced], common, pattern, seed)


def some_field() -> FieldLight:
    spec = GridSpec((-1, -1, 1), (1, 1, 3), (3, 4, 2))
    values = np.random.default_rng(9).normal(size=(*spec.shape, 4, 3)).astype(np.float32)
    return FieldLight(Grid(spec, values, np.ones(spec.shape, np.float32)))


def some_pixels(shape: tuple[int, int], seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    places = random.uniform([-1, -1, 1], [1, 1, 3], (*shape, 3))
    return places, unit(random.normal(size=(*shape, 3))), random.random(shape) > 0.2


@pytest.mark.parametrize(("pattern", "bands", "seed"), [((1, 1), 2, 0), ((3, 2), 3, 1), ((2, 4), 5, 2)])
def test_pixels_get_what_the_reference_says(pattern: tuple[int, int], bands: int, seed: int) -> None:
    rays = RayScene([placed(box(), 0.7, [0, 0, 0])])
    sets = some_sets(pattern, seed)
    places, normals, seen = some_pixels((5, 7), seed)
    field = some_field()
    got = Gatherer(rays, sets, bands, np.float64, field).gather(places, normals, seen, corner=(-1, -2))
    single = Gatherer(rays, sets, bands, field=field).gather(places, normals, seen, corner=(-1, -2), groups=1)
    lost = 0.0
    for (i, j), here in np.ndenumerate(seen):
        which = (j - 1) % pattern[0] + pattern[0] * ((i - 2) % pattern[1])
        expected, gone = gathered(rays, sets, bands, places[i, j], normals[i, j], which, field)
        if not here:
            expected, gone = np.zeros_like(expected), 0.0
        lost += gone
        size = np.abs(expected).max() + 1
        np.testing.assert_allclose(got.coefficients[i, j], expected, atol=1e-13 * size)
        np.testing.assert_allclose(single.coefficients[i, j, 0], expected.sum(axis=0), atol=1e-5 * size)
    assert got.clamped == pytest.approx(lost, rel=1e-12)
    assert got.clamped > 0 or seed == 1
    assert got.arrived == pytest.approx(got.coefficients[..., 0, :].sum() * np.sqrt(4 * np.pi))


def test_blocks_and_batches_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    rays = RayScene([placed(box(), 0.7, [0, 0, 0])])
    sets = some_sets((2, 2), 3)
    places, normals, seen = some_pixels((23, 37), 3)
    whole = Gatherer(rays, sets, 3, field=some_field()).gather(places, normals, seen)
    part = Gatherer(rays, sets, 3, field=some_field()).gather(
        places[4:18, 5:], normals[4:18, 5:], seen[4:18, 5:], corner=(5, 4)
    )
    np.testing.assert_array_equal(part.coefficients, whole.coefficients[4:18, 5:])
    monkeypatch.setattr(module, "BLOCK_SIDE", 3)
    monkeypatch.setattr(module, "LIGHTS_AT_ONCE", 7)
    again = Gatherer(rays, sets, 3, field=some_field()).gather(places, normals, seen)
    np.testing.assert_array_equal(again.coefficients, whole.coefficients)
    assert again.rays == whole.rays


def test_sets_share_everything_out() -> None:
    sets = some_sets((3, 2), 4, each=50)
    assert sets.starts[-1] == 6 * 3 + 4 * 50
    sampled = sets.lights.kind != POINT
    np.testing.assert_allclose(np.sort(sets.lights.flux[sampled].sum(axis=1))[0], 6 * _smallest(4), rtol=1e-12)
    for which in range(6):
        own = slice(sets.starts[which], sets.starts[which + 1])
        kinds = sets.lights.kind[own]
        assert np.count_nonzero(kinds == POINT) == 3
        assert all(np.count_nonzero(kinds == kind) in (8, 9, 16, 17, 18) for kind in (SURFACE, DIRECTIONAL, CAPTURED))
        direct = sets.lights.direct[own]
        assert direct[: sets.bounced[which] - sets.starts[which]].all()
        assert not direct[sets.bounced[which] - sets.starts[which] :].any()


def _smallest(seed: int) -> float:
    one = some_sets((1, 1), seed, each=50)
    return float(np.sort(one.lights.flux[one.lights.kind != POINT].sum(axis=1))[0])


def test_without_lights_it_is_dark() -> None:
    places, normals, seen = some_pixels((3, 4), 5)
    got = Gatherer(RayScene([]), arrange([], NONE, (4, 4), 0), 3).gather(places, normals, seen)
    assert not got.coefficients.any()
    assert (got.arrived, got.clamped, got.rays) == (0, 0, 0)
