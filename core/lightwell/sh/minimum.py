"""The least value of an SH expansion over the sphere.

Up to three bands the expansion is a quadratic form on the sphere and its minimum is the solution of a trust-region
problem, exact in every case (MATHS §4.2). Above three bands, the expansion is evaluated at ``12 bands²`` points that
cover the sphere evenly, and the twelve lowest, apart from each other, are refined by damped Newton steps in the tangent
plane. (With the ``8 bands²`` points and four starts of MATHS, one vector of noise in three hundred was missed.)
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count
from lightwell.sh.basis import RECURRENCE_A, RECURRENCE_AB, SECTORAL_RATIO, Y00, evaluate

_STARTS = 12
_NEWTON_STEPS = 12


def minimum(coefficients: ArrayLike) -> tuple[float, NDArray[np.float64]]:
    """Return the least value over the sphere and a direction in which it is taken.

    Parameters
    ----------
    coefficients
        ``(bands²,)``, one channel; for irradiance pass ``A_l c_lm``.

    Returns
    -------
    The value, and a ``(3,)`` unit vector (+Z for a constant, which takes it everywhere).

    Raises
    ------
    ValueError
        Where the shape is not ``(bands²,)``.
    """
    array = np.ascontiguousarray(coefficients, dtype=np.float64)
    if array.ndim != 1:
        raise ValueError(f"one channel has the shape (bands²,), not {array.shape}")
    bands = bands_of_count(len(array))
    if bands <= 3:
        value, x, y, z = _quadratic_minimum(_padded(array))
    else:
        points, basis = _cover(bands)
        value, x, y, z = _search_minimum(array, bands, points, basis)
    return float(value), np.array([x, y, z])


def is_at_least(coefficients: ArrayLike, floor: float) -> bool:
    """Return whether the expansion ``(bands²,)`` is nowhere below ``floor``; quicker than `minimum` where it is."""
    array = np.ascontiguousarray(coefficients, dtype=np.float64)
    bands = bands_of_count(len(array))
    if bands <= 3:
        return bool(_quadratic_minimum(_padded(array))[0] >= floor)
    points, basis = _cover(bands)
    if _any_below(array, basis, floor):
        return False
    return bool(_search_minimum(array, bands, points, basis)[0] >= floor)


def _padded(array: NDArray[np.float64]) -> NDArray[np.float64]:
    if len(array) == 9:
        return array
    padded = np.zeros(9)
    padded[: len(array)] = array
    return padded


@cache
def _cover(bands: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return ``12 bands²`` Fibonacci points on the sphere, ``(P, 3)``, and the basis there, ``(P, bands²)``."""
    count = 12 * bands * bands
    index = np.arange(count)
    z = 1 - (2 * index + 1) / count
    angle = index * np.pi * (3 - np.sqrt(5))
    ring = np.sqrt(1 - z * z)
    points = np.stack([ring * np.cos(angle), ring * np.sin(angle), z], axis=1)
    return points, evaluate(points, bands)


