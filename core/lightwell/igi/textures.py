"""Pictures on surfaces, as glTF places them: v runs down, row 0 begins at v = 0, texels are squares."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Singles = NDArray[np.float32]
Wrap = Literal["repeat", "mirror", "clamp"]
Encoding = Literal["linear", "srgb"]

FARTHEST = 1e9
"""Coordinates in pictures are no larger, so that texels can be counted."""


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
        if self.transform is not None and not (
            np.shape(self.transform) == (2, 3) and (np.abs(self.transform) < FARTHEST).all()
        ):
            raise ValueError(f"the texture's transform {self.transform} must be (2, 3), of numbers below {FARTHEST:g}")

    def at(self, uv: Singles, width: Singles | None = None) -> Singles:
        """Return the values ``(n, C)`` at texture coordinates ``(n, 2)``.

        ``width (n,)``: means over squares of this side in texture coordinates, as smaller pictures have them
        (trilinear); by default of no size. Nearest texels are no means ever.
        """
        u, v = self._placed(uv)
        if not self.is_smooth:
            height, across = self.pixels.shape[:2]
            column, row = np.floor(u * across).astype(np.int64), np.floor(v * height).astype(np.int64)
            return self._decoded(
                self.pixels[_wrapped(row, height, self.wrap[1]), _wrapped(column, across, self.wrap[0])]
            )
        if width is None:
            return self._bilinear(self.pixels, u, v)
        scale = 1.0 if self.transform is None else float(np.sqrt(abs(np.linalg.det(self.transform[:, :2]))))
        texels = np.maximum(width * np.float32(scale * np.sqrt(self.pixels.shape[0] * self.pixels.shape[1])), 1)
        # Of a width of 2^l (1 + f) texels: level l, and f of the next one. No logarithm, whose last digits may vary.
        mantissa, exponent = np.frexp(np.minimum(texels, np.float32(1 << 20)))
        level, further = exponent - 1, (2 * mantissa - 1)[:, None]
        values = np.empty((len(uv), self.pixels.shape[2]), np.float32)
        for number in range(int(level.min(initial=0)), int(level.max(initial=0)) + 1):
            here = np.flatnonzero(level == number)
            fine, coarse = (self._level(number + step) for step in (0, 1))
            part, share = self._bilinear(fine, u[here], v[here]), further[here]
            if fine is not coarse and share.any():
                part = part * (1 - share) + self._bilinear(coarse, u[here], v[here]) * share
            values[here] = part
        return values

    def _level(self, number: int) -> Singles | NDArray[np.uint8]:
        return self.pixels if number == 0 or not self._smaller else self._smaller[min(number, len(self._smaller)) - 1]

    @cached_property
    def _smaller(self) -> list[Singles | NDArray[np.uint8]]:
        """Each half as large as the one before, down to one texel."""
        found: list[Singles | NDArray[np.uint8]] = []
        last = self.pixels
        while max(last.shape[:2]) > 1:
            last = self._halved(last)
            found.append(last)
        return found

    def _halved(self, pixels: Singles | NDArray[np.uint8]) -> Singles | NDArray[np.uint8]:
        """Return the means, of linear light, over 2 × 2 texels, and a little more where the size is odd."""
        if pixels.dtype != np.uint8:
            return _pairs(_pairs(np.asarray(pixels, np.float32), 0), 1)
        means = _pairs(_pairs(_FINE[self.encoding][pixels], 0), 1)
        return np.asarray(_ENCODED[self.encoding][means.astype(np.uint16)], np.uint8)

    def _bilinear(self, pixels: Singles | NDArray[np.uint8], u: NDArray[np.float64], v: NDArray[np.float64]) -> Singles:
        height, width, _ = pixels.shape
        left, right, across = _texels(u * width - 0.5, width, self.wrap[0])
        upper, lower, down = _texels(v * height - 0.5, height, self.wrap[1])
        above = self._decoded(pixels[upper, left]) * (1 - across) + self._decoded(pixels[upper, right]) * across
        below = self._decoded(pixels[lower, left]) * (1 - across) + self._decoded(pixels[lower, right]) * across
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

    def _decoded(self, texels: Singles | NDArray[np.uint8]) -> Singles:
        """Return linear values of texels."""
        return np.asarray(_DECODED[self.encoding][texels] if texels.dtype == np.uint8 else texels, np.float32)

    def _placed(self, uv: Singles) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        u, v = uv[:, 0].astype(np.float64), uv[:, 1].astype(np.float64)
        if self.transform is not None:
            (a, b, c), (d, e, f) = self.transform
            u, v = a * u + b * v + c, d * u + e * v + f
        return np.clip(u, -FARTHEST, FARTHEST), np.clip(v, -FARTHEST, FARTHEST)


def linear_from_srgb(encoded: NDArray[np.floating]) -> Singles:
    """Return linear values of sRGB-encoded ones, 0 … 1 both (IEC 61966-2-1)."""
    value = np.asarray(encoded, np.float64)
    return np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).astype(np.float32)


_DECODED: dict[Encoding, Singles] = {
    "linear": (np.arange(256) / 255).astype(np.float32),
    "srgb": linear_from_srgb(np.arange(256) / 255),
}
"""Values of bytes."""
_FINE: dict[Encoding, Singles] = {name: np.round(values * np.float32(0xFFFF)) for name, values in _DECODED.items()}
"""The same, 65,535 for 1."""
_HALVES = (np.arange(255) + 0.5) / 255
_ENCODED: dict[Encoding, NDArray[np.uint8]] = {
    "linear": np.searchsorted(_HALVES, np.arange(1 << 16) / 0xFFFF).astype(np.uint8),
    "srgb": np.searchsorted(linear_from_srgb(_HALVES), np.arange(1 << 16) / 0xFFFF).astype(np.uint8),
}
"""The other way round."""


def _pairs(values: Singles, axis: int) -> Singles:
    """Return the means of pairs along an axis; of odd lengths 2m + 1, m means over 2 + 1/m each."""
    size = values.shape[axis]
    if size == 1:
        return values
    x = np.moveaxis(values, axis, 0)
    if size % 2 == 0:
        means = (x[::2] + x[1::2]) * np.float32(0.5)
    else:
        half = size // 2
        k = np.arange(half, dtype=np.float32)[:, None, None]
        means = ((half - k) * x[:-1:2] + np.float32(half) * x[1::2] + (k + 1) * x[2::2]) / np.float32(size)
    return np.asarray(np.moveaxis(means, 0, axis), np.float32)


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
