"""Shading against analytic light and against quadrature."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_render as slow
from tests.support import reference_sh

from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.shapes import box, plane, sphere
from lightwell.render import Camera, DistantLight, FieldLight, Harmonics, Material, Scene, SceneObject, render
from lightwell.render.material import horizon_factor
from lightwell.render.negatives import without_negatives
from lightwell.sh.lobes import lambert_zonal, zonal_to_coefficients

CAMERA = Camera((1.0, -4.0, 1.2), (0.0, 0.0, 0.2))
HALF_SPACE = (1.7724538509055159, 1.5349900619197328, 0.0, -0.5861840125, 0.0)


def constant(value: object, bands: int = 5) -> np.ndarray:
    coefficients = np.zeros((bands**2, 3))
    coefficients[0] = np.sqrt(4 * np.pi) * np.asarray(value)
    return coefficients


def test_constant_light_times_albedo_is_the_radiance() -> None:
    scene = Scene((SceneObject(sphere(albedo=(0.2, 0.5, 0.9))),), DistantLight(constant([1, 2, 3])))
    found = render(scene, CAMERA, (24, 18))
    hit = found.colour[found.coverage == 1]
    np.testing.assert_allclose(hit, np.broadcast_to([0.2, 1.0, 2.7], hit.shape), rtol=2e-6)
    assert 0.1 < found.coverage.mean() < 0.9


def test_a_normalised_lobe_keeps_constant_light() -> None:
    for exponent in (0.0, 1.0, 6.0, 40.0):
        material = Material(gloss=1.0, exponent=exponent)
        found = render(Scene((SceneObject(sphere(), material),), DistantLight(constant([1, 2, 3]))), CAMERA, (16, 12))
        hit = found.colour[found.coverage == 1]
        np.testing.assert_allclose(hit, np.broadcast_to([1, 2, 3], hit.shape), rtol=2e-6)


def test_the_lobe_of_paper_000_has_peak_one() -> None:
    material = Material(gloss=1.0, exponent=6.0, normalised=False)
    found = render(Scene((SceneObject(sphere(), material),), DistantLight(constant(1))), CAMERA, (16, 12))
    np.testing.assert_allclose(found.colour[found.coverage == 1], 2 * np.pi / 7, rtol=2e-6)


def test_half_space_light_is_half_one_plus_z() -> None:
    light = np.zeros((25, 3))
    light[[0, 2, 6, 12, 20]] = np.array(HALF_SPACE)[:, None]
    found = render(Scene((SceneObject(sphere(400, 800, albedo=0.6)),), DistantLight(light)), CAMERA, (24, 18))
    hit = found.coverage == 1
    expected = 0.6 * (1 + found.normal[hit][:, 2:]) / 2
    np.testing.assert_allclose(found.colour[hit], np.broadcast_to(expected, (hit.sum(), 3)), atol=3e-6)


def test_a_sphere_under_nine_coefficients_is_the_analytic_irradiance() -> None:
    """Done-when 2: within 0.1 %; the normal is that of the point on the true sphere, not the mesh's."""
    coefficients = np.random.default_rng(3).normal(size=(9, 3)) * 0.2 + constant([1, 1.5, 2], 3)
    found = render(Scene((SceneObject(sphere(albedo=1.0)),), DistantLight(coefficients)), CAMERA, (40, 30))
    rays = CAMERA.directions((40, 30))[:, :, 0]
    along = rays @ -np.array(CAMERA.position)
    within = along**2 - (np.dot(CAMERA.position, CAMERA.position) - 1)
    hit = (found.coverage == 1) & (within > 0.02)
    points = np.array(CAMERA.position) + (along - np.sqrt(np.maximum(within, 0)))[..., None] * rays
    expected = np.stack([slow.irradiance(coefficients, n) for n in points[hit]]) / np.pi
    relative = np.abs(found.colour[hit] - expected) / expected.mean()
    print(f"\nsphere under 9 coefficients: largest {relative.max():.1e}, mean {relative.mean():.1e} of the mean")
    assert relative.max() < 1e-3


