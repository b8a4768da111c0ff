"""Surfaces with holes: what rays meet, against every triangle tried in turn, and the light that comes through."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from tests.support.igi_scenes import matte, panel, placed
from tests.support.reference_igi import first_solid

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import plane
from lightwell.igi import IgiMaterial, IgiObject, IgiScene, PointLight, Sky, Texture, render_igi
from lightwell.igi.coverage import ABSENT, CUT, WHOLE
from lightwell.igi.holes import MOST_HOLES, HoledScene
from lightwell.igi.surfaces import Surfaces
from lightwell.igi_settings import IgiSettings
from lightwell.render import Camera

RANDOM = np.random.default_rng(5)
BLOTCHES = np.repeat(np.repeat(RANDOM.integers(0, 2, (16, 16, 1)), 4, 0), 4, 1).astype(np.uint8) * 255


def uv_of(mesh: Mesh) -> np.ndarray:
    """The square −1 … 1 with u along +x and v along −y."""
    return np.stack([(mesh.positions[:, 0] + 1) / 2, (1 - mesh.positions[:, 1]) / 2], axis=1).astype(np.float32)


def cut_out(mask: np.ndarray, **more: Any) -> IgiMaterial:
    return dataclasses.replace(
        matte(0.8, 0.8, 0.8), alpha_texture=Texture(mask), hole_below=0.5, two_sided=True, **more
    )


def cards(count: int) -> tuple[IgiObject, ...]:
    """Cards at all angles in the cube −1 … 1: two thirds with holes, some whole, some not there, one with fading
    vertices."""
    flat = plane(2)
    found = []
    for number in range(count):
        turn, _ = np.linalg.qr(RANDOM.normal(size=(3, 3)))
        mesh = make_mesh(
            f"card {number}",
            flat.positions @ turn * 0.7 + RANDOM.uniform(-1, 1, 3),
            flat.triangles,
            flat.normals @ turn,
        )
        kinds = [
            cut_out(BLOTCHES), cut_out(BLOTCHES[::-1], alpha=0.8), matte(0.5, 0.5, 0.5),
            dataclasses.replace(matte(1, 1, 1), transmission=0.9, hole_below=0.5),
            dataclasses.replace(matte(1, 1, 1), hole_below=0.5),
        ]  # fmt: skip
        fading = RANDOM.random(len(flat.positions)).astype(np.float32) if number % 5 == 4 else None
        found.append(IgiObject(mesh, kinds[number % 5], (uv_of(flat),), alpha=fading))
    return tuple(found)


@pytest.fixture(scope="module")
def wood() -> Surfaces:
    return Surfaces(IgiScene(cards(20)))


@pytest.fixture(scope="module")
def rays() -> tuple[np.ndarray, np.ndarray]:
    """From outside to somewhere inside; directions of unlike lengths."""
    origins = RANDOM.normal(size=(400, 3))
    origins *= 3 / np.linalg.norm(origins, axis=1, keepdims=True)
    aims = RANDOM.uniform(-1, 1, (400, 3)) - origins
    return origins.astype(np.float32), (aims * RANDOM.uniform(0.1, 3, (400, 1))).astype(np.float32)


def test_rays_meet_the_first_point_that_is_there(wood: Surfaces, rays: tuple[np.ndarray, np.ndarray]) -> None:
    assert isinstance(wood.rays, HoledScene)
    kinds = wood._coverage.kind
    assert set(kinds) == {WHOLE, CUT, ABSENT}
    origins, directions = rays
    hits = wood.rays.intersect(origins, directions)
    expected = [first_solid(wood, o, d) for o, d in zip(origins, directions, strict=True)]
    triangles = np.array([triangle for triangle, _ in expected])
    distances = np.array([distance for _, distance in expected])
    # A ray at the very edge of a hole may pass in single precision and not in double.
    same = triangles == hits.triangle
    assert same.mean() > 0.99
    assert np.isfinite(distances).mean() > 0.5
    np.testing.assert_allclose(hits.distance[same], distances[same], rtol=1e-4)
    assert (hits.mesh == np.where(hits.triangle >= 0, 0, -1)).all()
    passed = (triangles >= 0) & (RayScene([wood.mesh]).intersect(origins, directions).triangle != hits.triangle)
    assert passed.mean() > 0.2
    # What ends before is not seen, what ends behind is; and shadow rays say the same.
    found = hits.triangle >= 0
    for share, blocked in ((0.999, False), (1.001, True)):
        ends = np.where(found, hits.distance * np.float32(share), np.float32(1))
        assert (wood.rays.occluded(origins, directions, ends)[found] == blocked).all()
        assert ((wood.rays.intersect(origins, directions, ends).triangle >= 0)[found] == blocked).all()
    np.testing.assert_array_equal(wood.rays.occluded(origins, directions), found)


def test_batches_may_be_of_any_size(wood: Surfaces, rays: tuple[np.ndarray, np.ndarray]) -> None:
    origins, directions = rays
    whole = wood.rays.intersect(origins, directions)
    for size in (1, 7, 64):
        parts = [wood.rays.intersect(origins[k : k + size], directions[k : k + size]) for k in range(0, 128, size)]
        for name in whole._fields:
            joined = np.concatenate([getattr(part, name) for part in parts])
            np.testing.assert_array_equal(joined, getattr(whole, name)[: len(joined)])
    assert len(wood.rays.occluded(origins[:0], directions[:0])) == 0
    down = np.array([[0, 0, -1]], np.float32)
    np.testing.assert_array_equal(
        wood.rays.occluded(origins, down), wood.rays.occluded(origins, np.tile(down, (len(origins), 1)))
    )


def test_scenes_without_holes_are_plain() -> None:
    flat = plane(1)
    opaque = dataclasses.replace(
        matte(1, 1, 1), hole_below=0.5, alpha_texture=Texture(np.full((2, 2, 1), 255, np.uint8))
    )
    assert type(Surfaces(IgiScene((IgiObject(flat, opaque, (uv_of(flat),)),))).rays) is RayScene


def test_no_ray_passes_more_holes_than_it_may() -> None:
    flat = plane(1)
    pile = [placed(flat, 1, [0, 0, -0.01 * number]) for number in range(MOST_HOLES + 5)]
    holes = cut_out(np.zeros((2, 2, 1), np.uint8) + np.array([[[0], [0]], [[0], [255]]], np.uint8))
    surfaces = Surfaces(IgiScene(tuple(IgiObject(mesh, holes, (uv_of(flat),)) for mesh in pile)))
    eye, down = np.array([[-0.7, 0.7, 1]], np.float32), np.array([[0, 0, -1]], np.float32)
    hits = surfaces.rays.intersect(eye, down)
    assert surfaces.owner[hits.triangle[0]] == MOST_HOLES
    np.testing.assert_allclose(hits.distance, 1 + 0.01 * MOST_HOLES, rtol=1e-4)


def test_only_what_is_there_shines_and_counts() -> None:
    flat = plane(1)
    half = np.array([[[255], [0]]], np.uint8).repeat(2, 0)
    shining = dataclasses.replace(cut_out(half), emission=(3.0, 2.0, 1.0))
    surfaces = Surfaces(IgiScene((IgiObject(flat, shining, (uv_of(flat),)),)))
    places = RANDOM.uniform(0, 0.5, (50, 2))
    triangles = RANDOM.integers(0, 2, 50)
    corners = flat.positions[flat.triangles[triangles]]
    x = (1 - places.sum(axis=1)) * corners[:, 0, 0] + (places.T[:, :, None] * corners[:, 1:].transpose(1, 0, 2)).sum(0)[
        :, 0
    ]
    emission = surfaces.emission(triangles, places)
    np.testing.assert_array_equal(emission, np.where((x < 0)[:, None], [3.0, 2.0, 1.0], 0))


SETTINGS = IgiSettings(sets="1x1", vpls=64, bounces=0, clamp=0, filter="none", layers=())
FLOOR = IgiObject(placed(plane(1), [3, 3, 1], [0, 0, 0]), matte(0.5, 0.5, 0.5))


def test_a_card_with_a_disc_cut_out_casts_a_disc_of_light() -> None:
    """A lamp 3 m above the floor, a card at 2 m with a hole of 0.5 m radius: the light's disc has 1.5 m."""
    rows, columns = (np.arange(256) + 0.5) / 128 - 1, (np.arange(256) + 0.5) / 128 - 1
    mask = (np.hypot(rows[:, None], columns) > 0.5).astype(np.uint8)[..., None] * 255
    flat = plane(1)
    card = IgiObject(placed(flat, 1, [0, 0, 2]), cut_out(mask), (uv_of(flat),))
    scene = IgiScene((FLOOR, card), (PointLight((0, 0, 3), (20, 20, 20)),))
    camera = Camera((0, -3, 1), (0, 0, 0), fov_degrees=80)
    picture = render_igi(scene, camera, (64, 64), SETTINGS, tile=64)
    bare = render_igi(IgiScene((FLOOR,), scene.lamps), camera, (64, 64), SETTINGS, tile=64)
    x, y = np.meshgrid(np.arange(64) + 0.5, np.arange(64) + 0.5)
    along = camera.looking(x, y, (64, 64))
    floor = along[..., 2] < -0.05
    reach = np.where(floor, 1 / np.where(floor, -along[..., 2], 1), 0)
    radius = np.hypot(reach * along[..., 0], -3 + reach * along[..., 1])
    inside, outside = floor & (radius < 1.47), floor & (radius > 1.53) & (radius < 2.5)
    assert inside.sum() > 100
    assert outside.sum() > 100
    np.testing.assert_allclose(picture.colour[inside], bare.colour[inside], rtol=1e-4)
    np.testing.assert_array_equal(picture.colour[outside], 0)
    # The same bytes in other tiles.
    again = render_igi(scene, camera, (64, 64), SETTINGS, tile=23)
    np.testing.assert_array_equal(picture.colour, again.colour)


