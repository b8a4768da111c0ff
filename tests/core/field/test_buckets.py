"""Buckets against rays traced one by one (MATHS §3)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lightwell.field.buckets import make_buckets, sphere_offsets
from lightwell.field.gather import gather, gathered_buckets, turned_offsets
from lightwell.probe.latlong import LatLong
from lightwell.probe.mirror_sphere import MirrorSphere, solve_view
from lightwell.sh.basis import evaluate
from lightwell.synthetic.rig import VirtualProbe, rotation_of, turns
from lightwell.synthetic.scene import PRESETS

RADIUS, DISTANCE = 0.05, 1.25


def _sphere(size: int = 48) -> MirrorSphere:
    fov = 2.04 * math.degrees(math.asin(RADIUS / DISTANCE))
    return MirrorSphere(
        size, size, solve_view(size, size, fov, RADIUS, DISTANCE, None), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
    )


def test_offsets_are_where_the_camera_sees_the_sphere() -> None:
    mapping = _sphere()
    buckets = make_buckets(mapping, 3, sphere_radius_m=RADIUS)
    # One pinhole ray a pixel: d meets the sphere at P and leaves along r.
    row, column = np.divmod(buckets.pixels, 48)
    c = mapping.view.principal_distance
    rays = np.stack([(column + 0.5 - 24) / c, (24 - row - 0.5) / c, np.full(row.shape, -1.0)], axis=1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    rays = rays @ mapping.world_from_camera.T
    centre = DISTANCE * np.array([0.0, 1.0, 0.0])
    towards = rays @ centre
    hit = (towards - np.sqrt(towards**2 - (DISTANCE**2 - RADIUS**2)))[:, None] * rays
    normal = (hit - centre) / RADIUS
    reflected = rays - 2 * (rays * normal).sum(axis=1, keepdims=True) * normal
    np.testing.assert_allclose(buckets.directions, reflected, atol=1e-9)
    miss = hit - centre
    miss -= (miss * reflected).sum(axis=1, keepdims=True) * reflected
    np.testing.assert_allclose(buckets.offsets, miss, atol=1e-10 * 1e2)


@pytest.mark.parametrize("weights", ["solid-angle", "paper"])
def test_rows_of_a_whole_sphere_make_a_constant(weights: str) -> None:
    for mapping in (_sphere(), LatLong(24, 48)):
        rows = make_buckets(mapping, 4, weights).rows.sum(axis=0)  # type: ignore[arg-type]
        assert rows[0] == pytest.approx(math.sqrt(4 * math.pi), rel=1e-9)
        assert np.abs(rows[1:]).max() < 1e-9


def test_without_fill_the_blind_cone_is_missing() -> None:
    mapping = _sphere()
    half = math.asin(RADIUS / DISTANCE)
    seen = make_buckets(mapping, 1, blind="zero").rows.sum() * math.sqrt(4 * math.pi)
    assert seen == pytest.approx(2 * math.pi * (1 + math.cos(half)), rel=1e-6)


def test_offsets_vanish_for_single_viewpoints() -> None:
    assert not make_buckets(LatLong(8, 16), 2, sphere_radius_m=1.0).offsets.any()
    along = np.array([[0.0, 0.0, -1.0]])
    np.testing.assert_allclose(sphere_offsets(along, np.array([0.0, 0.0, 1.0]), 0.04), 0, atol=1e-12)


def test_fibonacci_directions_integrate_the_basis() -> None:
    buckets = gathered_buckets(4096, 4)
    gram = evaluate(buckets.directions, 4).T @ buckets.rows
    np.testing.assert_allclose(gram, np.eye(16), atol=5e-4)


def test_turned_probes_see_the_same_world() -> None:
    """A picture of a turned sphere, gathered at world directions, shows what the rays at those offsets carry."""
    mapping, scene = _sphere(160), PRESETS["distant"]
    quaternion = turns(1, seed=4)
    picture = VirtualProbe(mapping, RADIUS, 2).render(scene, np.zeros(3), quaternion[0])
    directions = gathered_buckets(300, 2).directions
    turn = rotation_of(quaternion)
    found = gather(picture, mapping, directions, turn[0])
    offsets = turned_offsets(mapping, directions, turn, RADIUS)
    assert offsets.shape == (300, 1, 3)
    np.testing.assert_allclose((offsets[:, 0] * directions).sum(axis=1), 0, atol=1e-12)
    known = np.isfinite(found).all(axis=1)
    assert known.mean() > 0.95
    exact = scene.radiance(offsets[known, 0], directions[known])
    assert np.abs(found[known] - exact).max() < 0.15 * exact.max()
    assert np.abs(found[known] - exact).mean() < 0.01 * exact.mean()
