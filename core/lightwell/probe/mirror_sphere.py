"""Mirror sphere seen by a perspective camera at a finite distance (MATHS §3)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from lightwell.conventions import DEFAULT_FORWARD, DEFAULT_UP
from lightwell.errors import MappingError
from lightwell.probe.disc import Disc, RoundMapping, check_disc_is_imaged
from lightwell.probe.mapping import Bools, Floats

RADIUS_TOLERANCE = 0.05
"""Largest relative disagreement between the disc's given radius and the one that the other inputs predict."""


@dataclass(frozen=True)
class SphereView:
    """Where the sphere is, in camera axes (x right, y up, z backwards)."""

    ratio: float
    """k = R/D: radius of the sphere over distance from the camera to its centre."""
    principal_distance: float
    """c, pixels: distance from the centre of projection to the picture."""
    axis: tuple[float, float, float] = (0.0, 0.0, -1.0)
    """Unit vector from the camera to the sphere's centre."""


class MirrorSphere(RoundMapping):
    """Each pixel's ray d meets the sphere at P with normal n and leaves along ``ω = d − 2(d·n)n``.

    With ψ the angle between d and the axis a, ``sin i = sinψ/k`` and ``β = ∠(ω, −a) = 2i − ψ``. The cone of half-angle
    ``asin k`` around +a is hidden behind the sphere. All lengths are in units of D. The principal point is the
    picture's centre.
    """

    kind: ClassVar[str] = "mirror-sphere"

    def __init__(
        self,
        height: int,
        width: int,
        view: SphereView,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        if not 0 < view.ratio < 1:
            raise MappingError(
                f"--sphere-radius-m must be smaller than --sphere-distance-m (their ratio is {view.ratio:g}): "
                "the distance is from the camera to the sphere's centre"
            )
        self.view = view
        self._axis = np.array(view.axis)
        scale = view.principal_distance / -self._axis[2]
        centre = (width / 2 + scale * self._axis[0], height / 2 - scale * self._axis[1])
        super().__init__(height, width, centre, forward, up)
        self.blind_axis = self.world_from_camera @ self._axis
        self.blind_half_angle = math.asin(view.ratio)
        tilt = math.acos(min(1.0, -view.axis[2]))
        check_disc_is_imaged(self, (*centre, outline(view.principal_distance, self.blind_half_angle, tilt).radius))

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, self.view)

    def _camera_rays(self, x: ArrayLike, y: ArrayLike) -> Floats:
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        c = self.view.principal_distance
        rays = np.stack([(x - self.width / 2) / c, (self.height / 2 - y) / c, np.full(x.shape, -1.0)], axis=-1)
        return _unit(rays)

    def sees(self, x: ArrayLike, y: ArrayLike) -> Bools:
        """Return whether the rays of picture points meet the sphere."""
        x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
        c, (ax, ay, az) = self.view.principal_distance, self.view.axis
        u, v = (x - self.width / 2) / c, (self.height / 2 - y) / c
        towards = u * ax + v * ay - az
        return (towards > 0) & (towards * towards >= (1 - self.view.ratio**2) * (u * u + v * v + 1) * (1 - 1e-12))

    def _sin_psi(self, rays: Floats) -> Floats:
        return np.asarray(np.linalg.norm(np.cross(rays, self._axis), axis=-1))

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the reflected directions of picture points, and whether their rays meet the sphere."""
        k = self.view.ratio
        rays = self._camera_rays(x, y)
        sin_psi = self._sin_psi(rays)
        towards = rays @ self._axis
        # t = d·S − √((d·S)² − (1 − k²)); the root is √(k² − sin²ψ), which loses no digits.
        distance = towards - np.sqrt(np.maximum(k * k - sin_psi * sin_psi, 0))
        normal = (distance[..., None] * rays - self._axis) / k
        reflected = rays - 2 * np.sum(rays * normal, axis=-1, keepdims=True) * normal
        return _unit(reflected) @ self.world_from_camera.T, self.sees(x, y)

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions: Newton on ``g(i) = 2i − asin(k sin i) − β`` (MATHS §3)."""
        k = self.view.ratio
        camera = np.asarray(directions, dtype=np.float64) @ self.world_from_camera
        along = camera @ self._axis
        across = camera - along[..., None] * self._axis
        sin_beta = np.linalg.norm(across, axis=-1)
        beta = np.arctan2(sin_beta, -along)
        # Straight behind the sphere, and straight back at the camera, every sideways direction is as good.
        sideways = np.where(sin_beta[..., None] > 0, across / np.maximum(sin_beta, 1e-300)[..., None], self._any_side())
        incidence = beta / 2
        for _ in range(4):
            sine = k * np.sin(incidence)
            slope = 2 - k * np.cos(incidence) / np.sqrt(1 - sine * sine)
            incidence = incidence - (2 * incidence - np.arcsin(sine) - beta) / slope
        psi = np.arcsin(k * np.sin(np.minimum(incidence, math.pi / 2)))
        rays = np.cos(psi)[..., None] * self._axis + np.sin(psi)[..., None] * sideways
        scale = self.view.principal_distance / -rays[..., 2]
        seen = beta <= math.pi - self.blind_half_angle + 1e-12
        return self.width / 2 + scale * rays[..., 0], self.height / 2 - scale * rays[..., 1], seen

    def _any_side(self) -> Floats:
        return _unit(np.cross(self._axis, (0.0, 1.0, 0.0)))

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return ``J cos³ / c²``, ``J = (sinβ/sinψ)(2cosψ/(k cos i) − 1)``; cos: of the angle to the camera's axis."""
        k = self.view.ratio
        rays = self._camera_rays(x, y)
        sin_psi = np.clip(self._sin_psi(rays), 1e-100, k * (1 - 1e-15))
        psi, incidence = np.arcsin(sin_psi), np.arcsin(sin_psi / k)
        jacobian = np.sin(2 * incidence - psi) / sin_psi * (2 * np.cos(psi) / (k * np.cos(incidence)) - 1)
        return np.asarray(jacobian * (-rays[..., 2]) ** 3 / self.view.principal_distance**2)


