"""An analytic room: its radiance is exact along every ray, and its coefficients are known to rounding error.

The room is an axis-aligned box whose walls glow with a smooth texture, seen from a point inside. In it float glowing
balls of thin gas: a ray gathers light in proportion to the length of its chord through a ball, and the walls shine
through. Light therefore only adds up, and so do the coefficients:

    c = Σ walls c_wall + Σ balls c_ball

A wall's coefficients are the integral ``∫ L(ω) Y(ω) dω`` over its rectangle, with ``dω = |n·r| / |r|³ dA``; the
integrand is smooth, so that a Gauss–Legendre product rule converges to rounding error. They do not change in time.

A ball of radius ``R`` at distance ``d`` fills the cone ``sin γ ≤ sin α = R/d`` with

    L(γ) = L_0 √(1 − sin²γ / sin²α),

which is zonal about its direction: ``c_lm = z_l Y_lm(direction)``, ``z_l = 2π ∫ L(γ) P_l(cos γ) d(cos γ)``. The
substitution ``cos γ = cos α + (1 − cos α) t²`` makes the integrand smooth in t (no square root at the rim), and a
Gauss–Legendre rule gives ``z_l`` to rounding error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import coefficient_count, degree_of_index
from lightwell.sh.basis import evaluate

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

ORIGIN: Vector = (0.0, 0.0, 0.0)

WALL_NODES = 96
"""Gauss–Legendre nodes along each side of a wall: doubling them changes no coefficient by more than 1e-13."""
CONE_NODES = 48

WALL_COLOURS = (
    (0.60, 0.50, 0.40),
    (0.14, 0.22, 0.50),
    (0.16, 0.42, 0.18),
    (0.55, 0.14, 0.10),
    (0.85, 0.88, 0.95),
    (0.16, 0.13, 0.10),
)
"""Mean radiance of the walls +X, −X, +Y, −Y, +Z (ceiling), −Z (floor)."""

BALL_COLOURS = ((9.0, 5.5, 2.5), (2.0, 5.0, 9.0), (3.0, 8.0, 3.5), (8.0, 3.0, 7.0))
"""Radiance through the balls' centres."""


