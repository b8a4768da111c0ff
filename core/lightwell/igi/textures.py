"""Pictures on surfaces, as glTF places them: v runs down, row 0 begins at v = 0, texels are squares."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]
Wrap = Literal["repeat", "mirror", "clamp"]
Encoding = Literal["linear", "srgb"]


@dataclass(frozen=True, eq=False)
class Texture:
    """A picture by texture coordinates, bilinear between the centres of its texels."""

    pixels: Singles | NDArray[np.uint8]
    """``(H, W, C)`` float32, linear and finite; or bytes, which take a quarter of the memory, 255 for 1."""
    wrap: tuple[Wrap, Wrap] = ("repeat", "repeat")
    """What there is beyond 0 … 1, along u and along v."""
    uv_set: int = 0
    """Which texture coordinates of the object it goes by."""
    transform: NDArray[np.float64] | None = None
    """``(2, 3)``: affine map from texture coordinates to those of the picture (KHR_texture_transform)."""
    encoding: Encoding = "linear"
    """Of bytes: those of colours are decoded from sRGB, each texel before it is mixed with others."""
    is_smooth: bool = True
    """Bilinear; else a texel is the same all over (a sampler's NEAREST)."""

    def __post_init__(self) -> None:
        if self.pixels.ndim != 3 or 0 in self.pixels.shape:
            raise ValueError(f"the texture has the shape {self.pixels.shape}; (height, width, channels) is needed")
        if self.pixels.dtype != np.uint8:
            if self.encoding != "linear":
                raise ValueError(f"the texture's pixels are {self.pixels.dtype}; only bytes are decoded from sRGB")
            if not np.isfinite(self.pixels).all():
                raise ValueError("the texture holds values that are not finite: repair them")
            object.__setattr__(self, "pixels", np.ascontiguousarray(self.pixels, np.float32))
        if self.transform is not None and np.shape(self.transform) != (2, 3):
            raise ValueError(f"the texture's transform has the shape {np.shape(self.transform)}; (2, 3) is needed")

    def at(self, uv: Singles) -> Singles:
        """Return the values ``(n, C)`` at texture coordinates ``(n, 2)``."""
        height, width, _ = self.pixels.shape
        u, v = self._placed(uv)
        if not self.is_smooth:
            column, row = np.floor(u * width).astype(np.int64), np.floor(v * height).astype(np.int64)
            return self._values(_wrapped(row, height, self.wrap[1]), _wrapped(column, width, self.wrap[0]))
        left, right, across = _texels(u * width - 0.5, width, self.wrap[0])
        upper, lower, down = _texels(v * height - 0.5, height, self.wrap[1])
        above = self._values(upper, left) * (1 - across) + self._values(upper, right) * across
        below = self._values(lower, left) * (1 - across) + self._values(lower, right) * across
        return np.asarray(above * (1 - down) + below * down, np.float32)

    def slopes_at(self, uv: Singles) -> Singles:
        """Return the derivatives of the first channel by u and by v, ``(n, 2)``: central differences of a texel."""
        height, width, _ = self.pixels.shape
        steps = np.array([[0.5 / width, 0], [0, 0.5 / height]], np.float32)
        if self.transform is not None:
            steps = np.asarray(np.linalg.solve(self.transform[:, :2], steps.T.astype(np.float64)).T, np.float32)
        # In coordinates of the picture first; the chain rule brings them to those of the object.
        changes = [self.at(uv + step)[:, 0] - self.at(uv - step)[:, 0] for step in steps]
        slopes = np.stack([changes[0] * width, changes[1] * height], axis=1)
        if self.transform is not None:
            slopes = slopes @ self.transform[:, :2].astype(np.float32)
        return np.asarray(slopes, np.float32)

    @property
    def bounds(self) -> tuple[Singles, Singles]:
        """Least and greatest value of each channel, ``(C,)``."""
        lowest, highest = self.pixels.min(axis=(0, 1)), self.pixels.max(axis=(0, 1))
        if self.pixels.dtype == np.uint8:
            return _DECODED[self.encoding][lowest], _DECODED[self.encoding][highest]
        return np.asarray(lowest, np.float32), np.asarray(highest, np.float32)

    def _values(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> Singles:
        """Return linear texels, ``(n, C)``."""
        texels = self.pixels[rows, columns]
        return np.asarray(_DECODED[self.encoding][texels] if texels.dtype == np.uint8 else texels, np.float32)

    def _placed(self, uv: Singles) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        u, v = uv[:, 0].astype(np.float64), uv[:, 1].astype(np.float64)
        if self.transform is None:
            return u, v
        (a, b, c), (d, e, f) = self.transform
        return a * u + b * v + c, d * u + e * v + f


def linear_from_srgb(encoded: NDArray[np.floating]) -> Singles:
    """Return linear values of sRGB-encoded ones, 0 … 1 both (IEC 61966-2-1)."""
    value = np.asarray(encoded, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


_DECODED: dict[Encoding, Singles] = {
    "linear": (np.arange(256) / 255).astype(np.float32),
    "srgb": linear_from_srgb(np.arange(256) / 255),
}
"""Values of bytes."""


def _texels(place: NDArray[np.float64], size: int, wrap: Wrap) -> tuple[NDArray[np.int64], NDArray[np.int64], Singles]:
    """Return the two texels round places in texels, ``(n,)`` each, and how far along it is, ``(n, 1)``."""
    first = np.floor(place)
    fraction = (place - first).astype(np.float32)[:, None]
    index = first.astype(np.int64)
    return _wrapped(index, size, wrap), _wrapped(index + 1, size, wrap), fraction


def _wrapped(index: NDArray[np.int64], size: int, wrap: Wrap) -> NDArray[np.int64]:
    match wrap:
        case "repeat":
            return index % size
        case "mirror":
            there_and_back = index % (2 * size)
            return np.minimum(there_and_back, 2 * size - 1 - there_and_back)
        case "clamp":
            return np.clip(index, 0, size - 1)
