"""Several rays a pixel: edges and bumps by all of them, incident radiance by the pixel's centre."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as examples
from hypothesis import strategies as st
from tests.support import reference_igi
from tests.support.igi_scenes import ROOM_CAMERA, lamp, matte, panel, panel_room, pixels, placed
from tests.support.shapes import quad

from lightwell.geometry.shapes import box, plane
from lightwell.igi import IgiMaterial, IgiObject, IgiScene, Sky, Texture, render_igi
from lightwell.igi.filter import Reach
from lightwell.igi.gbuffer import GBuffer
from lightwell.igi.subpixels import ELSEWHERE, UNSEEN, neighbours_means, own_pixels, pixel_means, strips
from lightwell.igi_settings import IgiSettings
from lightwell.render import Camera

GREY = Sky(np.full((8, 16, 3), 0.25, np.float32))
ABOVE = Camera((0.0, 0.0, 3.0), (0.0, 0.0, 0.0))


def seen_at_random(random: np.random.Generator, shape: tuple[int, int]) -> GBuffer:
    """Normals about as far apart, and places about as far off the plane, as the tests of a surface ask for."""
    normals = random.normal([0, 0, 1], 0.3, (*shape, 3))
    normals = (normals / np.linalg.norm(normals, axis=-1, keepdims=True)).astype(np.float32)
    return pixels(
        random.random(shape) > 0.25,
        random.normal(0, 0.02, (*shape, 3)).astype(np.float32),
        normals,
        normals,
        random.uniform(0.5, 3, shape).astype(np.float32),
    )


@given(seed=st.integers(0, 2**32 - 1), samples=st.integers(1, 3), side=st.integers(1, 3))
@examples(max_examples=25, deadline=None)
def test_what_rays_take_is_that_of_the_reference(seed: int, samples: int, side: int) -> None:
    random = np.random.default_rng(seed)
    reach = Reach(side // 2, side - 1 - side // 2, side - 1 - side // 2, side // 2)
    height, width = 4, 5
    wide = seen_at_random(random, (height + reach.up + reach.down, width + reach.left + reach.right))
    inner = wide.part(reach.within(wide.seen.shape))
    before = random.normal(size=(*wide.seen.shape, 4))
    after = random.normal(size=(height, width, 4))
    fine = seen_at_random(random, (height * samples, width * samples))
    expected = reference_igi.incident_of_rays(fine, wide, before, after, samples, reach)
    for first, last in ((0, 3), (3, height)):
        part = fine.part(np.s_[first * samples : last * samples, :])
        own = own_pixels(part, inner.part(np.s_[first:last, :]), samples)
        elsewhere = np.flatnonzero(own == ELSEWHERE)
        means, found = neighbours_means(before, wide, part, elsewhere, samples, reach, first)
        wanted = expected[first * samples * width * samples : last * samples * width * samples]
        place = {int(ray): k for k, ray in enumerate(elsewhere)}
        for ray, value in enumerate(wanted):
            if value is None:
                assert not found[place[ray]]
            elif ray in place:
                assert found[place[ray]]
                np.testing.assert_allclose(means[place[ray]], value, atol=1e-13)
            else:
                got = np.zeros(4) if own[ray] == UNSEEN else after[first:last].reshape(-1, 4)[own[ray]]
                np.testing.assert_array_equal(got, value)


def test_means_and_strips() -> None:
    random = np.random.default_rng(1)
    values = random.random((6, 9, 3)).astype(np.float32)
    expected = values.reshape(2, 3, 3, 3, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(pixel_means(values, 3), expected, rtol=1e-6)
    parts = strips(700, 128, 16)
    assert parts[0] == (0, 2)
    assert [a for a, _ in parts[1:]] == [b for _, b in parts[:-1]]
    assert parts[-1][1] == 700


def test_an_edge_covers_its_share_of_each_pixel() -> None:
    """A square of 1 × 1 m seen from above: it ends in the middle of pixels."""
    scene = IgiScene((IgiObject(placed(plane(1), 0.5, (0, 0, 0)), matte(0.8, 0.8, 0.8)),), sky=GREY)
    picture = render_igi(scene, ABOVE, (15, 15), IgiSettings(vpls=256, sets=(2, 2), bounces=0), samples=4)
    across = picture.coverage[7]
    half = 0.5 / (2 * 3 * np.tan(np.radians(18)) / 15)
    inside = np.clip(half + 7.5 - np.arange(15), 0, 1) * np.clip(half - 7.5 + np.arange(1, 16), 0, 1)
    np.testing.assert_allclose(across, inside, atol=0.13)
    assert 0 < across[across < 1].max() < 1
    # Behind is what the square leaves of the sky, and what it covers is its own radiance.
    np.testing.assert_allclose(picture.behind[7, :, 0], 0.25 * (1 - across), atol=1e-6)
    lit = picture.lit[7, :, 0][across > 0] / across[across > 0]
    np.testing.assert_allclose(lit, 0.8 * 0.25, rtol=0.1)
    np.testing.assert_allclose(picture.colour, picture.lit + picture.behind)
    assert picture.depth is not None
    assert np.isfinite(picture.depth).sum() == (picture.depth[7] < 9).sum() ** 2


def test_bumps_are_seen_by_every_ray() -> None:
    """One set: what rays take is what they would gather, so that a finer picture, shrunk, is the same."""
    waves = np.sin(np.linspace(0, 40 * np.pi, 512, endpoint=False))
    bumps = Texture((waves[:, None] * waves)[..., None].astype(np.float32))
    ground = IgiObject(
        plane(1),
        IgiMaterial(base=(0.6, 0.5, 0.4), roughness=0.5, bump_texture=bumps, bump_metres=0.02),
        ((plane(1).positions[:, :2] / 2 + 0.5).astype(np.float32),),
    )
    scene = IgiScene((ground, IgiObject(panel((0.4, 0.4), (0.3, 0, 2)), lamp(9, 9, 9))))
    settings = IgiSettings(sets=(1, 1), vpls=32, bounces=0)
    camera = Camera((0.0, -1.5, 1.2), (0.0, 0.0, 0.0), fov_degrees=25)
    fine = render_igi(scene, camera, (120, 90), settings).colour.reshape(30, 3, 40, 3, 3).mean(axis=(1, 3))
    mine = render_igi(scene, camera, (40, 30), settings, samples=3).colour
    alone = render_igi(scene, camera, (40, 30), settings).colour
    np.testing.assert_allclose(mine, fine, atol=0.02 * fine.mean())
    assert np.abs(alone - fine).max() > 0.2 * fine.mean()


@pytest.mark.parametrize("passes", [1, 2])
def test_tiles_and_threads_do_not_show(passes: int) -> None:
    """With poles thinner than pixels, which no pixel's centre may be on, and a card with holes, colours and bumps."""
    poles = [
        IgiObject(placed(box(), [0.004, 0.004, 1], [x, 0.3, 1], f"pole {x}"), matte(0.9, 0.9, 0.9))
        for x in (-0.9, -0.35, 0.2, 0.55)
    ]
    random, flat = np.random.default_rng(2), plane(1)
    blotched = IgiMaterial(
        base=(1, 1, 1),
        base_texture=Texture(random.integers(0, 256, (37, 65, 3), np.uint8), encoding="srgb"),
        bump_texture=Texture(random.random((33, 64, 1), np.float32)),
        bump_metres=0.01,
        alpha_texture=Texture(random.choice(np.array([0, 255], np.uint8), (16, 16, 1))),
        hole_below=0.5,
        two_sided=True,
    )
    uv = (flat.positions[:, :2] * 1.5).astype(np.float32)
    card = IgiObject(placed(flat, 0.6, (0.3, -0.2, 0.7), "card"), blotched, (uv,))
    scene = IgiScene((*panel_room().objects, *poles, card), sky=GREY)
    settings = IgiSettings(
        vpls=128, sets=(3, 2), passes=passes, layers=("normal", "depth", "albedo", "direct", "indirect", "set")
    )
    whole = render_igi(scene, ROOM_CAMERA, (50, 37), settings, tile=64, threads=1, samples=3)
    parts = render_igi(scene, ROOM_CAMERA, (50, 37), settings, tile=13, threads=2, samples=3)
    for name in ("lit", "behind", "coverage", "normal", "depth", "albedo", "direct", "indirect", "set"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(parts, name), err_msg=name)
    assert whole.rays > render_igi(scene, ROOM_CAMERA, (50, 37), settings, tile=64, samples=1).rays


