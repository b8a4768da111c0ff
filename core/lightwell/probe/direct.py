"""Full-resolution projection of any mapping: the basis evaluated on the fly from a table of directions and weights."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import to_float32
from lightwell.probe.mapping import Floats, Mapping
from lightwell.probe.matrix import unseen_moments
from lightwell.probe.rim import rim_weights
from lightwell.sh.basis import RECURRENCE_A, RECURRENCE_AB, SECTORAL_RATIO, Y00

CHUNK = 256
"""Pixels worked on together: their arrays stay in the first-level cache."""


def _legendre_factors(bands: int) -> NDArray[np.float32]:
    """Return ``Q_mm``, ``a_lm`` and ``a_lm b_lm`` of MATHS §1 as ``[l, m, (sectoral, a, ab)]``."""
    factors = np.stack([np.diag(Y00 * np.cumprod(SECTORAL_RATIO)), RECURRENCE_A, RECURRENCE_AB], axis=-1)
    return factors[:bands, :bands].astype(np.float32)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _six_sums(q, lit, turned, count, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    r = g = b = rt = gt = bt = np.float32(0)
    for x in range(count):
        r += q[x] * lit[0, x]
        g += q[x] * lit[1, x]
        b += q[x] * lit[2, x]
        rt += q[x] * turned[0, x]
        gt += q[x] * turned[1, x]
        bt += q[x] * turned[2, x]
    sums[0, 0], sums[0, 1], sums[0, 2], sums[1, 0], sums[1, 1], sums[1, 2] = r, g, b, rt, gt, bt


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _project(samples, first_row, first_column, table, factors, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    bands, width = factors.shape[0], table.shape[2]
    lit, turned = np.empty((3, CHUNK), np.float32), np.empty((3, CHUNK), np.float32)
    now, before = np.empty(CHUNK, np.float32), np.empty(CHUNK, np.float32)
    sums = np.empty((2, 3), np.float32)
    for i in range(table.shape[0]):
        for start in range(0, width, CHUNK):
            count = min(CHUNK, width - start)
            row = samples[first_row + i, 3 * (first_column + start) : 3 * (first_column + start + count)]
            dx, dy, dz = table[i, 0, start:], table[i, 1, start:], table[i, 2, start:]
            weight = table[i, 3, start:]
            for x in range(count):
                lit[0, x] = weight[x] * to_float32(row[3 * x])
                lit[1, x] = weight[x] * to_float32(row[3 * x + 1])
                lit[2, x] = weight[x] * to_float32(row[3 * x + 2])
            turned[:] = 0
            for m in range(bands):
                if m > 0:  # lit and turned become radiance times sinᵐθ cos mφ and sinᵐθ sin mφ
                    for x in range(count):
                        for channel in range(3):
                            cosine, sine = lit[channel, x], turned[channel, x]
                            lit[channel, x] = dx[x] * cosine - dy[x] * sine
                            turned[channel, x] = dx[x] * sine + dy[x] * cosine
                now[:count] = factors[m, m, 0]
                before[:count] = 0
                for degree in range(m, bands):
                    if degree > m:
                        a, ab = factors[degree, m, 1], factors[degree, m, 2]
                        for x in range(count):
                            before[x] = a * dz[x] * now[x] - ab * before[x]
                        now, before = before, now
                    _six_sums(now, lit, turned, count, sums)
                    centre = degree * degree + degree
                    for channel in range(3):
                        out[centre + m, channel] += sums[0, channel]
                        if m > 0:
                            out[centre - m, channel] += sums[1, channel]


class DirectProjection:
    """Sum of solid angle, basis and radiance over the pixels of a full-resolution picture.

    Each pixel is one direction (the mean over its footprint) and one solid angle: four float32 a pixel.
    """

    def __init__(self, mapping: Mapping, bands: int, blind: str) -> None:
        self._region = mapping.region
        row0, row1, col0, col1 = self._region
        moments = np.zeros((mapping.height * mapping.width, 4))
        for pixel, direction, solid_angle in mapping.footprints():
            for axis in range(3):
                np.add.at(moments[:, axis], pixel, solid_angle * direction[:, axis])
            np.add.at(moments[:, 3], pixel, solid_angle)
        length = np.linalg.norm(moments[:, :3], axis=1, keepdims=True)
        moments[:, :3] /= np.maximum(length, 1e-300)
        table = moments.reshape(mapping.height, mapping.width, 4)[row0:row1, col0:col1]
        self._table = np.ascontiguousarray(table.transpose(0, 2, 1), dtype=np.float32)
        self._factors = _legendre_factors(bands)
        weights = rim_weights(mapping)
        self._rim = np.flatnonzero(weights)
        self._rim_weights = weights[self._rim]
        self._unseen = np.zeros(bands * bands)
        if blind == "fill":
            ones = np.ones((mapping.height, 3 * mapping.width), np.float32)
            self._unseen = unseen_moments(self._sum(ones)[:, 0])

    @property
    def nbytes(self) -> int:
        """Size of the tables."""
        return self._table.nbytes

    def _sum(self, samples: NDArray[np.uint16] | NDArray[np.float32]) -> Floats:
        bands = self._factors.shape[0]
        out = np.zeros((bands * bands, 3))
        _project(samples, self._region.row0, self._region.col0, self._table, self._factors, out)
        return out

    def __call__(self, samples: NDArray[np.uint16] | NDArray[np.float32]) -> Floats:
        """Return the coefficients ``(bands², 3)`` of a picture's rows of samples ``(H, 3W)``."""
        rim = samples.reshape(-1, 3)[self._rim]
        radiance = rim.view(np.float16) if rim.dtype == np.uint16 else rim
        return self._sum(samples) + np.outer(self._unseen, self._rim_weights @ radiance.astype(np.float64))
