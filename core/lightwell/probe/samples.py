"""Counting and repairing samples that are no light: NaN, infinite, negative, saturated."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import Picture

LARGEST_HALF = 65504.0
"""The largest finite half float; what +Inf is taken for."""


@dataclass(frozen=True)
class SampleCounts:
    """How many samples (three a pixel) of a picture are out of the ordinary."""

    nan: int
    infinite: int
    negative: int
    """Finite and below zero."""
    saturated: int
    """Finite and at or above the level at which the source clips."""


# Bit patterns of floats without their sign order like integers, so integer compares tell all cases apart; they
# vectorise, and no compiler flag about NaN can touch them.
@njit(cache=True, nogil=True)
def _count_row(row, sign, infinity, saturation, counts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    nan = infinite = negative = saturated = np.int32(0)
    for column in range(row.shape[0]):
        sample = np.int32(row[column])
        magnitude = sample & np.int32(sign - 1)
        nan += np.int32(magnitude > infinity)
        infinite += np.int32(magnitude == infinity)
        negative += np.int32((magnitude != sample) & (magnitude > 0) & (magnitude < infinity))
        saturated += np.int32((magnitude == sample) & (magnitude >= saturation) & (magnitude < infinity))
    counts[0] += nan
    counts[1] += infinite
    counts[2] += negative
    counts[3] += saturated


@njit(cache=True, nogil=True)
def _count(bits, sign, infinity, saturation, counts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for row in range(bits.shape[0]):
        _count_row(bits[row], sign, infinity, saturation, counts)


def count_samples(image: Picture, saturation: float = LARGEST_HALF) -> SampleCounts:
    """Count the samples of a picture ``(H, W, 3)``, float16 or float32, in one pass.

    ``saturation`` is the level at which the source clips, in the picture's own units.
    """
    rows = np.ascontiguousarray(image).reshape(image.shape[0], -1)
    counts = np.zeros(4, np.int64)
    if image.dtype == np.float16:
        level = int(np.float16(min(saturation, LARGEST_HALF)).view(np.uint16))
        _count(rows.view(np.uint16), np.int32(0x8000), np.int32(0x7C00), np.int32(level), counts)
    elif image.dtype == np.float32:
        level = int(np.float32(saturation).view(np.uint32))
        _count(rows.view(np.int32), np.int32(-0x80000000), np.int32(0x7F800000), np.int32(level), counts)
    else:
        raise ValueError(f"pictures are float16 or float32, not {image.dtype}")
    return SampleCounts(*(int(count) for count in counts))


def repair(image: Picture, negatives: Literal["keep", "clamp"] = "keep") -> Picture:
    """Return the picture with NaN as 0, +Inf as 65504 and −Inf as 0; the same array where nothing had to change.

    Negative samples are noise around zero: kept they average out, clamped they brighten the dark. The default keeps
    them.
    """
    finite = np.isfinite(image)
    has_bad = not finite.all()
    has_negative = negatives == "clamp" and bool((image < 0).any())
    if not has_bad and not has_negative:
        return image
    repaired: NDArray[Any] = np.nan_to_num(image, nan=0.0, posinf=LARGEST_HALF, neginf=0.0)
    return np.maximum(repaired, 0) if negatives == "clamp" else repaired
