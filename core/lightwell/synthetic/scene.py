"""An analytic scene without occluders: the radiance along every ray is exact, and so are the coefficients at any point.

A scene is a far environment or the textured walls of a box, and flat rectangular emitters. Light adds up: a ray that
meets an emitter carries its radiance and that of the wall behind, so that coefficients add up too. There are three
kinds of emitter, those of paper 000 (figure 8):

area
    radiance ``1 + a cos(πs) cos(πt)`` over the rectangle, the same in all directions
projector
    a small lens; the radiance depends on where the ray leaves the lens to: four coloured squares with smooth edges
spot
    a small lens with a smooth cone, half of it blocked by the straight edge of a screen in front of the lens

An emitter's coefficients at a point are ``∫ L Y |n·r|/|r|³ dA`` over its rectangle. The integrand is smooth (the
screen's edge cuts the lens along a line of constant s, and only the part that it leaves is integrated), so that a
Gauss–Legendre product rule converges quickly.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import coefficient_count
from lightwell.synthetic.tracing import integrate, trace

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

EMITTERS = {"area": 0, "projector": 1, "spot": 2}
AREA_NODES, LENS_NODES, WALL_NODES = 24, 28, 32
COLUMNS = 17
"""Numbers that describe an emitter to the kernels."""


@dataclass(frozen=True)
class Emitter:
    """A rectangle that shines to the side from which its corners run u → v counter-clockwise (normal u × v)."""

    kind: Literal["area", "projector", "spot"]
    centre: Vector
    half_u: Vector
    """From the centre to the middle of a side, metres."""
    half_v: Vector
    """Perpendicular to ``half_u``."""
    radiance: Vector
    shape: float = 0.0
    """area: strength a of the texture; projector and spot: tangent of the half-angle of the picture."""
    screen_m: float = 0.0
    """spot: distance from the lens to the screen that blocks the half towards −u, metres; 0: no screen."""


@dataclass(frozen=True)
class Scene:
    """Emitters in a room, or before a far environment."""

    name: str
    emitters: tuple[Emitter, ...] = ()
    room_half: Vector | None = None
    """Half-size of the box round the origin, metres; None: the environment is infinitely far."""
    walls: tuple[Vector, ...] = ((0.0, 0.0, 0.0),) * 6
    """Mean radiance of the walls +X, −X, +Y, −Y, +Z, −Z."""
    wall_texture: float = 0.0
    far: Vector = (0.0, 0.0, 0.0)
    """Radiance of the far environment in all directions."""
    far_lobe: Vector = (0.0, 0.0, 0.0)
    """Radiance added at the centre of a far light, ``((1 + ω·d)/2)⁴`` elsewhere."""
    far_direction: Vector = (0.6, 0.0, 0.8)
    bounds: tuple[Vector, Vector] = ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))
    """The volume that probes may fill."""

    def to_json(self) -> dict[str, Any]:
        """Return the scene as what `scene_from_json` takes."""
        return asdict(self)

    def radiance(self, origins: ArrayLike, directions: ArrayLike) -> Floats:
        """Return the radiance ``(…, 3)`` that arrives at ``origins`` ``(…, 3)`` from unit ``directions`` ``(…, 3)``."""
        start, towards = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        out = np.empty((start.size // 3, 3))
        emitters, room, far = self.tables()
        rays = np.ascontiguousarray(start.reshape(-1, 3)), np.ascontiguousarray(towards.reshape(-1, 3))
        trace(*rays, emitters, room, far, out)
        return out.reshape(start.shape)

    def coefficients(self, points: ArrayLike, bands: int) -> Floats:
        """Return the exact coefficients at ``points`` ``(…, 3)``: ``(…, bands², 3)`` float64, to 1e-6 or better."""
        flat = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        out = np.zeros((len(flat), coefficient_count(bands), 3))
        rules = [np.polynomial.legendre.leggauss(count) for count in (AREA_NODES, LENS_NODES, WALL_NODES)]
        emitters, room, far = self.tables()
        (area_x, area_w), (lens_x, lens_w), (wall_x, wall_w) = rules
        integrate(flat, emitters, room, far, bands, area_x, area_w, lens_x, lens_w, wall_x, wall_w, out)
        return out.reshape(*np.shape(points)[:-1], *out.shape[1:])

    def tables(self) -> tuple[Floats, Floats, Floats]:
        """Return emitters ``(n, 17)``, room ``(8, 3)`` and far environment ``(3, 3)`` for the kernels."""
        emitters = np.zeros((len(self.emitters), COLUMNS))
        for row, emitter in zip(emitters, self.emitters, strict=True):
            row[0] = EMITTERS[emitter.kind]
            row[1:4], row[4:7], row[7:10] = emitter.centre, emitter.half_u, emitter.half_v
            row[10:13] = emitter.radiance
            row[13], row[14] = emitter.shape, emitter.screen_m
        room = np.zeros((8, 3))
        if self.room_half is not None:
            room[0] = self.room_half
            room[1:7] = self.walls
            room[7, 0] = self.wall_texture
        return emitters, room, np.array([self.far, self.far_lobe, self.far_direction])


def scene_from_json(document: dict[str, Any]) -> Scene:
    """Return the scene that `Scene.to_json` described; raises ``ValueError`` or ``TypeError`` where it is none."""
    fields = {key: _frozen(value) for key, value in document.items() if key != "emitters"}
    emitters = tuple(
        Emitter(**{key: _frozen(value) for key, value in emitter.items()}) for emitter in document.get("emitters", ())
    )
    return Scene(**fields, emitters=emitters)


def _frozen(value: Any) -> Any:  # noqa: ANN401
    """Return JSON's lists as tuples."""
    return tuple(_frozen(item) for item in value) if isinstance(value, list | tuple) else value


