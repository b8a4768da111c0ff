"""Light between samples that have gradients (MATHS §7.8). Needs no more than numpy: the Python client has it too.

Within the samples' hull the weights W have linear precision, and half of each gradient is right:
``c = Σ W_k (c_k + ½ G_k·(x − x_k))`` is exact for light that is quadratic in space. What lies off the hull, or across
the line or plane that few samples span, is extrapolated by the whole gradient from the nearest point of the hull.
Shepard's weights have no linear precision and take whole gradients.

Where a part of the samples has gradients, halves of those alone would tilt the light between. The sum above is one over
pairs, ``½ Σ_jk W_j W_k G_k·(x_j − x_k)``: how the light bends between two samples, by half of both gradients. One
gradient says that too, against the chord: ``W_j W_k (G_k·(x_j − x_k) − (c_j − c_k))``. So linear light stays exact, and
quadratic light is where at most one sample lacks a gradient. Without any between two, light runs straight from one to
the other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.gradients.extrapolate import limit_change
from lightwell.gradients.triangulation import Indices, triangulate

Floats = NDArray[np.float64]
Method = Literal["barycentric", "shepard"]

SAME = 1e-6
"""Samples nearer to each other than this share of the set's extent (or than a micrometre) are one place."""
THIN = 1e-3
"""Samples that leave a line or plane by less than this share of the set's extent lie on it."""
FARTHEST_M = 1e9
"""Places are within so many metres of the origin along each axis: their squares are to be finite, and their differences
exact."""
BLOCK = 1 << 20
"""Products of points and simplices that are worked on at a time."""


class SampleSet:
    """Samples of light at a few places, and the light between and near them.

    One sample extrapolates. Two light the line between them, three their triangle, more the Delaunay simplices of
    their hull; samples on a line or a plane are treated as such.

    Parameters
    ----------
    positions
        ``(n, 3)`` metres.
    coefficients
        ``(n, bands², 3)``.
    gradients
        ``(n, bands², 3, 3)`` per metre, or one array or None for each sample; None: samples alone.

    Raises
    ------
    ValueError
        Where there is no sample, arrays do not fit each other, something is not finite, a sample is farther than
        `FARTHEST_M` or two share a place.
    """

    def __init__(
        self,
        positions: ArrayLike,
        coefficients: ArrayLike,
        gradients: ArrayLike | Sequence[ArrayLike | None] | None = None,
    ) -> None:
        self.positions = _places(positions, "positions")
        self.coefficients = _finite(coefficients, "coefficients")
        if self.positions.ndim != 2 or self.positions.shape[1] != 3 or len(self.positions) == 0:
            raise ValueError(f"positions have the shape {self.positions.shape}; (n, 3) with n ≥ 1 is needed")
        if self.coefficients.ndim != 3 or self.coefficients.shape[0] != len(self.positions):
            raise ValueError(
                f"coefficients have the shape {self.coefficients.shape}; ({len(self.positions)}, bands², 3) is needed"
            )
        self.known = np.ones(len(self.positions), np.bool_)
        """Which samples have a gradient."""
        self.gradients: Floats | None = None
        if isinstance(gradients, Sequence) and any(one is None for one in gradients):
            self.known = np.array([one is not None for one in gradients])
            none = np.zeros((*self.coefficients.shape[1:], 3))
            if self.known.any():
                each = [none if one is None else np.asarray(one) for one in gradients]
                self.gradients = _finite(np.stack(each), "gradients")
        elif gradients is not None:
            self.gradients = _finite(cast(ArrayLike, gradients), "gradients")
        if self.gradients is not None and self.gradients.shape != (*self.coefficients.shape, 3):
            raise ValueError(
                f"gradients have the shape {self.gradients.shape}; {(*self.coefficients.shape, 3)} is needed"
            )
        self.places = Places(self.positions)

    def at(self, points: ArrayLike, method: Method = "barycentric", power: float = 2.0) -> Floats:
        """Return the coefficients ``(…, bands², 3)`` at points ``(…, 3)`` in metres.

        Parameters
        ----------
        points
            Anywhere; far outside the step is cut short as in `extrapolate`.
        method
            ``barycentric``, or ``shepard`` with weights 1/dᵠ.
        power
            Shepard's q.

        Raises
        ------
        ValueError
            Where a point is not finite or farther than `FARTHEST_M`.
        """
        places = _places(points, "points")
        flat = places.reshape(-1, 3)
        weights, steps = self.weights(flat, method, power)
        values = np.tensordot(weights, self.coefficients, axes=(1, 0))
        if self.gradients is not None:
            straightened: Floats = np.zeros(())
            if method == "barycentric" and not self.known.all():
                lacking = np.where(self.known, 0, weights)
                share = lacking.sum(axis=1, keepdims=True)
                steps = steps + 0.5 * ((lacking @ self.positions)[:, None] - share[..., None] * self.positions)
                straightened = np.tensordot(
                    weights * np.where(self.known, share, share - 1), self.coefficients, axes=(1, 0)
                )
            change = np.tensordot(
                weights[:, :, None] * steps, np.moveaxis(self.gradients, -1, 1), axes=([1, 2], [0, 1])
            )
            values = limit_change(values, straightened + change)
        return np.asarray(values.reshape(*places.shape[:-1], *self.coefficients.shape[1:]))

    def weights(self, points: Floats, method: Method = "barycentric", power: float = 2.0) -> tuple[Floats, Floats]:
        """Return the weights ``(p, n)`` of the samples at points ``(p, 3)``, and the steps of each ``(p, n, 3)``.

        ``c(x) = Σ_k W_k (c_k + G_k·step_k)`` where all samples have gradients.
        """
        offsets = points[:, None, :] - self.positions
        if method == "shepard":
            return _shepard(offsets, power), offsets
        weights, nearest = self.places.locate(points)
        return weights, offsets - 0.5 * (nearest[:, None, :] - self.positions)


