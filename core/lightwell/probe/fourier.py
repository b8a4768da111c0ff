"""Full-resolution projection of lat-long pictures: Fourier sums along rows, Legendre factors down the columns.

``c_l,±m = Σ_i G_lm(θ_i) Σ_j L_ij {cos, sin}(mφ_j)`` with ``G_lm = ω_i Q_lm(cosθ_i) sinᵐθ_i`` (MATHS §1, §2.1): the
inner sum needs ``2·bands − 1`` products a sample where the basis itself would need ``bands²``.

Where the width is a multiple of four, the four pixels that lie a quarter turn apart share their trigonometry: with
``a, b, c, d = L(φ), L(φ+π/2), L(φ+π), L(φ+3π/2)`` the sums over a quarter of the row need only

====== ============================= =============================
m mod 4 cosine                        sine
====== ============================= =============================
0       (a+b+c+d) cos mφ              (a+b+c+d) sin mφ
1       (a−c) cos mφ − (b−d) sin mφ   (a−c) sin mφ + (b−d) cos mφ
2       (a−b+c−d) cos mφ              (a−b+c−d) sin mφ
3       (a−c) cos mφ + (b−d) sin mφ   (a−c) sin mφ − (b−d) cos mφ
====== ============================= =============================

which are 13 products for four samples at five bands.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import to_float32
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats
from lightwell.probe.weights import row_weights
from lightwell.settings import ProjectionWeights
from lightwell.sh.basis import legendre_at

# Sums of one row run in float32 lanes; rows are added up in float64. No flag that assumes away NaN or infinity.
_FAST = {"contract", "reassoc", "nsz"}


@njit(cache=True, nogil=True, fastmath=_FAST)
def _fold_row(row, parts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write a+b+c+d, a−b+c−d, a−c and b−d into the four parts, colour samples still interleaved."""
    quarter = parts.shape[1]
    first, second = row[:quarter], row[quarter : 2 * quarter]
    third, fourth = row[2 * quarter : 3 * quarter], row[3 * quarter :]
    total, alternating, odd, odd_turned = parts[0], parts[1], parts[2], parts[3]
    for q in range(quarter):
        a, b, c, d = to_float32(first[q]), to_float32(second[q]), to_float32(third[q]), to_float32(fourth[q])
        total[q] = (a + c) + (b + d)
        alternating[q] = (a + c) - (b + d)
        odd[q] = a - c
        odd_turned[q] = b - d


@njit(cache=True, nogil=True, fastmath=_FAST)
def _even_sums(values, cosine, sine, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write ``Σ v cos`` and ``Σ v sin`` of each colour into ``sums`` ``(2, 3)``."""
    cr = cg = cb = sr = sg = sb = np.float32(0)
    for j in range(cosine.shape[0]):
        c, s = cosine[j], sine[j]
        red, green, blue = values[3 * j], values[3 * j + 1], values[3 * j + 2]
        cr += red * c
        cg += green * c
        cb += blue * c
        sr += red * s
        sg += green * s
        sb += blue * s
    sums[0, 0], sums[0, 1], sums[0, 2] = cr, cg, cb
    sums[1, 0], sums[1, 1], sums[1, 2] = sr, sg, sb


@njit(cache=True, nogil=True, fastmath=_FAST)
def _odd_sums(values, turned, cosine, sine, sign, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write ``Σ (v cos − sign·t sin)`` and ``Σ (v sin + sign·t cos)`` of each colour into ``sums`` ``(2, 3)``."""
    cr = cg = cb = sr = sg = sb = np.float32(0)
    for j in range(cosine.shape[0]):
        c, s = cosine[j], sine[j]
        ct, st = sign * c, sign * s
        red, green, blue = values[3 * j], values[3 * j + 1], values[3 * j + 2]
        red_t, green_t, blue_t = turned[3 * j], turned[3 * j + 1], turned[3 * j + 2]
        cr += red * c - red_t * st
        cg += green * c - green_t * st
        cb += blue * c - blue_t * st
        sr += red * s + red_t * ct
        sg += green * s + green_t * ct
        sb += blue * s + blue_t * ct
    sums[0, 0], sums[0, 1], sums[0, 2] = cr, cg, cb
    sums[1, 0], sums[1, 1], sums[1, 2] = sr, sg, sb


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_row(sums, legendre, m, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add one row's Fourier sums of order m to the coefficients of all degrees."""
    for degree in range(m, legendre.shape[0]):
        centre = degree * degree + degree
        factor = legendre[degree, m]
        for channel in range(3):
            out[centre + m, channel] += factor * sums[0, channel]
            if m > 0:
                out[centre - m, channel] += factor * sums[1, channel]


@njit(cache=True, nogil=True)
def _project_folded(samples, cosines, sines, legendre, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    parts = np.empty((4, samples.shape[1] // 4), np.float32)
    sums = np.empty((2, 3), np.float32)
    for i in range(samples.shape[0]):
        _fold_row(samples[i], parts)
        for m in range(cosines.shape[0]):
            if m % 2 == 0:
                _even_sums(parts[(m % 4) // 2], cosines[m], sines[m], sums)
            else:
                _odd_sums(parts[2], parts[3], cosines[m], sines[m], np.float32(2 - m % 4), sums)
            _add_row(sums, legendre[i], m, out)


@njit(cache=True, nogil=True)
def _project_plain(samples, cosines, sines, legendre, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    values = np.empty(samples.shape[1], np.float32)
    sums = np.empty((2, 3), np.float32)
    for i in range(samples.shape[0]):
        row = samples[i]
        for q in range(row.shape[0]):
            values[q] = to_float32(row[q])
        for m in range(cosines.shape[0]):
            _even_sums(values, cosines[m], sines[m], sums)
            _add_row(sums, legendre[i], m, out)


@njit(cache=True, nogil=True)
def _legendre_rows(theta, weights, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(theta.shape[0]):
        legendre_at(np.cos(theta[i]), bands, out[i])
        power = weights[i]
        for m in range(bands):
            for degree in range(m, bands):
                out[i, degree, m] *= power
            power *= np.sin(theta[i])


class FourierProjection:
    """Sum of weight, basis and radiance over all pixels of a lat-long picture, without a matrix.

    Exact to the rounding of float32 sums along one row; rows add up in float64.
    """

    def __init__(self, mapping: LatLong, bands: int, weights: ProjectionWeights) -> None:
        self._bands = bands
        theta = np.pi * (np.arange(mapping.height) + 0.5) / mapping.height
        self._legendre = np.zeros((mapping.height, bands, bands))
        _legendre_rows(theta, row_weights(mapping.height, mapping.width, weights), bands, self._legendre)
        self._folds = mapping.width % 4 == 0
        columns = mapping.width // 4 if self._folds else mapping.width
        phi = 2 * np.pi * (np.arange(columns) + 0.5) / mapping.width
        orders = np.arange(bands)[:, None]
        self._cosines = np.cos(orders * phi).astype(np.float32)
        self._sines = np.sin(orders * phi).astype(np.float32)

    @property
    def nbytes(self) -> int:
        """Size of the tables."""
        return self._legendre.nbytes + self._cosines.nbytes + self._sines.nbytes

    def __call__(self, samples: NDArray[np.uint16] | NDArray[np.float32]) -> Floats:
        """Return the coefficients ``(bands², 3)`` of a picture's rows of samples ``(H, 3W)``."""
        out = np.zeros((self._bands * self._bands, 3))
        kernel = _project_folded if self._folds else _project_plain
        kernel(samples, self._cosines, self._sines, self._legendre, out)
        return out
