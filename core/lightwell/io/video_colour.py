"""From video signals to linear light: matrices, ranges, transfer functions and primaries.

Formulas: ITU-R BT.2100-2 (PQ, HLG, quantisation), SMPTE ST 2084 (PQ), BT.709-6, BT.2020-2 and BT.601-7 (luma
coefficients, primaries).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.video_settings import REFERENCE_WHITE, Matrix, Primaries, Range, Transfer

Floats = NDArray[np.float64]

PQ_PEAK = 10_000.0
"""Luminance at signal 1, cd/m²."""

_LUMA = {"bt601": (0.299, 0.114), "bt709": (0.2126, 0.0722), "bt2020": (0.2627, 0.0593)}
"""K_R and K_B."""

_PRIMARIES = {
    "bt709": ((0.640, 0.330), (0.300, 0.600), (0.150, 0.060)),
    "bt2020": ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046)),
}
_D65 = (0.3127, 0.3290)

TABLE_STEPS = 16384
"""Steps of the transfer table; interpolating between them errs by less than 1e-5 of the signal's peak."""


def pq_eotf(signal: ArrayLike) -> Floats:
    """Return the luminance, cd/m², of PQ signals in 0 … 1 (BT.2100 table 4)."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    root = np.asarray(signal, dtype=np.float64) ** (1 / m2)
    return np.asarray(PQ_PEAK * (np.maximum(root - c1, 0) / (c2 - c3 * root)) ** (1 / m1))


def hlg_inverse_oetf(signal: ArrayLike) -> Floats:
    """Return the scene light, 0 … 1, of HLG signals in 0 … 1 (BT.2100 table 5)."""
    a = 0.17883277
    b, c = 1 - 4 * a, 0.5 - a * math.log(4 * a)
    signal = np.asarray(signal, dtype=np.float64)
    return np.asarray(np.where(signal <= 0.5, signal**2 / 3, (np.exp((signal - c) / a) + b) / 12))


def transfer_table(transfer: Transfer, white: float = REFERENCE_WHITE) -> NDArray[np.float32]:
    """Return linear light at ``TABLE_STEPS + 1`` signals from 0 to 1; empty for a linear signal.

    PQ: 1.0 stands for ``white`` cd/m². HLG: 1.0 is the brightest scene light of the signal.
    """
    signal = np.linspace(0.0, 1.0, TABLE_STEPS + 1)
    if transfer == "pq":
        return np.asarray(pq_eotf(signal) / white, dtype=np.float32)
    if transfer == "hlg":
        return np.asarray(hlg_inverse_oetf(signal), dtype=np.float32)
    return np.empty(0, dtype=np.float32)


def signal_from_codes(matrix: Matrix, bits: int, code_range: Range) -> tuple[Floats, Floats]:
    """Return ``A`` (3, 3) and ``b`` (3,) with ``R'G'B' = A codes + b`` (BT.2100 table 9).

    ``codes`` are Y', Cb, Cr, or R', G', B' for ``matrix="rgb"``.
    """
    if code_range == "limited":
        unit = 2.0 ** (bits - 8)
        luma_scale, chroma_scale, black = 1 / (219 * unit), 1 / (224 * unit), 16 * unit
    else:
        luma_scale = chroma_scale = 1 / (2.0**bits - 1)
        black = 0.0
    middle = 2.0 ** (bits - 1)
    if matrix == "rgb":
        return np.eye(3) * luma_scale, np.full(3, -black * luma_scale)
    kr, kb = _LUMA[matrix]
    kg = 1 - kr - kb
    rgb_from_ycc = np.array(
        [
            [1.0, 0.0, 2 * (1 - kr)],
            [1.0, -2 * kb * (1 - kb) / kg, -2 * kr * (1 - kr) / kg],
            [1.0, 2 * (1 - kb), 0.0],
        ]
    )
    scale = np.array([luma_scale, chroma_scale, chroma_scale])
    return rgb_from_ycc * scale, rgb_from_ycc @ (-np.array([black, middle, middle]) * scale)


def rec709_from(primaries: Primaries) -> Floats:
    """Return the matrix from linear RGB with these primaries to linear Rec. 709 RGB, ``(3, 3)``."""
    return np.asarray(np.linalg.solve(_xyz_from_rgb(_PRIMARIES["bt709"]), _xyz_from_rgb(_PRIMARIES[primaries])))


def _xyz_from_rgb(primaries: tuple[tuple[float, float], ...]) -> Floats:
    columns = np.array([[x / y, 1.0, (1 - x - y) / y] for x, y in primaries]).T
    x, y = _D65
    white = np.array([x / y, 1.0, (1 - x - y) / y])
    return np.asarray(columns * np.linalg.solve(columns, white))


def chroma_taps(size: int, chroma_size: int, *, centred: bool) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Return, for each luma position along one axis, the chroma sample before it and the weight of the one behind.

    Chroma lies between two luma rows (``centred``) and on every other luma column, as in MPEG-2, H.264 and H.265.
    """
    ratio = chroma_size / size
    offset = 0.5 * (ratio - 1) if centred else 0.0
    position = np.clip(np.arange(size) * ratio + offset, 0, chroma_size - 1)
    first = np.minimum(position.astype(np.int64), max(chroma_size - 2, 0))
    return first, (position - first).astype(np.float32)


