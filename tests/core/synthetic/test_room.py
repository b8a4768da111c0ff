"""The room's coefficients are those of its radiance."""

from __future__ import annotations

import math

import numpy as np
import pytest

from lightwell.conventions import world_from_camera
from lightwell.sh.basis import evaluate
from lightwell.synthetic import room as room_module
from lightwell.synthetic.room import Room, RoomCamera, ball_zonal


def sphere_rule(rows: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss–Legendre in z, uniform in φ: directions (n, 3) and weights (n,)."""
    z, weights = np.polynomial.legendre.leggauss(rows)
    phi = 2 * math.pi * (np.arange(2 * rows) + 0.5) / (2 * rows)
    sin_theta = np.sqrt(1 - z * z)[:, None]
    directions = np.stack(
        [sin_theta * np.cos(phi), sin_theta * np.sin(phi), np.broadcast_to(z[:, None], (rows, 2 * rows))], axis=-1
    )
    return directions.reshape(-1, 3), np.repeat(weights * math.pi / rows, 2 * rows)


@pytest.mark.parametrize("lights", [0, 1, 3])
def test_truth_agrees_with_brute_force_quadrature(lights: int) -> None:
    room = Room(lights=lights)
    directions, weights = sphere_rule(600)
    radiance = room.radiance(directions, 1.3)
    brute = (evaluate(directions, 5) * weights[:, None]).T @ radiance
    truth = room.coefficients(5, 1.3)
    assert np.linalg.norm(brute - truth) <= 1e-3 * np.linalg.norm(truth)  # edges of the walls: the rule is O(1/n)


def test_brute_force_converges_to_the_truth() -> None:
    room = Room(lights=2)
    truth = room.coefficients(4, 0.7)
    errors = []
    for rows in (50, 400):
        directions, weights = sphere_rule(rows)
        brute = (evaluate(directions, 4) * weights[:, None]).T @ room.radiance(directions, 0.7)
        errors.append(np.linalg.norm(brute - truth))
    assert errors[1] < errors[0] / 6


def test_wall_rule_has_converged(monkeypatch: pytest.MonkeyPatch) -> None:
    room = Room(lights=0)
    coarse = room.coefficients(8, 0.0)
    monkeypatch.setattr(room_module, "WALL_NODES", 192)
    room_module._wall_coefficients.cache_clear()
    np.testing.assert_allclose(coarse, room.coefficients(8, 0.0), atol=1e-12)
    room_module._wall_coefficients.cache_clear()


def test_grey_walls_without_texture_are_a_constant_probe() -> None:
    room = Room(lights=0, texture=0.0, wall_colours=((0.5, 0.5, 0.5),) * 6)
    truth = room.coefficients(5, 0.0)
    np.testing.assert_allclose(truth[0], 0.5 * math.sqrt(4 * math.pi), rtol=1e-13)
    np.testing.assert_allclose(truth[1:], 0.0, atol=1e-12)


def test_ball_of_half_a_turn_has_the_closed_form() -> None:
    # Near α = π/2: L = cos γ on a half sphere, the clamped cosine, z = (π, 2π/3, π/4, 0).
    np.testing.assert_allclose(
        ball_zonal(math.pi / 2 - 1e-9, 4), [math.pi, 2 * math.pi / 3, math.pi / 4, 0.0], atol=1e-7
    )


def test_small_ball_is_a_point_light() -> None:
    # The mean of √(1 − ρ²) over a disc is 2/3.
    half_angle = 1e-3
    np.testing.assert_allclose(ball_zonal(half_angle, 5), 2 / 3 * math.pi * half_angle**2, rtol=1e-5)


def test_scene_repeats_after_two_periods() -> None:
    room = Room(lights=4, period_seconds=3.0)
    np.testing.assert_allclose(room.light_positions(0.4), room.light_positions(6.4), atol=1e-12)
    assert not np.allclose(room.light_positions(0.4), room.light_positions(1.4))


def test_camera_sees_the_rotated_room() -> None:
    room = Room()
    directions, _ = sphere_rule(8)
    rotation = world_from_camera((1.0, 2.0, 0.5), (0.0, 0.3, 1.0))
    picture = RoomCamera(room, directions.reshape(8, 16, 3)).render(2.0, rotation)
    assert picture.dtype == np.float32
    np.testing.assert_allclose(picture.reshape(-1, 3), room.radiance(directions @ rotation.T, 2.0), rtol=1e-5)


@pytest.mark.parametrize("changes", [{"centre": (9.0, 0.0, 0.0)}, {"lights": -1}, {"light_radius": 5.0}])
def test_impossible_rooms_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        Room(**changes)  # type: ignore[arg-type]
