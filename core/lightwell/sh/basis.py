"""The real, orthonormal spherical-harmonic basis, without Condon–Shortley phase, and its tangential gradient.

Each basis function is ``Y_l,±m = Q_lm(z) · {c_m, s_m}(x, y)``: a polynomial in z with the normalisation folded in,
times ``sinᵐθ cos mφ`` or ``sinᵐθ sin mφ``. Both factors follow from two-term recurrences without trigonometry, without
poles and without cancellation (MATHS §1; the same recurrence as Filament's ``CubemapSH`` and sphericart).

`basis_at`, `basis_at_float32` and `legendre_at` are building blocks for other numba kernels.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, DTypeLike, NDArray

from lightwell.conventions import MAX_BANDS


def _recurrence_tables() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return ``a_lm`` and ``a_lm b_lm`` by ``[l, m]``, and ``Q_mm / Q_{m−1,m−1}``, for all bands."""
    a = np.zeros((MAX_BANDS, MAX_BANDS))
    b = np.zeros((MAX_BANDS, MAX_BANDS))
    for degree in range(1, MAX_BANDS):
        for order in range(degree):
            a[degree, order] = np.sqrt((4 * degree**2 - 1) / (degree**2 - order**2))
            b[degree, order] = np.sqrt(((degree - 1) ** 2 - order**2) / (4 * (degree - 1) ** 2 - 1))
    orders = np.arange(1, MAX_BANDS)
    diagonal = np.ones(MAX_BANDS)
    diagonal[1:] = np.sqrt((2 * orders + 1) / (2 * orders) * np.where(orders == 1, 2, 1))
    return a, a * b, diagonal


RECURRENCE_A, RECURRENCE_AB, SECTORAL_RATIO = _recurrence_tables()
"""``Q_lm = A[l, m] z Q_{l−1,m} − AB[l, m] Q_{l−2,m}`` and ``Q_mm = SECTORAL_RATIO[m] Q_{m−1,m−1}``."""

Y00 = 1 / np.sqrt(4 * np.pi)
"""Value of the constant basis function."""