@dataclass(frozen=True)
class Room:
    """Walls at ``±half_size`` around ``centre`` as seen from the origin, and balls that circle the origin.

    The probe is at the origin unless ``at`` says where it is, ``(3,)`` metres from there (`require_free`).
    """

    half_size: tuple[float, float, float] = (3.0, 2.5, 1.6)
    """Half of the box's extent along x, y and z, metres."""
    centre: tuple[float, float, float] = (0.4, -0.3, 0.2)
    """The box's centre, metres; the origin must be inside."""
    lights: int = 2
    """Number of balls."""
    light_radius: float = 0.35
    """Radius of each ball, metres."""
    period_seconds: float = 8.0
    """Time of one turn of the first ball."""
    texture: float = 0.5
    """Contrast of the walls' texture, 0 … 1."""
    wall_colours: tuple[tuple[float, float, float], ...] = field(default=WALL_COLOURS, repr=False)

    def __post_init__(self) -> None:
        """Check what the formulas rely on; raises ``ValueError``."""
        if any(abs(c) >= s for c, s in zip(self.centre, self.half_size, strict=True)):
            raise ValueError("the probe (the origin) must be inside the room")
        if self.lights < 0 or self.light_radius <= 0 or self.period_seconds <= 0 or not 0 <= self.texture <= 1:
            raise ValueError("lights ≥ 0, light_radius > 0, period_seconds > 0 and 0 ≤ texture ≤ 1 are needed")
        if self.light_radius >= 0.9 * self._orbit_radius():
            raise ValueError(f"the balls must not reach the probe: light_radius < {0.9 * self._orbit_radius():.3g} m")

    def bounds(self) -> tuple[Floats, Floats]:
        """Return the box's lower and upper corner, metres, ``(3,)`` each."""
        centre, half = np.array(self.centre), np.array(self.half_size)
        return centre - half, centre + half

    def require_free(self, at: ArrayLike) -> None:
        """Raise ``ValueError`` where a probe at ``at`` ``(…, 3)`` is not inside the room, or a ball may reach it."""
        points = np.asarray(at, dtype=np.float64).reshape(-1, 3)
        lower, upper = self.bounds()
        outside = ~((points > lower) & (points < upper)).all(axis=1)
        if outside.any():
            place = ", ".join(f"{value:g}" for value in points[outside][0])
            room = " … ".join("(" + ", ".join(f"{value:g}" for value in corner) + ")" for corner in (lower, upper))
            raise ValueError(f"the probe at ({place}) m is not inside the room {room} m")
        if self.lights == 0:
            return
        from_orbit = np.abs(np.hypot(points[:, 0], points[:, 1]) - self._orbit_radius())
        above = np.maximum(np.abs(points[:, 2]) - 0.5 * (self.half_size[2] - abs(self.centre[2])), 0)
        nearest = float(np.hypot(from_orbit, above).min())
        if self.light_radius >= 0.9 * nearest:
            raise ValueError(
                f"the balls would reach the probe, {nearest:.3g} m from their path: lights=0, a light_radius below "
                f"{0.9 * nearest:.3g} m or another place is needed"
            )

    def _orbit_radius(self) -> float:
        return 0.6 * min(s - abs(c) for c, s in zip(self.centre[:2], self.half_size[:2], strict=True))

    def light_positions(self, time_seconds: float) -> Floats:
        """Return the centres of the balls, metres, ``(lights, 3)``.

        Ball ``i`` circles the origin ``1 + i/2`` times a period, every other one backwards, and bobs up and down.
        After two periods all are where they were.
        """
        index = np.arange(self.lights)
        turns = (1.0 + 0.5 * index) * np.where(index % 2, -1.0, 1.0)
        angle = 2 * math.pi * (turns * time_seconds / self.period_seconds + 0.31 * index)
        height = 0.5 * (self.half_size[2] - abs(self.centre[2]))
        radius = self._orbit_radius() * np.ones(self.lights)
        return np.stack([radius * np.cos(angle), radius * np.sin(angle), height * np.sin(2 * angle + index)], axis=-1)

    def light_colours(self) -> Floats:
        """Return the radiance through the centre of each ball, ``(lights, 3)``."""
        return np.array([BALL_COLOURS[i % len(BALL_COLOURS)] for i in range(self.lights)]).reshape(-1, 3)

    def radiance(self, directions: ArrayLike, time_seconds: float, at: Vector = ORIGIN) -> Floats:
        """Return the radiance along unit ``directions`` (…, 3) in world axes, (…, 3)."""
        directions = np.asarray(directions, dtype=np.float64)
        flat = np.ascontiguousarray(directions.reshape(-1, 3))
        out = np.empty((len(flat), 3))
        _render(flat, np.eye(3), *self._tables(time_seconds, at), out)
        return out.reshape(directions.shape)

    def coefficients(self, bands: int, time_seconds: float, at: Vector = ORIGIN) -> Floats:
        """Return the exact coefficients, ``(bands², 3)``."""
        total = _wall_coefficients(self, bands, at).copy()
        positions = self.light_positions(time_seconds) - np.array(at)
        for position, colour in zip(positions, self.light_colours(), strict=True):
            distance = float(np.linalg.norm(position))
            zonal = ball_zonal(math.asin(self.light_radius / distance), bands)
            basis = evaluate(position / distance, bands)
            total += (zonal[degree_of_index(bands)] * basis)[:, None] * colour
        return total

    def _tables(self, time_seconds: float, at: Vector) -> tuple[Floats, Floats, Floats, float, Floats, Floats]:
        positions = self.light_positions(time_seconds) - np.array(at)
        distances = np.linalg.norm(positions, axis=-1)
        lights = np.concatenate(
            [positions / distances[:, None], (self.light_radius / distances)[:, None] ** 2], axis=-1
        )
        return (
            np.array(self.half_size),
            np.array(self.centre) - np.array(at),
            np.array(self.wall_colours),
            self.texture,
            lights,
            self.light_colours(),
        )


class RoomCamera:
    """Renders pictures of a room along fixed directions in camera axes."""

    def __init__(self, room: Room, directions: ArrayLike) -> None:
        """Prepare for ``directions`` (height, width, 3): unit vectors, in camera axes."""
        self._room = room
        self._directions = np.ascontiguousarray(directions, dtype=np.float64)

    def render(
        self, time_seconds: float, world_from_camera: Floats | None = None, at: Vector = ORIGIN
    ) -> NDArray[np.float32]:
        """Return the radiance at every pixel centre, ``(height, width, 3)``."""
        flat = self._directions.reshape(-1, 3)
        out = np.empty(flat.shape, dtype=np.float32)
        rotation = np.eye(3) if world_from_camera is None else np.ascontiguousarray(world_from_camera)
        _render(flat, rotation, *self._room._tables(time_seconds, at), out)
        return out.reshape(self._directions.shape)


