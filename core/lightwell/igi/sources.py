"""What every source of light offers: virtual lights of its own, and the rays that its light leaves along."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.lights import VirtualLights

Floats = NDArray[np.float64]

POSITION_NUMBERS, RAY_NUMBERS = 3, 5
"""How many random numbers a light and a ray take."""


class Rays(NamedTuple):
    """Light that leaves a source."""

    origins: Floats
    """``(n, 3)`` metres."""
    directions: Floats
    """``(n, 3)`` unit vectors."""
    flux: Floats
    """``(n, 3)`` W: what each ray carries."""


class Source(Protocol):
    """A source of light. Each sample is an estimate of all its light, weighted as one of ``count``."""

    power: float
    """Luminance times metres² times steradians: how many of the samples it deserves."""
    is_sampled: bool
    """Whether its direct light is by samples too, or by one light that every set has."""

    def lights(self, numbers: Floats, count: float, clamp: float) -> VirtualLights:
        """Return a virtual light for each row of random numbers ``(n, 3)``; ``clamp`` as in `IgiSettings`."""
        ...

    def rays(self, numbers: Floats, count: float) -> Rays:
        """Return a ray for each row of random numbers ``(n, 5)``."""
        ...


def pick(cumulative: Floats, numbers: Floats) -> tuple[NDArray[np.int64], Floats]:
    """Return which part of a rising ``(k,)`` sum that ends at 1 each number is in, and how far along it is, 0 … 1."""
    index = np.minimum(np.searchsorted(cumulative, numbers, side="right"), len(cumulative) - 1)
    before = np.where(index > 0, cumulative[index - 1], 0.0)
    share = cumulative[index] - before
    along = np.divide(numbers - before, share, out=np.zeros_like(numbers), where=share > 0)
    return index, np.clip(along, 0, np.nextafter(1.0, 0.0))


def cosine_directions(normals: Floats, a: Floats, b: Floats) -> Floats:
    """Return unit vectors ``(n, 3)`` about unit normals, cosine-weighted (Malley's method), of two numbers each."""
    radius, angle = np.sqrt(a), 2 * np.pi * b
    local = np.stack([radius * np.cos(angle), radius * np.sin(angle), np.sqrt(1 - a)], axis=1)
    first, second = frames(normals)
    return local[:, :1] * first + local[:, 1:2] * second + local[:, 2:] * normals


def frames(axes: Floats) -> tuple[Floats, Floats]:
    """Return two unit vectors at right angles to each unit axis and to each other, ``(n, 3)`` (Duff et al. 2017)."""
    x, y, z = axes.T
    sign = np.where(z >= 0, 1.0, -1.0)
    a = -1 / (sign + z)
    b = x * y * a
    first = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    return first, np.stack([b, sign + y * y * a, -y], axis=1)
