"""Pictures: the same bytes however they are cut, layers, and scenes in which something is missing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from tests.support.igi_scenes import ROOM_CAMERA, lamp, matte, panel, panel_room, placed
from tests.support.shapes import quad

from lightwell.errors import RenderError
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.mesh import Mesh
from lightwell.geometry.shapes import box, plane
from lightwell.igi import (
    IgiMaterial,
    IgiObject,
    IgiRendering,
    IgiScene,
    PointLight,
    Sky,
    Texture,
    render_igi,
    sky_of_harmonics,
)
from lightwell.igi.rendering import cut
from lightwell.igi_settings import IgiFilter, IgiSettings
from lightwell.render import Camera
from lightwell.render.light import FieldLight, SummedLight

LAYERS = ("colour", "coverage", "normal", "depth", "albedo", "direct", "indirect", "set", "coefficients")
ALL = IgiSettings(
    vpls=128, layers=("normal", "depth", "albedo", "direct", "indirect", "set", "coefficients"), bounces=3
)
ABOVE = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))


def assert_same(one: IgiRendering, other: IgiRendering) -> None:
    for name in LAYERS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


@pytest.mark.parametrize("chosen", ["sh", "irradiance", "irradiance-strict", "none"])
def test_tiles_and_threads_do_not_show(chosen: IgiFilter) -> None:
    settings = ALL.model_copy(update={"filter": chosen, "sets": (3, 2)})
    whole = render_igi(panel_room(), ROOM_CAMERA, (50, 37), settings, tile=64, threads=1)
    parts = render_igi(panel_room(), ROOM_CAMERA, (50, 37), settings, tile=13, threads=2)
    assert_same(whole, parts)
    assert whole.colour.mean() > 0.1
    other = render_igi(panel_room(), ROOM_CAMERA, (50, 37), settings.model_copy(update={"seed": 1}))
    assert not np.array_equal(whole.colour, other.colour)


def test_layers() -> None:
    seen: list[tuple[int, int]] = []
    picture = render_igi(
        panel_room(), ROOM_CAMERA, (40, 30), ALL, progress=lambda done, total: seen.append((done, total)), tile=20
    )
    assert seen == [(k, 4) for k in range(1, 5)]
    assert picture.direct is not None
    assert picture.indirect is not None
    assert picture.normal is not None
    assert picture.coefficients is not None
    np.testing.assert_allclose(picture.direct + picture.indirect, picture.colour, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(picture.normal, axis=-1), 1, atol=1e-5)
    assert picture.coefficients.shape == (30, 40, 9, 3)
    assert (picture.coefficients[..., 0, :] > 0).mean() > 0.99
    assert picture.coefficients[..., 0, :].min() >= 0
    assert picture.set is not None
    assert picture.set[:4, :4].ravel().tolist() == list(range(16))
    assert picture.depth is not None
    assert 0.5 < picture.depth.min() < picture.depth.max() < 6
    assert 0 < picture.clamp_bias < 0.1
    few = render_igi(panel_room(), ROOM_CAMERA, (40, 30), ALL.model_copy(update={"layers": ()}))
    assert (few.direct, few.normal, few.coefficients) == (None, None, None)
    np.testing.assert_allclose(few.colour, picture.colour, rtol=2e-5)


def test_without_any_light_the_picture_is_black() -> None:
    for scene in (
        IgiScene((IgiObject(plane(1), matte(1, 1, 1)),)),
        IgiScene((IgiObject(plane(1), matte(1, 1, 1)),), sky=Sky(np.zeros((4, 8, 3), np.float32))),
        IgiScene(()),
    ):
        picture = render_igi(scene, ABOVE, (8, 8), IgiSettings())
        assert not picture.colour.any()
        assert picture.clamp_bias == 0


def test_without_objects_there_is_the_sky() -> None:
    sky = Sky(np.random.default_rng(0).random((8, 16, 3)).astype(np.float32))
    camera = Camera((0, 0, 0), (1, 0, 0.2))
    picture = render_igi(IgiScene((), sky=sky), camera, (6, 4), IgiSettings())
    expected = sky.radiance(camera.directions((6, 4)).reshape(-1, 3)).reshape(4, 6, 3)
    np.testing.assert_allclose(picture.colour, expected, rtol=1e-4)
    assert not picture.coverage.any()


def test_a_camera_inside_a_wall_is_told() -> None:
    scene = IgiScene((IgiObject(placed(box(), 1, [0, 0, 0], "wall"), matte(1, 1, 1)),))
    with pytest.raises(RenderError, match=r"inside object 'wall', at \(0.2, 0, 0\): move it out"):
        render_igi(scene, Camera((0.2, 0, 0), (1, 0, 0)), (8, 8), IgiSettings())


def test_backs_are_not_seen_unless_they_are_two_sided() -> None:
    floor = IgiObject(placed(plane(1), 3, [0, 0, -1], "floor"), matte(1, 1, 1))
    lamps = (PointLight((0.0, 0.0, 2.5), (10.0, 10.0, 10.0)), PointLight((0.0, 0.0, -0.5), (1.0, 1.0, 1.0)))
    for two_sided in (False, True):
        sheet = placed(make_down(), 1, [0, 0, 0], "sheet")
        material = IgiMaterial(base=(0.5, 0.5, 0.5), specular=0, two_sided=two_sided)
        picture = render_igi(IgiScene((floor, IgiObject(sheet, material)), lamps), ABOVE, (9, 9), IgiSettings())
        assert picture.depth is not None
        assert picture.depth[4, 4] == pytest.approx(3 if two_sided else 4, abs=1e-4)
        assert picture.colour[4, 4, 0] > 0.1


def make_down() -> Mesh:
    return quad([[-1, -1, 0], [-1, 1, 0], [1, 1, 0], [1, -1, 0]])


def test_emissive_surfaces_show_their_radiance() -> None:
    lit = IgiObject(placed(plane(1), 1, [0, 0, 0]), lamp(3, 2, 1))
    picture = render_igi(IgiScene((lit,)), ABOVE, (8, 8), IgiSettings())
    np.testing.assert_allclose(picture.colour[4, 4], [3, 2, 1], rtol=1e-6)


def test_even_light_of_a_grid_is_that_of_an_even_sky() -> None:
    """A grid that says 1 everywhere: a surface amid it gets radiance 1 from its whole upper side."""
    coefficients = np.zeros((3, 3, 3, 9, 3), np.float32)
    coefficients[..., 0, :] = np.sqrt(4 * np.pi)
    spec = GridSpec((-1, -1, -1), (1, 1, 1), (3, 3, 3))
    field = FieldLight(Grid(spec, coefficients, np.ones((3, 3, 3), np.float32)))
    ground = IgiObject(placed(plane(1), 0.4, [0, 0, 0]), matte(0.8, 0.8, 0.8))
    settings = IgiSettings(vpls=4096, bounces=0, clamp=0)
    picture = render_igi(IgiScene((ground,), field=field), Camera((0, 0, 1.5), (0, 0, 0)), (16, 16), settings)
    np.testing.assert_allclose(picture.colour[picture.coverage == 1], 0.8, rtol=0.02)
    # Light groups add up, each with a gain of its own.
    groups = SummedLight(tuple(replace(field, gain=np.array(gain)) for gain in ([0.25, 0.5, 1.0], [0.75, 0.5, 0.0])))
    both = render_igi(IgiScene((ground,), field=groups), Camera((0, 0, 1.5), (0, 0, 0)), (16, 16), settings)
    np.testing.assert_allclose(both.colour, picture.colour, rtol=1e-4)


def test_a_sky_of_coefficients() -> None:
    coefficients = np.zeros((9, 3))
    coefficients[0], coefficients[2] = 2.0, 0.5
    ground = IgiObject(placed(plane(1), 1, [0, 0, 0]), matte(0.8, 0.8, 0.8))
    scene = IgiScene((ground,), sky=sky_of_harmonics(coefficients))
    picture = render_igi(scene, ABOVE, (8, 8), IgiSettings(vpls=4096))
    irradiance = np.pi * 2.0 * 0.28209479 + 2 * np.pi / 3 * 0.5 * 0.48860251
    np.testing.assert_allclose(picture.colour[4, 4], 0.8 * irradiance / np.pi, rtol=0.02)


def test_bounces_of_a_bowl_of_light() -> None:
    """A closed white box with one emitting side: the series of reflections adds up (the furnace of a closed room)."""
    albedo, radiance = 0.5, 1.0
    inside = placed(box(), 1, [0, 0, 0], "box", inwards=True)
    glowing = IgiMaterial(base=(albedo,) * 3, specular=0, emission=(radiance,) * 3)
    scene = IgiScene((IgiObject(inside, glowing),))
    settings = IgiSettings(vpls=8192, bounces=16, clamp=0.3)
    picture = render_igi(scene, Camera((0.1, 0.2, 0.0), (1, 0, 0), fov_degrees=40), (24, 24), settings)
    assert picture.colour.mean() == pytest.approx(radiance / (1 - albedo), rel=0.02)
    once = render_igi(
        scene, Camera((0.1, 0.2, 0.0), (1, 0, 0), fov_degrees=40), (24, 24), settings.model_copy(update={"bounces": 0})
    )
    assert once.colour.mean() == pytest.approx(radiance * (1 + albedo), rel=0.02)


@pytest.mark.parametrize("pattern", [(4, 4), (8, 8)])
def test_on_bumps_incident_radiance_is_what_to_filter(pattern: tuple[int, int]) -> None:
    """Paper 004's claim (issue 6, Done-when 3); `docs/examples/igi.py` shows it at length."""
    wave = 2 * np.pi * np.arange(128) / 128
    heights = np.sin(7 * wave[:, None] + 3 * wave) + np.sin(5 * wave - 8 * wave[:, None])
    bumpy = IgiMaterial(
        base=(0.6, 0.6, 0.6), bump_texture=Texture(heights[..., None].astype(np.float32)), bump_metres=0.05
    )
    flat = placed(plane(1), 2, [0, 0, 0])
    ground = IgiObject(flat, bumpy, ((flat.positions[:, :2] / 2).astype(np.float32),))
    panels = [
        IgiObject(panel((0.8, 0.8), [x, 0.5, 1.5], f"panel {x}"), lamp(red, 6, 12 - red))
        for x, red in ((-1.5, 12), (1.5, 2))
    ]
    blocker = IgiObject(placed(box(), 0.2, [0.3, 0.4, 0.2]), matte(0.5, 0.5, 0.5))
    scene, camera = IgiScene((ground, blocker, *panels)), Camera((0, -3, 1.6), (0, 0.2, 0.1), fov_degrees=24)
    plain = IgiSettings(sets=(1, 1), filter="none", vpls=512, bounces=0)
    truth = render_igi(scene, camera, (96, 64), plain).colour
    errors = {}
    for name in ("sh", "irradiance", "irradiance-strict", "none"):
        settings = plain.model_copy(update={"sets": pattern, "filter": name})
        difference = render_igi(scene, camera, (96, 64), settings).colour - truth
        errors[name] = float(np.sqrt((difference**2).mean()) / truth.mean())
    assert errors["sh"] < errors["irradiance"] / 3
    assert errors["sh"] < 1.2 * min(errors["irradiance-strict"], errors["none"])


