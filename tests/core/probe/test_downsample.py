"""Downsampling keeps energy, at any ratio, in every mapping."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import DTypeLike, NDArray
from tests.support.reference_probe import MAPPINGS, area_means, latlong_means, mapping_of, real_map

from lightwell.errors import MappingError
from lightwell.probe.cube import Cube
from lightwell.probe.downsample import Downsampler
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Mapping

names = pytest.mark.parametrize("name", MAPPINGS)
methods = pytest.mark.parametrize("method", ["area", "gaussian"])


def energy(mapping: Mapping, image: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(np.einsum("ij,ijc->c", mapping.solid_angles(), image.astype(np.float64)))


def picture(mapping: Mapping, seed: int = 0, dtype: DTypeLike = np.float32) -> NDArray[Any]:
    """Return random light with a sun, and something absurd where the probe is not seen."""
    rng = np.random.default_rng(seed)
    image = rng.lognormal(size=(mapping.height, mapping.width, 3))
    rows, cols = np.nonzero(mapping.coverage())
    sun = rng.integers(rows.size)
    image[rows[sun], cols[sun]] = 2e4
    image[~mapping.coverage()] = 6e4
    return image.astype(dtype)


@names
@pytest.mark.parametrize("width", [1, 7, 18, 33, 64])
def test_energy_is_kept(name: str, width: int) -> None:
    mapping = mapping_of(name)
    image = picture(mapping)
    reduce = Downsampler(mapping, width)
    small = reduce(image)
    assert small.shape == (reduce.mapping.height, reduce.mapping.width, 3)
    assert energy(reduce.mapping, small) == pytest.approx(energy(mapping, image), rel=3e-6)
    assert reduce.mapping.solid_angles().sum() == pytest.approx(mapping.solid_angles().sum(), rel=1e-12)


@names
@methods
def test_constant_stays_constant(name: str, method: Literal["area", "gaussian"]) -> None:
    mapping = mapping_of(name)
    image = np.full((mapping.height, mapping.width, 3), 2.5, np.float16)
    image[~mapping.coverage()] = 1000
    reduce = Downsampler(mapping, 19, method)
    small = reduce(image)
    assert small.dtype == np.float32
    assert small[reduce.mapping.coverage()] == pytest.approx(2.5, rel=1e-6)
    assert not small[~reduce.mapping.coverage()].any()


@settings(max_examples=12, deadline=None)
@given(height=st.integers(2, 14), width=st.integers(2, 17), target=st.integers(1, 16), half=st.booleans())
def test_latlong_equals_the_slow_reference(height: int, width: int, target: int, half: bool) -> None:
    mapping = LatLong(height, width)
    image = picture(mapping, dtype=np.float16 if half else np.float32)
    reduce = Downsampler(mapping, target)
    if target >= width:
        assert reduce(image) is image
        return
    assert reduce(image) == pytest.approx(latlong_means(image, reduce.mapping.height, target), rel=3e-6)


@pytest.mark.parametrize("ratio", [2, 3, 4])
def test_latlong_whole_ratios_equal_the_slow_reference(ratio: int) -> None:
    mapping = LatLong(12, 24)
    image = picture(mapping)
    expected = area_means(image, mapping.solid_angles(), 12 // ratio, 24 // ratio)
    assert Downsampler(mapping, 24 // ratio)(image) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("name", ["octahedral", "vertical cross", "mirror ball"])
def test_other_mappings_equal_the_slow_reference(name: str) -> None:
    mapping = mapping_of(name)
    image = picture(mapping)
    reduce = Downsampler(mapping, 9)
    row0, row1, col0, col1 = mapping.region
    expected = area_means(
        image[row0:row1, col0:col1],
        mapping.solid_angles()[row0:row1, col0:col1],
        reduce.mapping.height,
        reduce.mapping.width,
    )
    assert reduce(image) == pytest.approx(expected, rel=1e-5)


def test_sun_near_the_pole_keeps_its_energy() -> None:
    """MATHS §2.1: ×16 reduction with the sun at row 20 of 816; unweighted means would gain 17 %."""
    mapping = LatLong(816, 1632)
    image = np.full((816, 1632, 3), 0.2, np.float32)
    image[20, 700] = 3e4
    reduce = Downsampler(mapping, 102)
    exact = energy(mapping, image)
    assert energy(reduce.mapping, reduce(image)) == pytest.approx(exact, rel=1e-6)
    sun = energy(mapping, image)[0] - 0.2 * 4 * math.pi
    plain = image.reshape(51, 16, 102, 16, 3).mean(axis=(1, 3))
    plain_sun = energy(reduce.mapping, plain)[0] - 0.2 * 4 * math.pi
    assert plain_sun / sun == pytest.approx(1.170, abs=0.005)
    gaussian = Downsampler(mapping, 102, "gaussian")
    gaussian_sun = energy(gaussian.mapping, gaussian(image))[0] - 0.2 * 4 * math.pi
    assert gaussian_sun / sun == pytest.approx(1, abs=0.06)


@pytest.mark.parametrize("width", [512, 600])
def test_a_width_of_at_least_the_pictures_own_is_the_identity(width: int) -> None:
    image = real_map("venice")
    mapping = LatLong(256, 512)
    reduce = Downsampler(mapping, width)
    assert reduce(image) is image
    assert reduce.mapping is mapping


def test_cube_faces_stay_whole_pixels() -> None:
    reduce = Downsampler(Cube(96, 128), 50)
    assert (reduce.mapping.height, reduce.mapping.width) == (36, 48)


def test_half_and_float_agree() -> None:
    image = real_map("forest")
    reduce = Downsampler(LatLong(256, 512), 100)
    assert np.array_equal(reduce(image), reduce(image.astype(np.float32)))


@pytest.mark.parametrize("name", ["sphere", "latlong", "octahedral"])
def test_reducing_twice(name: str) -> None:
    mapping = mapping_of(name)
    image = picture(mapping)
    once = Downsampler(mapping, 40)
    twice = Downsampler(once.mapping, 13)
    assert energy(twice.mapping, twice(once(image))) == pytest.approx(energy(mapping, image), rel=3e-6)


def test_what_cannot_be_reduced() -> None:
    with pytest.raises(MappingError, match="width of 0 pixels"):
        Downsampler(LatLong(8, 16), 0)
    with pytest.raises(MappingError, match=r"shape \(8, 8, 3\)"):
        Downsampler(LatLong(8, 16), 4)(np.zeros((8, 8, 3), np.float32))
    with pytest.raises(ValueError, match="float16 or float32"):
        Downsampler(LatLong(8, 16), 4)(np.zeros((8, 16, 3)))  # type: ignore[arg-type]
