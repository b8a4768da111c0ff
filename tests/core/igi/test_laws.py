"""What MATHS §10 says of virtual lights, interleaving and the filter, at the errors given there."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support import reference_igi
from tests.support.igi_scenes import lamp, matte, panel, pixels, placed
from tests.support.shapes import quad

from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import plane
from lightwell.igi import DirectionalLight, IgiObject, IgiScene, Sky, render_igi
from lightwell.igi.emit import EmissiveSurfaces
from lightwell.igi.filter import filtered, windows
from lightwell.igi.gather import Gatherer
from lightwell.igi.hemisphere import LOBE_EXPONENTS, lobe_table
from lightwell.igi.lights import DIRECTIONAL, NONE, SURFACE, VirtualLights, arrange, make_lights
from lightwell.igi.materials import SHARPEST, phong_exponent
from lightwell.igi.sequence import halton
from lightwell.igi.shade import responses
from lightwell.igi.sky import SkySource
from lightwell.igi.surfaces import Surfaces
from lightwell.igi_settings import IgiKernel, IgiSettings
from lightwell.render import Camera
from lightwell.sh.basis import evaluate
from lightwell.sh.lobes import phong_zonal

UP = np.array([0.0, 0, 1])


def unit(vectors: np.ndarray) -> np.ndarray:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


SPACE = RayScene([])


def gather_at(lights: VirtualLights, place: np.ndarray, normal: np.ndarray, bands: int = 3) -> np.ndarray:
    """Coefficients ``(bands², 3)`` of one place, all lights, float64."""
    sets = arrange([lights], NONE, (1, 1), 0)
    gatherer = Gatherer(SPACE, sets, bands, np.float64)
    seen = np.ones((1, 1), np.bool_)
    got = gatherer.gather(place.reshape(1, 1, 3), normal.reshape(1, 1, 3), seen)
    return np.asarray(got.coefficients.sum(axis=2)[0, 0])


def matte_of(
    coefficients: np.ndarray, normal: np.ndarray, kernel: IgiKernel = "none", geometric: np.ndarray | None = None
) -> np.ndarray:
    """Irradiance over π, ``(…, 3)``; the geometric normal is the normal unless it is given."""
    flat = coefficients.reshape(-1, 1, *coefficients.shape[-2:])
    normals = np.broadcast_to(normal, (len(flat), 3)).astype(np.float64)
    bands = int(np.sqrt(coefficients.shape[-2]))
    dull = np.zeros(len(flat), bool)
    below = normals if geometric is None else np.broadcast_to(geometric, normals.shape)
    got = responses(flat, normals, normals, below, np.ones(len(flat)), dull, kernel, bands)
    return got.matte[:, 0].reshape(*coefficients.shape[:-2], 3)


@pytest.mark.parametrize("kernel", ["none", "nonneg"])
@pytest.mark.parametrize("bands", [2, 3, 5])
def test_furnace(kernel: IgiKernel, bands: int) -> None:
    """Radiance 1 from the whole upper side leaves a white surface as radiance 1."""
    half = np.zeros((bands * bands, 3))
    degree = np.arange(bands)
    half[degree * degree + degree] = (np.sqrt((2 * degree + 1) / (4 * np.pi)) * 2 * np.pi * phong_zonal(0.0, bands))[
        :, None
    ]
    np.testing.assert_allclose(matte_of(half, UP, kernel), 1, rtol=1e-14)


def test_furnace_as_a_picture() -> None:
    ground = IgiObject(placed(plane(4), 2, [0, 0, 0]), matte(0.8, 0.5, 0.2))
    scene = IgiScene((ground,), sky=Sky(np.full((32, 64, 3), 1.5, np.float32)))
    for kernel in ("none", "nonneg"):
        picture = render_igi(scene, Camera((0, 0, 3), (0, 0, 0)), (16, 16), IgiSettings(kernel=kernel, vpls=4096))
        np.testing.assert_allclose(picture.colour[picture.coverage == 1] / [1.2, 0.75, 0.3], 1, atol=3e-3)


def test_a_light_straight_ahead() -> None:
    """The bands of the cosine over-brighten it by 17/16; the kernel for light from above is exact."""
    facing = gather_at(make_lights(DIRECTIONAL, np.zeros((1, 3)), UP, np.array([[2.0, 1, 4]])), np.zeros(3), UP)
    irradiance = np.array([2.0, 1, 4])
    np.testing.assert_allclose(matte_of(facing, UP), 17 / 16 * irradiance / np.pi, rtol=1e-14)
    np.testing.assert_allclose(matte_of(facing, UP, "nonneg"), irradiance / np.pi, rtol=1e-14)
    ground = IgiObject(plane(1), matte(0.5, 0.5, 0.5))
    scene = IgiScene((ground,), lamps=(DirectionalLight((0, 0, 2), (2.0, 1, 4)),))
    picture = render_igi(scene, Camera((0, 0, 3), (0, 0, 0)), (8, 8), IgiSettings(kernel="none"))
    np.testing.assert_allclose(picture.colour[4, 4], 0.5 / np.pi * 17 / 16 * irradiance, rtol=1e-6)


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_a_flat_surface_gets_its_irradiance_without_error(bands: int) -> None:
    """Light from anywhere above: the cosine is a harmonic of degree 1."""
    random = np.random.default_rng(bands)
    towards, flux = unit(random.normal(size=(40, 3))), random.random((40, 3))
    lights = make_lights(DIRECTIONAL, np.zeros((40, 3)), towards, flux)
    for normal in unit(random.normal(size=(5, 3))):
        got = np.pi * matte_of(gather_at(lights, np.zeros(3), normal, bands), normal, "nonneg")
        np.testing.assert_allclose(got, np.maximum(towards @ normal, 0) @ flux, rtol=1e-13)


@pytest.mark.parametrize(("bands", "most"), [(2, 0.42), (3, 0.115), (5, 0.115)])
def test_tilted_normals(bands: int, most: float) -> None:
    """Never negative for light from above, right for an even sky, and near to the cosine; by brute force."""
    random = np.random.default_rng(1)
    directions = unit(random.normal(size=(4000, 3)))
    flux = np.ones((1, 3))
    for degrees in (0.0, 3.0, 20.0, 50.5, 80.0):
        axis, other = unit(random.normal(size=(2, 3)))
        aside = unit(np.cross(axis, other))
        normal = np.cos(np.radians(degrees)) * axis + np.sin(np.radians(degrees)) * aside
        above = directions[directions @ axis > 0]
        each = evaluate(above, bands)[:, :, None] * flux
        kernel = np.pi * matte_of(each, normal, "nonneg", axis)[:, 0]
        truth = np.maximum(above @ normal, 0)
        assert kernel.min() > -3e-4
        assert np.sqrt(((kernel - truth) ** 2).mean() / (truth**2).mean()) < most
        half = np.zeros((bands * bands, 3))
        zonal = 2 * np.pi * phong_zonal(0.0, bands) * np.sqrt((2 * np.arange(bands) + 1) / (4 * np.pi))
        degree = np.repeat(np.arange(bands), 2 * np.arange(bands) + 1)
        half[:] = (zonal[degree] * np.sqrt(4 * np.pi / (2 * degree + 1)) * evaluate(axis, bands))[:, None]
        even = (1 + np.cos(np.radians(degrees))) / 2
        np.testing.assert_allclose(matte_of(half, normal, "nonneg", axis), even, rtol=2e-4)


def test_a_lit_plane_seen_from_above() -> None:
    """Virtual lights of a plane with reflectivity ρ under irradiance E₀ give a surface that faces it ``E = ρ E₀``."""
    albedo, lit = 0.6, np.array([3.0, 2, 1])
    nodes, weights = np.polynomial.legendre.leggauss(12)
    cosine, azimuth = (nodes + 1) / 2, 2 * np.pi * (np.arange(16) + 0.5) / 16
    mu, phi = (part.reshape(-1) for part in np.meshgrid(cosine, azimuth, indexing="ij"))
    solid = np.repeat(weights / 2, 16) * 2 * np.pi / 16
    distance = 1 / mu
    radius = distance * np.sqrt(1 - mu**2)
    places = np.stack([radius * np.cos(phi), radius * np.sin(phi), 0 * phi], axis=1)
    areas = solid * distance**2 / mu
    lights = make_lights(SURFACE, places, UP, albedo * lit * areas[:, None])
    got = gather_at(lights, UP, -UP)
    np.testing.assert_allclose(got[0], albedo * lit / np.pi * 1.7724538509055159, rtol=7.5e-12)
    np.testing.assert_allclose(np.pi * matte_of(got, -UP), albedo * lit, rtol=7.5e-12)


def random_lights(count: int, seed: int) -> VirtualLights:
    random = np.random.default_rng(seed)
    places = random.uniform([-2, -2, 0.5], [2, 2, 4.5], (count, 3))
    normals = -places / np.linalg.norm(places, axis=1, keepdims=True)
    return make_lights(SURFACE, places, normals, random.random((count, 3)) ** 4)


def test_interleaving_and_the_box_are_all_lights() -> None:
    """Pixels of one place: the mean over a window is what a place gets of all lights."""
    pattern = (4, 4)
    ((left, right, up, down),) = (reach,) = windows(IgiSettings(sets=pattern, passes=1))
    shape = (8 + up + down, 8 + left + right)
    place, normal = np.tile([0.3, -0.2, 0.0], (*shape, 1)), np.tile(UP, (*shape, 1))
    seen, depth = np.ones(shape, bool), np.ones(shape)
    lights = random_lights(512, 1)
    gatherer = Gatherer(SPACE, arrange([lights], NONE, pattern, 7), 3, np.float64)
    own = gatherer.gather(place, normal, seen, (-left, -up), groups=1).coefficients.reshape(*shape, 27)
    mean = filtered(own, pixels(seen, place, normal, normal, depth), reach).reshape(8, 8, 9, 3)
    whole = gather_at(lights, place[0, 0], UP)
    assert np.abs(own.reshape(*shape, 9, 3) / whole[0] - whole / whole[0]).max() > 0.1
    np.testing.assert_allclose(mean, np.broadcast_to(whole, mean.shape), atol=4 * 9e-16 * np.abs(whole).max())


def test_what_is_filtered_on_bumps() -> None:
    """16 random normals: filtering incident radiance is exact, filtering irradiance is hardly better than nothing."""
    random = np.random.default_rng(3)
    shading = random.normal([0, 0, 0.6], 1, (7, 7, 3))
    shading /= np.linalg.norm(shading, axis=-1, keepdims=True)
    shading[..., 2] = np.abs(shading[..., 2])
    place, normal = np.zeros((7, 7, 3)), np.tile(UP, (7, 7, 1))
    seen, depth = np.ones((7, 7), bool), np.ones((7, 7))
    (reach,) = windows(IgiSettings(passes=1))
    lights = random_lights(16, 1)
    sets = arrange([lights], NONE, (4, 4), 0)
    own = Gatherer(SPACE, sets, 3, np.float64).gather(place, normal, seen, groups=1).coefficients[:, :, 0]
    bumpy = pixels(seen, place, normal, shading, depth)
    mean = filtered(own.reshape(7, 7, 27), bumpy, reach).reshape(4, 4, 9, 3)
    inner = shading[2:6, 2:6]

    def shade(coefficients: np.ndarray, normals: np.ndarray) -> np.ndarray:
        flat = [matte_of(c, n) for c, n in zip(coefficients.reshape(-1, 9, 3), normals.reshape(-1, 3), strict=True)]
        return np.array(flat).reshape(*normals.shape)

    truth = shade(np.tile(gather_at(lights, np.zeros(3), UP), (4, 4, 1, 1)), inner)
    alone = shade(own, shading)
    irradiance = filtered(alone, bumpy, reach)
    strict = filtered(alone, bumpy, reach, strict=True)

    def error(values: np.ndarray) -> float:
        return float(np.sqrt(((values - truth) ** 2).mean()) / truth.max())

    assert error(shade(mean, inner)) < 4e-16
    print(
        f"\nof the peak: SH {error(shade(mean, inner)):.1e}, irradiance {error(irradiance):.2f}, "
        f"strictly {error(strict):.2f}, nothing {error(alone[2:6, 2:6]):.2f}"
    )
    assert error(irradiance) > 0.15
    assert error(strict) > 0.15
    assert error(alone[2:6, 2:6]) > 0.15


def sun_and_sky() -> Sky:
    """A bright lobe, a dim sky and a dark ground, in three colours."""
    theta, phi = np.meshgrid(np.pi * (np.arange(32) + 0.5) / 32, 2 * np.pi * (np.arange(64) + 0.5) / 64, indexing="ij")
    x, z = np.sin(theta) * np.cos(phi), np.cos(theta)
    lobe = 40 * np.exp(12 * (0.8 * x + 0.6 * z - 1))
    return Sky(np.stack([lobe * a + b * (1 + z) + 0.1 for a, b in ((1, 0.5), (0.9, 0.8), (0.7, 1.3))], axis=-1))


def test_directional_lights_converge() -> None:
    sky = sun_and_sky()
    source = SkySource(sky, np.zeros(3), 1.0)
    truth = _irradiance_of(source.lights(halton(1 << 16, 3, 99), 1 << 16, 0))
    errors = []
    for count in (16, 64, 256, 1024):
        runs = [source.lights(halton(count, 3, seed), count, 0) for seed in range(8)]
        errors.append(_relative_rms([_irradiance_of(run) for run in runs], truth))
    assert (np.array(errors) < [0.33, 0.16, 0.052, 0.0082]).all(), errors


def test_area_lights_converge() -> None:
    surfaces = Surfaces(IgiScene((IgiObject(panel((1.0, 0.6), [0.2, 0.1, 1.0]), lamp(5, 4, 3)),)))
    source = EmissiveSurfaces(surfaces)
    truth = _irradiance_of(source.lights(halton(1 << 16, 3, 99), 1 << 16, 0))
    errors = []
    for count in (16, 256, 4096):
        runs = [source.lights(halton(count, 3, seed), count, 0) for seed in range(8)]
        errors.append(_relative_rms([_irradiance_of(run) for run in runs], truth))
    assert (np.array(errors) < [0.076, 0.017, 0.0042]).all(), errors


def _irradiance_of(lights: VirtualLights) -> np.ndarray:
    return np.pi * matte_of(gather_at(lights, np.zeros(3), UP), UP)


def _relative_rms(values: list[np.ndarray], truth: np.ndarray) -> float:
    return float(np.sqrt(((np.array(values) - truth) ** 2).mean()) / truth.mean())


@pytest.mark.parametrize("bands", [2, 3, 5])
def test_shading_is_that_of_the_reference(bands: int) -> None:
    random = np.random.default_rng(bands)
    coefficients = random.normal(size=(40, 2, bands * bands, 3)) * 0.1
    coefficients[:, :, 0] += 2
    normals, views = random.normal(size=(2, 40, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    views /= np.linalg.norm(views, axis=-1, keepdims=True)
    exponents = phong_exponent(random.uniform(0.3, 1, 40))
    mirrored = views - 2 * (views * normals).sum(axis=1, keepdims=True) * normals
    steps = np.linspace(0, np.log1p(SHARPEST), LOBE_EXPONENTS)
    share = np.interp(np.log1p(exponents), steps, lobe_table(bands)[:, 0])
    got = responses(coefficients, normals, views, mirrored, exponents, np.ones(40, bool), "none", bands)
    for i in range(40):
        for group in range(2):
            matte_part, lobe = reference_igi.shaded(
                coefficients[i, group], normals[i], views[i], float(exponents[i]), np.ones(bands)
            )
            np.testing.assert_allclose(got.matte[i, group], matte_part, rtol=1e-12)
            np.testing.assert_allclose(got.lobe[i, group], lobe * share[i], rtol=1e-7)


def test_shadows() -> None:
    """A blocker between a lamp and the ground: dark behind it, lit beside it."""
    blocker = IgiObject(quad([[-1, -1, 1], [0, -1, 1], [0, 1, 1], [-1, 1, 1]]), matte(0, 0, 0))
    ground = IgiObject(placed(plane(1), 3, [0, 0, 0]), matte(1, 1, 1))
    scene = IgiScene((ground, blocker), lamps=(DirectionalLight((0, 0, 1), (1.0, 1, 1)),))
    settings = IgiSettings(sets="1x1", filter="none", bounces=0)
    picture = render_igi(scene, Camera((0, -4, 0.4), (0, 0, 0.2)), (64, 8), settings)
    row = picture.colour[4, :, 0]
    assert row[[30, 31]].tolist() == [0, 0]
    assert row[[34, 38]].min() > 0.3
