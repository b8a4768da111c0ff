"""What is in a picture by virtual lights: objects, lamps and surroundings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import Mesh
from lightwell.igi.materials import BRIGHTEST, Colour, IgiMaterial
from lightwell.igi.sky import Sky
from lightwell.render.light import StaticField

Singles = NDArray[np.float32]
Place = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class IgiObject:
    """A mesh with its material and what places textures on it."""

    mesh: Mesh
    material: IgiMaterial
    uv: tuple[Singles, ...] = ()
    """Sets of texture coordinates, ``(V, 2)`` each."""
    tangents: Singles | None = None
    """``(V, 4)``: unit tangents, and ±1 for the side of the bitangent ``w n × t``; None: from texture coordinates."""
    alpha: Singles | None = None
    """``(V,)``, 0 … 1: the material's alpha is multiplied with it; None: 1."""
    is_flat: bool = False
    """Each triangle is shaded by its own normal instead of those of its vertices."""

    def __post_init__(self) -> None:
        count, name = len(self.mesh.positions), self.mesh.name
        for number, uv in enumerate(self.uv):
            if uv.shape != (count, 2) or not np.isfinite(uv).all():
                raise ValueError(
                    f"texture coordinates {number} of object {name!r} have the shape {uv.shape}; finite ({count}, 2)"
                    " are needed"
                )
        if self.tangents is not None and self.tangents.shape != (count, 4):
            raise ValueError(f"the tangents of object {name!r} have the shape {self.tangents.shape}, not ({count}, 4)")
        if self.alpha is not None and self.alpha.shape != (count,):
            raise ValueError(f"the alpha of object {name!r} has the shape {self.alpha.shape}, not ({count},)")
        for texture in self.material.textures:
            if texture.uv_set >= len(self.uv):
                raise ValueError(f"object {name!r} has a texture but no texture coordinates {texture.uv_set}")


@dataclass(frozen=True)
class PointLight:
    """A lamp at a point, or a spot (KHR_lights_punctual)."""

    position: Place
    intensity: Colour
    """W/sr, the same in all directions, or along the axis of a spot."""
    direction: Place | None = None
    """Axis of a spot, away from the lamp; None: light goes everywhere."""
    inner_angle: float = 0.0
    """Spot: half-angle of the cone of full intensity, radians."""
    outer_angle: float = np.pi / 4
    """Spot: half-angle beyond which there is no light, radians, at most π/2."""

    def __post_init__(self) -> None:
        _require_light("the point light", self.intensity, self.position)
        if self.direction is not None:
            if not (np.isfinite(self.direction).all() and np.any(self.direction)):
                raise ValueError(f"the spot's direction {self.direction} must be finite and have a length")
            if not 0 <= self.inner_angle < self.outer_angle <= np.pi / 2:
                raise ValueError(
                    f"the spot's angles {self.inner_angle:g} and {self.outer_angle:g} must rise from 0 to π/2"
                )

    @property
    def falloff(self) -> tuple[float, float]:
        """Numbers a and b of ``clip(a cosθ + b, 0, 1)²``, θ the angle to the axis: glTF's."""
        inner, outer = np.cos(self.inner_angle), np.cos(self.outer_angle)
        slope = 1 / max(float(inner - outer), 1e-3)
        return slope, float(-outer * slope)


@dataclass(frozen=True)
class DirectionalLight:
    """A lamp so far away that its light is parallel."""

    towards: Place
    """Direction towards the lamp."""
    irradiance: Colour
    """W/m² on a surface that faces it."""

    def __post_init__(self) -> None:
        _require_light("the directional light", self.irradiance, self.towards)
        if not np.any(self.towards):
            raise ValueError("the directional light's direction must have a length")


@dataclass(frozen=True, eq=False)
class IgiScene:
    """Objects and all that shines on them. All parts of the light add up."""

    objects: tuple[IgiObject, ...]
    lamps: tuple[PointLight | DirectionalLight, ...] = ()
    """Punctual lights; emissive surfaces are lamps by themselves."""
    sky: Sky | None = None
    """Distant surroundings, also seen behind the objects."""
    field: StaticField | None = None
    """A grid of what was captured, or light groups."""


def _require_light(what: str, power: Colour, place: Place) -> None:
    if not all(0 <= value <= BRIGHTEST for value in power):
        raise ValueError(f"{what} has the power {power}, which must be finite and not negative, at most {BRIGHTEST:g}")
    if not np.isfinite(place).all():
        raise ValueError(f"{what} is at {place}, which must be finite")
