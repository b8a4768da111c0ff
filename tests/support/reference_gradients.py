"""Truth and slow references for gradients (MATHS §7): a textured quad, a sphere before it, the edge sum pixel by pixel.

The quad is the one that the figures of docs/gradients.md are of: at 1.2 m, tilted, of .7 m.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.gradients.forms import Derived, surface_form
from lightwell.sh.basis import evaluate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Quad:
    """A square of radiance ``(1 + texture cos πs cos πt) · colour``, black behind, before black sky."""

    centre: tuple[float, float, float] = (0.3, 0.2, 1.1)
    towards: tuple[float, float, float] = (-0.3, 0.1, -1.0)
    half: float = 0.35
    texture: float = 0.8
    colour: tuple[float, float, float] = (1.0, 0.8, 0.5)

    def axes(self) -> Floats:
        """Return u, v and the normal, ``(3, 3)``."""
        normal = np.array(self.towards) / np.linalg.norm(self.towards)
        u = np.cross(normal, [0.3, 1.0, 0.2])
        u /= np.linalg.norm(u)
        return np.stack([u, np.cross(normal, u), normal])

    def emitted(self, s: Floats, t: Floats) -> Floats:
        shine = 1 + self.texture * np.cos(np.pi * s) * np.cos(np.pi * t)
        return np.asarray(shine[..., None] * np.array(self.colour))

    def pieces(self, nodes: int = 32) -> tuple[Floats, Floats, Floats, Floats]:
        """Return points, normals, areas and radiance of a Gauss–Legendre rule."""
        x, w = np.polynomial.legendre.leggauss(nodes)
        s, t = (grid.reshape(-1) for grid in np.meshgrid(x, x))
        u, v, normal = self.axes()
        points = np.array(self.centre) + self.half * (s[:, None] * u + t[:, None] * v)
        areas = np.outer(w, w).reshape(-1) * self.half**2
        return points, np.tile(normal, (len(points), 1)), areas, self.emitted(s, t)

    def derived(self, origin: Floats, bands: int, nodes: int = 32) -> Derived:
        """Return the exact coefficients and gradients at a point before the quad."""
        return surface_form(origin, *self.pieces(nodes), bands)

    def seen(self, origin: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """Return radiance ``(…, 3)`` and distance ``(…)`` along directions; 0 and infinite beside the quad."""
        u, v, normal = self.axes()
        facing = directions @ normal
        ahead = (np.array(self.centre) - origin) @ normal
        distance = np.divide(ahead, facing, out=np.full(facing.shape, np.inf), where=facing < -1e-12)
        at = np.where(np.isfinite(distance), distance, 0)[..., None] * directions + origin - np.array(self.centre)
        s, t = at @ u / self.half, at @ v / self.half
        hit = (distance > 0) & np.isfinite(distance) & (np.abs(s) <= 1) & (np.abs(t) <= 1)
        return np.where(hit[..., None], self.emitted(s, t), 0), np.where(hit, distance, np.inf)


@dataclass(frozen=True)
class Occluded:
    """A black sphere before the quad, all of it within the quad's outline as seen from near the origin."""

    quad: Quad = Quad()
    centre: tuple[float, float, float] = (0.15, 0.1, 0.55)
    radius: float = 0.07

    def coefficients(self, origin: Floats, bands: int) -> Floats:
        """Return the exact coefficients: the quad's less what the sphere's cone of directions hides of it."""
        towards = np.array(self.centre) - origin
        distance = float(np.linalg.norm(towards))
        axis = towards / distance
        side = np.cross(axis, [1.0, 0.0, 0.0])
        side /= np.linalg.norm(side)
        lowest = np.sqrt(1 - (self.radius / distance) ** 2)
        x, w = np.polynomial.legendre.leggauss(24)
        cosine = lowest + (1 - lowest) * (x + 1) / 2
        sine = np.sqrt(1 - cosine**2)[:, None, None]
        turns = 2 * np.pi * np.arange(48) / 48
        ring = np.cos(turns)[:, None] * side + np.sin(turns)[:, None] * np.cross(axis, side)
        directions = (cosine[:, None, None] * axis + sine * ring).reshape(-1, 3)
        weights = np.repeat(w * (1 - lowest) / 2 * 2 * np.pi / 48, 48)
        hidden = np.einsum("n,nc,ni->ic", weights, self.quad.seen(origin, directions)[0], evaluate(directions, bands))
        return np.asarray(self.quad.derived(origin, bands).coefficients - hidden)

    def seen(self, origin: Floats, directions: Floats) -> tuple[Floats, Floats]:
        """As `Quad.seen`."""
        radiance, distance = self.quad.seen(origin, directions)
        towards = np.array(self.centre) - origin
        along = directions @ towards
        inside = along**2 - (towards @ towards - self.radius**2)
        hit = (inside > 0) & (along > 0)
        near = along - np.sqrt(np.maximum(inside, 0))
        return np.where(hit[..., None], 0, radiance), np.where(hit, near, distance)


def finite_difference(coefficients: Callable[[Floats], Floats], origin: Floats, step: float = 1e-3) -> Floats:
    """Return ``∂c/∂(x, y, z)`` of a function of a point, by five-point differences: ``(…, 3)``."""
    slopes = []
    for axis in np.eye(3):
        near = coefficients(origin + step * axis) - coefficients(origin - step * axis)
        far = coefficients(origin + 2 * step * axis) - coefficients(origin - 2 * step * axis)
        slopes.append((8 * near - far) / (12 * step))
    return np.stack(slopes, axis=-1)