@given(
    seed=st.integers(0, 2**32 - 1),
    gloss=st.sampled_from([0.0, 0.4, 1.0]),
    exponent=st.sampled_from([1.0, 6.0, 13.0]),
    normalised=st.booleans(),
    channels=st.sampled_from([0, 1, 3]),
    in_grid=st.booleans(),
)
@settings(max_examples=6, deadline=None)
def test_pictures_are_those_of_the_slow_reference(
    seed: int, gloss: float, exponent: float, normalised: bool, channels: int, in_grid: bool
) -> None:
    rng = np.random.default_rng(seed)
    material = Material(gloss=gloss, exponent=exponent, normalised=normalised)
    objects = []
    for mesh in (sphere(5, 7, albedo=rng.uniform(size=3)), plane(2, albedo=rng.uniform(size=(9, 3))), box()):
        turn = reference_sh.rotation(int(rng.integers(1 << 30))) if mesh.name != "plane" else np.eye(3)
        positions = (0.6 * mesh.positions @ turn.T + rng.uniform(-1, 1, 3)).astype(np.float32)
        moved = type(mesh)(
            mesh.name, positions, mesh.triangles, (mesh.normals @ turn.T).astype(np.float32), mesh.albedo
        )
        transfer = rng.normal(size=(len(positions), 9, channels)) if channels else None
        objects.append(SceneObject(moved, material, transfer))
    spec = GridSpec((-2.0, -2.0, -2.0), (2.0, 2.0, 2.0), (3, 2, 4))
    grid = Grid(spec, rng.normal(size=(4, 2, 3, 16, 3)).astype(np.float32), np.ones((4, 2, 3), np.float32))
    one = rng.normal(size=(16, 3))
    light = FieldLight(grid) if in_grid else DistantLight(one)
    camera = Camera((0.3, -5.0, 2.0), (0.0, 0.0, 0.0), fov_degrees=30)
    found = render(Scene(tuple(objects), light, negatives="keep"), camera, (8, 6))
    rays = camera.directions((8, 6))[:, :, 0]
    worst, disagree = 0.0, 0
    for row, column in np.ndindex(6, 8):
        expected = slow.pixel(
            objects,
            lambda at: grid.sample(at).coefficients if in_grid else one,
            np.array(camera.position),
            rays[row, column],
        )
        if (expected is not None) != bool(found.coverage[row, column]):
            disagree += 1
        elif expected is not None:
            error = np.abs(found.colour[row, column] - expected).max() / (1 + np.abs(expected).max())
            disagree += int(error > 1e-3)
            worst = max(worst, 0.0 if error > 1e-3 else float(error))
    assert worst < 1e-4
    assert disagree <= 1  # a ray along an edge, in single precision


def test_shading_at_vertices_is_shading_at_points_for_dense_meshes() -> None:
    coefficients = np.random.default_rng(0).normal(size=(25, 3)) * 0.1 + constant(1)
    item = SceneObject(sphere(96, 192), Material(gloss=0.5, exponent=6))
    pictures = [
        render(Scene((item,), DistantLight(coefficients), sampling=sampling), CAMERA, (32, 24)).colour
        for sampling in ("point", "vertex")
    ]
    assert np.abs(pictures[0] - pictures[1]).max() < 2e-3
    assert np.abs(pictures[0] - pictures[1]).max() > 0


def test_transfer_of_an_unshadowed_surface_is_no_transfer() -> None:
    mesh = sphere(48, 96)
    transfer = zonal_to_coefficients(lambert_zonal(5), mesh.normals.astype(np.float64))[..., None]
    coefficients = np.random.default_rng(0).normal(size=(25, 3)) * 0.1 + constant(1)
    material = Material(gloss=0.3)
    pictures = [
        render(Scene((SceneObject(mesh, material, given),), DistantLight(coefficients)), CAMERA, (32, 24)).colour
        for given in (None, transfer, transfer.repeat(3, axis=2))
    ]
    np.testing.assert_allclose(pictures[1], pictures[0], atol=1e-3)
    np.testing.assert_allclose(pictures[2], pictures[1], atol=1e-6)


def test_more_bands_of_light_than_of_transfer_are_left_out() -> None:
    mesh = sphere(16, 32)
    transfer = zonal_to_coefficients(lambert_zonal(2), mesh.normals.astype(np.float64))[..., None]
    coefficients = np.random.default_rng(0).normal(size=(25, 3))
    scenes = [
        Scene((SceneObject(mesh, transfer=transfer),), DistantLight(light), negatives="keep")
        for light in (coefficients, coefficients[:4])
    ]
    first, second = (render(scene, CAMERA, (16, 12)).colour for scene in scenes)
    np.testing.assert_array_equal(first, second)


