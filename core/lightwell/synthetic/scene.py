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

An emitter's coefficients at a point are ``∫ L Y |n·r|/|r|³ dA`` over its rectangle. The integrand is smooth (the screen's
edge cuts the lens along a line of constant s, and only the part that it leaves is integrated), so that a Gauss–Legendre
product rule converges quickly.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import coefficient_count
from lightwell.sh.basis import basis_at

Floats = NDArray[np.float64]
Vector = tuple[float, float, float]

EMITTERS = {"area": 0, "projector": 1, "spot": 2}
SQUARES = np.array([[4.0, 0.6, 0.4], [0.5, 3.0, 0.6], [0.5, 0.8, 4.0], [3.2, 2.8, 0.5]])
"""Colours of the projector's four squares."""
EDGE = 0.12
"""Width of the smooth edges of squares and cone, as a share of the picture's half-size."""
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
        """Return the radiance that arrives at ``origins`` ``(…, 3)`` from unit ``directions`` ``(…, 3)``, ``(…, 3)``."""
        start, towards = np.broadcast_arrays(
            np.asarray(origins, dtype=np.float64), np.asarray(directions, dtype=np.float64)
        )
        out = np.empty((start.size // 3, 3))
        trace(
            np.ascontiguousarray(start.reshape(-1, 3)),
            np.ascontiguousarray(towards.reshape(-1, 3)),
            *self.tables(),
            out,
        )
        return out.reshape(start.shape)

    def coefficients(self, points: ArrayLike, bands: int) -> Floats:
        """Return the exact coefficients at ``points`` ``(…, 3)``: ``(…, bands², 3)`` float64, to 1e-6 or better."""
        flat = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        out = np.zeros((len(flat), coefficient_count(bands), 3))
        rules = [np.polynomial.legendre.leggauss(count) for count in (AREA_NODES, LENS_NODES, WALL_NODES)]
        emitters, room, far = self.tables()
        _integrate(flat, emitters, room, far, bands, *(array for rule in rules for array in rule), out)
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

    def frozen(value: object) -> object:
        return tuple(frozen(item) for item in value) if isinstance(value, list | tuple) else value

    fields = {key: frozen(value) for key, value in document.items() if key != "emitters"}
    emitters = tuple(
        Emitter(**{key: frozen(value) for key, value in emitter.items()}) for emitter in document.get("emitters", ())
    )
    return Scene(**fields, emitters=emitters)  # type: ignore[arg-type]


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
    "constant": Scene("constant", far=(1.0, 0.8, 0.6)),
    "distant": Scene("distant", far=(0.3, 0.35, 0.4), far_lobe=(8.0, 7.0, 5.0)),
}
"""``cube``: the simulation of MATHS §6. ``scene1``, ``scene2``: the two of paper 000. ``constant`` and ``distant``: no
change in space."""


@njit(cache=True, nogil=True)
def _rise(x):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Smooth step: 0 below 0, 1 above 1, four times differentiable (its quadrature converges)."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * x * x * x * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + 70.0 * x))))


@njit(cache=True, nogil=True)
def _emitted(row, s, t, a, b, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write the radiance that leaves an emitter at (s, t) ∈ [−1, 1]² towards the slopes (a, b) along u and v."""
    kind = int(row[0])
    if kind == 0:
        factor = 1.0 + row[13] * math.cos(math.pi * s) * math.cos(math.pi * t)
        out[0], out[1], out[2] = factor * row[10], factor * row[11], factor * row[12]
        return
    a, b = a / row[13], b / row[13]
    if kind == 1:
        # Each quarter of the picture holds a square from .1 to .9 of its side.
        x, y = abs(a), abs(b)
        inside = _rise((x - 0.1) / EDGE) * _rise((0.9 - x) / EDGE) * _rise((y - 0.1) / EDGE) * _rise((0.9 - y) / EDGE)
        square = (0 if a > 0 else 1) + (0 if b > 0 else 2)
        for channel in range(3):
            out[channel] = inside * SQUARES[square, channel] / 4.0 * row[10 + channel]
        return
    inside = _rise((1.0 - math.sqrt(a * a + b * b)) / EDGE)
    for channel in range(3):
        out[channel] = inside * row[10 + channel]


@njit(cache=True, nogil=True)
def _wall(position, wall, room, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    axis = wall // 2
    u = position[(axis + 1) % 3] / room[0, (axis + 1) % 3]
    v = position[(axis + 2) % 3] / room[0, (axis + 2) % 3]
    pattern = 1.0 + room[7, 0] * math.cos(2.0 * math.pi * u) * math.cos(math.pi * v)
    for channel in range(3):
        out[channel] = room[1 + wall, channel] * pattern


@njit(cache=True, nogil=True)
def _background(o, d, room, far, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if room[0, 0] == 0.0:
        cosine = d[0] * far[2, 0] + d[1] * far[2, 1] + d[2] * far[2, 2]
        lobe = (0.5 + 0.5 * cosine) ** 4
        for channel in range(3):
            out[channel] = far[0, channel] + lobe * far[1, channel]
        return
    nearest, wall = np.inf, 0
    for axis in range(3):
        if d[axis] == 0.0:
            continue
        side = room[0, axis] if d[axis] > 0 else -room[0, axis]
        distance = (side - o[axis]) / d[axis]
        if distance < nearest:
            nearest, wall = distance, 2 * axis + (0 if d[axis] > 0 else 1)
    hit = np.empty(3)
    for axis in range(3):
        hit[axis] = o[axis] + nearest * d[axis]
    _wall(hit, wall, room, out)


@njit(cache=True, nogil=True)
def trace_one(o, d, emitters, room, far, out, light):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write the radiance from direction ``d`` at ``o`` to ``out`` (3,); ``light`` (3,) is scratch."""
    _background(o, d, room, far, out)
    for e in range(emitters.shape[0]):
        row = emitters[e]
        ux, uy, uz, vx, vy, vz = row[4], row[5], row[6], row[7], row[8], row[9]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        facing = nx * d[0] + ny * d[1] + nz * d[2]
        if facing >= 0.0:
            continue
        rx, ry, rz = row[1] - o[0], row[2] - o[1], row[3] - o[2]
        distance = (nx * rx + ny * ry + nz * rz) / facing
        if distance <= 0.0:
            continue
        x, y, z = distance * d[0] - rx, distance * d[1] - ry, distance * d[2] - rz
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        s, t = (x * ux + y * uy + z * uz) / uu, (x * vx + y * vy + z * vz) / vv
        if abs(s) > 1.0 or abs(t) > 1.0:
            continue
        size_u, size_v = math.sqrt(uu), math.sqrt(vv)
        depth = -facing / (size_u * size_v)
        a = -(d[0] * ux + d[1] * uy + d[2] * uz) / size_u / depth
        b = -(d[0] * vx + d[1] * vy + d[2] * vz) / size_v / depth
        if row[14] > 0.0 and s * size_u + a * row[14] < 0.0:
            continue  # the ray passes the screen's dark side
        _emitted(row, s, t, a, b, light)
        for channel in range(3):
            out[channel] += light[channel]


@njit(cache=True, nogil=True)
def trace(origins, directions, emitters, room, far, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write the radiance of rays ``(n, 3)`` to ``out`` ``(n, 3)``."""
    light = np.empty(3)
    for i in range(out.shape[0]):
        trace_one(origins[i], directions[i], emitters, room, far, out[i], light)


@njit(cache=True, nogil=True)
def _add(solid_angle, light, basis, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for k in range(basis.shape[0]):
        for channel in range(3):
            out[k, channel] += solid_angle * light[channel] * basis[k]


@njit(cache=True, nogil=True)
def _integrate(  # type: ignore[no-untyped-def]  # noqa: ANN202
    points,
    emitters,
    room,
    far,
    bands,
    area_x,
    area_w,
    lens_x,
    lens_w,
    wall_x,
    wall_w,
    out,  # noqa: ANN001
):
    basis, light, r, position = np.empty(bands * bands), np.empty(3), np.empty(3), np.empty(3)
    for i in range(points.shape[0]):
        x = points[i]
        for e in range(emitters.shape[0]):
            row = emitters[e]
            u, v = row[4:7], row[7:10]
            n = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
            area = math.sqrt((n * n).sum())
            size_u, size_v = math.sqrt((u * u).sum()), math.sqrt((v * v).sum())
            depth = ((x - row[1:4]) * n).sum() / area
            if depth <= 0.0:
                continue
            along_u = ((x - row[1:4]) * u).sum() / size_u
            along_v = ((x - row[1:4]) * v).sum() / size_v
            first = -1.0
            if row[14] > 0.0:
                # The ray from s crosses the screen at s·size·(1 − screen/depth) + along·screen/depth: seen where ≥ 0.
                first = max(-1.0, -along_u * row[14] / depth / (size_u * (1.0 - row[14] / depth)))
                if first >= 1.0:
                    continue
            nodes, weights = (area_x, area_w) if row[0] == 0 else (lens_x, lens_w)
            for j in range(nodes.shape[0]):
                s = first + (1.0 - first) * 0.5 * (nodes[j] + 1.0)
                for k in range(nodes.shape[0]):
                    t = nodes[k]
                    squared = 0.0
                    for axis in range(3):
                        r[axis] = row[1 + axis] + s * u[axis] + t * v[axis] - x[axis]
                        squared += r[axis] * r[axis]
                    length = math.sqrt(squared)
                    measure = weights[j] * 0.5 * (1.0 - first) * weights[k] * area * depth / (squared * length)
                    _emitted(row, s, t, (along_u - s * size_u) / depth, (along_v - t * size_v) / depth, light)
                    basis_at(r[0] / length, r[1] / length, r[2] / length, bands, basis)
                    _add(measure, light, basis, out[i])
        if room[0, 0] == 0.0:
            _integrate_far(far, bands, wall_x, wall_w, basis, light, out[i])
            continue
        for wall in range(6):
            axis, side = wall // 2, 1.0 if wall % 2 == 0 else -1.0
            one, two = (axis + 1) % 3, (axis + 2) % 3
            for j in range(wall_x.shape[0]):
                for k in range(wall_x.shape[0]):
                    position[axis] = side * room[0, axis]
                    position[one] = wall_x[j] * room[0, one]
                    position[two] = wall_x[k] * room[0, two]
                    squared = 0.0
                    for component in range(3):
                        r[component] = position[component] - x[component]
                        squared += r[component] * r[component]
                    length = math.sqrt(squared)
                    measure = wall_w[j] * wall_w[k] * room[0, one] * room[0, two] * abs(r[axis]) / (squared * length)
                    _wall(position, wall, room, light)
                    basis_at(r[0] / length, r[1] / length, r[2] / length, bands, basis)
                    _add(measure, light, basis, out[i])


@njit(cache=True, nogil=True)
def _integrate_far(far, bands, nodes, weights, basis, light, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Project the far environment, a polynomial of degree 4: a product rule is exact."""
    columns = 2 * nodes.shape[0]
    o, d = np.zeros(3), np.empty(3)
    room = np.zeros((8, 3))
    for j in range(nodes.shape[0]):
        sine = math.sqrt(1.0 - nodes[j] * nodes[j])
        for k in range(columns):
            phi = 2.0 * math.pi * k / columns
            d[0], d[1], d[2] = sine * math.cos(phi), sine * math.sin(phi), nodes[j]
            _background(o, d, room, far, light)
            basis_at(d[0], d[1], d[2], bands, basis)
            _add(weights[j] * 2.0 * math.pi / columns, light, basis, out)