@njit(cache=True, nogil=True)
def _eigen_symmetric(matrix, vectors):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Turn the symmetric 3 × 3 ``matrix`` into its eigenvalues on the diagonal, ``vectors`` into its eigenvectors.

    Cyclic Jacobi rotations (Golub and Van Loan, §8.5).
    """
    vectors[:] = 0.0
    for i in range(3):
        vectors[i, i] = 1.0
    for _ in range(20):
        off = abs(matrix[0, 1]) + abs(matrix[0, 2]) + abs(matrix[1, 2])
        if off <= 1e-18 * (abs(matrix[0, 0]) + abs(matrix[1, 1]) + abs(matrix[2, 2])):
            return
        for p in range(2):
            for q in range(p + 1, 3):
                if matrix[p, q] == 0.0:
                    continue
                theta = (matrix[q, q] - matrix[p, p]) / (2 * matrix[p, q])
                tangent = (1.0 if theta >= 0 else -1.0) / (abs(theta) + np.sqrt(theta * theta + 1))
                cosine = 1 / np.sqrt(tangent * tangent + 1)
                sine = tangent * cosine
                for k in range(3):
                    a, b = matrix[k, p], matrix[k, q]
                    matrix[k, p], matrix[k, q] = cosine * a - sine * b, sine * a + cosine * b
                for k in range(3):
                    a, b = matrix[p, k], matrix[q, k]
                    matrix[p, k], matrix[q, k] = cosine * a - sine * b, sine * a + cosine * b
                for k in range(3):
                    a, b = vectors[k, p], vectors[k, q]
                    vectors[k, p], vectors[k, q] = cosine * a - sine * b, sine * a + cosine * b


@njit(cache=True, nogil=True)
def _quadratic_minimum(c):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return (value, x, y, z) of the minimum of nine coefficients: ``min c₀' + b·n + nᵀAn`` over ``|n| = 1``.

    With A = QΛQᵀ and g = Qᵀb, the minimiser is ``y_i = −g_i / (2(d_i + δ))``, where d_i = λ_i − λ_min ≥ 0 and δ ≥ 0
    solves φ(δ) = |y|² = 1. In the hard case (g vanishes where d does, and φ(0) < 1) δ is 0 and the rest of the length
    goes along the lowest eigenvector.
    """
    k0, k1 = 0.5 / np.sqrt(np.pi), np.sqrt(0.75 / np.pi)
    k20, k2, k22 = np.sqrt(5 / (16 * np.pi)), np.sqrt(15 / (4 * np.pi)), np.sqrt(15 / (16 * np.pi))
    b = np.array([k1 * c[3], k1 * c[1], k1 * c[2]])
    form = np.array(
        [
            [k22 * c[8] - k20 * c[6], k2 * c[4] / 2, k2 * c[7] / 2],
            [k2 * c[4] / 2, -k22 * c[8] - k20 * c[6], k2 * c[5] / 2],
            [k2 * c[7] / 2, k2 * c[5] / 2, 2 * k20 * c[6]],
        ]
    )
    eigen = form.copy()
    vectors = np.empty((3, 3))
    _eigen_symmetric(eigen, vectors)

    lowest = 0
    for i in range(1, 3):
        if eigen[i, i] < eigen[lowest, lowest]:
            lowest = i
    d, g = np.empty(3), np.zeros(3)
    for i in range(3):
        d[i] = eigen[i, i] - eigen[lowest, lowest]
        for k in range(3):
            g[i] += vectors[k, i] * b[k]
    length = np.sqrt(g[0] * g[0] + g[1] * g[1] + g[2] * g[2])

    y = np.zeros(3)
    at_zero = 0.0
    for i in range(3):
        if d[i] > 0:
            at_zero += (g[i] / (2 * d[i])) ** 2
        elif g[i] != 0:
            at_zero = np.inf
    if at_zero < 1:
        for i in range(3):
            if d[i] > 0:
                y[i] = -g[i] / (2 * d[i])
        y[lowest] = np.sqrt(1 - at_zero)
    else:
        low, high = abs(g[lowest]) / 2, length / 2
        delta = high
        for _ in range(100):
            phi, slope = 0.0, 0.0
            for i in range(3):
                if g[i] != 0:
                    term = (g[i] / (2 * (d[i] + delta))) ** 2
                    phi += term
                    slope -= 2 * term / (d[i] + delta)
            if phi > 1:
                low = delta
            else:
                high = delta
            # Newton on 1/√φ − 1, which is nearly linear in δ; bisection where it leaves the bracket.
            following = delta + 2 * phi * (1 - np.sqrt(phi)) / slope
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - delta) <= 1e-16 * delta:
                break
            delta = following
        for i in range(3):
            if g[i] != 0:
                y[i] = -g[i] / (2 * (d[i] + delta))

    n = np.zeros(3)
    for k in range(3):
        for i in range(3):
            n[k] += vectors[k, i] * y[i]
    norm = np.sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2])
    value = k0 * c[0]
    for k in range(3):
        n[k] /= norm
    for k in range(3):
        value += n[k] * (b[k] + form[k, 0] * n[0] + form[k, 1] * n[1] + form[k, 2] * n[2])
    return value, n[0], n[1], n[2]


