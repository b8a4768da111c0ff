"""Sets of directions in which visibility is asked for (MATHS §9).

Each set is split into two halves that cover the sphere alike, so that their difference tells how far to trust the sum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Sampling = Literal["stratified", "fibonacci", "hemisphere"]
GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


@dataclass(frozen=True)
class Directions:
    """Directions and the solid angle that each stands for."""

    vectors: NDArray[np.float32]
    """``(N, 3)`` unit vectors: in world axes, or (``about_normal``) with the vertex's normal along +Z."""
    half: NDArray[np.uint8]
    """``(N,)``: 0 or 1."""
    weight: float
    """Solid angle of one direction, 4π/N; ``about_normal``: π/N, the solid angle times the cosine."""
    about_normal: bool
    """Cosine-weighted over the hemisphere of each vertex."""

    @property
    def count(self) -> int:
        """Number of directions."""
        return len(self.vectors)


def make_directions(sampling: Sampling, count: int, seed: int = 0) -> Directions:
    """Return a set of about ``count`` directions.

    ``stratified``
        The paper's: k × k jittered cells of equal solid angle, ``z = 1 − 2a``, ``φ = 2πb``; ``count`` is rounded to k².
    ``fibonacci``
        A spiral of equal areas (Swinbank and Purser 2006), turned at random with the seed.
    ``hemisphere``
        A spiral of equal cosine-weighted solid angles about the normal, ``r² = (k + ½)/N`` (Malley's method on Vogel's
        spiral), turned about the normal with the seed. Half the error of as many jittered ones.

    Raises
    ------
    ValueError
        Where ``count`` is below 4 or the sampling is unknown.
    """
    if count < 4:
        raise ValueError(f"{count} directions are too few; take at least 4")
    random = np.random.default_rng(seed)
    if sampling == "hemisphere":
        index = np.arange(count)
        azimuth = GOLDEN_ANGLE * index + 2 * np.pi * random.random()
        vectors = _on_sphere(np.sqrt(1 - (index + 0.5) / count), azimuth)
        return Directions(vectors, (index & 1).astype(np.uint8), math.pi / count, True)
    if sampling == "fibonacci":
        return Directions(
            _turned(_spiral(count), random), (np.arange(count) & 1).astype(np.uint8), 4 * math.pi / count, False
        )
    across, around, half = _jittered(count, random)
    if sampling == "stratified":
        vectors = _on_sphere(1 - 2 * across, 2 * np.pi * around)
        return Directions(vectors, half, 4 * math.pi / len(vectors), False)
    raise ValueError(f"no sampling {sampling!r}; there are stratified, fibonacci and hemisphere")


def _jittered(
    count: int, random: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.uint8]]:
    """Return k² jittered points of the unit square, and which are on the black fields of its chessboard."""
    side = max(2, round(math.sqrt(count)))
    row, column = np.divmod(np.arange(side * side), side)
    jitter = random.random((2, side * side))
    return (row + jitter[0]) / side, (column + jitter[1]) / side, ((row + column) & 1).astype(np.uint8)


def _on_sphere(z: NDArray[np.floating[Any]], azimuth: NDArray[np.floating[Any]]) -> NDArray[np.float32]:
    radius = np.sqrt(np.maximum(0, 1 - z * z))
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1).astype(np.float32)


def _spiral(count: int) -> NDArray[np.float32]:
    index = np.arange(count)
    return _on_sphere(1 - (2 * index + 1) / count, GOLDEN_ANGLE * index)


def _turned(vectors: NDArray[np.float32], random: np.random.Generator) -> NDArray[np.float32]:
    """Return vectors turned by a random rotation, uniform among all (from a random unit quaternion)."""
    w, x, y, z = (lambda q: q / np.linalg.norm(q))(random.normal(size=4))
    matrix = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    return np.ascontiguousarray(vectors @ matrix.T, dtype=np.float32)