@njit(cache=True, nogil=True)
def linear_rgb(  # type: ignore[no-untyped-def]  # noqa: ANN201
    plane0,  # noqa: ANN001
    plane1,  # noqa: ANN001
    plane2,  # noqa: ANN001
    row_first,  # noqa: ANN001
    row_weight,  # noqa: ANN001
    col_first,  # noqa: ANN001
    col_weight,  # noqa: ANN001
    scale,  # noqa: ANN001
    offset,  # noqa: ANN001
    table,  # noqa: ANN001
    gamut,  # noqa: ANN001
    out,  # noqa: ANN001
):
    """Write linear RGB (height, width, 3) float32 to ``out``.

    ``plane0`` is (height, width); ``plane1`` and ``plane2`` may be smaller and are interpolated with the taps of
    `chroma_taps`. ``scale`` (3, 3) and ``offset`` (3,) give the signal, ``table`` (n,) the light of signals 0 … 1
    (empty: the signal is linear), ``gamut`` (3, 3) the final primaries; all float32.
    """
    height, width = plane0.shape
    steps = table.size - 1
    rows, cols = plane1.shape
    light = np.empty(3, dtype=np.float32)
    for i in range(height):
        i0 = row_first[i]
        i1 = min(i0 + 1, rows - 1)
        wi = row_weight[i]
        for j in range(width):
            j0 = col_first[j]
            j1 = min(j0 + 1, cols - 1)
            wj = col_weight[j]
            w00, w01 = (1 - wi) * (1 - wj), (1 - wi) * wj
            w10, w11 = wi * (1 - wj), wi * wj
            a = np.float32(plane0[i, j])
            b = w00 * plane1[i0, j0] + w01 * plane1[i0, j1] + w10 * plane1[i1, j0] + w11 * plane1[i1, j1]
            c = w00 * plane2[i0, j0] + w01 * plane2[i0, j1] + w10 * plane2[i1, j0] + w11 * plane2[i1, j1]
            for channel in range(3):
                value = scale[channel, 0] * a + scale[channel, 1] * b + scale[channel, 2] * c + offset[channel]
                if steps > 0:
                    position = min(max(value, np.float32(0.0)), np.float32(1.0)) * steps
                    k = min(int(position), steps - 1)
                    fraction = np.float32(position - k)
                    value = table[k] + fraction * (table[k + 1] - table[k])
                light[channel] = value
            for channel in range(3):
                out[i, j, channel] = (
                    gamut[channel, 0] * light[0] + gamut[channel, 1] * light[1] + gamut[channel, 2] * light[2]
                )
