"""Projection of small pictures with one precomputed matrix."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import to_float32
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats, Mapping
from lightwell.probe.rim import rim_weights
from lightwell.probe.weights import row_weights
from lightwell.settings import ProjectionWeights
from lightwell.sh.basis import basis_at, evaluate


@njit(cache=True, nogil=True)
def _add_samples(pixel, direction, solid_angle, bands, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    basis = np.empty(bands * bands)
    for n in range(pixel.shape[0]):
        basis_at(direction[n, 0], direction[n, 1], direction[n, 2], bands, basis)
        row = out[pixel[n]]
        for k in range(basis.shape[0]):
            row[k] += solid_angle[n] * basis[k]


@njit(cache=True, nogil=True, fastmath={"contract", "reassoc", "nsz"})
def _multiply(samples, first_row, first_column, matrix, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    width = matrix.shape[2]
    red, green, blue = np.empty(width, np.float32), np.empty(width, np.float32), np.empty(width, np.float32)
    for i in range(matrix.shape[0]):
        row = samples[first_row + i, 3 * first_column :]
        for x in range(width):
            red[x] = to_float32(row[3 * x])
            green[x] = to_float32(row[3 * x + 1])
            blue[x] = to_float32(row[3 * x + 2])
        for k in range(matrix.shape[1]):
            weights = matrix[i, k]
            r, g, b = np.float32(0), np.float32(0), np.float32(0)
            for x in range(width):
                r += weights[x] * red[x]
                g += weights[x] * green[x]
                b += weights[x] * blue[x]
            out[k, 0] += r
            out[k, 1] += g
            out[k, 2] += b


def projection_matrix(mapping: Mapping, bands: int, weights: ProjectionWeights, blind: str) -> Floats:
    """Return what each pixel of the mapping's region adds to each coefficient, ``(pixels, bands²)`` float64.

    Lat-long: quadrature weight times the basis at the pixel's centre. Other mappings: the integral of the basis over
    the pixel's footprint. With ``blind`` = ``fill``, what the footprints leave of the integral of the basis over the
    whole sphere — the blind cone, and the rounding of the quadrature — is lit by the mean of the rim (`rim_weights`),
    so that a constant picture gives exactly ``√(4π)`` and nothing else. With ``zero`` it stays dark.
    """
    if isinstance(mapping, LatLong):
        basis = evaluate(mapping.directions(*mapping.pixel_centres())[0], bands)
        basis *= row_weights(mapping.height, mapping.width, weights)[:, None, None]
        return np.asarray(basis.reshape(-1, bands * bands))
    row0, row1, col0, col1 = mapping.region
    matrix = footprint_matrix(mapping, bands)
    if blind == "fill":
        rim = rim_weights(mapping).reshape(mapping.height, mapping.width)[row0:row1, col0:col1]
        matrix += np.outer(rim, unseen_moments(matrix.sum(axis=0)))
    return matrix


def footprint_matrix(mapping: Mapping, bands: int) -> Floats:
    """Return the integral of the basis over the footprint of each pixel of the region, ``(pixels, bands²)`` float64."""
    row0, row1, col0, col1 = mapping.region
    matrix = np.zeros(((row1 - row0) * (col1 - col0), bands * bands))
    for pixel, direction, solid_angle in mapping.footprints():
        row, column = np.divmod(pixel, mapping.width)
        _add_samples((row - row0) * (col1 - col0) + column - col0, direction, solid_angle, bands, matrix)
    return matrix


def unseen_moments(seen: Floats) -> Floats:
    """Return the integral of each basis function over what is not seen, from that over what is, ``(bands²,)``."""
    unseen = -seen
    unseen[0] += math.sqrt(4 * math.pi)
    return unseen


class MatrixProjection:
    """One matrix that folds unwrapping, orientation, solid angle, mask, blind cone and basis."""

    def __init__(self, mapping: Mapping, bands: int, weights: ProjectionWeights, blind: str) -> None:
        self._region = mapping.region
        rows = self._region.row1 - self._region.row0
        matrix = projection_matrix(mapping, bands, weights, blind).reshape(rows, -1, bands * bands)
        # Row by row, then coefficient by coefficient: the kernel streams through it.
        self._matrix = np.ascontiguousarray(matrix.transpose(0, 2, 1), dtype=np.float32)

    @property
    def nbytes(self) -> int:
        """Size of the matrix."""
        return self._matrix.nbytes

    def __call__(self, samples: NDArray[np.uint16] | NDArray[np.float32]) -> Floats:
        """Return the coefficients ``(bands², 3)`` of a picture's rows of samples ``(H, 3W)``."""
        out = np.zeros((self._matrix.shape[1], 3))
        _multiply(samples, self._region.row0, self._region.col0, self._matrix, out)
        return out
