"""Pictures whose radius tells the angle from the optical axis: angular map and fisheye lenses."""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from lightwell.conventions import DEFAULT_FORWARD, DEFAULT_UP
from lightwell.errors import MappingError
from lightwell.probe.disc import CentredDiscMapping, Disc
from lightwell.probe.mapping import Bools, Floats


class RadialMapping(CentredDiscMapping):
    """The picture's centre looks forward; a point at disc radius ρ looks ``θ(ρ)`` away from there."""

    @abstractmethod
    def _angle(self, rho: Floats) -> Floats:
        """Return θ of the disc radius ρ, radians."""

    @abstractmethod
    def _radius(self, theta: Floats) -> Floats:
        """Return the disc radius of θ."""

    @abstractmethod
    def _jacobian(self, rho: Floats) -> Floats:
        """Return dΩ/dA on the unit disc (MATHS §2.2)."""

    def directions(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Bools]:
        """Return the directions of picture points, and whether they lie on the disc."""
        u, v = self.disc_from_picture(x, y)
        rho = np.hypot(u, v)
        theta = self._angle(np.minimum(rho, 1))
        scale = np.sin(theta) / np.maximum(rho, 1e-300)
        camera = np.stack([u * scale, v * scale, -np.cos(theta)], axis=-1)
        return camera @ self.world_from_camera.T, self.sees(x, y)

    def pixels(self, directions: ArrayLike) -> tuple[Floats, Floats, Bools]:
        """Return the picture points of directions, and whether the field of view holds them."""
        u, v, back = np.moveaxis(np.asarray(directions, dtype=np.float64) @ self.world_from_camera, -1, 0)
        sin_theta = np.hypot(u, v)
        theta = np.arctan2(sin_theta, -back)
        seen = theta <= math.pi - self.blind_half_angle + 1e-12
        scale = np.where(sin_theta > 0, self._radius(theta) / np.maximum(sin_theta, 1e-300), 0.0)
        # Straight behind the camera every point of an angular map's rim is as good: take the one on the right.
        behind = (sin_theta == 0) & (back > 0)
        return *self.picture_from_disc(np.where(behind, self._radius(theta), u * scale), v * scale), seen

    def density(self, x: ArrayLike, y: ArrayLike) -> Floats:
        """Return J / radius²."""
        return self._jacobian(np.minimum(np.hypot(*self.disc_from_picture(x, y)), 1)) / self.radius**2


class Equidistant(RadialMapping):
    """Equidistant fisheye: ``θ = θ_m ρ``, ``J = θ_m sin(θ_m ρ)/ρ``; ``fov_degrees`` is the field across the disc."""

    kind: ClassVar[str] = "fisheye"

    def __init__(
        self,
        height: int,
        width: int,
        fov_degrees: float,
        disc: Disc | None = None,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        self.half_field = _half_field(fov_degrees)
        super().__init__(height, width, disc, forward, up)
        _set_blind_cone(self, self.half_field)

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, "equidistant", self.half_field)

    def _angle(self, rho: Floats) -> Floats:
        return self.half_field * rho

    def _radius(self, theta: Floats) -> Floats:
        return theta / self.half_field

    def _jacobian(self, rho: Floats) -> Floats:
        return self.half_field**2 * np.sinc(self.half_field * rho / np.pi)


class Angular(Equidistant):
    """Angular map (Debevec's light-probe format): the equidistant picture of the whole sphere, ``θ = πρ``."""

    kind: ClassVar[str] = "angular"

    def __init__(
        self,
        height: int,
        width: int,
        disc: Disc | None = None,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        super().__init__(height, width, 360.0, disc, forward, up)


class Equisolid(RadialMapping):
    """Equisolid fisheye: ``ρ = sin(θ/2)/sin(θ_m/2)``; J is the constant ``4 sin²(θ_m/2)``."""

    kind: ClassVar[str] = "fisheye"

    def __init__(
        self,
        height: int,
        width: int,
        fov_degrees: float,
        disc: Disc | None = None,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        self.half_field = _half_field(fov_degrees)
        self._sin_quarter_field = math.sin(self.half_field / 2)
        super().__init__(height, width, disc, forward, up)
        _set_blind_cone(self, self.half_field)

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, "equisolid", self.half_field)

    def _angle(self, rho: Floats) -> Floats:
        return 2 * np.arcsin(np.minimum(rho * self._sin_quarter_field, 1))

    def _radius(self, theta: Floats) -> Floats:
        return np.sin(theta / 2) / self._sin_quarter_field

    def _jacobian(self, rho: Floats) -> Floats:
        return np.full(np.shape(rho), 4 * self._sin_quarter_field**2)


def make_fisheye(
    lens: Literal["equidistant", "equisolid"],
    height: int,
    width: int,
    fov_degrees: float,
    disc: Disc | None,
    forward: tuple[float, float, float],
    up: tuple[float, float, float],
) -> RadialMapping:
    """Return the fisheye mapping of a lens."""
    lens_class = Equidistant if lens == "equidistant" else Equisolid
    return lens_class(height, width, fov_degrees, disc, forward, up)


def _half_field(fov_degrees: float) -> float:
    if not 0 < fov_degrees <= 360:
        raise MappingError(
            f"--fov-degrees: a fisheye's field of view is between 0 and 360 degrees, not {fov_degrees:g}"
        )
    return math.radians(fov_degrees) / 2


def _set_blind_cone(mapping: RadialMapping, half_field: float) -> None:
    if half_field < math.pi:
        mapping.blind_axis = mapping.world_from_camera[:, 2].copy()
        mapping.blind_half_angle = math.pi - half_field