class Places:
    """Where points lie among samples ``(n, 3)``: simplices of the samples' affine hull."""

    def __init__(self, positions: Floats) -> None:
        self.count = len(positions)
        self.origin = positions.mean(axis=0)
        spread = positions - self.origin
        extent = float(np.abs(spread).max())
        gaps = np.linalg.norm(positions[:, None] - positions, axis=2) + np.where(np.eye(self.count), np.inf, 0)
        if self.count > 1 and gaps.min() <= max(SAME * extent, 1e-6):
            first, second = np.unravel_index(int(np.argmin(gaps)), gaps.shape)
            raise ValueError(f"samples {first} and {second} share a place; leave one of them out")
        _, singular, axes = np.linalg.svd(spread, full_matrices=False)
        self.dimension = int(np.count_nonzero(singular > THIN * singular[0])) if self.count > 1 else 0
        self.axes = axes[: self.dimension]
        self.local = spread @ self.axes.T
        self.simplices: Indices = np.zeros((1, 1), np.intp)
        self.hull: Indices = np.zeros((1, 0), np.intp)
        if self.dimension:
            self.simplices, self.hull = triangulate(self.local)
            corners = np.concatenate([self.local, np.ones((self.count, 1))], axis=1)[self.simplices]
            self.inverse = np.linalg.inv(np.moveaxis(corners, 1, 2))

    def locate(self, points: Floats) -> tuple[Floats, Floats]:
        """Return the points of the hull nearest to ``points``: barycentric weights ``(p, n)`` and places ``(p, 3)``."""
        weights = np.zeros((len(points), self.count))
        if self.dimension == 0:
            weights[:, 0] = 1
        else:
            local = (points - self.origin) @ self.axes.T
            block = max(1, BLOCK // (len(self.simplices) * (self.dimension + 1)))
            for start in range(0, len(points), block):
                self._locate(local[start : start + block], weights[start : start + block])
        if self.dimension == 0:
            return weights, np.broadcast_to(self.origin, points.shape)
        return weights, self.origin + (weights @ self.local) @ self.axes

    def owners(self, points: Floats) -> Indices:
        """Return which simplex each of the points ``(p, 3)`` is in, ``(p,)``; −1 outside the hull."""
        if self.dimension == 0:
            return np.full(len(points), -1, np.intp)
        local = (points - self.origin) @ self.axes.T
        block = max(1, BLOCK // (len(self.simplices) * (self.dimension + 1)))
        parts = [self._owners(local[start : start + block]) for start in range(0, len(points), block)]
        return np.concatenate([np.where(inside, best, -1) for _, best, inside in parts])

    def _owners(self, local: Floats) -> tuple[Floats, Indices, NDArray[np.bool_]]:
        """Return barycentric coordinates ``(p, simplices, d + 1)``, the simplex that fits best, and whether it does."""
        aim = np.concatenate([local, np.ones((len(local), 1))], axis=1)
        shares = (aim @ self.inverse.reshape(-1, self.dimension + 1).T).reshape(len(local), -1, self.dimension + 1)
        lowest = shares.min(axis=2)
        best = np.argmax(lowest, axis=1)
        return shares, best, lowest[np.arange(len(local)), best] >= -1e-9

    def _locate(self, local: Floats, weights: Floats) -> None:
        shares, best, inside = self._owners(local)
        rows = np.arange(len(local))
        chosen = np.maximum(shares[rows, best], 0)
        chosen /= chosen.sum(axis=1, keepdims=True)
        weights[rows[inside, None], self.simplices[best[inside]]] = chosen[inside]
        outside = np.flatnonzero(~inside)
        if outside.size:
            facet, shares = nearest_on_facets(self.local[self.hull], local[outside])
            weights[outside[:, None], self.hull[facet]] = shares


def nearest_on_facets(facets: Floats, points: Floats) -> tuple[Indices, Floats]:
    """Return for points ``(p, d)`` which of the facets ``(f, d, d)`` is nearest, ``(p,)``, and the weights ``(p, d)``.

    The weights are those of the facet's corners at its nearest point. For each subset of corners the foot of the
    perpendicular is tried; it counts where all its weights are positive.
    """
    size = facets.shape[1]
    best = np.full(len(points), np.inf)
    which = np.zeros(len(points), np.intp)
    weights = np.zeros((len(points), size))
    rows = np.arange(len(points))
    for subset in range(1, 1 << size):
        corners = [k for k in range(size) if subset >> k & 1]
        start = facets[:, corners[0]]
        shares = np.zeros((len(points), len(facets), size))
        if len(corners) > 1:
            edges = facets[:, corners[1:]] - start[:, None]
            inverse = np.linalg.pinv(np.swapaxes(edges, 1, 2))
            rest = np.einsum("fkd,pfd->pfk", inverse, points[:, None] - start, optimize=True)
            shares[:, :, corners[1:]] = rest
            shares[:, :, corners[0]] = 1 - rest.sum(axis=2)
        else:
            shares[:, :, corners[0]] = 1
        feet = np.einsum("pfk,fkd->pfd", shares, facets, optimize=True)
        distance = np.sum((points[:, None] - feet) ** 2, axis=2)
        distance[(shares < -1e-12).any(axis=2)] = np.inf
        facet = np.argmin(distance, axis=1)
        nearer = distance[rows, facet] < best
        best[nearer] = distance[rows, facet][nearer]
        which[nearer] = facet[nearer]
        weights[nearer] = np.maximum(shares[rows, facet][nearer], 0)
    return which, weights / weights.sum(axis=1, keepdims=True)


def _shepard(offsets: Floats, power: float) -> Floats:
    """Return Shepard's weights ``(p, n)`` of offsets ``(p, n, 3)``; at a sample it alone counts."""
    distance = np.linalg.norm(offsets, axis=2)
    nearest = distance.min(axis=1, keepdims=True)
    here = distance <= 1e-12
    with np.errstate(divide="ignore", invalid="ignore"):
        relative = np.where(nearest > 0, (nearest / distance) ** power, 0)
    weights = np.where(here.any(axis=1, keepdims=True), here, relative)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _finite(values: ArrayLike, name: str) -> Floats:
    array = np.asarray(values, dtype=np.float64)
    if not np.isfinite(array).all():
        raise ValueError(f"{name} must be finite")
    return array


def _places(values: ArrayLike, name: str) -> Floats:
    array = _finite(values, name)
    if array.size and np.abs(array).max() > FARTHEST_M:
        raise ValueError(f"{name} must be within {FARTHEST_M:g} m of the origin")
    return array
