"""How far away the light comes from."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from tests.support.reference_gradients import latlong_directions

from lightwell.errors import ProxyError
from lightwell.geometry.mesh import make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import box, plane, sphere
from lightwell.gradients.panorama import GradientPanorama
from lightwell.gradients.proxy import BoxProxy, DepthProxy, MeshProxy, SphereProxy, inverse_distances
from lightwell.probe.latlong import LatLong
from lightwell.probe.mirror_sphere import MirrorSphere, SphereView

DIRECTIONS = latlong_directions(32, 64)


def test_rays_end_on_the_sphere() -> None:
    centre, origin = np.array([0.1, 0.2, -0.3]), np.array([1.0, 0.9, -1.2])
    at = origin + SphereProxy(2.0, centre).distances(origin, DIRECTIONS)[..., None] * DIRECTIONS
    np.testing.assert_allclose(np.linalg.norm(at - centre, axis=-1), 2, rtol=1e-13)
    on_edge = SphereProxy(1.0).distances([1 - 1e-12, 0, 0], DIRECTIONS)
    assert (on_edge > 0).all()


def test_rays_end_on_the_box() -> None:
    lower, upper, origin = np.array([-1.0, -2, 0]), np.array([3.0, 1, 2.5]), np.array([2.5, 0.5, 1.8])
    distances = BoxProxy(lower, upper).distances(origin, DIRECTIONS)
    at = origin + distances[..., None] * DIRECTIONS
    gaps = np.minimum(at - lower, upper - at)
    np.testing.assert_allclose(gaps.min(axis=-1), 0, atol=1e-12)
    along_an_axis = BoxProxy(lower, upper).distances(origin, np.array([[0.0, 0, -1], [1, 0, 0], [0, 1, 0]]))
    np.testing.assert_allclose(along_an_axis, [1.8, 0.5, 0.5])


def test_mesh_is_its_shape_and_sky_is_far() -> None:
    origin = np.array([0.3, -0.2, 0.4])
    room = MeshProxy(RayScene([box()]))
    np.testing.assert_allclose(
        room.distances(origin, DIRECTIONS), BoxProxy([-1] * 3, [1] * 3).distances(origin, DIRECTIONS), rtol=1e-5
    )
    ball = MeshProxy(RayScene([sphere(128, 256)]))
    np.testing.assert_allclose(
        ball.distances(origin, DIRECTIONS), SphereProxy(1.0).distances(origin, DIRECTIONS), rtol=1e-3
    )
    floor = MeshProxy(RayScene([plane()])).distances(origin, np.array([[0, 0, -1], [0, 0, 1.0]]))
    np.testing.assert_allclose(floor, [0.4, np.inf], rtol=1e-6)


def test_depth_map_is_read_at_the_nearest_pixel() -> None:
    mapping = LatLong(8, 16)
    depth = np.arange(1.0, 129).reshape(8, 16)
    depth[0, 0], depth[0, 1], depth[0, 2], depth[0, 3] = np.inf, np.nan, -1, 0
    distances = DepthProxy(mapping, depth).distances([0, 0, 0], latlong_directions(8, 16))
    np.testing.assert_array_equal(distances[0, :4], np.inf)
    np.testing.assert_array_equal(distances.reshape(-1)[4:], depth.reshape(-1)[4:])


def test_depth_map_is_sky_where_the_probe_does_not_look() -> None:
    mapping = MirrorSphere(64, 64, SphereView(0.3, 100.0))
    proxy = DepthProxy(mapping, np.ones((64, 64)))
    np.testing.assert_array_equal(proxy.distances([0, 0, 0], [[0, 0, 1.0], [0, 0, -1.0]]), [1, np.inf])


def test_outlines_take_what_is_near() -> None:
    """A ball in a room: pixels that show any of it count as near, all others keep the distance at their centre."""
    small = sphere(64, 128)
    ball = make_mesh("ball", 0.25 * small.positions + np.array([0.5, 0, 0]), small.triangles)
    proxy, panorama = MeshProxy(RayScene([box(), ball])), GradientPanorama(LatLong(32, 64))
    ours = panorama.inverse_distances(proxy, np.zeros(3))
    centre = 1 / proxy.distances(np.zeros(3), panorama.directions)
    assert (ours >= centre).all()
    changed = ours > 1.1 * centre
    assert 5 < np.count_nonzero(changed) < 60
    # All of them lie at the cone that the ball fills, half-angle 30°.
    angles = np.degrees(np.arccos(panorama.directions[..., 0]))
    assert (np.abs(angles[changed] - 30) < 6).all()


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: SphereProxy(0.0), "radius of 0 m"),
        (lambda: SphereProxy(np.inf), "finite"),
        (lambda: SphereProxy(1.0, [0, 0]), "three finite numbers"),
        (lambda: SphereProxy(1.0).distances([0, 0, 2], DIRECTIONS), r"2 m from the centre .* radius of 1 m; correct"),
        (lambda: BoxProxy([0, 0, 0], [1, 0, 1]), "grow along every axis"),
        (lambda: BoxProxy([0, 0, 0], [1, 1, 1]).distances([0.5, 2, 0.5], DIRECTIONS), r"\(0.5, 2, 0.5\).*not inside"),
        (lambda: BoxProxy([0, 0, 0], [1, 1, 1]).distances([np.nan, 0, 0], DIRECTIONS), "probe's position"),
        (lambda: MeshProxy(RayScene([])), "no triangles"),
        (lambda: DepthProxy(LatLong(4, 8), np.ones((8, 4))), r"needs \(4, 8\)"),
        (lambda: DepthProxy(LatLong(4, 8), np.where(np.eye(4, 8), 1e-42, 1)), "1.*e-42 m in row 0, column 0: .*metres"),
        (lambda: inverse_distances(MeshProxy(RayScene([plane()])), [0.1, 0.1, 1e-6], -DIRECTIONS), "surface, .*metres"),
        (lambda: inverse_distances(DepthProxy(LatLong(4, 8), np.zeros((4, 8))), [0, 0, 0], DIRECTIONS), "not seen in"),
        (lambda: inverse_distances(MeshProxy(RayScene([plane()])), [9, 9, -1], -DIRECTIONS[:2]), "not seen in"),
    ],
)
def test_bad_input(make: Callable[[], object], match: str) -> None:
    with pytest.raises(ProxyError, match=match):
        make()
