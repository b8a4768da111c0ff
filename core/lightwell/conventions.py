"""The conventions of Lightwell, stated once. Everything else imports them from here.

World axes
    Right-handed, +Z up. ``ω`` is a unit vector that points *towards* the light.
Lat-long images
    Row 0 is +Z. Pixel centres ``θ = π(i+½)/H``, ``φ = 2π(j+½)/W``, direction ``(sinθ cosφ, sinθ sinφ, cosθ)``.
Pictures taken by a camera (mirror sphere, mirror ball, angular map, fisheye)
    The camera looks along ``forward``, the image's top points along ``up``, image x runs to the camera's right, and
    nothing is mirrored. In camera axes x is right, y is up and z points *backwards* (out of the scene, towards the
    photographer), so that the axes are right-handed; with the default ``forward = (0, 0, −1)``, ``up = (0, 1, 0)``
    camera axes and world axes coincide.
Pixels
    Pixel ``(row i, column j)`` has its centre at ``x = j + ½``, ``y = i + ½``; x runs right and y runs down.
Spherical harmonics
    Real, orthonormal, no Condon–Shortley phase, coefficient ``(l, m)`` at index ``l² + l + m``. "Bands" ``n`` means
    degrees ``0 … n−1``, which is ``n²`` coefficients. The polar axis of the basis is world +Z.
Coefficients
    Of radiance, linear Rec. 709 RGB: W·sr⁻¹·m⁻² when the source is calibrated, relative units otherwise. Arrays have
    the shape ``(bands², 3)``.
Units
    Times are integer nanoseconds since the Unix epoch (UTC), angles radians, distances metres. Where a number leaves
    the program, its name says its unit.
"""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

MAX_BANDS = 11
"""Most bands that the basis supports (degree 10)."""

MAX_STREAM_BANDS = 8
"""Most bands that a stream is projected onto."""

DEFAULT_BANDS = 5
"""Bands of a stream unless it says otherwise: 25 coefficients."""

DEFAULT_FORWARD = (0.0, 0.0, -1.0)
DEFAULT_UP = (0.0, 1.0, 0.0)

Convention = Literal["lightwell", "three", "filament", "unity", "unreal", "sloan"]
"""Names of coefficient conventions. ``lightwell`` is the one above; `lightwell.sh.engines` defines the others."""

CONVENTIONS: tuple[Convention, ...] = get_args(Convention)

Units = Literal["relative", "W.sr-1.m-2"]
"""Unit of radiance: relative, or calibrated."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Luminance of linear Rec. 709 RGB (ITU-R BT.709-6)."""


def coefficient_count(bands: int) -> int:
    """Return the number of coefficients of ``bands`` bands: ``bands²``."""
    return bands * bands


def coefficient_index(degree: int, order: int) -> int:
    """Return the index ``l² + l + m`` of the coefficient of degree ``l`` and order ``m``, ``−l ≤ m ≤ l``."""
    if abs(order) > degree:
        raise ValueError(f"order {order} is outside −{degree} … {degree}")
    return degree * degree + degree + order


def degree_of_index(bands: int) -> NDArray[np.int64]:
    """Return the degree ``l`` of each coefficient, ``(bands²,)``."""
    return np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)


def order_of_index(bands: int) -> NDArray[np.int64]:
    """Return the order ``m`` of each coefficient, ``(bands²,)``."""
    return np.concatenate([np.arange(-degree, degree + 1) for degree in range(bands)])


def bands_of_count(count: int) -> int:
    """Return how many bands ``count`` coefficients make; a count that is no square raises ``ValueError``."""
    bands = math.isqrt(max(count, 0))
    if bands < 1 or bands * bands != count:
        raise ValueError(f"{count} coefficients are not a whole number of bands (1, 4, 9, 16, 25, …)")
    return bands


def world_from_camera(
    forward: tuple[float, float, float] = DEFAULT_FORWARD,
    up: tuple[float, float, float] = DEFAULT_UP,
) -> NDArray[np.float64]:
    """Return the rotation that takes camera axes (x right, y up, z backwards) to world axes, ``(3, 3)``.

    ``forward`` is kept, ``up`` is made perpendicular to it; both are normalised.

    Raises
    ------
    ValueError
        Where one of them has no length or the two are parallel.
    """
    forward_axis = np.asarray(forward, dtype=np.float64)
    right = np.cross(forward_axis, np.asarray(up, dtype=np.float64))
    length = float(np.linalg.norm(forward_axis)), float(np.linalg.norm(right))
    if not np.isfinite(length).all() or length[0] < 1e-12 or length[1] < 1e-9 * max(length[0], 1e-300):
        raise ValueError(f"forward {forward} and up {up} must be finite, have a length and not be parallel")
    forward_axis = forward_axis / length[0]
    right = right / length[1]
    return np.stack([right, np.cross(right, forward_axis), -forward_axis], axis=1)
