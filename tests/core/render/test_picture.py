"""Rays, pixels, layers, surroundings."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.errors import RenderError
from lightwell.geometry.mesh import make_mesh
from lightwell.geometry.shapes import box, make_shape, plane, sphere
from lightwell.probe.latlong import LatLong
from lightwell.render import Camera, DistantLight, Harmonics, Material, Panorama, Scene, SceneObject, render

LIGHT = DistantLight(np.full((1, 3), np.sqrt(4 * np.pi)))
CAMERA = Camera((0.0, -4.0, 0.0), (0.0, 0.0, 0.0), fov_degrees=40)


def test_layers_of_a_box_seen_from_the_front() -> None:
    picture = render(Scene((SceneObject(box(albedo=0.5)),), LIGHT), CAMERA, (30, 20))
    middle = (10, 15)
    assert picture.colour[middle] == pytest.approx(0.5, rel=1e-6)
    assert picture.depth[middle] == pytest.approx(3.0, rel=1e-6)
    np.testing.assert_allclose(picture.normal[middle], [0, -1, 0], atol=1e-6)
    assert picture.albedo[middle] == pytest.approx(0.5)
    np.testing.assert_allclose(picture.depth[picture.coverage == 1], 3.0, rtol=1e-5)  # along the axis, not the ray
    corner = (0, 0)
    assert (picture.coverage[corner], picture.depth[corner]) == (0, np.inf)
    assert not picture.colour[corner].any()
    assert not picture.normal[corner].any()


def test_antialiasing_is_the_share_of_the_pixel() -> None:
    # The front face, 3 m away, spans three quarters of the picture: 12 of 16 rays along each side.
    camera = Camera((0.0, -4.0, 0.0), (0.0, 0.0, 0.0), fov_degrees=2 * np.degrees(np.arctan(4 / 9)))
    picture = render(Scene((SceneObject(box()),), LIGHT), camera, (1, 1), samples=16)
    assert picture.coverage[0, 0] == pytest.approx(0.75**2)
    assert picture.colour[0, 0] == pytest.approx(0.8 * 0.75**2, rel=1e-5)


def test_progress_ends_with_all_rows() -> None:
    seen: list[tuple[int, int]] = []
    render(Scene((), LIGHT), CAMERA, (200, 150), 4, lambda done, total: seen.append((done, total)))
    assert len(seen) > 3
    assert seen == sorted(seen)
    assert seen[-1] == (150, 150)


def test_batches_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene((SceneObject(sphere(12, 24)),), LIGHT, Harmonics(np.ones((4, 3))))
    whole = render(scene, CAMERA, (20, 15), 2)
    monkeypatch.setattr("lightwell.render.picture.RAYS_AT_ONCE", 1)
    np.testing.assert_array_equal(render(scene, CAMERA, (20, 15), 2).colour, whole.colour)


def test_an_empty_scene_is_the_backdrop_or_black() -> None:
    assert render(Scene((), LIGHT), CAMERA, (4, 3)).colour.max() == 0
    lit = render(Scene((), LIGHT, Harmonics(LIGHT.coefficients)), CAMERA, (4, 3))
    np.testing.assert_allclose(lit.colour, 1, rtol=1e-6)
    assert lit.coverage.max() == 0


def test_no_light_is_a_dark_picture_with_its_layers() -> None:
    scene = Scene((SceneObject(sphere(12, 24), Material(gloss=0.5)),), DistantLight(np.zeros((9, 3))))
    picture = render(scene, CAMERA, (12, 9))
    assert picture.colour.max() == 0
    assert picture.coverage.max() == 1


def test_a_camera_inside_an_object_is_told_so() -> None:
    scene = Scene((SceneObject(box()),), LIGHT)
    with pytest.raises(RenderError, match=r"inside object 'box', at \(0, 0.5, 0\): move it out"):
        render(scene, Camera((0.0, 0.5, 0.0), (0.0, 2.0, 0.0)), (4, 3))


def test_a_camera_in_a_room_that_faces_inwards_is_fine() -> None:
    room = box()
    turned = make_mesh("room", room.positions, room.triangles[:, ::-1], -room.normals)
    picture = render(Scene((SceneObject(turned),), LIGHT), Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)), (4, 3))
    assert picture.coverage.min() == 1


def test_backs_are_not_seen_unless_two_sided() -> None:
    below = Camera((0.0, 0.5, -3.0), (0.0, 0.0, 0.0))
    ball = SceneObject(sphere(24, 48, albedo=0.3))
    floor = make_mesh("floor", plane(1).positions - [0, 0, 1.5], plane(1).triangles)
    through = render(Scene((ball, SceneObject(floor)), LIGHT), below, (9, 9))
    assert through.colour[4, 4] == pytest.approx(0.3, rel=1e-5)
    shown = render(Scene((ball, SceneObject(floor, Material(two_sided=True))), LIGHT), below, (9, 9))
    assert shown.colour[4, 4] == pytest.approx(0.8, rel=1e-5)
    np.testing.assert_allclose(shown.normal[4, 4], [0, 0, -1], atol=1e-6)


def test_the_back_of_a_shadowed_surface_gets_its_own_light() -> None:
    mesh = plane(1)
    item = SceneObject(mesh, Material(two_sided=True), np.zeros((len(mesh.positions), 9, 1)))
    front, back = (
        render(Scene((item,), LIGHT), Camera((0.0, 0.5, z), (0.0, 0.0, 0.0)), (3, 3)).colour[1, 1, 0]
        for z in (3.0, -3.0)
    )
    assert (front, back) == (0, pytest.approx(0.8, rel=1e-5))


def test_normals_say_which_side_is_front_whatever_the_winding() -> None:
    mesh = sphere(12, 24)
    wrong = make_mesh("wrong", mesh.positions, mesh.triangles[:, ::-1], mesh.normals, mesh.albedo)
    pictures = [render(Scene((SceneObject(given),), LIGHT), CAMERA, (12, 9)) for given in (mesh, wrong)]
    np.testing.assert_allclose(pictures[0].colour, pictures[1].colour, rtol=1e-5)
    np.testing.assert_allclose(pictures[0].depth, pictures[1].depth, rtol=1e-6)


def test_degenerate_triangles_do_no_harm() -> None:
    mesh = make_mesh("bad", [[0, 0, 0], [1, 0, 0], [0, 0, 1], [0, 0, 0]], [[0, 0, 1], [0, 1, 2], [3, 3, 3]])
    picture = render(Scene((SceneObject(mesh, Material(two_sided=True)),), LIGHT), CAMERA, (20, 20))
    assert np.isfinite(picture.colour).all()
    assert 0 < picture.coverage.mean() < 0.5


@pytest.mark.parametrize(("size", "samples"), [((0, 5), 1), ((5, 20000), 1), ((5, 5), 0), ((5, 5), 17)])
def test_refuses_sizes_out_of_range(size: tuple[int, int], samples: int) -> None:
    with pytest.raises(ValueError, match="must lie between"):
        render(Scene((), LIGHT), CAMERA, size, samples)


@pytest.mark.parametrize("filter_", ["linear", "nearest", "cubic"])
def test_a_panorama_looks_where_lat_long_says(filter_: str) -> None:
    mapping = LatLong(16, 32)
    directions = mapping.directions(*mapping.pixel_centres())[0]
    pixels = (1 + 0.3 * directions).astype(np.float32)
    found = Panorama(pixels, filter_).radiance(directions.reshape(-1, 3))  # type: ignore[arg-type]
    tolerance = 0.02 if filter_ == "cubic" else 1e-6
    np.testing.assert_allclose(found.reshape(pixels.shape), pixels, atol=tolerance)


def test_a_panorama_is_seamless() -> None:
    pixels = np.random.default_rng(0).uniform(size=(8, 16, 3))
    for filter_ in ("linear", "cubic"):
        near = np.array([[1.0, -1e-9, 0.2], [1.0, 1e-9, 0.2]])
        found = Panorama(pixels, filter_).radiance(near / np.linalg.norm(near, axis=1, keepdims=True))
        np.testing.assert_allclose(found[0], found[1], atol=1e-6)
        assert np.isfinite(Panorama(pixels, filter_).radiance(np.array([[0, 0, 1.0], [0, 0, -1.0]]))).all()


def test_linear_filter_is_halfway_between_two_pixels() -> None:
    pixels = np.random.default_rng(0).uniform(size=(4, 8, 3))
    direction, _ = LatLong(4, 8).directions(np.array([2.0]), np.array([1.5]))
    np.testing.assert_allclose(Panorama(pixels).radiance(direction)[0], (pixels[1, 1] + pixels[1, 2]) / 2, atol=1e-12)


@pytest.mark.parametrize("name", ["sphere", "plane", "box"])
def test_shapes_face_outwards_and_have_the_area_that_they_should(name: str) -> None:
    mesh = make_shape(name)  # type: ignore[arg-type]
    corners = mesh.positions[mesh.triangles].astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("fk,fvk->f", cross, mesh.normals[mesh.triangles]) > 0).all()
    area = np.linalg.norm(cross, axis=1).sum() / 2
    assert area == pytest.approx({"sphere": 4 * np.pi, "plane": 4, "box": 24}[name], rel=2e-3)