def test_what_no_centre_is_on_gathers_its_own_light() -> None:
    """A wire under an even sky, between the centres of pixels, is as bright as a surface under it."""
    wire = quad([[-3, 0.02, 0], [3, 0.02, 0], [3, 0.03, 0], [-3, 0.03, 0]], "wire")
    scene = IgiScene((IgiObject(wire, matte(0.8, 0.8, 0.8)),), sky=GREY)
    settings = IgiSettings(vpls=1024, sets=(2, 2))
    assert not render_igi(scene, ABOVE, (12, 12), settings).coverage.any()
    picture = render_igi(scene, ABOVE, (12, 12), settings, samples=16)
    covered = picture.coverage > 0
    assert 0 < covered.mean() < 0.2
    np.testing.assert_allclose(picture.lit[covered][:, 0] / picture.coverage[covered], 0.2, rtol=0.1)


@pytest.mark.parametrize("samples", [0, 17])
def test_samples_out_of_range(samples: int) -> None:
    with pytest.raises(ValueError, match=f"samples = {samples} must lie between 1 and 16"):
        render_igi(IgiScene(()), ABOVE, (4, 4), IgiSettings(), samples=samples)
    with pytest.raises(ValueError, match="samples = 2 needs filter = 'sh': with 'none' a pixel is one ray"):
        render_igi(IgiScene(()), ABOVE, (4, 4), IgiSettings(filter="none"), samples=2)