def aimed(
    kind: Literal["projector", "spot"],
    centre: Vector,
    target: Vector,
    half: float,
    radiance: Vector,
    shape: float,
    screen_m: float = 0.0,
) -> Emitter:
    """Return a square lens of half-size ``half`` metres at ``centre`` that points at ``target``."""
    axis = np.subtract(target, centre) / np.linalg.norm(np.subtract(target, centre))
    u = np.cross((0.0, 0.0, 1.0), axis)
    u = u / np.linalg.norm(u)
    v = np.cross(axis, u)
    return Emitter(kind, centre, _vector(half * u), _vector(half * v), radiance, shape, screen_m)


def _vector(values: Floats) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])


_ROOM: dict[str, Any] = {
    "room_half": (2.6, 2.3, 1.7),
    "walls": (
        (0.12, 0.1, 0.08),
        (0.05, 0.06, 0.1),
        (0.05, 0.09, 0.06),
        (0.1, 0.05, 0.05),
        (0.1, 0.1, 0.1),
        (0.04, 0.03, 0.03),
    ),
    "wall_texture": 0.5,
}

PRESETS: dict[str, Scene] = {
    "cube": Scene("cube", (Emitter("area", (0.0, 0.0, 1.0), (0.0, 0.3, 0.0), (0.3, 0.0, 0.0), (10.0, 9.0, 7.0), 0.8),)),
    "scene1": Scene(
        "scene1",
        (
            Emitter("area", (-0.4, 0.2, 1.6), (0.0, 0.3, 0.0), (0.4, 0.0, 0.0), (6.0, 5.6, 5.0), 0.4),
            aimed("projector", (1.5, -1.3, 1.2), (0.0, 0.0, 0.0), 0.05, (150.0, 150.0, 150.0), 0.22),
        ),
        **_ROOM,
    ),
    "scene2": Scene(
        "scene2",
        (
            aimed("spot", (-1.7, 0.4, 1.1), (0.0, 0.0, 0.0), 0.06, (260.0, 22.0, 14.0), 0.5, 0.25),
            aimed("spot", (1.2, 1.2, 1.4), (0.0, 0.0, -0.1), 0.05, (240.0, 250.0, 260.0), 0.13),
        ),
        **_ROOM,
    ),
    "panel": Scene(
        "panel",
        (Emitter("area", (0.2, 0.1, 1.4), (0.0, 0.35, 0.0), (0.5, 0.0, 0.0), (12.0, 11.0, 9.0), 0.3),),
        room_half=(2.6, 2.2, 1.4),
        walls=_ROOM["walls"],
        wall_texture=0.5,
        bounds=((-0.8, -0.8, -0.6), (0.8, 0.8, 0.8)),
    ),
    "constant": Scene("constant", far=(1.0, 0.8, 0.6)),
    "distant": Scene("distant", far=(0.3, 0.35, 0.4), far_lobe=(8.0, 7.0, 5.0)),
}
"""``cube``: the simulation of MATHS §6. ``scene1``, ``scene2``: the two of paper 000. ``panel``: a room with an area
light in its ceiling, so that the room's box says how far all of it is. ``constant`` and ``distant``: no change in
space."""
