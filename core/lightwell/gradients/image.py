"""Gradients from a picture and how far away each of its pixels is: the edge-aware sum of MATHS §7.5.

    G_i ≈ Σ_{edges a|b} y_i(ω_e) (L_b − L_a) max(1/r_a, 1/r_b) ℓ_e τ_ab

Between neighbouring pixels a and b the radiance jumps; what moves such an edge is the nearer of the two. So occluders
are right, no normals are needed, and nothing blows up at grazing angles. Where 1/r of both differ by less than a tenth
they are of one surface, and their mean takes the maximum's place: in a room that takes a third off the error. Along the
rows of a lat-long picture the sum is a Fourier sum: τ raises and lowers the order m by one. Other mappings are read as
a lat-long picture first (`lightwell.gradients.panorama`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import LUMINANCE, MAX_BANDS, coefficient_count
from lightwell.errors import MappingError
from lightwell.gradients.kernels import edge_weights, sum_edges, sum_light
from lightwell.probe.fourier import PADDED_ORDERS, legendre_rows
from lightwell.probe.half import Picture, sample_rows
from lightwell.probe.weights import row_weights

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Tables:
    """What depends on the picture's size and the bands alone."""

    edge_cosines: NDArray[np.float32]
    edge_sines: NDArray[np.float32]
    cosines: NDArray[np.float32]
    sines: NDArray[np.float32]
    across_legendre: Floats
    down_legendre: Floats
    down_cosine: Floats
    down_sine: Floats
    row_weights: Floats
    folds: bool


@lru_cache(maxsize=8)
def _tables(height: int, width: int, bands: int) -> _Tables:
    folds = width % 4 == 0
    columns = np.arange(width // 4 if folds else width)
    orders = np.arange(PADDED_ORDERS)[:, None]
    needed = orders <= bands
    edge, centre = (2 * np.pi * (columns + shift) / width for shift in (1.0, 0.5))
    middle = np.pi * (np.arange(height) + 0.5) / height
    between = np.pi * np.arange(1, height) / height
    across, down = np.zeros((height, bands, bands)), np.zeros((height - 1, bands, bands))
    legendre_rows(middle, np.ones(height), bands, across)
    legendre_rows(between, np.ones(height - 1), bands, down)
    return _Tables(
        (needed * np.cos(orders * edge)).astype(np.float32),
        (needed * np.sin(orders * edge)).astype(np.float32),
        (needed * np.cos(orders * centre)).astype(np.float32),
        (needed * np.sin(orders * centre)).astype(np.float32),
        across,
        down,
        np.cos(between),
        np.sin(between),
        row_weights(height, width),
        folds,
    )


class GradientPlan:
    """Makes gradients of lat-long pictures, all seen at the same distances.

    Making one takes about as long as using it: a probe that moves may make one a frame.

    Parameters
    ----------
    height, width
        Size of the pictures; row 0 is +Z of the axes that the gradients are in.
    bands
        1 … 11.
    inverse_distance
        ``(height, width)`` 1/r per metre at the pixels' centres, 0 for sky.
    seen
        ``(height, width)`` bool: the pixels that the probe sees. The edges of others are left out: their light is
        taken to go on. None: all.

    Raises
    ------
    ValueError
        Where the distances have another shape or are not finite and at least 0.
    """

    def __init__(
        self,
        height: int,
        width: int,
        bands: int,
        inverse_distance: ArrayLike,
        seen: NDArray[np.bool_] | None = None,
    ) -> None:
        if not 1 <= bands <= MAX_BANDS:
            raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
        inverse = np.ascontiguousarray(inverse_distance, dtype=np.float32)
        if inverse.shape != (height, width):
            raise ValueError(f"inverse distances have the shape {inverse.shape}, not ({height}, {width})")
        if not (np.isfinite(inverse).all() and (inverse >= 0).all()):
            raise ValueError("inverse distances must be finite and at least 0")
        self.bands = bands
        self._size = height, width
        self._inverse = inverse
        self._seen = np.ones(inverse.shape, np.bool_) if seen is None else np.ascontiguousarray(seen, np.bool_)
        if self._seen.shape != inverse.shape:
            raise ValueError(f"what is seen has the shape {self._seen.shape}, not ({height}, {width})")
        self._tables = _tables(height, width, bands)
        self._across = np.empty((height, width), np.float32)
        self._down = np.empty((height - 1, width), np.float32)
        edge_weights(
            inverse,
            self._seen,
            np.pi / height,
            self._tables.down_sine,
            2 * np.pi / width,
            self._across,
            self._down,
        )

    def apply(self, image: Picture, out: Floats | None = None) -> Floats:
        """Return the gradients ``(bands², 3, 3)`` float64 per metre of a picture ``(height, width, 3)``.

        ``out`` is written to where it is given.

        Raises
        ------
        MappingError
            Where the picture has another size.
        """
        samples = self._samples(image)
        count = coefficient_count(self.bands)
        total = np.zeros((count, 9))
        t = self._tables
        sum_edges(
            samples,
            self._across,
            self._down,
            t.edge_cosines,
            t.edge_sines,
            t.cosines,
            t.sines,
            t.across_legendre,
            t.down_legendre,
            t.down_cosine,
            t.down_sine,
            t.folds,
            total,
        )
        out = np.empty((count, 3, 3)) if out is None else out
        out[:] = total.reshape(count, 3, 3)
        return out

    def mean_distance(self, image: Picture) -> float:
        """Return how far the picture's light is on average, ``∫L / ∫(L/r)`` in metres (MATHS §7.4).

        Infinite where no near light is seen. Raises as `apply`.
        """
        light, near = sum_light(
            self._samples(image), self._inverse, self._tables.row_weights, self._seen, LUMINANCE.astype(np.float32)
        )
        return light / near if near > 0 else float("inf")

    def _samples(self, image: Picture) -> NDArray[np.uint16] | NDArray[np.float32]:
        try:
            return sample_rows(image, *self._size)
        except MappingError as error:
            raise MappingError(f"gradients: {error}") from None