def test_a_window_lets_the_light_of_a_map_in() -> None:
    """A closed box is dark inside; a pane that stops little is as good as none, and one that stops most as a wall."""

    def inside(pane: IgiMaterial | None) -> float:
        wall = panel((2.0, 2.0), [0, 0, 2])
        objects = [
            IgiObject(placed(plane(1), 1, [0, 0, 0]), matte(0.5, 0.5, 0.5)),
            *(
                IgiObject(make_mesh(f"wall {k}", corners, [[0, 1, 2], [0, 2, 3]]), two_sided)
                for k, corners in enumerate(_sides(2.0))
            ),
        ]
        if pane is not None:
            objects.append(IgiObject(wall, pane))
        scene = IgiScene(tuple(objects), sky=Sky(np.ones((4, 8, 3), np.float32)))
        camera = Camera((0, 0, 1.5), (0, 0.01, 0), fov_degrees=40)
        return float(render_igi(scene, camera, (16, 16), SETTINGS, tile=16).colour.mean())

    two_sided = dataclasses.replace(matte(0, 0, 0), two_sided=True)
    opaque = inside(matte(0, 0, 0))
    assert opaque == 0
    open_roof = inside(None)
    assert open_roof > 0.05
    glass = dataclasses.replace(matte(1, 1, 1), alpha=0.2, hole_below=0.5)
    assert inside(glass) == pytest.approx(open_roof, rel=0.05)
    assert inside(dataclasses.replace(matte(0, 0, 0), alpha=0.7, hole_below=0.5)) == 0


def _sides(height: float) -> list[list[list[float]]]:
    ring = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
    return [
        [[*ring[k], 0.0], [*ring[(k + 1) % 4], 0.0], [*ring[(k + 1) % 4], height], [*ring[k], height]] for k in range(4)
    ]
