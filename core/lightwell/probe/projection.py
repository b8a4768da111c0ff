"""From a picture to spherical-harmonic coefficients (MATHS §2)."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Literal

from lightwell.conventions import MAX_BANDS
from lightwell.errors import MappingError
from lightwell.probe.direct import DirectProjection
from lightwell.probe.fourier import FourierProjection
from lightwell.probe.half import Picture, sample_rows
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats, Mapping
from lightwell.probe.matrix import MatrixProjection
from lightwell.settings import ProjectionWeights

Blind = Literal["fill", "zero"]

MATRIX_BYTES = 1 << 25
"""Largest projection matrix: above it the basis is computed on the fly, which is faster than reading the matrix."""
CACHE_BYTES = 1 << 28
"""Tables that `projector` keeps."""


class Projector:
    """Projects pictures of one mapping onto ``bands`` bands.

    Small pictures (256×128 at five bands) go through one precomputed matrix. Larger ones need none: lat-long pictures
    go through Fourier sums along their rows, others through a table of directions.

    Parameters
    ----------
    mapping
        Mapping of the pictures that will come.
    bands
        1 … 11: ``bands²`` coefficients.
    weights
        Quadrature: ``solid-angle``, or for lat-long pictures ``paper`` or ``fejer`` (`row_weights`).
    blind
        What the probe cannot see: ``fill`` lights it with the mean of the rim, ``zero`` leaves it dark.

    Raises
    ------
    MappingError
        Where the weights are not for this mapping.
    """

    def __init__(
        self, mapping: Mapping, bands: int, weights: ProjectionWeights = "solid-angle", blind: Blind = "fill"
    ) -> None:
        if not 1 <= bands <= MAX_BANDS:
            raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
        if weights != "solid-angle" and not isinstance(mapping, LatLong):
            raise MappingError(
                f"--weights {weights} is a quadrature of lat-long rows, not for --mapping {mapping.kind}; "
                "use --weights solid-angle"
            )
        self.bands = bands
        self._size = mapping.height, mapping.width
        self._projection: MatrixProjection | FourierProjection | DirectProjection
        row0, row1, col0, col1 = mapping.region
        if (row1 - row0) * (col1 - col0) * bands * bands * 4 <= MATRIX_BYTES:
            self._projection = MatrixProjection(mapping, bands, weights, blind)
        elif isinstance(mapping, LatLong):
            self._projection = FourierProjection(mapping, bands, weights)
        else:
            self._projection = DirectProjection(mapping, bands, blind)

    @property
    def nbytes(self) -> int:
        """Size of the precomputed tables in bytes."""
        return self._projection.nbytes

    def project(self, image: Picture) -> Floats:
        """Return the coefficients ``(bands², 3)`` of a picture ``(H, W, 3)`` of finite samples, float16 or float32.

        Raises
        ------
        MappingError
            Where the picture's size is not the mapping's.
        """
        return self._projection(sample_rows(image, *self._size))


class _Cache:
    """Projectors by what they were made from; the least recently used go when the tables outgrow `CACHE_BYTES`."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: OrderedDict[tuple[object, ...], Projector] = OrderedDict()

    def get(self, mapping: Mapping, bands: int, weights: ProjectionWeights, blind: Blind) -> Projector:
        key = (mapping.key, bands, weights, blind)
        with self._lock:
            if key in self._entries:
                self._entries.move_to_end(key)
                return self._entries[key]
        made = Projector(mapping, bands, weights, blind)
        with self._lock:
            self._entries[key] = made
            while len(self._entries) > 1 and sum(entry.nbytes for entry in self._entries.values()) > CACHE_BYTES:
                self._entries.popitem(last=False)
        return made


_cache = _Cache()


def projector(
    mapping: Mapping, bands: int, weights: ProjectionWeights = "solid-angle", blind: Blind = "fill"
) -> Projector:
    """Return a `Projector`, from the cache where an equal one was made before. Raises as `Projector`."""
    return _cache.get(mapping, bands, weights, blind)