def latlong_directions(height: int, width: int) -> Floats:
    """Return the directions of the pixels' centres, ``(H, W, 3)``."""
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    phi = 2 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    return _directions(theta, phi)


def _directions(theta: Floats, phi: Floats) -> Floats:
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta) + 0 * phi], axis=-1)


def edge_sum(image: Floats, inverse: Floats, bands: int, seen: NDArray[np.bool_] | None = None) -> Floats:
    """Return the jump form of MATHS §7.5, edge by edge, with the mean of 1/r on a surface: ``(bands², 3, 3)``."""

    def moving(one: Floats, other: Floats) -> Floats:
        near, far = np.maximum(one, other), np.minimum(one, other)
        return np.where(near > 1.1 * far, near, (near + far) / 2)

    height, width, _ = image.shape
    mask = np.ones((height, width)) if seen is None else seen.astype(float)
    out = np.zeros((bands * bands, 3, 3))
    phi = 2 * np.pi * (np.arange(width) + 0.5)[None, :] / width
    edge = phi + np.pi / width
    theta = np.pi * (np.arange(height) + 0.5)[:, None] / height
    right = np.roll(image, -1, axis=1) - image
    weight = moving(inverse, np.roll(inverse, -1, axis=1)) * mask * np.roll(mask, -1, axis=1) * np.pi / height
    tangent = np.broadcast_to(np.stack([-np.sin(edge), np.cos(edge), 0 * edge], axis=-1), image.shape)
    basis = evaluate(_directions(theta, edge), bands)
    out += np.einsum("ijn,ijc,ij,ijk->nck", basis, right, weight, tangent, optimize=True)
    between = np.pi * np.arange(1, height)[:, None] / height
    down = image[1:] - image[:-1]
    length = np.sin(between) * 2 * np.pi / width
    weight = moving(inverse[1:], inverse[:-1]) * mask[1:] * mask[:-1] * length
    tangent = np.stack(
        [np.cos(between) * np.cos(phi), np.cos(between) * np.sin(phi), -np.sin(between) + 0 * phi], axis=-1
    )
    basis = evaluate(_directions(between, phi), bands)
    return np.asarray(out + np.einsum("ijn,ijc,ij,ijk->nck", basis, down, weight, tangent, optimize=True))


AWAY = {0.04: (0.082, 0.006), 0.08: (0.160, 0.022), 0.17: (0.330, 0.091), 0.25: (0.480, 0.201), 0.42: (0.82, 0.57)}
"""Steps as shares of the mean distance: relative errors without and with the gradient (MATHS §7.4)."""
BETWEEN = {
    0.3: {"trilinear": 0.0767, "full": 0.0744, "half": 0.0054, "Shepard": 0.108, "Shepard, full": 0.091},
    0.15: {"trilinear": 0.0196, "full": 0.0195, "half": 0.00066, "Shepard": 0.042, "Shepard, full": 0.023},
}
"""Sizes of a cell in metres: relative errors within it (MATHS §7.8)."""


def _rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def moving_away(quad: Quad, bands: int = 5) -> list[tuple[float, float, float, tuple[float, float]]]:
    """Return ``(share, error without, error with gradient, MATHS's)``: rms over 26 directions, relative to c."""
    points, normals, areas, light = quad.pieces()
    r = np.linalg.norm(points, axis=1)
    seen = -areas * np.sum(normals * points, axis=1) / r**3 * light[:, 1]
    mean_distance = float(seen.sum() / (seen / r).sum())
    c, gradients = quad.derived(np.zeros(3), bands)
    ways = np.array([way for way in itertools.product((-1.0, 0, 1), repeat=3) if any(way)])
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    rows = []
    for share, given in AWAY.items():
        without, with_gradient = [], []
        for step in share * mean_distance * ways:
            change = quad.derived(step, bands).coefficients - c
            without.append(float(np.linalg.norm(change) / np.linalg.norm(c)))
            with_gradient.append(float(np.linalg.norm(change - gradients @ step) / np.linalg.norm(c)))
        rows.append((share, _rms(without), _rms(with_gradient), given))
    return rows


def between_samples(quad: Quad, bands: int = 5) -> list[tuple[float, str, float, float]]:
    """Return ``(cell size, way, error, MATHS's)``: rms over 100 points in a cell round the origin, relative to c."""
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    places = np.random.default_rng(0).uniform(size=(100, 3))
    rows = []
    for size, given in BETWEEN.items():
        positions = (corners - 0.5) * size
        samples = [quad.derived(position, bands) for position in positions]
        c, slopes = np.array([one.coefficients for one in samples]), np.array([one.gradients for one in samples])
        errors: dict[str, list[float]] = {way: [] for way in given}
        for place in places:
            point = (place - 0.5) * size
            truth = quad.derived(point, bands).coefficients
            steps = np.einsum("nick,nk->nic", slopes, point - positions)
            linear = np.prod(np.where(corners > 0, place, 1 - place), axis=1)
            shepard = 1 / np.sum((point - positions) ** 2, axis=1)
            shepard /= shepard.sum()
            found = {
                "trilinear": np.tensordot(linear, c, 1),
                "full": np.tensordot(linear, c + steps, 1),
                "half": np.tensordot(linear, c + 0.5 * steps, 1),
                "Shepard": np.tensordot(shepard, c, 1),
                "Shepard, full": np.tensordot(shepard, c + steps, 1),
            }
            for way, light in found.items():
                errors[way].append(float(np.linalg.norm(light - truth) / np.linalg.norm(truth)))
        rows += [(size, way, _rms(errors[way]), given[way]) for way in given]
    return rows