def _compile_basis_at(dtype: DTypeLike) -> Any:  # noqa: ANN401  numba's dispatcher has no public type
    """Return the kernel of `basis_at` that computes in ``dtype`` throughout."""
    a, ab, diagonal = RECURRENCE_A.astype(dtype), RECURRENCE_AB.astype(dtype), SECTORAL_RATIO.astype(dtype)
    zero, y00 = np.zeros(1, dtype)[0], np.full(1, Y00, dtype)[0]

    @njit(cache=True, nogil=True, fastmath={"contract"})
    def kernel(x, y, z, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        cosine, sine, sectoral = y00, zero, y00
        for m in range(bands):
            if m == 1:
                cosine, sine = x, y
                sectoral *= diagonal[1]
            elif m > 1:
                cosine, sine = x * cosine - y * sine, x * sine + y * cosine
                sectoral *= diagonal[m]
            before, q = zero, sectoral
            for degree in range(m, bands):
                if degree > m:
                    before, q = q, a[degree, m] * z * q - ab[degree, m] * before
                centre = degree * degree + degree
                if m == 0:
                    out[centre] = q
                else:
                    out[centre + m] = q * cosine
                    out[centre - m] = q * sine

    return kernel


basis_at = _compile_basis_at(np.float64)
"""``basis_at(x, y, z, bands, out)``: write the ``bands²`` float64 basis values at a unit vector into ``out`` (njit)."""

basis_at_float32 = _compile_basis_at(np.float32)
"""`basis_at` in float32 throughout: x, y, z and out are float32 (njit). Error below 2.9e-6 up to degree 10."""


@njit(cache=True, nogil=True, fastmath={"contract"})
def legendre_at(z, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN201
    """Write ``Q_lm(z)`` into ``out[l, m]``, ``(bands, bands)`` float64, for 0 ≤ m ≤ l (njit).

    The part of the basis that depends on z alone: a lat-long row shares it. ``Y_l,m = Q_lm sinᵐθ cos mφ`` and
    ``Y_l,−m = Q_lm sinᵐθ sin mφ``. Entries with m > l are left alone.
    """
    sectoral = Y00
    for m in range(bands):
        sectoral *= SECTORAL_RATIO[m]
        before, q = 0.0, sectoral
        out[m, m] = q
        for degree in range(m + 1, bands):
            before, q = q, RECURRENCE_A[degree, m] * z * q - RECURRENCE_AB[degree, m] * before
            out[degree, m] = q


@njit(cache=True, nogil=True)
def _evaluate_float64(directions, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(directions.shape[0]):
        basis_at(directions[i, 0], directions[i, 1], directions[i, 2], bands, out[i])


@njit(cache=True, nogil=True)
def _evaluate_float32(directions, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(directions.shape[0]):
        basis_at_float32(directions[i, 0], directions[i, 1], directions[i, 2], bands, out[i])


def _flatten(directions: ArrayLike, bands: int, dtype: DTypeLike) -> NDArray[Any]:
    """Return the directions as a contiguous ``(N, 3)`` array of ``dtype``; check shape and bands."""
    array = np.asarray(directions, dtype=dtype)
    if array.ndim == 0 or array.shape[-1] != 3:
        raise ValueError(f"directions have the shape {array.shape}; the last axis must hold x, y, z")
    if not 1 <= bands <= MAX_BANDS:
        raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
    return np.ascontiguousarray(array.reshape(-1, 3))


def evaluate(directions: ArrayLike, bands: int, dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return the basis at unit vectors (MATHS §1).

    Parameters
    ----------
    directions
        ``(..., 3)`` unit vectors; they are not normalised here.
    bands
        1 … 11; degrees 0 … bands − 1.
    dtype
        float64, or float32 for computing in single precision throughout (error below 2.9e-6).

    Returns
    -------
    ``(..., bands²)`` of ``dtype``, coefficient ``(l, m)`` at ``l² + l + m``.

    Raises
    ------
    ValueError
        Where the last axis is not 3, the bands are out of range or the dtype is another.
    """
    precision = np.dtype(dtype)
    if precision not in (np.dtype(np.float64), np.dtype(np.float32)):
        raise ValueError(f"the basis is computed in float64 or float32, not in {precision}")
    flat = _flatten(directions, bands, precision)
    out = np.empty((flat.shape[0], bands * bands), dtype=precision)
    kernel = _evaluate_float64 if precision == np.dtype(np.float64) else _evaluate_float32
    kernel(flat, bands, out)
    return out.reshape(*np.shape(directions)[:-1], bands * bands)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _evaluate_with_gradient(directions, bands, values, gradients):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(directions.shape[0]):
        x, y, z = directions[i, 0], directions[i, 1], directions[i, 2]
        cosine, sine, cosine_below, sine_below, sectoral = 1.0, 0.0, 0.0, 0.0, Y00
        for m in range(bands):
            if m > 0:
                cosine_below, sine_below = cosine, sine
                cosine, sine = x * cosine_below - y * sine_below, x * sine_below + y * cosine_below
            sectoral *= SECTORAL_RATIO[m]
            q, q_before, slope, slope_before = sectoral, 0.0, 0.0, 0.0
            for degree in range(m, bands):
                if degree > m:
                    a, ab = RECURRENCE_A[degree, m], RECURRENCE_AB[degree, m]
                    slope, slope_before = a * (q + z * slope) - ab * slope_before, slope
                    q, q_before = a * z * q - ab * q_before, q
                centre = degree * degree + degree
                values[i, centre + m] = q * cosine
                gradients[i, centre + m, 0] = q * m * cosine_below
                gradients[i, centre + m, 1] = -q * m * sine_below
                gradients[i, centre + m, 2] = slope * cosine
                if m > 0:
                    values[i, centre - m] = q * sine
                    gradients[i, centre - m, 0] = q * m * sine_below
                    gradients[i, centre - m, 1] = q * m * cosine_below
                    gradients[i, centre - m, 2] = slope * sine
        for k in range(bands * bands):
            gradient = gradients[i, k]
            radial = gradient[0] * x + gradient[1] * y + gradient[2] * z
            gradient[0] -= radial * x
            gradient[1] -= radial * y
            gradient[2] -= radial * z


def evaluate_with_gradient(directions: ArrayLike, bands: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the basis and its gradient along the unit sphere, ``∇_S Y = (I − ωωᵀ)∇Y`` (MATHS §1).

    Parameters
    ----------
    directions
        ``(..., 3)`` unit vectors.
    bands
        1 … 11.

    Returns
    -------
    Values ``(..., bands²)`` and gradients ``(..., bands², 3)``, float64; each gradient is perpendicular to its
    direction, per radian.

    Raises
    ------
    ValueError
        As `evaluate`.
    """
    flat = _flatten(directions, bands, np.float64)
    values = np.empty((flat.shape[0], bands * bands))
    gradients = np.empty((flat.shape[0], bands * bands, 3))
    _evaluate_with_gradient(flat, bands, values, gradients)
    shape = (*np.shape(directions)[:-1], bands * bands)
    return values.reshape(shape), gradients.reshape(*shape, 3)


def basis_gradients(directions: ArrayLike, bands: int) -> NDArray[np.float64]:
    """Return ``∇_S Y`` at unit vectors ``(..., 3)``, as ``(..., bands², 3)``.

    The second value of `evaluate_with_gradient`: analytic and finite everywhere, poles included.

    Raises
    ------
    ValueError
        As `evaluate`.
    """
    return evaluate_with_gradient(directions, bands)[1]
