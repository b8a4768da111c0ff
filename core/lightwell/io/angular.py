"""Samples of a capture in angular order: all probes' samples of one direction lie together (paper 000 §3).

A Zarr v3 group with ``samples`` (directions, probes, 3), halves or floats, in chunks of some directions of some probes;
``order`` (directions,), which of the probe's buckets lies at each place, so that directions that are resampled together
lie together; and ``scale`` (probes,), the power of two by which each probe's samples must be multiplied: halves end at
65504. NaN says that a probe has no sample in a direction. Probes are written in any order, as whole batches; writing a
batch again writes the same bytes.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
import zarr
from numpy.typing import NDArray
from zarr.errors import BaseZarrError

from lightwell.io.poses import CaptureError

FORMAT = "lightwell.samples.v2"
LARGEST_HALF = 65504.0
CHUNK_DIRECTIONS = 512


class AngularStore:
    """An open store."""

    def __init__(self, samples: Any, scale: Any, order: NDArray[np.int64], path: Path) -> None:  # noqa: ANN401
        self._samples = samples
        self._scale = scale
        self.order = order
        """``(directions,)``: the bucket at each place."""
        self.path = path

    @classmethod
    def create(
        cls,
        path: Path,
        order: NDArray[np.int64],
        probes: int,
        batch: int,
        sample_format: Literal["half", "float"] = "half",
    ) -> Self:
        """Make a store for batches of ``batch`` probes; one that is there is replaced.

        ``order`` is a permutation of the buckets, `lightwell.field.buckets.angular_order`.
        """
        directions = order.size
        group = zarr.open_group(path, mode="w", zarr_format=3, attributes={"format": FORMAT})
        samples = group.create_array(
            "samples",
            shape=(directions, probes, 3),
            chunks=(min(CHUNK_DIRECTIONS, directions), min(batch, probes), 3),
            dtype="float16" if sample_format == "half" else "float32",
            compressors=None,
            fill_value=float("nan"),
        )
        scale = group.create_array(
            "scale", shape=(probes,), chunks=(min(batch, probes),), dtype="float32", compressors=None
        )
        group.create_array("order", data=order.astype(np.int64), compressors=None)
        return cls(samples, scale, order, path)

    @classmethod
    def open(cls, path: Path) -> Self:
        """Open a store; raises `CaptureError` where it is none."""
        try:
            group: Any = zarr.open_group(path, mode="r+", zarr_format=3)
            if group.attrs.get("format") != FORMAT:
                raise CaptureError(f"{path}: holds no samples in angular order of this version: sort the frames again")
            samples, order = group["samples"], np.asarray(group["order"][...], np.int64)
            if not np.array_equal(np.sort(order), np.arange(samples.shape[0])):
                raise CaptureError(f"{path}: the order of its directions is damaged: sort the frames again")
            return cls(samples, group["scale"], order, path)
        except (BaseZarrError, OSError, KeyError, ValueError) as error:
            raise CaptureError(f"{path}: cannot be read as sorted samples: {error}") from None

    @property
    def directions(self) -> int:
        """Number of directions."""
        return int(self._samples.shape[0])

    @property
    def probes(self) -> int:
        """Number of probes."""
        return int(self._samples.shape[1])

    @property
    def batch(self) -> int:
        """Probes that are written together."""
        return int(self._samples.chunks[1])

    def write_probes(self, first: int, samples: NDArray[np.floating[Any]]) -> None:
        """Write a batch of probes: ``samples`` ``(n, buckets, 3)``, beginning at probe ``first``."""
        scale = np.ones(len(samples), np.float32)
        if self._samples.dtype == np.float16 and samples.dtype != np.float16:
            finite = np.where(np.isfinite(samples), np.abs(samples), 0)
            largest = finite.reshape(len(samples), -1).max(axis=1)
            exponent = np.ceil(np.log2(np.maximum(largest / LARGEST_HALF, 1.0)))
            scale = np.exp2(exponent).astype(np.float32)
            samples = samples / scale[:, None, None]
        last = first + len(samples)
        self._scale[first:last] = scale
        self._samples[:, first:last] = samples.transpose(1, 0, 2)[self.order]

    def read(self, first: int, last: int) -> NDArray[np.float32]:
        """Return the samples of the buckets ``order[first:last]``: ``(K, probes, 3)`` float32."""
        samples = np.asarray(self._samples[first:last], np.float32)
        scale = np.asarray(self._scale[...])
        if (scale != 1).any():
            samples *= scale[:, None]
        return samples
