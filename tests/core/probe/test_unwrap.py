"""Unwrapping and resampling between mappings."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.reference_probe import MAPPINGS, mapping_of

from lightwell.probe.latlong import LatLong
from lightwell.probe.unwrap import Unwrapper, resample

names = pytest.mark.parametrize("name", MAPPINGS)


def smooth(directions: NDArray[Any]) -> NDArray[Any]:
    """Return light that changes slowly over the sphere, one channel an axis."""
    return (1 + 0.5 * directions).astype(np.float32)


@names
def test_smooth_light_survives_unwrapping(name: str) -> None:
    mapping = mapping_of(name)
    directions, _seen = mapping.directions(*mapping.pixel_centres())
    image = smooth(directions)
    image[~mapping.coverage()] = 1e4
    unwrapped = Unwrapper(mapping, 64)(image)
    assert unwrapped.shape == (32, 64, 3)
    target = LatLong(32, 64).directions(*LatLong(32, 64).pixel_centres())[0]
    visible = mapping.pixels(target)[2]
    error = np.abs(unwrapped - smooth(target)).max(axis=-1)
    assert unwrapped.max() <= 1.5 + 1e-5, "no background"
    # Near the rim one pixel spans many degrees.
    assert np.median(error[visible]) < 0.01
    assert np.quantile(error[visible], 0.97) < 0.12
    if not visible.all():
        rim = unwrapped[~visible]
        assert np.ptp(rim, axis=0).max() < 1e-6, "what is not seen has one colour, the mean of the rim"


@names
def test_constant_is_constant(name: str) -> None:
    mapping = mapping_of(name)
    image = np.full((mapping.height, mapping.width, 3), 3, np.float16)
    image[~mapping.coverage()] = 999
    assert Unwrapper(mapping, 40)(image) == pytest.approx(3, rel=1e-6)


@names
def test_resample_into_every_mapping(name: str) -> None:
    source = LatLong(64, 128)
    image = smooth(source.directions(*source.pixel_centres())[0])
    mapping = mapping_of(name)
    picture = resample(image, source, mapping, supersample=3)
    assert picture.shape == (mapping.height, mapping.width, 3)
    directions, _ = mapping.directions(*mapping.pixel_centres())
    covered = mapping.coverage()
    error = np.abs(picture - smooth(directions)).max(axis=-1)[covered]
    assert np.median(error) < 2e-3
    assert np.quantile(error, 0.98) < 0.06
    corner = mapping.sees(0.5, 0.5)
    assert corner or not picture[0, 0].any(), "outside the probe the picture is black"


def test_half_and_float_agree() -> None:
    mapping = mapping_of("sphere")
    image = np.random.default_rng(0).lognormal(size=(100, 100, 3)).astype(np.float16)
    unwrap = Unwrapper(mapping, 64)
    assert np.array_equal(unwrap(image), unwrap(image.astype(np.float32)))
