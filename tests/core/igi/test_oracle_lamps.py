"""Lamps against closed forms; scenes of any size; lamps of very unlike power; values that cannot be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.igi_scenes import lamp, matte, panel, placed

from lightwell.geometry.mesh import make_mesh
from lightwell.geometry.shapes import box, plane, sphere
from lightwell.igi import DirectionalLight, IgiMaterial, IgiObject, IgiScene, PointLight, Sky, Texture, render_igi
from lightwell.igi.surfaces import Surfaces
from lightwell.igi.virtual import make_virtual_lights
from lightwell.igi_settings import IgiSettings
from lightwell.render import Camera

SIZE = (16, 12)
CAMERA = Camera((0, 0, 3), (0, 0, 0), fov_degrees=60)
PLAIN = IgiSettings(sets=(1, 1), filter="none", bounces=0)
INNER, OUTER = np.radians(20), np.radians(35)


def ground(half: float = 3.0) -> IgiObject:
    return IgiObject(placed(plane(1), half, (0, 0, 0), "ground"), matte(0.5, 0.5, 0.5))


def places() -> NDArray[np.float64]:
    """Where the pixels of `CAMERA` see the ground, ``(H, W, 3)``."""
    directions = CAMERA.directions(SIZE).reshape(SIZE[1], SIZE[0], 3)
    return np.asarray(CAMERA.position - 3 / directions[..., 2:] * directions)


@pytest.mark.parametrize("height", [1.5, 0.05])
def test_a_point_light(height: float) -> None:
    """``E = I cosα / r²``."""
    scene = IgiScene((ground(),), lamps=(PointLight((0.2, -0.1, height), (4.0, 3.0, 2.0)),))
    distance = np.linalg.norm(np.array([0.2, -0.1, height]) - places(), axis=-1)
    expected = 0.5 / np.pi * height / distance[..., None] ** 3 * [4.0, 3.0, 2.0]
    np.testing.assert_allclose(render_igi(scene, CAMERA, SIZE, PLAIN).colour, expected, rtol=5e-4)


def test_a_spot() -> None:
    """glTF's: full inside, nothing outside, the square of a ramp in the cosine between."""
    axis = np.array([0.3, 0, -1])
    spot = PointLight((0.2, -0.1, 1.5), (4.0, 3.0, 2.0), (0.3, 0, -1), INNER, OUTER)
    away = places() - spot.position
    distance = np.linalg.norm(away, axis=-1)
    cosine = away @ axis / np.linalg.norm(axis) / distance
    strength = np.clip((cosine - np.cos(OUTER)) / (np.cos(INNER) - np.cos(OUTER)), 0, 1) ** 2
    expected = 0.5 / np.pi * 4 * strength * 1.5 / distance**3
    got = render_igi(IgiScene((ground(),), lamps=(spot,)), CAMERA, SIZE, PLAIN).colour[..., 0]
    assert (expected == 0).any()
    np.testing.assert_allclose(got, expected, atol=5e-5 * expected.max())


def test_parallel_light() -> None:
    scene = IgiScene((ground(),), lamps=(DirectionalLight((1, 1, 2), (3.0, 2.0, 1.0)),))
    expected = 0.5 / np.pi * 2 / np.sqrt(6) * np.array([3.0, 2.0, 1.0])
    got = render_igi(scene, CAMERA, SIZE, PLAIN).colour
    np.testing.assert_allclose(got, np.broadcast_to(expected, got.shape), rtol=1e-6)


def test_a_ball_of_triangles_some_of_which_have_no_area() -> None:
    """``E = π L R²/h²`` below a ball of the radius R."""
    ball = sphere(64, 128)
    positions = np.concatenate([ball.positions * 0.3 + [0, 0, 1], [[0, 0, 1]]])
    triangles = np.concatenate([ball.triangles, [[0, 0, 0], [0, 1, 1]]])
    normals = np.concatenate([ball.normals, [[0, 0, 1]]])
    scene = IgiScene((ground(), IgiObject(make_mesh("ball", positions, triangles, normals), lamp(2, 2, 2))))
    settings = PLAIN.model_copy(update={"vpls": 4096})
    below = render_igi(scene, Camera((0, -1, 0.15), (0, 0, 0), fov_degrees=0.2), (4, 4), settings).colour
    np.testing.assert_allclose(below, 0.5 * 2 * 0.09, rtol=4e-3)


@pytest.mark.parametrize("spot", [False, True])
def test_flux_of_a_point_light_in_a_closed_room(spot: bool) -> None:
    """All that a lamp sends out arrives: ``4π I``, or the integral over its cone."""
    room = IgiObject(placed(box(), 1, [0, 0, 0], "room", inwards=True), matte(0.5, 0.5, 0.5))
    cone = {"direction": (1, 0, 0), "inner_angle": INNER, "outer_angle": OUTER} if spot else {}
    scene = IgiScene((room,), lamps=(PointLight((0.2, 0.1, 0.3), (4.0, 3.0, 2.0), **cone),))
    made = make_virtual_lights(scene, Surfaces(scene), IgiSettings(sets=(1, 1), vpls=4096, bounces=1)).lights
    flux = made.flux[~made.direct, 0].sum()
    cosine = np.linspace(np.cos(OUTER), 1, 2001)
    ramp = np.clip((cosine - np.cos(OUTER)) / (np.cos(INNER) - np.cos(OUTER)), 0, 1) ** 2
    expected = 4 * 2 * np.pi * (np.trapezoid(ramp, cosine) if spot else 2)
    assert flux == pytest.approx(0.5 * expected, rel=1e-3)


