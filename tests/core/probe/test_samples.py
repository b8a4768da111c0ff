"""Samples that are no light."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import DTypeLike, NDArray

from lightwell.probe.samples import SampleCounts, count_samples, repair


@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_each_kind_is_told_apart(dtype: DTypeLike) -> None:
    values = [np.nan, -np.nan, np.inf, -np.inf, -0.0, 0.0, -1e-4, -3, 1, 65504, 6e-8, -6e-8]
    image = np.array(values, dtype).reshape(2, 2, 3)
    assert count_samples(image) == SampleCounts(nan=2, infinite=2, negative=3, saturated=1)
    assert count_samples(image, saturation=1.0).saturated == 2
    repaired = repair(image)
    assert repaired.dtype == dtype
    expected = np.array([0, 0, 65504, 0, 0, 0, -1e-4, -3, 1, 65504, 6e-8, -6e-8], dtype).reshape(2, 2, 3)
    assert np.array_equal(repaired, expected)
    assert repair(image, "clamp").min() == 0
    assert np.isnan(image).sum() == 2, "the picture itself is not touched"


def test_a_sound_picture_is_returned_as_it_is() -> None:
    image = np.array([-1, 0, 5], np.float16).reshape(1, 1, 3)
    assert repair(image) is image
    assert repair(np.abs(image), "clamp").max() == 5


@settings(max_examples=50, deadline=None)
@given(arrays(np.float32, (3, 5, 3), elements=st.floats(width=32)))
def test_counts_equal_numpy(image: NDArray[Any]) -> None:
    for picture in (image, image.astype(np.float32).clip(-6e4, 6e4).astype(np.float16)):
        counts = count_samples(picture, 100.0)
        finite = np.isfinite(picture)
        assert counts.nan == np.isnan(picture).sum()
        assert counts.infinite == np.isinf(picture).sum()
        assert counts.negative == (finite & (picture < 0)).sum()
        assert counts.saturated == (finite & (picture >= 100)).sum()


def test_other_types_are_refused() -> None:
    with pytest.raises(ValueError, match="float16 or float32"):
        count_samples(np.zeros((1, 1, 3)))  # type: ignore[arg-type]
