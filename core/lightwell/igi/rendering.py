"""A picture, and the tiles that it is cut into."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.surfaces import Singles

TILE = 128
"""Pixels along each side of a tile, unless it is said."""


class Tile(NamedTuple):
    """A rectangle of pixels: rows ``top … bottom − 1``, columns ``left … right − 1``."""

    top: int
    bottom: int
    left: int
    right: int


@dataclass(frozen=True, eq=False)
class IgiRendering:
    """A picture or a tile of one, ``(H, W, …)`` float32, row 0 is the top; layers that were not asked for are None."""

    lit: Singles
    """``(H, W, 3)`` linear radiance, Rec. 709, of surfaces, times `coverage`."""
    behind: Singles
    """``(H, W, 3)``: that of the sky behind them, times what they leave of the pixel; black where there is none."""
    coverage: Singles
    """``(H, W)``: share of the pixel in which there is a surface."""
    normal: Singles | None
    """``(H, W, 3)`` unit normals that materials go by, world axes, at the pixel's centre; zero where nothing is."""
    depth: Singles | None
    """``(H, W)`` metres along the viewing axis, at the pixel's centre; infinite where nothing is."""
    albedo: Singles | None
    """``(H, W, 3)``: reflectivity, of the matte part and the lobe together, times `coverage`."""
    direct: Singles | None
    """``(H, W, 3)``: emission and reflected light of lamps and sky; with `indirect` it is `lit`."""
    indirect: Singles | None
    """``(H, W, 3)``: reflected light that has been reflected before."""
    set: NDArray[np.uint16] | None
    """``(H, W)``: which set of lights was the pixel's own."""
    coefficients: Singles | None
    """``(H, W, bands², 3)``: incident radiance at the pixel's centre after the filter; before those of irradiance."""
    arrived: float
    """Light that arrived at the pixels, summed over lights and channels, with what the filter needs around them."""
    clamped: float
    """What would have come on top without the clamp."""
    rays: int
    """Shadow rays."""

    @property
    def colour(self) -> Singles:
        """``(H, W, 3)`` linear radiance, Rec. 709: of surfaces and of the sky behind them."""
        return np.asarray(self.lit + self.behind)

    def shown(self, backdrop: bool) -> Singles:
        """Return `colour`, or without a backdrop `lit`: what a picture on something else shows."""
        return self.colour if backdrop else self.lit

    @property
    def clamp_bias(self) -> float:
        """Share of the light that the clamp takes away."""
        whole = self.arrived + self.clamped
        return self.clamped / whole if whole > 0 else 0.0


def cut(size: tuple[int, int], side: int = TILE) -> list[Tile]:
    """Return the tiles of a picture, row by row; those at the right and lower edges may be smaller."""
    width, height = size
    return [
        Tile(top, min(top + side, height), left, min(left + side, width))
        for top in range(0, height, side)
        for left in range(0, width, side)
    ]


LAYERS = ("lit", "behind", "coverage", "normal", "depth", "albedo", "direct", "indirect", "set", "coefficients")
"""Fields of a rendering that have a value a pixel."""


def assemble(size: tuple[int, int], parts: Iterable[tuple[Tile, IgiRendering]]) -> IgiRendering:
    """Return a picture of all its tiles, which are taken one after the other."""
    width, height = size
    layers: dict[str, NDArray[Any]] = {}
    arrived, clamped, rays = [], [], 0
    for tile, part in parts:
        for name in LAYERS:
            values = getattr(part, name)
            if values is None:
                continue
            if name not in layers:
                layers[name] = np.empty((height, width, *values.shape[2:]), values.dtype)
            layers[name][tile.top : tile.bottom, tile.left : tile.right] = values
        arrived.append(part.arrived)
        clamped.append(part.clamped)
        rays += part.rays
    return IgiRendering(
        **{name: layers.get(name) for name in LAYERS},  # type: ignore[arg-type]
        arrived=sum(arrived),
        clamped=sum(clamped),
        rays=rays,
    )