@pytest.mark.parametrize("albedo", [1.0, 0.0])
def test_a_room_that_absorbs_nothing_and_one_that_absorbs_all(albedo: float) -> None:
    """Radiance 1 from every wall: ``Σ ρ^k`` up to the last bounce."""
    glowing = IgiMaterial(base=(albedo,) * 3, specular=0, emission=(1.0, 1.0, 1.0))
    scene = IgiScene((IgiObject(placed(box(), 1, [0, 0, 0], "room", inwards=True), glowing),))
    settings = PLAIN.model_copy(update={"vpls": 4096, "bounces": 3, "clamp": 0.0})
    picture = render_igi(scene, Camera((0.1, 0.2, 0), (1, 0, 0), fov_degrees=60), (16, 16), settings)
    assert picture.colour.mean() == pytest.approx(sum(albedo**k for k in range(5)), rel=0.02)


def test_a_screen_that_is_dark_but_for_a_spot() -> None:
    """A lamp's picture counts wherever it is bright; what is dark takes no lights."""
    pixels = np.zeros((32, 32, 3), np.float32)
    pixels[20:22, 9:11] = 100
    flat = panel((1, 1), [0, 0, 2], "screen")
    uv = (flat.positions[:, :2] + 0.5).astype(np.float32)
    material = IgiMaterial(base=(0, 0, 0), specular=0, emission=(2, 2, 2), emission_texture=Texture(pixels))
    scene = IgiScene((ground(), IgiObject(flat, material, (uv,))))
    made = make_virtual_lights(scene, Surfaces(scene), PLAIN.model_copy(update={"vpls": 1 << 15})).lights
    assert made.flux.min() > 0
    assert made.flux[:, 0].sum() == pytest.approx(np.pi * 2 * 100 * 4 / 32**2, rel=0.05)


def test_lamps_of_very_unlike_power() -> None:
    """A large weak panel beside a small one of a million times its radiance: neither is lost."""
    weak = IgiObject(panel((1, 1), [-1, 0, 2], "weak"), lamp(1, 1, 1))
    tiny = IgiObject(panel((0.01, 0.01), [1, 0, 1.9], "tiny"), lamp(1e6, 1e6, 1e6))
    below = Camera((0, 0, 1.7), (0, 0, 0), fov_degrees=80)
    dense = PLAIN.model_copy(update={"vpls": 4096})
    apart = [render_igi(IgiScene((ground(), one)), below, SIZE, dense).colour for one in (weak, tiny)]
    together = render_igi(IgiScene((ground(), weak, tiny)), below, SIZE, dense).colour
    np.testing.assert_allclose(together, apart[0] + apart[1], rtol=2e-3)


def block_in_the_sun(half: float, scale: float) -> NDArray[np.float32]:
    """A block of 0.6 on a wide ground, both scaled."""
    block = IgiObject(placed(box(), 0.3 * scale, [0, 0, 0.3 * scale], "block"), matte(0.5, 0.5, 0.5))
    scene = IgiScene((ground(half * scale), block), lamps=(DirectionalLight((0.5, 0, 1), (1.0, 1.0, 1.0)),))
    camera = Camera((0, -2 * scale, 2.2 * scale), (0, 0, 0.2 * scale))
    return render_igi(scene, camera, (48, 36), PLAIN).colour


def test_size_does_not_matter() -> None:
    """Millimetres, kilometres, and a small thing on a wide ground, whose shadow stays at its foot."""
    expected = block_in_the_sun(5, 1)
    assert (expected.max(axis=2) == 0).sum() > 20
    for half, scale in ((5, 1e-3), (5, 1e3), (100, 1), (1000, 1)):
        different = np.abs(block_in_the_sun(half, scale) - expected).max(axis=2) > 1e-4
        assert different.mean() < 0.003, (half, scale)


def test_light_that_cannot_be() -> None:
    for value in (np.nan, np.inf, -1.0, 1e39):
        with pytest.raises(ValueError, match=r"must be finite and not negative, at most 1e\+30"):
            IgiMaterial(emission=(1.0, value, 1.0))
        with pytest.raises(ValueError, match=r"which must be finite and not negative, at most 1e\+30"):
            PointLight((0, 0, 0), (1.0, value, 1.0))
    for single in (np.nan, np.inf, -1.0, 1e31):
        with pytest.raises(ValueError, match=r"the sky must be finite and not negative, at most 1e\+30: repair"):
            Sky(np.full((2, 4, 3), single, np.float32))