def test_work_can_be_stopped() -> None:
    class StopError(Exception):
        pass

    def check() -> None:
        raise StopError

    with pytest.raises(StopError):
        render_igi(panel_room(), ROOM_CAMERA, (32, 32), ALL, check=check)


@pytest.mark.parametrize(
    ("size", "tile", "words"), [((0, 4), 8, "0×4"), ((8192, 8193), 8, "at most"), ((4, 4), 0, "tile")]
)
def test_sizes_are_checked(size: tuple[int, int], tile: int, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        render_igi(IgiScene(()), ABOVE, size, IgiSettings(), tile=tile)


def test_tiles_cover_a_picture_once() -> None:
    count = np.zeros((23, 40), int)
    for tile in cut((40, 23), 9):
        count[tile.top : tile.bottom, tile.left : tile.right] += 1
    assert (count == 1).all()


def test_lamps_are_panels_too() -> None:
    """A small panel is nearly a point light of ``L A`` W/sr straight ahead."""
    ground = IgiObject(placed(plane(1), 0.5, [0, 0, 0]), matte(0.7, 0.7, 0.7))
    emissive = IgiScene((ground, IgiObject(panel((0.1, 0.1), [0, 0, 4.0]), lamp(100, 100, 100))))
    point = IgiScene((ground,), (PointLight((0, 0, 4.0), (1.0, 1.0, 1.0)),))
    spot = IgiScene((ground,), (PointLight((0, 0, 4.0), (1.0, 1.0, 1.0), (0, 0, -2), 0.4, 0.5),))
    camera = Camera((0.0, -1.0, 1.5), (0, 0, 0))
    one, *others = (
        render_igi(s, camera, (16, 16), IgiSettings(vpls=256)).colour[8, 4:12] for s in (emissive, point, spot)
    )
    for other in others:
        np.testing.assert_allclose(one, other, rtol=5e-3)