def _unit(vectors: Floats) -> Floats:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


@dataclass(frozen=True)
class Outline:
    """The ellipse in which the camera sees the sphere."""

    offset: float
    """Distance of its centre from the principal point, pixels."""
    major: float
    """Semi-axis that points to the principal point, pixels."""
    radius: float
    """Radius of the circle of the same area, pixels."""


def outline(c: float, psi: float, alpha: float) -> Outline:
    """Return the outline of a sphere of angular radius ψ at the angle α from the optical axis.

    The cone of half-angle ψ cuts the picture in an ellipse whose ends lie at ``c tan(α ± ψ)``.
    """
    total = math.cos(2 * alpha) + math.cos(2 * psi)
    major = c * math.sin(2 * psi) / total
    return Outline(c * math.sin(2 * alpha) / total, major, major * _roundness(alpha, psi))


def _roundness(alpha: float, psi: float) -> float:
    """Return √(minor/major) of the outline."""
    return math.sqrt(math.sqrt(max(1 - (math.sin(alpha) / math.cos(psi)) ** 2, 1e-12)))


def solve_view(
    height: int,
    width: int,
    fov_degrees: float | None,
    radius_m: float | None,
    distance_m: float | None,
    disc: Disc | None,
) -> SphereView:
    """Return the view of the sphere from any two of field of view, radius over distance, and disc.

    ``fov_degrees`` is across the picture's width. The disc is the circle that fits the sphere's outline; where its
    centre is not the picture's, the sphere stands off the optical axis.

    Raises
    ------
    MappingError
        Where too little is given (it names the options), or where everything is given and the disc's radius differs
        by more than 5 % from the one that follows from the rest.
    """
    ratio = radius_m / distance_m if radius_m is not None and distance_m is not None else None
    if fov_degrees is not None and not 0.01 <= fov_degrees <= 170:
        raise MappingError(f"--fov-degrees: a perspective camera sees 0.01 … 170 degrees, not {fov_degrees:g}")
    if ratio is not None and not 0 < ratio < 1:
        raise MappingError(
            f"--sphere-radius-m ({radius_m:g}) must be smaller than --sphere-distance-m ({distance_m:g}), "
            "which is from the camera to the sphere's centre"
        )
    c = width / 2 / math.tan(math.radians(fov_degrees) / 2) if fov_degrees is not None else None
    dx, dy = (disc[0] - width / 2, height / 2 - disc[1]) if disc is not None else (0.0, 0.0)
    offset = math.hypot(dx, dy)

    if c is not None and ratio is not None:
        psi = math.asin(ratio)
        # c sin2α − e cos2α = e cos2ψ, from the outline's centre e = c sin2α / (cos2α + cos2ψ).
        alpha = (math.atan2(offset, c) + math.asin(offset * math.cos(2 * psi) / math.hypot(c, offset))) / 2
        predicted = outline(c, psi, alpha).radius
        if disc is not None and abs(disc[2] / predicted - 1) > RADIUS_TOLERANCE:
            raise MappingError(
                f"the sphere's disc should have a radius of {predicted:.1f} pixels by --fov-degrees, "
                f"--sphere-radius-m and --sphere-distance-m, but --disc says {disc[2]:.1f}: correct or leave out one"
            )
    elif disc is not None and (c is not None or ratio is not None):
        ratio, c, alpha = _solve_from_disc(offset, disc[2], c, ratio)
    else:
        raise MappingError(
            "a mirror sphere needs two of: --fov-degrees; --sphere-radius-m with --sphere-distance-m; --disc cx,cy,r. "
            f"Missing: {_missing(fov_degrees, radius_m, distance_m, disc)}"
        )
    sideways = math.sin(alpha) / offset if offset > 0 else 0.0
    return SphereView(ratio, c, (dx * sideways, dy * sideways, -math.cos(alpha)))


def _solve_from_disc(offset: float, radius: float, c: float | None, ratio: float | None) -> tuple[float, float, float]:
    """Return ratio, principal distance and tilt α from the outline and one of the first two."""
    if radius <= 0:
        raise MappingError(f"--disc: the radius must be positive, not {radius:g} pixels")
    alpha, psi = 0.0, math.asin(ratio) if ratio is not None else 0.0
    distance = c if c is not None else 0.0
    for _ in range(60):
        major = radius / _roundness(alpha, psi)
        if c is not None:
            outer, inner = math.atan((offset + major) / c), math.atan((offset - major) / c)
            alpha, psi = (outer + inner) / 2, (outer - inner) / 2
        else:
            alpha = math.asin(min(1.0, offset / major * math.sin(2 * psi))) / 2
            distance = major * (math.cos(2 * alpha) + math.cos(2 * psi)) / math.sin(2 * psi)
    return math.sin(psi), distance, alpha


def _missing(fov_degrees: float | None, radius_m: float | None, distance_m: float | None, disc: Disc | None) -> str:
    names = {
        "--fov-degrees": fov_degrees,
        "--sphere-radius-m": radius_m,
        "--sphere-distance-m": distance_m,
        "--disc": disc,
    }
    return ", ".join(name for name, value in names.items() if value is None)
