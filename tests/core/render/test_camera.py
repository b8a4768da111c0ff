"""The pinhole camera."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.render import Camera

NORTH = Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), fov_degrees=90)


def test_the_middle_looks_at_the_target_and_the_top_points_up() -> None:
    rays = NORTH.directions((3, 3))[:, :, 0]
    np.testing.assert_allclose(rays[1, 1], [0, 1, 0], atol=1e-15)
    assert rays[0, 1, 2] > 0 > rays[2, 1, 2]
    assert rays[1, 0, 0] < 0 < rays[1, 2, 0]  # looking along +Y, +X is on the right


def test_the_angle_spans_the_height_between_edges() -> None:
    rays = NORTH.directions((1, 1000))[:, 0, 0]
    slope = rays[:, 2] / rays[:, 1]
    np.testing.assert_allclose(slope, 1 - 2 * (np.arange(1000) + 0.5) / 1000, atol=1e-12)


def test_pixels_are_square() -> None:
    rays = NORTH.directions((7, 5))[:, :, 0]
    plane = rays / rays[..., 1:2]
    np.testing.assert_allclose(np.diff(plane[..., 0], axis=1), 0.4, rtol=1e-12)
    np.testing.assert_allclose(np.diff(plane[..., 2], axis=0), -0.4, rtol=1e-12)


@pytest.mark.parametrize("samples", [1, 2, 3, 5])
def test_samples_are_the_pixel_centres_of_a_finer_picture(samples: int) -> None:
    camera = Camera((1.0, 2.0, 3.0), (-1.0, 0.5, 0.0), fov_degrees=50)
    coarse = camera.directions((6, 4), samples)
    fine = camera.directions((6 * samples, 4 * samples))[:, :, 0]
    expected = fine.reshape(4, samples, 6, samples, 3).swapaxes(1, 2).reshape(4, 6, samples**2, 3)
    np.testing.assert_allclose(coarse, expected, atol=1e-14)
    np.testing.assert_array_equal(camera.directions((6, 4), samples, slice(1, 3)), coarse[1:3])


def test_a_picture_goes_on_beyond_its_edges() -> None:
    camera = Camera((1.0, 2.0, 3.0), (0.0, 0.5, -1.0), fov_degrees=40)
    inside = camera.directions((12, 8))[:, :, 0]
    x, y = np.arange(-3, 15) + 0.5, np.arange(-2, 10) + 0.5
    around = camera.looking(x[None], y[:, None], (12, 8))
    np.testing.assert_array_equal(around[2:10, 3:15], inside)
    assert around[0, 0] @ around[-1, -1] < inside[0, 0] @ inside[-1, -1]


@pytest.mark.parametrize("down", [(0.0, 0.0, -1.0), (0.0, 0.0, 5.0)])
def test_looking_along_up_has_y_at_the_top(down: tuple[float, float, float]) -> None:
    rays = Camera((0.0, 0.0, 0.0), down).directions((1, 2))[:, 0, 0]
    assert rays[0, 1] > 0 > rays[1, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"target": (0.0, 0.0, 0.0)}, "where the camera stands"),
        ({"fov_degrees": 180.0}, "between 0 and 180"),
        ({"up": (0.0, 0.0, 0.0)}, "length"),
        ({"position": (np.nan, 0.0, 0.0)}, "finite"),
    ],
)
def test_refuses_what_makes_no_picture(arguments: dict[str, object], message: str) -> None:
    given = {"position": (0.0, 0.0, 0.0), "target": (1.0, 0.0, 0.0)} | arguments
    with pytest.raises(ValueError, match=message):
        Camera(**given)  # type: ignore[arg-type]
