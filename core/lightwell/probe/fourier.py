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

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import to_float32
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats
from lightwell.probe.prefetch import CACHE_LINE_BYTES, prefetch
from lightwell.probe.weights import row_weights
from lightwell.settings import ProjectionWeights
from lightwell.sh.basis import legendre_at

PADDED_ORDERS = 16
"""Orders of the tables. Those that no band needs are zero: every order has the partner that it is summed with."""
SPLIT_SAMPLES = 1 << 20
"""Pictures of more samples are projected by two threads, the upper and the lower half of the rows.

Elsewhere threads work on whole frames. One frame of full size that a camera delivers is worth two of them: the result
is there sooner.
"""

ROWS_AHEAD = 2
"""Rows are asked for so early: folding reads in bursts, and the processor's own prefetching starts anew at each."""

# Sums of one row run in float32 lanes; rows are added up in float64. No flag that assumes away NaN or infinity.
_FAST = {"contract", "reassoc", "nsz"}


# Kernels take whole arrays and indices, not views of them: numba counts the references to an array, so each view would
# change a counter that the other thread changes too.
@njit(cache=True, nogil=True, fastmath=_FAST)
def fold_row(samples, i, parts):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write a+b+c+d, a−b+c−d, a−c and b−d of row i into the four parts, colour samples still interleaved."""
    quarter = parts.shape[1]
    for q in range(quarter):
        a, b = to_float32(samples[i, q]), to_float32(samples[i, quarter + q])
        c, d = to_float32(samples[i, 2 * quarter + q]), to_float32(samples[i, 3 * quarter + q])
        parts[0, q] = (a + c) + (b + d)
        parts[1, q] = (a + c) - (b + d)
        parts[2, q] = a - c
        parts[3, q] = b - d


@njit(cache=True, nogil=True)
def _prefetch_quarter(samples, i, quarter):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Ask for a quarter of row i while the sums of another are at work; there is nothing to do for a fifth quarter."""
    if i < samples.shape[0] and quarter < 4:
        length = samples.shape[1] // 4
        for q in range(quarter * length, (quarter + 1) * length, CACHE_LINE_BYTES // samples.itemsize):
            prefetch(samples, i, q)


@njit(cache=True, nogil=True, fastmath=_FAST)
def widen_row(samples, i, values):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write row i as float32 into ``values[0]``."""
    for q in range(values.shape[1]):
        values[0, q] = to_float32(samples[i, q])


# Colours lie interleaved, and taking them apart costs as much as the products: so two orders share it.
@njit(cache=True, nogil=True, fastmath=_FAST)
def even_sums(values, part, cosines, sines, m, far, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write ``Σ v cos`` and ``Σ v sin`` of a part's colours into ``sums[m]``, and those of far into ``sums[far]``."""
    cr = cg = cb = sr = sg = sb = np.float32(0)
    far_cr = far_cg = far_cb = far_sr = far_sg = far_sb = np.float32(0)
    for j in range(cosines.shape[1]):
        c, s, far_c, far_s = cosines[m, j], sines[m, j], cosines[far, j], sines[far, j]
        red, green, blue = values[part, 3 * j], values[part, 3 * j + 1], values[part, 3 * j + 2]
        cr += red * c
        cg += green * c
        cb += blue * c
        sr += red * s
        sg += green * s
        sb += blue * s
        far_cr += red * far_c
        far_cg += green * far_c
        far_cb += blue * far_c
        far_sr += red * far_s
        far_sg += green * far_s
        far_sb += blue * far_s
    sums[m, 0, 0], sums[m, 0, 1], sums[m, 0, 2] = cr, cg, cb
    sums[m, 1, 0], sums[m, 1, 1], sums[m, 1, 2] = sr, sg, sb
    sums[far, 0, 0], sums[far, 0, 1], sums[far, 0, 2] = far_cr, far_cg, far_cb
    sums[far, 1, 0], sums[far, 1, 1], sums[far, 1, 2] = far_sr, far_sg, far_sb


@njit(cache=True, nogil=True, fastmath=_FAST)
def odd_sums(parts, cosines, sines, m, sums):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write the sums of an order m ≡ 1 (mod 4) into ``sums[m]`` and those of m + 2 into ``sums[m + 2]``."""
    cr = cg = cb = sr = sg = sb = np.float32(0)
    far_cr = far_cg = far_cb = far_sr = far_sg = far_sb = np.float32(0)
    for j in range(cosines.shape[1]):
        c, s, far_c, far_s = cosines[m, j], sines[m, j], cosines[m + 2, j], sines[m + 2, j]
        red, green, blue = parts[2, 3 * j], parts[2, 3 * j + 1], parts[2, 3 * j + 2]
        red_t, green_t, blue_t = parts[3, 3 * j], parts[3, 3 * j + 1], parts[3, 3 * j + 2]
        cr += red * c - red_t * s
        cg += green * c - green_t * s
        cb += blue * c - blue_t * s
        sr += red * s + red_t * c
        sg += green * s + green_t * c
        sb += blue * s + blue_t * c
        far_cr += red * far_c + red_t * far_s
        far_cg += green * far_c + green_t * far_s
        far_cb += blue * far_c + blue_t * far_s
        far_sr += red * far_s - red_t * far_c
        far_sg += green * far_s - green_t * far_c
        far_sb += blue * far_s - blue_t * far_c
    sums[m, 0, 0], sums[m, 0, 1], sums[m, 0, 2] = cr, cg, cb
    sums[m, 1, 0], sums[m, 1, 1], sums[m, 1, 2] = sr, sg, sb
    sums[m + 2, 0, 0], sums[m + 2, 0, 1], sums[m + 2, 0, 2] = far_cr, far_cg, far_cb
    sums[m + 2, 1, 0], sums[m + 2, 1, 1], sums[m + 2, 1, 2] = far_sr, far_sg, far_sb


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_row(sums, legendre, i, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Add the Fourier sums of row i to the coefficients."""
    bands = legendre.shape[1]
    for m in range(bands):
        for degree in range(m, bands):
            centre = degree * degree + degree
            factor = legendre[i, degree, m]
            for channel in range(3):
                out[centre + m, channel] += factor * sums[m, 0, channel]
                if m > 0:
                    out[centre - m, channel] += factor * sums[m, 1, channel]


@njit(cache=True, nogil=True)
def _project_folded(samples, cosines, sines, legendre, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    parts = np.empty((4, samples.shape[1] // 4), np.float32)
    sums = np.empty((PADDED_ORDERS, 2, 3), np.float32)
    for i in range(samples.shape[0]):
        fold_row(samples, i, parts)
        _prefetch_quarter(samples, i + ROWS_AHEAD, 0)
        for m in range(legendre.shape[1]):
            if m % 8 == 0 or m % 8 == 2:
                even_sums(parts, (m % 4) // 2, cosines, sines, m, m + 4, sums)
            elif m % 4 == 1:
                odd_sums(parts, cosines, sines, m, sums)
            else:
                continue
            _prefetch_quarter(samples, i + ROWS_AHEAD, m + 1)
        _add_row(sums, legendre, i, out)


@njit(cache=True, nogil=True)
def _project_plain(samples, cosines, sines, legendre, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    values = np.empty((1, samples.shape[1]), np.float32)
    sums = np.empty((PADDED_ORDERS, 2, 3), np.float32)
    for i in range(samples.shape[0]):
        widen_row(samples, i, values)
        for m in range(0, legendre.shape[1], 2):
            even_sums(values, 0, cosines, sines, m, m + 1, sums)
        _add_row(sums, legendre, i, out)


@njit(cache=True, nogil=True)
def legendre_rows(theta, weights, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write ``w Q_lm(cosθ) sinᵐθ`` of each row into ``out`` ``(rows, bands, bands)``."""
    for i in range(theta.shape[0]):
        legendre_at(np.cos(theta[i]), bands, out[i])
        power = weights[i]
        for m in range(bands):
            for degree in range(m, bands):
                out[i, degree, m] *= power
            power *= np.sin(theta[i])


_second_half = ThreadPoolExecutor(max_workers=2, thread_name_prefix="project")


class FourierProjection:
    """Sum of weight, basis and radiance over all pixels of a lat-long picture, without a matrix.

    Exact to the rounding of float32 sums along one row; rows add up in float64.
    """

    def __init__(self, mapping: LatLong, bands: int, weights: ProjectionWeights) -> None:
        self._bands = bands
        theta = np.pi * (np.arange(mapping.height) + 0.5) / mapping.height
        self._legendre = np.zeros((mapping.height, bands, bands))
        legendre_rows(theta, row_weights(mapping.height, mapping.width, weights), bands, self._legendre)
        self._folds = mapping.width % 4 == 0
        columns = mapping.width // 4 if self._folds else mapping.width
        phi = 2 * np.pi * (np.arange(columns) + 0.5) / mapping.width
        orders = np.arange(PADDED_ORDERS)[:, None]
        needed = orders < bands
        self._cosines = (needed * np.cos(orders * phi)).astype(np.float32)
        self._sines = (needed * np.sin(orders * phi)).astype(np.float32)

    @property
    def nbytes(self) -> int:
        """Size of the tables."""
        return self._legendre.nbytes + self._cosines.nbytes + self._sines.nbytes

    def __call__(self, samples: NDArray[np.uint16] | NDArray[np.float32]) -> Floats:
        """Return the coefficients ``(bands², 3)`` of a picture's rows of samples ``(H, 3W)``."""
        if samples.size <= SPLIT_SAMPLES:
            return self._project(samples, self._legendre)
        middle = samples.shape[0] // 2
        lower = _second_half.submit(self._project, samples[middle:], self._legendre[middle:])
        return self._project(samples[:middle], self._legendre[:middle]) + lower.result()

    def _project(self, samples: NDArray[np.uint16] | NDArray[np.float32], legendre: Floats) -> Floats:
        out = np.zeros((self._bands * self._bands, 3))
        kernel = _project_folded if self._folds else _project_plain
        kernel(samples, self._cosines, self._sines, legendre, out)
        return out
