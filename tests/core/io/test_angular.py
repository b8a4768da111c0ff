"""Samples in angular order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import zarr

from lightwell.io.angular import AngularStore
from lightwell.io.poses import CaptureError


@pytest.mark.parametrize("sample_format", ["half", "float"])
def test_round_trip_in_any_order_of_batches(tmp_path: Path, sample_format: str) -> None:
    generator = np.random.default_rng(0)
    samples = generator.lognormal(sigma=3, size=(10, 700, 3)).astype(np.float32)
    samples[3] *= 1e6
    samples[4, 5] = np.nan
    order = generator.permutation(700)
    store = AngularStore.create(tmp_path / "s.zarr", order, 10, 4, sample_format)  # type: ignore[arg-type]
    for first in (8, 0, 4, 0):
        store.write_probes(first, samples[first : first + 4])
    opened = AngularStore.open(tmp_path / "s.zarr")
    np.testing.assert_array_equal(opened.order, order)
    found = opened.read(100, 650)
    expected = samples[:, order[100:650]].transpose(1, 0, 2)
    tolerance = 1e-3 if sample_format == "half" else 0
    scale = np.nanmax(np.abs(samples), axis=(1, 2))[None, :, None]
    assert np.isfinite(found).sum() == np.isfinite(expected).sum()
    np.testing.assert_array_less(
        np.abs(found - expected)[np.isfinite(expected)],
        (tolerance * np.abs(expected) + 1e-7 * scale + 1e-9)[np.isfinite(expected)],
    )


def test_writing_again_writes_the_same_bytes(tmp_path: Path) -> None:
    samples = np.random.default_rng(1).random((3, 20, 3)).astype(np.float32)
    store = AngularStore.create(tmp_path / "s.zarr", np.arange(20), 3, 3)

    def contents() -> dict[str, bytes]:
        return {str(path): path.read_bytes() for path in sorted(tmp_path.rglob("*")) if path.is_file()}

    store.write_probes(0, samples)
    before = contents()
    store.write_probes(0, samples)
    assert contents() == before


def test_what_is_no_store_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="cannot be read as sorted samples"):
        AngularStore.open(tmp_path / "none.zarr")
    zarr.open_group(tmp_path / "old.zarr", mode="w", zarr_format=3, attributes={"format": "lightwell.samples.v1"})
    with pytest.raises(CaptureError, match="sort the frames again"):
        AngularStore.open(tmp_path / "old.zarr")
    AngularStore.create(tmp_path / "twice.zarr", np.array([0, 1, 1]), 3, 3)
    with pytest.raises(CaptureError, match="order of its directions is damaged"):
        AngularStore.open(tmp_path / "twice.zarr")
