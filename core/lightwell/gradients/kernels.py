"""Kernels of the edge sum over lat-long pictures (`lightwell.gradients.image`)."""

from __future__ import annotations

import numpy as np
from numba import njit

from lightwell.probe.fourier import PADDED_ORDERS, even_sums, fold_row, odd_sums
from lightwell.probe.half import to_float32

JUMP = 1.1
"""Distances of neighbours that differ by more are those of an outline."""


@njit(cache=True, nogil=True)
def _moving(one, other):  # type: ignore[no-untyped-def]
    """Return the 1/r with which an edge moves: of an outline what is near's, on a surface that of its middle."""
    near, far = max(one, other), min(one, other)
    return near if near > JUMP * far else 0.5 * (near + far)


@njit(cache=True, nogil=True)
def edge_weights(inverse, seen, theta_step, sines, phi_step, across, down):  # type: ignore[no-untyped-def]
    """Write the 1/r of two neighbours' edge times its length to ``across`` (H, W) and ``down`` (H−1, W).

    Edges of pixels that are not seen weigh nothing. ``sines`` (H−1,): sinθ of the edges between rows.
    """
    height, width = inverse.shape
    for i in range(height):
        for j in range(width):
            right = j + 1 if j + 1 < width else 0
            both = seen[i, j] and seen[i, right]
            across[i, j] = _moving(inverse[i, j], inverse[i, right]) * theta_step if both else 0.0
            if i + 1 < height:
                both = seen[i, j] and seen[i + 1, j]
                down[i, j] = _moving(inverse[i, j], inverse[i + 1, j]) * sines[i] * phi_step if both else 0.0


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _jump_across(samples, i, weights, jumps):  # type: ignore[no-untyped-def]
    last = weights.shape[1] - 1
    for j in range(last):
        for channel in range(3):
            q = 3 * j + channel
            jumps[0, q] = weights[i, j] * (to_float32(samples[i, q + 3]) - to_float32(samples[i, q]))
    for channel in range(3):
        q = 3 * last + channel
        jumps[0, q] = weights[i, last] * (to_float32(samples[i, channel]) - to_float32(samples[i, q]))


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _jump_down(samples, i, weights, jumps):  # type: ignore[no-untyped-def]
    for j in range(weights.shape[1]):
        for channel in range(3):
            q = 3 * j + channel
            jumps[0, q] = weights[i, j] * (to_float32(samples[i + 1, q]) - to_float32(samples[i, q]))


@njit(cache=True, nogil=True)
def _fourier(jumps, parts, cosines, sines, orders, folds, sums):  # type: ignore[no-untyped-def]
    """Write ``Σ_j J_j cos mφ_j`` and ``Σ_j J_j sin mφ_j``, m < orders, into ``sums`` (16, 2, 3)."""
    if folds:
        fold_row(jumps, 0, parts)
        for m in range(orders):
            if m % 8 == 0 or m % 8 == 2:
                even_sums(parts, (m % 4) // 2, cosines, sines, m, m + 4, sums)
            elif m % 4 == 1:
                odd_sums(parts, cosines, sines, m, sums)
    else:
        for m in range(0, orders, 2):
            even_sums(jumps, 0, cosines, sines, m, m + 1, sums)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_edges(sums, legendre, i, along_phi, cosine, sine, products, out):  # type: ignore[no-untyped-def]
    """Add a row's edges to ``out`` (bands², 9): ``Σ J y τ``, where τ is φ̂, or θ̂ with the row's cosθ and sinθ.

    ``φ̂ = (−sinφ, cosφ, 0)`` and ``θ̂ = (cosθ cosφ, cosθ sinφ, −sinθ)`` turn order m into m ± 1. ``products`` (2, 9) is
    scratch: colours and axes of one order lie side by side, so that adding them for each degree vectorises.
    """
    bands = legendre.shape[1]
    for m in range(bands):
        for channel in range(3):
            c_up, s_up = 0.5 * sums[m + 1, 0, channel], 0.5 * sums[m + 1, 1, channel]
            if m > 0:
                c_low, s_low = 0.5 * sums[m - 1, 0, channel], 0.5 * sums[m - 1, 1, channel]
            else:
                c_low, s_low = c_up, -s_up
            # Sums of J times the product of cos mφ or sin mφ with cosφ or sinφ.
            cc, cs, sc, ss = c_up + c_low, s_up - s_low, s_up + s_low, c_low - c_up
            q = 3 * channel
            if along_phi:
                products[0, q], products[0, q + 1], products[0, q + 2] = -cs, cc, 0.0
                products[1, q], products[1, q + 1], products[1, q + 2] = -ss, sc, 0.0
            else:
                products[0, q], products[0, q + 1] = cosine * cc, cosine * cs
                products[1, q], products[1, q + 1] = cosine * sc, cosine * ss
                products[0, q + 2] = -sine * sums[m, 0, channel]
                products[1, q + 2] = -sine * sums[m, 1, channel]
        for degree in range(m, bands):
            centre = degree * degree + degree
            factor = legendre[i, degree, m]
            for q in range(9):
                out[centre + m, q] += factor * products[0, q]
            if m > 0:
                for q in range(9):
                    out[centre - m, q] += factor * products[1, q]


@njit(cache=True, nogil=True)
def sum_edges(  # type: ignore[no-untyped-def]
    samples,
    across,
    down,
    edge_cosines,
    edge_sines,
    cosines,
    sines,
    across_legendre,
    down_legendre,
    down_cosine,
    down_sine,
    folds,
    out,
):
    """Add ``Σ_edges y_i (L_b − L_a) w τ`` to ``out`` ``(bands², 9)`` float64, colour by colour and in them x, y, z.

    ``samples`` (H, 3W) float32 or bits of halves; ``across``, ``down`` from `edge_weights`; the cosines and sines of mφ
    at the edges between columns and at the columns' centres ``(16, columns)``; Q_lm sinᵐθ ``(rows, bands, bands)``.
    """
    orders = across_legendre.shape[1] + 1
    jumps = np.empty((1, samples.shape[1]), np.float32)
    parts = np.empty((4, samples.shape[1] // 4), np.float32)
    sums = np.empty((PADDED_ORDERS, 2, 3), np.float32)
    products = np.empty((2, 9))
    for i in range(samples.shape[0]):
        _jump_across(samples, i, across, jumps)
        _fourier(jumps, parts, edge_cosines, edge_sines, orders, folds, sums)
        _add_edges(sums, across_legendre, i, True, 0.0, 0.0, products, out)
        if i + 1 < samples.shape[0]:
            _jump_down(samples, i, down, jumps)
            _fourier(jumps, parts, cosines, sines, orders, folds, sums)
            _add_edges(sums, down_legendre, i, False, down_cosine[i], down_sine[i], products, out)


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def sum_light(samples, inverse, row_weights, seen, luminance):  # type: ignore[no-untyped-def]
    """Return ``∫L dω`` and ``∫(L/r) dω`` over what is seen, L the luminance."""
    light, near = 0.0, 0.0
    for i in range(inverse.shape[0]):
        row_light, row_near = np.float32(0), np.float32(0)
        for j in range(inverse.shape[1]):
            value = (
                luminance[0] * to_float32(samples[i, 3 * j])
                + luminance[1] * to_float32(samples[i, 3 * j + 1])
                + luminance[2] * to_float32(samples[i, 3 * j + 2])
            )
            value = max(value, np.float32(0)) * seen[i, j]
            row_light += value
            row_near += value * inverse[i, j]
        light += row_weights[i] * row_light
        near += row_weights[i] * row_near
    return light, near
