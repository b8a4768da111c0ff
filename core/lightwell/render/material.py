"""What a surface does with the light that it gets."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

HORIZON_STEPS = 257
"""Nodes of the table of `horizon_factor`; its error is below 1e-4 (tests)."""


@dataclass(frozen=True)
class Material:
    """A mix of a matte part and a Phong lobe, and on top of it the mirrored surroundings.

    ``(1 − gloss) albedo/π · irradiance + gloss · lobe + mirror · backdrop``; the last is equation 15 of paper 003.
    """

    albedo: tuple[float, float, float] | None = None
    """Linear Rec. 709 reflectance, 0 … 1; None: that of the mesh's vertices."""
    gloss: float = 0.0
    """Weight of the Phong lobe, 0 … 1."""
    exponent: float = 12.0
    """s of the lobe ``max(0, cos)^s``."""
    normalised: bool = True
    """The lobe integrates to 1 (factor (s + 1)/2π); False: peak 1, as paper 000 writes it (MATHS §8)."""
    horizon: bool = False
    """Multiply the lobe by the share of it that lies above the surface: `horizon_factor`."""
    mirror: float = 0.0
    """c_k of equation 15, 0 … 1."""
    two_sided: bool = False
    """Light the back of the surface too, without its transfer; else it is not seen from behind, as in the browser."""

    def __post_init__(self) -> None:
        for name in ("gloss", "mirror"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)} must lie between 0 and 1")
        if not (np.isfinite(self.exponent) and self.exponent >= 0):
            raise ValueError(f"exponent = {self.exponent} must be finite and not negative")
        if self.albedo is not None and not all(0 <= value <= 1 for value in self.albedo):
            raise ValueError(f"albedo = {self.albedo} must lie between 0 and 1")


def horizon_factor(cosine: ArrayLike, exponent: float) -> Floats:
    """Return the share of a Phong lobe that lies above the surface, the shape of ``cosine``.

    A lobe about a mirror direction near the horizon reaches below the surface, where no light comes from (MATHS §8).
    With α the angle to the lobe's axis and μ = ``cosine`` that of axis and normal, the share is
    ``(s+1)/π ∫_0^{π/2} cos^s α sin α φ(α) dα``, φ = arccos(−cot α μ / √(1−μ²)): ½ for μ = 0, about 1 for a narrow lobe
    well above the surface. In constant light it is what the lobe gets.
    """
    nodes, shares = _horizon_table(float(exponent))
    return np.asarray(np.interp(np.asarray(cosine, dtype=np.float64), nodes, shares))


@cache
def _horizon_table(exponent: float) -> tuple[Floats, Floats]:
    # Nodes are equally far apart in angle. With u = cos^(s+1) α the weight cos^s α sin α (s+1) dα is −du.
    angles = np.linspace(np.pi, 0, HORIZON_STEPS)
    cosines = np.cos(angles)
    t, weights = _gauss_rule()
    u = 0.5 * (t + 1)
    alpha = np.arccos(u ** (1 / (exponent + 1)))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = -cosines[:, None] / np.sqrt(1 - cosines[:, None] ** 2) / np.tan(alpha)
    ratio = np.nan_to_num(ratio, nan=0.0, posinf=1.0, neginf=-1.0)
    shares = np.arccos(np.clip(ratio, -1, 1)) / np.pi @ (0.5 * weights)
    shares[0], shares[-1] = 0.0, 1.0
    return cosines, shares


@cache
def _gauss_rule() -> tuple[Floats, Floats]:
    """Return nodes and weights of the quadrature; they take longer to find than a table takes to fill."""
    nodes, weights = legendre.leggauss(400)
    return nodes, weights