@njit(cache=True, nogil=True, fastmath={"contract"})
def _value_at(c, bands, x, y, z):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    cosine, sine, sectoral, value = 1.0, 0.0, Y00, 0.0
    for m in range(bands):
        if m > 0:
            cosine, sine = x * cosine - y * sine, x * sine + y * cosine
        sectoral *= SECTORAL_RATIO[m]
        q, q_before = sectoral, 0.0
        for degree in range(m, bands):
            if degree > m:
                q, q_before = RECURRENCE_A[degree, m] * z * q - RECURRENCE_AB[degree, m] * q_before, q
            centre = degree * degree + degree
            value += q * c[centre + m] * cosine
            if m > 0:
                value += q * c[centre - m] * sine
    return value


@njit(cache=True, nogil=True, fastmath={"contract"})
def _derivatives_at(c, bands, x, y, z, gradient, hessian):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Write gradient and Hessian, in space, of the polynomial ``Σ c Y`` that the recurrence defines."""
    gradient[:] = 0.0
    hessian[:] = 0.0
    cosine, sine, cosine1, sine1, cosine2, sine2 = 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    sectoral = Y00
    for m in range(bands):
        if m > 0:
            cosine2, sine2 = cosine1, sine1
            cosine1, sine1 = cosine, sine
            cosine, sine = x * cosine1 - y * sine1, x * sine1 + y * cosine1
        sectoral *= SECTORAL_RATIO[m]
        # Sums over the degree of c_l,±m times Q, Q' and Q''.
        u, v, u1, v1, u2, v2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        q, q_before, slope, slope_before, bend, bend_before = sectoral, 0.0, 0.0, 0.0, 0.0, 0.0
        for degree in range(m, bands):
            if degree > m:
                a, ab = RECURRENCE_A[degree, m], RECURRENCE_AB[degree, m]
                bend, bend_before = a * (2 * slope + z * bend) - ab * bend_before, bend
                slope, slope_before = a * (q + z * slope) - ab * slope_before, slope
                q, q_before = a * z * q - ab * q_before, q
            centre = degree * degree + degree
            plus = c[centre + m]
            u, u1, u2 = u + plus * q, u1 + plus * slope, u2 + plus * bend
            if m > 0:
                minus = c[centre - m]
                v, v1, v2 = v + minus * q, v1 + minus * slope, v2 + minus * bend
        gradient[0] += m * (u * cosine1 + v * sine1)
        gradient[1] += m * (v * cosine1 - u * sine1)
        gradient[2] += u1 * cosine + v1 * sine
        hessian[0, 0] += m * (m - 1) * (u * cosine2 + v * sine2)
        hessian[0, 1] += m * (m - 1) * (v * cosine2 - u * sine2)
        hessian[0, 2] += m * (u1 * cosine1 + v1 * sine1)
        hessian[1, 2] += m * (v1 * cosine1 - u1 * sine1)
        hessian[2, 2] += u2 * cosine + v2 * sine
    hessian[1, 1] = -hessian[0, 0]
    hessian[1, 0], hessian[2, 0], hessian[2, 1] = hessian[0, 1], hessian[0, 2], hessian[1, 2]


@njit(cache=True, nogil=True)
def _descend(c, bands, n, longest_step):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Move the unit vector ``n`` downhill to a minimum, in place, and return the value there."""
    gradient, hessian = np.empty(3), np.empty((3, 3))
    first, second, candidate = np.empty(3), np.empty(3), np.empty(3)
    value = _value_at(c, bands, n[0], n[1], n[2])
    for _ in range(_NEWTON_STEPS):
        _derivatives_at(c, bands, n[0], n[1], n[2], gradient, hessian)
        # Tangent frame of Duff and others 2017.
        sign = 1.0 if n[2] >= 0 else -1.0
        a = -1 / (sign + n[2])
        b = n[0] * n[1] * a
        first[0], first[1], first[2] = 1 + sign * n[0] * n[0] * a, sign * b, -sign * n[0]
        second[0], second[1], second[2] = b, sign + n[1] * n[1] * a, -n[1]
        g1, g2, h11, h12, h22, radial = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for i in range(3):
            g1 += gradient[i] * first[i]
            g2 += gradient[i] * second[i]
            radial += gradient[i] * n[i]
            for k in range(3):
                h11 += first[i] * hessian[i, k] * first[k]
                h12 += first[i] * hessian[i, k] * second[k]
                h22 += second[i] * hessian[i, k] * second[k]
        h11, h22 = h11 - radial, h22 - radial
        # Eigenvalues of the tangential Hessian, taken positive, so that the step goes downhill off a saddle or a top.
        half_trace, half_difference = 0.5 * (h11 + h22), 0.5 * (h11 - h22)
        root = np.sqrt(half_difference * half_difference + h12 * h12)
        angle = 0.5 * np.arctan2(h12, half_difference)
        cosine, sine = np.cos(angle), np.sin(angle)
        floor = 1e-9 * (abs(half_trace) + root) + 1e-300
        along = -(cosine * g1 + sine * g2) / max(abs(half_trace + root), floor)
        across = -(cosine * g2 - sine * g1) / max(abs(half_trace - root), floor)
        length = np.sqrt(along * along + across * across)
        if length > longest_step:
            along, across, length = along * longest_step / length, across * longest_step / length, longest_step
        step1, step2 = cosine * along - sine * across, sine * along + cosine * across
        moved = False
        for _ in range(8):
            norm = 0.0
            for i in range(3):
                candidate[i] = n[i] + step1 * first[i] + step2 * second[i]
                norm += candidate[i] * candidate[i]
            norm = np.sqrt(norm)
            for i in range(3):
                candidate[i] /= norm
            lower = _value_at(c, bands, candidate[0], candidate[1], candidate[2])
            if lower < value:
                value, moved = lower, True
                n[:] = candidate
                break
            step1, step2 = 0.5 * step1, 0.5 * step2
        if not moved or length < 1e-9:
            break
    return value


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _values_at_points(c, basis, values):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(basis.shape[0]):
        total = 0.0
        for k in range(basis.shape[1]):
            total += basis[i, k] * c[k]
        values[i] = total


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _any_below(c, basis, floor):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for i in range(basis.shape[0]):
        total = 0.0
        for k in range(basis.shape[1]):
            total += basis[i, k] * c[k]
        if total < floor:
            return True
    return False


@njit(cache=True, nogil=True)
def _search_minimum(c, bands, points, basis):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Return (value, x, y, z) of the lowest minimum found from the lowest points."""
    values = np.empty(points.shape[0])
    _values_at_points(c, basis, values)
    # Starts are apart by a fraction of the shortest wavelength, so that they do not share one basin.
    reach = 0.5 / bands
    best, best_value = points[0].copy(), np.inf
    for _ in range(_STARTS):
        start = np.argmin(values)
        if values[start] == np.inf:
            break
        n = points[start].copy()
        for i in range(points.shape[0]):
            cosine = points[start, 0] * points[i, 0] + points[start, 1] * points[i, 1] + points[start, 2] * points[i, 2]
            if cosine > 1 - 0.5 * reach * reach:
                values[i] = np.inf
        value = _descend(c, bands, n, reach)
        if value < best_value:
            best_value = value
            best[:] = n
    return best_value, best[0], best[1], best[2]
