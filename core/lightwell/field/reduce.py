"""Adaptive subsampling of a sequence of probes (paper 000 §5.1; MATHS §6).

A probe is dropped where it looks like the last one that was kept and like the next one, and where the gap that this
leaves is short enough. Comparing with the last *kept* probe, and not with the previous one, keeps slow drift.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.field.spec import Floats

Frame = NDArray[np.float32]


def difference(one: Frame, other: Frame, weights: Floats) -> float:
    """Return ``Σ w |I − J| / ½ Σ w (I + J)`` of frames ``(Q, 3)``; ``weights`` ``(Q,)`` are solid angles."""
    apart = float(weights @ np.abs(one - other).sum(axis=1))
    both = float(weights @ (one + other).sum(axis=1)) / 2
    return apart / both if both > 0 else 0.0


@dataclass(frozen=True)
class Decision:
    """What becomes of one probe."""

    index: int
    kept: bool
    difference: float
    """From the last probe that was kept."""


def decide(
    frames: Iterator[Frame],
    positions: Floats,
    weights: Floats,
    tolerance: float,
    max_distance_m: float,
    first: int = 0,
    last_kept: tuple[int, Frame] | None = None,
) -> Iterator[Decision]:
    """Decide on the probes from ``first`` on; ``frames`` yields theirs.

    Three frames are in memory. A sequence that was interrupted goes on with the index and frame of the last probe that
    was kept. The first and the last probe are always kept.
    """
    total = len(positions)
    current = next(frames)
    for index in range(first, total):
        following = next(frames) if index + 1 < total else None
        apart = 0.0 if last_kept is None else difference(current, last_kept[1], weights)
        drop = (
            last_kept is not None
            and following is not None
            and apart < tolerance
            and difference(current, following, weights) < tolerance
            and float(np.linalg.norm(positions[index + 1] - positions[last_kept[0]])) <= max_distance_m
        )
        if not drop:
            last_kept = (index, current)
        yield Decision(index, not drop, apart)
        if following is not None:
            current = following