def test_what_is_closed_reflects_nothing() -> None:
    mesh = sphere(16, 32)
    item = SceneObject(mesh, Material(gloss=1.0), np.zeros((len(mesh.positions), 25, 1)))
    assert render(Scene((item,), DistantLight(constant(1))), CAMERA, (16, 12)).colour.max() == 0


def test_mirrors_add_the_backdrop_in_the_mirror_direction() -> None:
    light = np.zeros((4, 3))
    light[[0, 2]] = [[np.sqrt(4 * np.pi)], [0.9]]
    scenes = [
        Scene((SceneObject(plane(1), Material(mirror=weight)),), DistantLight(light), Harmonics(light))
        for weight in (0.0, 0.25)
    ]
    camera = Camera((0.0, -3.0, 3.0), (0.0, 0.0, 0.0), fov_degrees=5)
    plain, mirrored = (render(scene, camera, (5, 5)) for scene in scenes)
    upwards = camera.directions((5, 5))[:, :, 0] * [1, 1, -1]
    expected = 0.25 * Harmonics(light).radiance(upwards.reshape(-1, 3)).reshape(5, 5, 3)
    np.testing.assert_allclose(mirrored.colour - plain.colour, expected, atol=1e-6)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 6.0, 30.0])
def test_horizon_factor_is_the_share_of_the_lobe_above_the_surface(exponent: float) -> None:
    for cosine in (-1.0, -0.3, 0.0, 0.2, 0.7, 1.0):
        assert horizon_factor(cosine, exponent) == pytest.approx(slow.share_above(cosine, exponent), abs=4e-3)
    assert horizon_factor(0.0, exponent) == pytest.approx(0.5, abs=1e-9)
    angles = np.linspace(0, np.pi, 1001)
    assert (np.diff(horizon_factor(np.cos(angles), exponent)) <= 1e-9).all()


def test_horizon_factor_is_known_for_the_two_simplest_lobes() -> None:
    """s = 0: the lune that two hemispheres share; s = 1: what a tilted surface gets of half-space light."""
    angles = np.linspace(0, np.pi, 50)
    np.testing.assert_allclose(horizon_factor(np.cos(angles), 0.0), 1 - angles / np.pi, atol=1e-4)
    np.testing.assert_allclose(horizon_factor(np.cos(angles), 1.0), (1 + np.cos(angles)) / 2, atol=1e-4)


def test_horizon_cuts_the_lobe_off() -> None:
    light = DistantLight(constant(1))
    camera = Camera((0.0, -5.0, 0.02), (0.0, 0.0, 0.0), fov_degrees=0.05)
    cut, whole = (
        render(Scene((SceneObject(plane(1), Material(gloss=1, horizon=on)),), light), camera, (3, 3)).colour
        for on in (True, False)
    )
    assert whole[1, 1, 0] == pytest.approx(1, abs=1e-6)
    assert cut[1, 1, 0] == pytest.approx(0.5, abs=0.02)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_negatives_move_towards_luminance(seed: int) -> None:
    rgb = np.random.default_rng(seed).normal(size=(20, 3))
    moved = without_negatives(rgb)
    weights = np.array([0.2126, 0.7152, 0.0722])
    assert (moved >= 0).all()
    np.testing.assert_allclose(moved @ weights, np.maximum(rgb @ weights, 0), atol=1e-12)
    fine = (rgb >= 0).all(axis=1)
    np.testing.assert_allclose(moved[fine], rgb[fine], atol=1e-15)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Material(gloss=1.5), "gloss = 1.5"),
        (lambda: Material(exponent=-1), "exponent = -1"),
        (lambda: Material(albedo=(2, 0, 0)), "albedo"),
        (lambda: DistantLight(np.zeros((8, 3))), "whole number of bands"),
        (lambda: DistantLight(np.zeros(9)), "coefficients are needed"),
        (lambda: DistantLight(np.full((9, 3), np.nan)), "finite"),
        (lambda: SceneObject(sphere(4, 4), transfer=np.zeros((3, 9, 1))), "compute it for this mesh"),
        (lambda: SceneObject(plane(1), transfer=np.zeros((4, 8, 1))), "whole number of bands"),
        (lambda: SceneObject(plane(1), transfer=np.full((4, 9, 1), np.inf)), "not finite"),
    ],
)
def test_refuses_what_cannot_be_shaded(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]
