"""Cameras that move."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.render.camera import Camera
from lightwell.render.path import camera_path, orbit

A = Camera((0.0, -4.0, 1.0), (0.0, 0.0, 1.0), fov_degrees=40)
B = Camera((3.0, -1.0, 4.0), (1.0, 0.0, 0.0), fov_degrees=60)
C = Camera((3.0, 5.0, 2.0), (0.0, 1.0, 1.0), fov_degrees=20)


def test_a_path_goes_straight_between_two_cameras_and_smoothly_through_more() -> None:
    straight = camera_path([A, B], 5)
    assert (straight[0], straight[-1]) == (A, B)
    np.testing.assert_allclose([one.position for one in straight], np.linspace(A.position, B.position, 5), atol=1e-12)
    np.testing.assert_allclose([one.fov_degrees for one in straight], np.linspace(40, 60, 5))
    curved = camera_path([A, B, C], 201)
    assert (curved[0], curved[100], curved[-1]) == (A, B, C)
    places = np.array([one.position for one in curved])
    steps = np.diff(places, axis=0)
    # No corner at the camera in the middle: the two steps beside it differ by a curvature's worth.
    assert np.linalg.norm(steps[100] - steps[99]) < 0.05 * np.linalg.norm(steps[100])
    assert camera_path([A, B, C], 1) == [A]
    with pytest.raises(ValueError, match="two cameras"):
        camera_path([A], 3)
    through = Camera(B.target, B.position)
    with pytest.raises(ValueError, match="where the camera stands"):
        camera_path([B, through], 3)


def test_an_orbit_keeps_its_distance_and_closes() -> None:
    turned = orbit(B, 360, 8)
    assert len(turned) == 8
    np.testing.assert_allclose(turned[0].position, B.position, atol=1e-12)
    places = np.array([one.position for one in turned]) - B.target
    np.testing.assert_allclose(np.linalg.norm(places, axis=1), np.linalg.norm(places[0]))
    np.testing.assert_allclose(places[4], places[0] * [-1, -1, 1], atol=1e-12)
    # Counter-clockwise from above.
    assert np.cross(places[0], places[1])[2] > 0
    assert {one.target for one in turned} == {B.target}
