"""Exact rotation of coefficients (Ivanic and Ruedenberg 1996, with the erratum of 1998; MATHS §8).

The matrix of each degree follows from that of the degree below and from degree 1, which is the rotation itself in the
order (y, z, x). The recurrence holds unchanged for the basis without Condon–Shortley phase.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import MAX_BANDS, bands_of_count

_TOLERANCE = 1e-5
"""How far ``RᵀR`` may be from the identity: room for matrices that were stored as float32."""


@njit(cache=True, nogil=True)
def _p(i, a, n, degree, one, below):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return P(i; a, n) of Ivanic and Ruedenberg: degree 1 times the degree below; all indices count from −l."""
    if n == degree:
        return one[i + 1, 2] * below[a + degree - 1, 2 * degree - 2] - one[i + 1, 0] * below[a + degree - 1, 0]
    if n == -degree:
        return one[i + 1, 2] * below[a + degree - 1, 0] + one[i + 1, 0] * below[a + degree - 1, 2 * degree - 2]
    return one[i + 1, 1] * below[a + degree - 1, n + degree - 1]


@njit(cache=True, nogil=True)
def _v_term(m, n, degree, one, below):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if m == 0:
        return _p(1, 1, n, degree, one, below) + _p(-1, -1, n, degree, one, below)
    if m > 0:
        first = _p(1, m - 1, n, degree, one, below)
        if m == 1:
            return np.sqrt(2.0) * first
        return first - _p(-1, -m + 1, n, degree, one, below)
    second = _p(-1, -m - 1, n, degree, one, below)
    if m == -1:
        return np.sqrt(2.0) * second
    return _p(1, m + 1, n, degree, one, below) + second


@njit(cache=True, nogil=True)
def _w_term(m, n, degree, one, below):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    if m > 0:
        return _p(1, m + 1, n, degree, one, below) + _p(-1, -m - 1, n, degree, one, below)
    return _p(1, m - 1, n, degree, one, below) - _p(-1, -m + 1, n, degree, one, below)


@njit(cache=True, nogil=True)
def _rotation_blocks(rotation, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Fill the diagonal blocks of ``out``, ``(bands², bands²)``, which holds zeros."""
    out[0, 0] = 1.0
    if bands == 1:
        return
    one = np.empty((3, 3))
    axes = (1, 2, 0)
    for row in range(3):
        for column in range(3):
            one[row, column] = out[1 + row, 1 + column] = rotation[axes[row], axes[column]]
    for degree in range(2, bands):
        start, start_below = degree * degree, (degree - 1) * (degree - 1)
        below = out[start_below:start, start_below:start]
        for m in range(-degree, degree + 1):
            for n in range(-degree, degree + 1):
                magnitude = abs(m)
                if abs(n) == degree:
                    denominator = 2.0 * degree * (2 * degree - 1)
                else:
                    denominator = float((degree + n) * (degree - n))
                value = 0.0
                if magnitude < degree:
                    u = np.sqrt((degree + m) * (degree - m) / denominator)
                    value += u * _p(0, m, n, degree, one, below)
                if m == 0:
                    v = -0.5 * np.sqrt(2.0 * (degree - 1) * degree / denominator)
                else:
                    v = 0.5 * np.sqrt((degree + magnitude - 1) * (degree + magnitude) / denominator)
                value += v * _v_term(m, n, degree, one, below)
                if m != 0 and magnitude < degree - 1:
                    w = -0.5 * np.sqrt((degree - magnitude - 1) * (degree - magnitude) / denominator)
                    value += w * _w_term(m, n, degree, one, below)
                out[start + degree + m, start + degree + n] = value


def rotation_matrix(rotation: ArrayLike, bands: int) -> NDArray[np.float64]:
    """Return the matrix M that rotates coefficients: ``c' = M c``, and ``Y(Rω) = M Y(ω)``.

    Parameters
    ----------
    rotation
        ``(3, 3)`` proper rotation R; the function f turns into ``f'(ω) = f(R⁻¹ω)``: what was at ω is at Rω.
    bands
        1 … 11.

    Returns
    -------
    ``(bands², bands²)`` float64, orthogonal, one block a degree.

    Raises
    ------
    ValueError
        Where ``rotation`` is no proper rotation (wrong shape, not finite, scaled, skewed, or a reflection), or the
        bands are out of range.
    """
    if not 1 <= bands <= MAX_BANDS:
        raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
    matrix = _proper_rotation(rotation)
    out = np.zeros((bands * bands, bands * bands))
    _rotation_blocks(matrix, bands, out)
    return out


def rotate(coefficients: ArrayLike, rotation: ArrayLike) -> NDArray[np.float64]:
    """Return the coefficients of the function rotated by ``rotation``.

    Parameters
    ----------
    coefficients
        ``(bands², ...)``, for instance ``(bands², 3)`` for RGB.
    rotation
        ``(3, 3)`` proper rotation; `world_from_local` takes coefficients from local to world axes.

    Returns
    -------
    The same shape, float64.

    Raises
    ------
    ValueError
        As `rotation_matrix`, and where the number of coefficients is no square.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    rotated: NDArray[np.float64] = np.tensordot(
        rotation_matrix(rotation, bands_of_count(array.shape[0])), array, axes=1
    )
    return rotated


def rotate_gradients(gradients: ArrayLike, rotation: ArrayLike) -> NDArray[np.float64]:
    """Return derivatives ``(bands², ..., 3)`` along x, y, z of the function rotated by ``rotation``, space with it.

    The coefficients are turned, and the axes along which they change: ``G'_k = Σ_j R_kj M G_j``. Raises as `rotate`.
    """
    return np.asarray(rotate(gradients, rotation) @ np.asarray(rotation, dtype=np.float64).T)


def _proper_rotation(rotation: ArrayLike) -> NDArray[np.float64]:
    """Return the rotation as a contiguous float64 array, or raise ``ValueError`` that says why it is none."""
    matrix: NDArray[Any] = np.ascontiguousarray(rotation, dtype=np.float64)
    if matrix.shape != (3, 3):
        raise ValueError(f"a rotation has the shape (3, 3), not {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise ValueError("the rotation holds NaN or Inf")
    error = float(np.abs(matrix.T @ matrix - np.eye(3)).max())
    if error > _TOLERANCE:
        raise ValueError(f"the matrix is no rotation: its columns are not orthonormal (RᵀR − I reaches {error:.1e})")
    if np.linalg.det(matrix) < 0:
        raise ValueError("the matrix is a reflection (determinant −1), not a rotation; it would change handedness")
    return matrix
