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
    """The picture's centre looks forward; a point at disc radius ρ looks ``θ(ρ)`` away from there.

    ``fov_degrees`` is the field of view across the disc; ``half_field``, half of it in radians, is θ at the rim.
    """

    def __init__(
        self,
        height: int,
        width: int,
        fov_degrees: float,
        disc: Disc | None = None,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        self.half_field = math.radians(fov_degrees) / 2
        super().__init__(height, width, disc, forward, up)
        if self.half_field < math.pi:
            self.blind_axis = self.world_from_camera[:, 2].copy()
            self.blind_half_angle = math.pi - self.half_field

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, type(self).__name__, self.half_field)

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
    """Equidistant fisheye: ``θ = θ_m ρ``, ``J = θ_m sin(θ_m ρ)/ρ``."""

    kind: ClassVar[str] = "fisheye"

    @property
    def rim_is_weightless(self) -> bool:
        """True for the whole sphere: there the outline is the one direction straight behind the camera."""
        return self.half_field >= math.pi

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

    def _angle(self, rho: Floats) -> Floats:
        return 2 * np.arcsin(np.minimum(rho * math.sin(self.half_field / 2), 1))

    def _radius(self, theta: Floats) -> Floats:
        return np.sin(theta / 2) / math.sin(self.half_field / 2)

    def _jacobian(self, rho: Floats) -> Floats:
        return np.full(np.shape(rho), 4 * math.sin(self.half_field / 2) ** 2)


def make_fisheye(
    lens: Literal["equidistant", "equisolid"],
    height: int,
    width: int,
    fov_degrees: float,
    disc: Disc | None,
    forward: tuple[float, float, float],
    up: tuple[float, float, float],
) -> RadialMapping:
    """Return the fisheye mapping of a lens whose field of view is ``fov_degrees`` across the picture's *width*.

    The disc is the image circle. Without one it is as wide as the picture: a picture that is lower than wide cuts the
    circle off at its top and bottom.

    Raises
    ------
    MappingError
        Where the field of view is out of bounds, or the disc's rim would look further than straight back.
    """
    disc = disc if disc is not None else (width / 2, height / 2, width / 2)
    if not 1 <= fov_degrees <= 360:
        raise MappingError(f"--fov-degrees: a fisheye's field of view is 1 … 360 degrees, not {fov_degrees:g}")
    widths = disc[2] / (width / 2)
    half_field = math.radians(fov_degrees) / 2
    if lens == "equidistant":
        turns = half_field * widths / math.pi
        disc_degrees = 360 * turns
    else:
        turns = math.sin(half_field / 2) * widths
        disc_degrees = math.degrees(4 * math.asin(min(turns, 1)))
    if turns > 1 + 1e-9:
        raise MappingError(
            f"--fov-degrees {fov_degrees:g} is across the picture's width ({width} pixels); the rim of a disc with a "
            f"radius of {disc[2]:g} pixels would look further than straight back: correct one of them"
        )
    lens_class = Equidistant if lens == "equidistant" else Equisolid
    return lens_class(height, width, min(disc_degrees, 360), disc, forward, up)
