"""The iterated Gaussian of paper 003, §3.4: blur and halve until the picture is small enough."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import to_float32

BINOMIAL = np.array([1, 5, 10, 10, 5, 1], np.float32) / np.float32(32)
"""Six-tap Gaussian (σ = √5/2 source pixels), centred between the two pixels that become one: halving does not shift."""


@njit(cache=True, nogil=True)
def weigh(samples, first_row, first_column, solid_angles, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write solid angle times radiance, and solid angle, into ``out`` ``(h, w, 4)`` float32 (njit)."""
    for i in range(out.shape[0]):
        row = samples[first_row + i, 3 * first_column :]
        for x in range(out.shape[1]):
            weight = solid_angles[i, x]
            for channel in range(3):
                out[i, x, channel] = weight * to_float32(row[3 * x + channel])
            out[i, x, 3] = weight


@njit(cache=True, nogil=True, fastmath={"contract"})
def _halve(weighted, taps, wraps, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    height, width = weighted.shape[0], weighted.shape[1]
    blurred = np.empty((width, 4), np.float32)
    for i in range(out.shape[0]):
        blurred[:] = 0
        for t in range(taps.shape[0]):
            source = 2 * i + t - 2
            if 0 <= source < height:
                for x in range(width):
                    for channel in range(4):
                        blurred[x, channel] += taps[t] * weighted[source, x, channel]
        for j in range(out.shape[1]):
            out[i, j] = 0
            for t in range(taps.shape[0]):
                source = 2 * j + t - 2
                if wraps:
                    source %= width
                if 0 <= source < width:
                    for channel in range(4):
                        out[i, j, channel] += taps[t] * blurred[source, channel]


def halve_down(weighted: NDArray[np.float32], width: int, wraps: bool) -> NDArray[np.float32]:
    """Blur and halve a weighted picture ``(h, w, 4)`` while it is at least twice as wide as ``width``.

    Radiance is weighted with solid angle, and blurred together with its weight: otherwise lights near the poles of a
    lat-long picture would change their energy (MATHS §2.1). ``wraps`` joins the left and right edges. A side of odd
    length ends the halving; what is left of the ratio is up to the caller.
    """
    while weighted.shape[1] >= 2 * width and weighted.shape[0] % 2 == 0 and weighted.shape[1] % 2 == 0:
        out = np.empty((weighted.shape[0] // 2, weighted.shape[1] // 2, 4), np.float32)
        _halve(weighted, BINOMIAL, wraps, out)
        weighted = out
    return weighted