def ball_zonal(half_angle: float, bands: int) -> Floats:
    """Return ``z_l`` of a ball of gas with unit radiance through its centre, ``(bands,)``; see the module's formula.

    A ball that fills the cone of ``half_angle`` (radians, below π/2) around ω has the coefficients ``z_l Y_lm(ω)``.
    """
    cos_rim = math.cos(half_angle)
    nodes, weights = np.polynomial.legendre.leggauss(CONE_NODES)
    t = 0.5 * (nodes + 1.0)
    cos_gamma = cos_rim + (1.0 - cos_rim) * t * t
    # √(1 − sin²γ/sin²α) = √((cosγ − cosα)(cosγ + cosα)) / sinα, and √(cosγ − cosα) = √(1 − cosα) t.
    radiance = np.sqrt(1.0 - cos_rim) * t * np.sqrt(cos_gamma + cos_rim) / math.sin(half_angle)
    measure = 0.5 * weights * 2.0 * (1.0 - cos_rim) * t
    legendre = np.polynomial.legendre.legvander(cos_gamma, bands - 1)
    return np.asarray(2.0 * math.pi * (radiance * measure) @ legendre)


@lru_cache(maxsize=8)
def _wall_coefficients(room: Room, bands: int, at: Vector) -> Floats:
    nodes, weights = np.polynomial.legendre.leggauss(WALL_NODES)
    half_size, centre = np.array(room.half_size), np.array(room.centre) - np.array(at)
    total = np.zeros((coefficient_count(bands), 3))
    for wall in range(6):
        axis, side = wall // 2, 1.0 if wall % 2 == 0 else -1.0
        first, second = (axis + 1) % 3, (axis + 2) % 3
        u, v = np.meshgrid(nodes, nodes, indexing="ij")
        points = np.empty((*u.shape, 3))
        points[..., axis] = centre[axis] + side * half_size[axis]
        points[..., first] = centre[first] + u * half_size[first]
        points[..., second] = centre[second] + v * half_size[second]
        distance = np.linalg.norm(points, axis=-1)
        area = np.outer(weights, weights) * half_size[first] * half_size[second]
        solid_angle = area * np.abs(points[..., axis]) / distance**3
        pattern = 1.0 + room.texture * np.cos(2 * math.pi * u) * np.cos(math.pi * v)
        basis = evaluate(points / distance[..., None], bands)
        total += np.einsum("uv,uvk->k", solid_angle * pattern, basis)[:, None] * np.array(room.wall_colours[wall])
    return total


@njit(cache=True, nogil=True)
def _render(directions, world_from_camera, half_size, centre, walls, texture, lights, colours, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the radiance along ``directions`` (n, 3), rotated to world axes, to ``out`` (n, 3).

    ``lights`` is (lights, 4): the direction of each ball and sin²α.
    """
    position = np.empty(3)
    d = np.empty(3)
    for i in range(directions.shape[0]):
        for axis in range(3):
            d[axis] = (
                world_from_camera[axis, 0] * directions[i, 0]
                + world_from_camera[axis, 1] * directions[i, 1]
                + world_from_camera[axis, 2] * directions[i, 2]
            )
        # Leave the box through the wall whose plane comes first.
        nearest = np.inf
        wall = 0
        for axis in range(3):
            if d[axis] > 0.0:
                distance = (centre[axis] + half_size[axis]) / d[axis]
            elif d[axis] < 0.0:
                distance = (centre[axis] - half_size[axis]) / d[axis]
            else:
                continue
            if distance < nearest:
                nearest = distance
                wall = 2 * axis + (0 if d[axis] > 0.0 else 1)
        # Look the texture up at the point that was hit.
        for axis in range(3):
            position[axis] = (nearest * d[axis] - centre[axis]) / half_size[axis]
        u, v = position[(wall // 2 + 1) % 3], position[(wall // 2 + 2) % 3]
        pattern = 1.0 + texture * math.cos(2.0 * math.pi * u) * math.cos(math.pi * v)
        red, green, blue = walls[wall, 0] * pattern, walls[wall, 1] * pattern, walls[wall, 2] * pattern
        # Add the light of the balls on the way.
        for k in range(lights.shape[0]):
            cos_gamma = d[0] * lights[k, 0] + d[1] * lights[k, 1] + d[2] * lights[k, 2]
            chord_squared = 1.0 - (1.0 - cos_gamma * cos_gamma) / lights[k, 3]
            if cos_gamma > 0.0 and chord_squared > 0.0:
                chord = math.sqrt(chord_squared)
                red += colours[k, 0] * chord
                green += colours[k, 1] * chord
                blue += colours[k, 2] * chord
        out[i, 0], out[i, 1], out[i, 2] = red, green, blue
