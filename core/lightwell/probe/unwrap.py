"""Between mappings: lat-long backdrops from any probe picture, and pictures of any mapping from any other."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.probe.half import Picture, sample_rows, to_float32
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Floats, Mapping
from lightwell.probe.rim import rim_weights


class Lookup:
    """Bilinear reading of one mapping's pictures in given directions: four pixels and four weights a direction.

    Pixels that the probe does not cover have no weight. Directions that the probe does not see get the mean of its
    rim.
    """

    def __init__(self, mapping: Mapping, directions: Floats) -> None:
        self.mapping = mapping
        x, y, seen = mapping.pixels(directions)
        if not isinstance(mapping, LatLong):
            x, y = mapping.nearest_covered(x, y)
        column, row = np.floor(x - 0.5), np.floor(y - 0.5)
        right, down = x - 0.5 - column, y - 0.5 - row
        is_covered = mapping.solid_angles() > 0
        count = x.size
        self.pixel: NDArray[np.int32] = np.empty((count, 4), np.int32)
        weights = np.empty((count, 4))
        for corner, (dy, dx) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
            i = np.clip(row + dy, 0, mapping.height - 1).astype(np.int64)
            j = (column + dx).astype(np.int64)
            j = j % mapping.width if isinstance(mapping, LatLong) else np.clip(j, 0, mapping.width - 1)
            share = (down if dy else 1 - down) * (right if dx else 1 - right)
            self.pixel[:, corner] = (i * mapping.width + j).reshape(-1)
            weights[:, corner] = (share * is_covered[i, j]).reshape(-1)
        total = weights.sum(axis=1, keepdims=True)
        weights = np.where(total > 0, weights / np.maximum(total, 1e-300), 0) * seen.reshape(-1, 1)
        self.weights = weights.astype(np.float32)
        rim = rim_weights(mapping) if not seen.all() else np.zeros(0)
        self.rim = np.flatnonzero(rim)

    def __call__(self, image: Picture) -> NDArray[np.float32]:
        """Return the radiance in each direction, ``(N, 3)`` float32."""
        samples = sample_rows(image, self.mapping.height, self.mapping.width)
        out = np.empty((self.pixel.shape[0], 3), np.float32)
        rim = image.reshape(-1, 3)[self.rim]
        fill = rim.mean(axis=0, dtype=np.float64) if rim.size else np.zeros(3)
        _look_up(samples.reshape(-1), self.pixel, self.weights, fill.astype(np.float32), out)
        return out


@njit(cache=True, nogil=True, fastmath={"contract"})
def _look_up(samples, pixel, weights, fill, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    for n in range(pixel.shape[0]):
        unseen = np.float32(1) - (weights[n, 0] + weights[n, 1] + weights[n, 2] + weights[n, 3])
        unseen = unseen if unseen > np.float32(0.5) else np.float32(0)
        for channel in range(3):
            value = unseen * fill[channel]
            for corner in range(4):
                value += weights[n, corner] * to_float32(samples[3 * pixel[n, corner] + channel])
            out[n, channel] = value


class Unwrapper:
    """Turns pictures of one mapping into lat-long pictures ``(width/2, width, 3)`` float32: the backdrop."""

    def __init__(self, mapping: Mapping, width: int) -> None:
        self.mapping = LatLong(max(1, width // 2), width)
        self._lookup = Lookup(mapping, self.mapping.directions(*self.mapping.pixel_centres())[0])

    def __call__(self, image: Picture) -> NDArray[np.float32]:
        """Return the lat-long picture."""
        return self._lookup(image).reshape(self.mapping.height, self.mapping.width, 3)


def resample(image: Picture, source: Mapping, target: Mapping, supersample: int = 1) -> NDArray[np.float32]:
    """Return a picture of the target mapping that shows what the source's picture shows.

    Parameters
    ----------
    image
        ``(source.height, source.width, 3)`` float16 or float32.
    source, target
        The mappings of the given picture and of the wanted one.
    supersample
        Rays a side of each target pixel; 1 reads the pixel centres, more take means over the pixel's area as a camera
        does.

    Returns
    -------
    ``(target.height, target.width, 3)`` float32; 0 where the target's picture does not show the probe.
    """
    out = np.empty((target.height, target.width, 3), np.float32)
    offsets = (np.arange(supersample) + 0.5) / supersample
    x = (np.arange(target.width)[:, None] + offsets).reshape(1, -1)
    band = max(1, (1 << 18) // (x.size * supersample))
    for start in range(0, target.height, band):
        rows = np.arange(start, min(start + band, target.height))
        y = (rows[:, None] + offsets).reshape(-1, 1)
        directions, seen = target.directions(x, y)
        light = Lookup(source, directions.reshape(-1, 3))(image).reshape(*seen.shape, 3)
        light *= seen[..., None]
        cells = light.reshape(rows.size, supersample, target.width, supersample, 3)
        out[rows] = cells.mean(axis=(1, 3), dtype=np.float64)
    return out
