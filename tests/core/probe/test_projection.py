"""Projection: exact sums, constants, single pixels, and agreement of the fast paths with the slow one."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import DTypeLike, NDArray
from tests.support.reference_probe import (
    MAP_NAMES,
    MAPPINGS,
    ROOT_4PI,
    basis,
    mapping_of,
    project_centres,
    project_latlong,
    real_map,
    relative_error,
)

from lightwell.conventions import MAX_BANDS
from lightwell.errors import MappingError
from lightwell.probe import fourier, projection
from lightwell.probe.direct import DirectProjection
from lightwell.probe.downsample import Downsampler
from lightwell.probe.factory import make_mapping
from lightwell.probe.fourier import FourierProjection
from lightwell.probe.half import sample_rows
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Mapping
from lightwell.probe.matrix import projection_matrix
from lightwell.probe.projection import Projector, projector
from lightwell.probe.unwrap import resample
from lightwell.settings import MappingSettings

names = pytest.mark.parametrize("name", MAPPINGS)
maps = pytest.mark.parametrize("map_name", MAP_NAMES)


def light(mapping: Mapping, dtype: DTypeLike = np.float16, seed: int = 0) -> NDArray[Any]:
    return np.random.default_rng(seed).lognormal(size=(mapping.height, mapping.width, 3)).astype(dtype)


@maps
def test_real_latlong_maps_against_an_independent_sum(map_name: str) -> None:
    image = real_map(map_name)
    mapping = LatLong(256, 512)
    reference = project_latlong(image, 5)
    full = FourierProjection(mapping, 5, "solid-angle")(sample_rows(image, 256, 512))
    for value in (Projector(mapping, 5).project(image), full):
        assert relative_error(value, reference) < 1e-6
    assert relative_error(Projector(mapping, 5).project(image.astype(np.float32)), reference) < 1e-6
    # Clamping the maps' negative samples (DWA ringing around bright lights) is no rounding matter: it adds light.
    clamped = project_latlong(np.maximum(image, 0), 5)
    assert relative_error(clamped, reference) > 1e-5


@pytest.mark.parametrize(
    ("settings_of", "height", "width", "error"),
    [
        (MappingSettings(kind="angular"), 250, 250, 5.1e-6),
        (MappingSettings(kind="fisheye", fov_degrees=360), 250, 250, 5.1e-6),
        (MappingSettings(kind="octahedral"), 250, 250, 3.4e-5),
        (MappingSettings(kind="cube"), 750, 1000, 9.6e-6),
    ],
)
def test_operator_error_of_point_samples(settings_of: MappingSettings, height: int, width: int, error: float) -> None:
    # max |P − I| of degree 4 at N = 250 (MATHS §2.2).
    mapping = make_mapping(settings_of, height, width)
    values = basis(mapping.directions(*mapping.pixel_centres())[0].reshape(-1, 3), 5).reshape(height, width, 25)
    pad = np.concatenate([values, np.zeros((height, width, 2))], axis=-1).astype(np.float32)
    project = Projector(mapping, 5)
    operator = np.concatenate([project.project(pad[..., k : k + 3]) for k in range(0, 27, 3)], axis=1)[:, :25]
    assert np.abs(operator - np.eye(25)).max() < 1.5 * error


# Against one direction a pixel. What the centres leave of the integral of the basis is lit by the mean, so that
# constant light is exact: at 128 pixels that is the difference. Mirrors differ by more: their pixels' footprints are
# integrated, and pixels that straddle the outline are not read (MATHS §3); a real sun on one pixel shows it most.
DISCRETISATION = {"octahedral": 5e-4, "cube": 6e-4, "mirror-ball": 2e-2, "angular": 1e-4, "fisheye": 1e-4}


@maps
@pytest.mark.parametrize("kind", [*DISCRETISATION, "mirror-sphere"])
def test_real_maps_through_every_mapping(map_name: str, kind: str) -> None:
    options: dict[str, Any] = {
        "fisheye": {"fov_degrees": 360},
        "mirror-sphere": {"sphere_radius_m": 0.0458, "sphere_distance_m": 1.25},
    }
    height, width = (96, 128) if kind == "cube" else (128, 128)
    disc: dict[str, Any] = {"disc": (64, 64, 64)} if kind == "mirror-sphere" else {}
    mapping = make_mapping(MappingSettings(kind=kind, **options.get(kind, {}), **disc), height, width)
    image = resample(real_map(map_name), LatLong(256, 512), mapping, 2)
    value = Projector(mapping, 5).project(image)
    error = relative_error(value, project_centres(mapping, image, 5))
    assert error < DISCRETISATION.get(kind, 4e-2)


@names
@pytest.mark.parametrize("bands", [1, 3, 5])
@pytest.mark.parametrize("width", [None, 23])
def test_constant_light(name: str, bands: int, width: int | None) -> None:
    mapping = mapping_of(name)
    image: Any = np.ones((mapping.height, mapping.width, 3), np.float16)
    if width:
        reduce = Downsampler(mapping, width)
        image, mapping = reduce(image), reduce.mapping
    value = projector(mapping, bands).project(image)
    assert value[0] == pytest.approx(ROOT_4PI, rel=1e-6)
    exact_nodes = not isinstance(mapping, LatLong)
    # Solid angles at the pixel centres of a lat-long picture integrate degree 2 only to O(1/H²) (MATHS §2.1).
    assert np.abs(value[1:]).max(initial=0) < (1e-6 if exact_nodes else 8 / mapping.height**2)


@names
def test_background_is_never_read(name: str) -> None:
    mapping = mapping_of(name)
    image = light(mapping)
    other = np.where(mapping.coverage()[..., None], image, np.float16(6e4))
    for blind in ("fill", "zero"):
        one = Projector(mapping, 4, blind=blind)
        assert np.array_equal(one.project(image), one.project(other))


@pytest.mark.parametrize("fov", [180.0, 270.0])
@pytest.mark.parametrize("lens", ["equidistant", "equisolid"])
def test_dark_cone_loses_what_its_closed_form_says(fov: float, lens: str) -> None:
    """A dark cone takes ``√(π/(2l+1)) (P_{l−1}(cosδ) − P_{l+1}(cosδ))`` from c_l0 of a constant probe (MATHS §2.3)."""
    settings_of = MappingSettings(kind="fisheye", fov_degrees=fov, fisheye=lens, forward=(0, 0, -1), up=(0, 1, 0))
    mapping = make_mapping(settings_of, 200, 200)
    check_dark_cone(mapping, tolerance=2e-4)


@pytest.mark.parametrize("k", [0.0366, 0.0732, 0.3])
def test_dark_cone_of_the_mirror_sphere(k: float) -> None:
    mapping = make_mapping(
        MappingSettings(
            kind="mirror-sphere", sphere_radius_m=k, sphere_distance_m=1, disc=(125, 125, 125), forward=(0, 0, 1)
        ),
        250,
        250,
    )
    assert mapping.blind_half_angle == pytest.approx(math.asin(k))
    check_dark_cone(mapping, tolerance=4e-4)


def check_dark_cone(mapping: Any, tolerance: float) -> None:
    ones = np.ones((mapping.height, mapping.width, 3), np.float32)
    value = Projector(mapping, 5, blind="zero").project(ones)[:, 0]
    cosine, side = math.cos(mapping.blind_half_angle), float(mapping.blind_axis[2])
    legendre = [np.polynomial.legendre.Legendre.basis(degree)(cosine) for degree in range(6)]
    for degree in range(5):
        below = 1.0 if degree == 0 else legendre[degree - 1]
        loss = math.sqrt(math.pi / (2 * degree + 1)) * (below - legendre[degree + 1]) * side**degree
        expected = (ROOT_4PI if degree == 0 else 0) - loss
        assert value[degree * degree + degree] == pytest.approx(expected, abs=tolerance * ROOT_4PI)
    assert value[0] == pytest.approx((1 + cosine) / 2 * ROOT_4PI, rel=1e-6), "weights sum to 2π(1 + cos δ)"


def test_loss_of_the_papers_dead_angles() -> None:
    """MATHS §2.3: losses relative to c00 for half-angles of 4.2° and 2.1°."""
    for degrees, expected in ((4.2, (0.00134, 0.00232, 0.00299, 0.00352, 0.00397)), (2.1, (0.00034, 0.00058, 0.00075))):
        cosine = math.cos(math.radians(degrees))
        legendre = [np.polynomial.legendre.Legendre.basis(degree)(cosine) for degree in range(6)]
        for degree, value in enumerate(expected):
            below = 1.0 if degree == 0 else legendre[degree - 1]
            loss = math.sqrt(math.pi / (2 * degree + 1)) * (below - legendre[degree + 1]) / ROOT_4PI
            assert loss == pytest.approx(value, abs=6e-6)


@names
def test_one_hot_pixel(name: str) -> None:
    """A pixel of radiance L gives L ΔΩ Y(ω), up to the extent of its footprint."""
    mapping = mapping_of(name)
    rows, cols = np.nonzero(mapping.coverage())
    row0, row1, col0, col1 = mapping.region
    distance = np.hypot(rows - (0.55 * row0 + 0.45 * row1), cols - (0.45 * col0 + 0.55 * col1))
    row, col = rows[distance.argmin()], cols[distance.argmin()]
    image = np.zeros((mapping.height, mapping.width, 3), np.float32)
    image[row, col] = 1, 10, 1000
    value = Projector(mapping, 5).project(image)
    direction = mapping.directions(col + 0.5, row + 0.5)[0]
    expected = mapping.solid_angles()[row, col] * basis(direction, 5)
    assert np.abs(value - expected[:, None] * np.array([1, 10, 1000])).max() < 0.03 * np.abs(expected).max() * 1000
    assert value[0] / image[row, col] == pytest.approx(expected[0], rel=1e-6)


def test_band_limited_light_is_recovered_exactly_by_fejer() -> None:
    mapping = LatLong(32, 64)
    directions, _ = mapping.directions(*mapping.pixel_centres())
    for index in range(25):
        image = np.repeat(basis(directions, 5)[..., index : index + 1], 3, axis=-1).astype(np.float32)
        value = Projector(mapping, 5, "fejer").project(image)
        assert value == pytest.approx(np.eye(25)[:, [index] * 3], abs=3e-7)


def test_paper_weights_over_count() -> None:
    mapping = LatLong(50, 100)
    value = Projector(mapping, 5, "paper").project(np.ones((50, 100, 3), np.float32))
    assert value[0, 0] / ROOT_4PI - 1 == pytest.approx(math.pi**2 / (24 * 50**2), rel=2e-3)


@settings(max_examples=25, deadline=None)
@given(
    height=st.integers(1, 40),
    width=st.integers(1, 60),
    bands=st.integers(1, MAX_BANDS),
    weights=st.sampled_from(["solid-angle", "paper", "fejer"]),
    half=st.booleans(),
)
def test_fourier_sums_equal_the_matrix(height: int, width: int, bands: int, weights: Any, half: bool) -> None:
    mapping = LatLong(height, width)
    image = light(mapping, np.float16 if half else np.float32)
    reference = projection_matrix(mapping, bands, weights, "fill").T @ image.reshape(-1, 3).astype(np.float64)
    value = FourierProjection(mapping, bands, weights)(sample_rows(image, height, width))
    assert relative_error(value, reference) < 2e-6
    assert relative_error(Projector(mapping, bands, weights).project(image), reference) < 2e-6


@pytest.mark.parametrize("height", [2, 31])
def test_two_threads_make_the_same_sums(height: int, monkeypatch: pytest.MonkeyPatch) -> None:
    mapping = LatLong(height, 64)
    samples = sample_rows(light(mapping), height, 64)
    project = FourierProjection(mapping, 5, "solid-angle")
    alone = project(samples)
    monkeypatch.setattr(fourier, "SPLIT_SAMPLES", 0)
    np.testing.assert_allclose(project(samples), alone, rtol=1e-12, atol=1e-12)


@names
@pytest.mark.parametrize("bands", [1, 5, 8])
def test_direct_sums_equal_a_slow_sum_over_their_table(name: str, bands: int) -> None:
    mapping = mapping_of(name)
    image = light(mapping)
    direct = DirectProjection(mapping, bands, "zero")
    moments = np.zeros((mapping.height * mapping.width, 4))
    for pixel, direction, solid_angle in mapping.footprints():
        np.add.at(moments, pixel, solid_angle[:, None] * np.concatenate([direction, np.ones((len(pixel), 1))], axis=1))
    used = moments[:, 3] > 0
    directions = moments[used, :3] / np.linalg.norm(moments[used, :3], axis=1, keepdims=True)
    radiance = image.reshape(-1, 3)[used].astype(np.float64)
    reference = np.einsum("p,pk,pc->kc", moments[used, 3], basis(directions, bands), radiance)
    assert relative_error(direct(sample_rows(image, mapping.height, mapping.width)), reference) < 3e-6


@pytest.mark.parametrize("name", ["octahedral", "horizontal cross", "angular"])
def test_large_pictures_need_no_matrix_and_agree_with_it(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    mapping = mapping_of(name)
    image = light(mapping)
    small = Projector(mapping, 5)
    monkeypatch.setattr(projection, "MATRIX_BYTES", 0)
    large = Projector(mapping, 5)
    assert type(large._projection) is DirectProjection
    assert relative_error(large.project(image), small.project(image)) < 3e-4
    ones = np.ones_like(image)
    assert large.project(ones)[0] == pytest.approx(ROOT_4PI, rel=1e-6)


def test_full_resolution_sun_does_not_drown_in_rounding() -> None:
    """1.3 Mpx with a sun: a running float32 sum is 0.7 % off (MATHS §2.1)."""
    mapping = LatLong(814, 1628)
    image = np.random.default_rng(1).lognormal(size=(814, 1628, 3)).astype(np.float32)
    image[200, 300] = 3e7
    reference = project_latlong(image, 3)
    assert relative_error(Projector(mapping, 3).project(image), reference) < 1e-6


def test_weights_and_bands_are_checked() -> None:
    with pytest.raises(MappingError, match="lat-long rows, not for --mapping cube"):
        Projector(mapping_of("row strip"), 5, "paper")
    with pytest.raises(ValueError, match="12 bands"):
        Projector(LatLong(4, 8), MAX_BANDS + 1)
    with pytest.raises(MappingError, match="the mapping is for"):
        Projector(LatLong(4, 8), 2).project(np.zeros((4, 9, 3), np.float32))


def test_projectors_are_kept_and_the_oldest_go(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(projection, "_cache", projection._Cache())
    one = projector(LatLong(16, 32), 3)
    assert projector(LatLong(16, 32), 3) is one
    assert projector(LatLong(16, 32), 4) is not one
    assert projector(LatLong(16, 32), 3, "fejer") is not one
    monkeypatch.setattr(projection, "CACHE_BYTES", 2 * one.nbytes)
    latest = projector(LatLong(16, 32), 2)
    assert projector(LatLong(16, 32), 2) is latest
    assert projector(LatLong(16, 32), 3) is not one
