"""What surfaces do with light: glTF's metallic-roughness model as a matte part and a Phong lobe (paper 004 §3.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.igi.textures import Texture

Colour = tuple[float, float, float]

DIELECTRIC = 0.04
"""Reflectance of a dielectric seen head-on: that of glTF 2.0, for an index of refraction of 1.5."""
BRIGHTEST = 1e30
"""Largest emission and power of a lamp: what comes of more does not fit into a float32."""
SHARPEST = 1e4
"""Largest Phong exponent; a few bands of harmonics show nothing of one above 10 or so."""


@dataclass(frozen=True, eq=False)
class IgiMaterial:
    """A matte part ``kd``, a Phong lobe ``ks`` and emission.

    With b the base colour, m the metallic share and f the reflectance of the rest:
    ``kd = b (1 − m)(1 − f)``, ``ks = f (1 − m) + b m``. The lobe's exponent is that of `phong_exponent`.
    """

    base: Colour | None = None
    """Linear Rec. 709, 0 … 1; None: the albedo of the mesh's vertices."""
    metallic: float = 0.0
    roughness: float = 1.0
    specular: float = DIELECTRIC
    """f: reflectance, seen head-on, of what is not metal; 0: matte."""
    emission: Colour = (0.0, 0.0, 0.0)
    """Radiance of the front, and of the back where that is seen, W·sr⁻¹·m⁻²."""
    base_texture: Texture | None = None
    """Three channels that the base colour is multiplied with."""
    metallic_roughness_texture: Texture | None = None
    """Multiplies the roughness with its second channel and the metallic share with its third."""
    emission_texture: Texture | None = None
    """Three channels that the emission is multiplied with."""
    normal_texture: Texture | None = None
    """Normals in tangent space, ``2 t − 1``, x along the tangent."""
    normal_scale: float = 1.0
    """Multiplies x and y of those normals."""
    bump_texture: Texture | None = None
    """Heights, first channel."""
    bump_metres: float = 0.0
    """Height of the value 1 of the bump texture."""
    alpha: float = 1.0
    """Share of the surface that is there, 0 … 1."""
    alpha_texture: Texture | None = None
    """One channel that alpha is multiplied with."""
    transmission: float = 0.0
    """Share of the light that goes straight through what is there and no metal, 0 … 1."""
    transmission_texture: Texture | None = None
    """Multiplies that with its first channel."""
    hole_below: float = 0.0
    """There is a hole where ``alpha (1 − transmission (1 − metallic))`` is less (`igi.coverage`); 0: nowhere."""
    two_sided: bool = False
    """The back is seen too, and reflects; else rays from the camera pass it, and light that falls on it is lost."""

    def __post_init__(self) -> None:
        for name in ("metallic", "roughness", "specular", "alpha", "transmission"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)} must lie between 0 and 1")
        if self.base is not None and not all(0 <= value <= 1 for value in self.base):
            raise ValueError(f"base = {self.base} must lie between 0 and 1")
        if not all(0 <= value <= BRIGHTEST for value in self.emission):
            raise ValueError(f"emission = {self.emission} must be finite and not negative, at most {BRIGHTEST:g}")
        if not (np.isfinite(self.bump_metres) and np.isfinite(self.normal_scale)):
            raise ValueError("bump_metres and normal_scale must be finite")
        wanted = {"base_texture": 3, "metallic_roughness_texture": 3, "emission_texture": 3, "normal_texture": 3}
        wanted |= {"alpha_texture": 1}
        for name, channels in wanted.items():
            texture: Texture | None = getattr(self, name)
            if texture is not None and texture.pixels.shape[2] != channels:
                raise ValueError(f"{name} has {texture.pixels.shape[2]} channels; {channels} are needed")
        if self.normal_texture is not None and self.bump_texture is not None:
            raise ValueError("a surface has a normal texture or a bump texture, not both: leave one out")

    @property
    def emits(self) -> bool:
        """Whether it is a lamp."""
        return any(self.emission)

    @property
    def textures(self) -> tuple[Texture, ...]:
        """All that it has."""
        every = (
            self.base_texture,
            self.metallic_roughness_texture,
            self.emission_texture,
            self.normal_texture,
            self.bump_texture,
            self.alpha_texture,
            self.transmission_texture,
        )
        return tuple(texture for texture in every if texture is not None)


def phong_exponent(roughness: ArrayLike) -> NDArray[np.float64]:
    """Return the exponent of the Phong lobe about the mirror direction for glTF's roughness.

    glTF's width is ``α = roughness²``. A microfacet lobe of the width α is near a Blinn–Phong lobe of the exponent
    ``2/α² − 2`` (Walter et al. 2007, "Microfacet models for refraction"), and that is near a Phong lobe of a quarter
    of it, since the half vector turns by half the angle (Fisher and Woo 1994, "R·E versus N·H"):
    ``s = (1/α² − 1)/2``. Fully rough is 0, a hemisphere; at most `SHARPEST`.
    """
    alpha = np.maximum(np.asarray(roughness, np.float64) ** 2, 1e-4)
    return np.asarray(np.minimum((1 / (alpha * alpha) - 1) / 2, SHARPEST))
