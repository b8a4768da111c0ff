"""Materials, textures, normal and bump maps at points of surfaces."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.support.igi_scenes import placed

from lightwell.geometry.shapes import plane, sphere
from lightwell.igi import IgiMaterial, IgiObject, IgiScene, PointLight, Sky, Texture, linear_from_srgb
from lightwell.igi.emit import EmissiveSurfaces
from lightwell.igi.materials import phong_exponent
from lightwell.igi.surfaces import SurfacePoints, Surfaces
from lightwell.igi_settings import IgiSettings

DOWN = np.array([[0.0, 0, -1]], np.float32)


def flat(material: IgiMaterial, tangents: np.ndarray | None = None, scale: float = 1.0) -> Surfaces:
    """The square −1 … 1 with u along +x and v along −y, as a picture lies that is seen from above."""
    mesh = placed(plane(4), [scale, scale, 1], [0, 0, 0])
    uv = np.stack([(mesh.positions[:, 0] / scale + 1) / 2, (1 - mesh.positions[:, 1] / scale) / 2], axis=1)
    return Surfaces(IgiScene((IgiObject(mesh, material, (uv.astype(np.float32),), tangents),)))


def seen(surfaces: Surfaces, *places: tuple[float, float]) -> SurfacePoints:
    origins = np.array([(x, y, 1.0) for x, y in places], np.float32)
    down = np.tile(DOWN, (len(places), 1))
    hits = surfaces.rays.intersect(origins, down)
    return surfaces.at(hits.triangle, hits.barycentric, down)


def test_a_texture_lies_as_gltf_has_it() -> None:
    pixels = np.zeros((2, 2, 3), np.float32)
    pixels[0, 0], pixels[0, 1], pixels[1, 0] = (1, 0, 0), (0, 1, 0), (0, 0, 1)
    points = seen(
        flat(IgiMaterial(base=(1, 1, 1), specular=0, base_texture=Texture(pixels))),
        (-0.5, 0.5), (0.5, 0.5), (-0.5, -0.5), (0, 0.5),
    )  # fmt: skip
    expected = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [0.5, 0.5, 0]])
    np.testing.assert_allclose(points.kd, expected, atol=1e-6)


@pytest.mark.parametrize(
    ("wrap", "expected"),
    [("repeat", [0.5, 0.0, 1.0, 0.0]), ("mirror", [0.0, 0.0, 1.0, 1.0]), ("clamp", [0.0, 0.0, 1.0, 1.0])],
)
def test_beyond_a_texture(wrap: Any, expected: list[float]) -> None:
    texture = Texture(np.array([[[0.0], [1.0]]], np.float32), (wrap, "clamp"))
    places = np.array([[0.0, 0.5], [0.25, 0.5], [0.75, 0.5], [1.25, 0.5]], np.float32)
    np.testing.assert_allclose(texture.at(places)[:, 0], expected, atol=1e-6)


def test_a_texture_can_be_moved_and_scaled() -> None:
    random = np.random.default_rng(0)
    pixels = random.random((5, 7, 1)).astype(np.float32)
    uv = random.random((20, 2)).astype(np.float32)
    transform = np.array([[2.0, 0.5, 0.3], [-0.4, 1.5, -0.2]])
    moved = uv @ transform[:, :2].T + transform[:, 2]
    np.testing.assert_allclose(
        Texture(pixels, transform=transform).at(uv), Texture(pixels).at(moved.astype(np.float32)), atol=1e-4
    )
    far = Texture(pixels).at(np.array([[3e38, -3e38]], np.float32))
    assert np.isfinite(far).all()
    smooth = np.sin(np.linspace(0, 2 * np.pi, 64, endpoint=False))[None, :, None].astype(np.float32).repeat(64, 0)
    slope = Texture(smooth, transform=transform).slopes_at(uv)
    at = 2 * np.pi * ((uv @ transform[0, :2] + transform[0, 2]) - 0.5 / 64)
    np.testing.assert_allclose(slope, 2 * np.pi * np.cos(at)[:, None] * transform[0, :2], atol=0.08)


def test_metal_and_dielectric() -> None:
    for metallic, kd, ks in ((0.0, 0.48, 0.04), (1.0, 0.0, 0.5), (0.5, 0.24, 0.27)):
        points = seen(flat(IgiMaterial(base=(0.5, 0.5, 0.5), metallic=metallic, roughness=0.5)), (0.1, 0.2))
        np.testing.assert_allclose(points.kd[0], kd, atol=1e-6)
        np.testing.assert_allclose(points.ks[0], ks, atol=1e-6)
        np.testing.assert_allclose(points.exponent, 7.5, rtol=1e-5)
    np.testing.assert_allclose(phong_exponent([1.0, 0.0]), [0, 1e4])
    texture = Texture(np.array([[[0.0, 0.5, 1.0]]], np.float32))
    rough = IgiMaterial(base=(0.5, 0.5, 0.5), metallic=0.5, metallic_roughness_texture=texture)
    points = seen(flat(rough), (0.1, 0.2))
    np.testing.assert_allclose([points.kd[0, 0], points.ks[0, 0], points.exponent[0]], [0.24, 0.27, 7.5], rtol=1e-5)
    np.testing.assert_allclose(linear_from_srgb(np.array([0.0, 0.5, 1.0])), [0, 0.21404, 1], atol=1e-5)


def test_colours_of_vertices() -> None:
    mesh = plane(1, albedo=[[0.2, 0.4, 0.6]] * 4)
    points = seen(Surfaces(IgiScene((IgiObject(mesh, IgiMaterial(specular=0)),))), (0.3, 0.1))
    np.testing.assert_allclose(points.kd[0], [0.2, 0.4, 0.6], rtol=1e-6)


@pytest.mark.parametrize("with_tangents", [False, True])
def test_a_normal_map_turns_normals(with_tangents: bool) -> None:
    """Red turns them along u; green against v, which here is +y: glTF's."""
    tangents = np.tile([1.0, 0, 0, 1], (25, 1)).astype(np.float32) if with_tangents else None
    for local in ([0.6, 0.0, 0.8], [0.0, 0.6, 0.8]):
        pixels = np.full((2, 2, 3), (np.array(local) + 1) / 2, np.float32)
        points = seen(flat(IgiMaterial(normal_texture=Texture(pixels)), tangents), (0.2, -0.3))
        np.testing.assert_allclose(points.shading[0], local, atol=1e-5)
        np.testing.assert_allclose(points.geometric[0], [0, 0, 1])
    scaled = flat(IgiMaterial(normal_texture=Texture(pixels), normal_scale=0.0), tangents)
    np.testing.assert_allclose(seen(scaled, (0.2, -0.3)).shading[0], [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_a_bump_map_is_the_slope_of_its_heights(scale: float) -> None:
    """Heights that rise by 1 over the texture along +x, on a square of 2 m times the scale."""
    ramp = np.linspace(0, 1, 65)[None, :-1, None].astype(np.float32).repeat(4, 0)
    surfaces = flat(IgiMaterial(bump_texture=Texture(ramp, ("clamp", "clamp")), bump_metres=0.5), scale=scale)
    expected = np.array([-0.5 / (2 * scale), 0, 1])
    points = seen(surfaces, (0.1 * scale, 0.2 * scale))
    np.testing.assert_allclose(points.shading[0], expected / np.linalg.norm(expected), atol=1e-3)


def test_smooth_normals_and_flat_ones() -> None:
    surfaces = Surfaces(IgiScene((IgiObject(sphere(16, 32), IgiMaterial()),)))
    origins = np.array([[0.3, 0.2, 2.0], [0.3, 0.2, 0.0]], np.float32)
    along = np.tile(DOWN, (2, 1))
    hits = surfaces.rays.intersect(origins, along)
    points = surfaces.at(hits.triangle, hits.barycentric, along)
    unit = points.position / np.linalg.norm(points.position, axis=1, keepdims=True)
    np.testing.assert_allclose(points.shading, unit * [[1], [-1]], atol=0.01)
    assert points.reflects.tolist() == [True, False]
    assert (np.einsum("nk,nk->n", points.geometric, along) < 0).all()


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: IgiMaterial(metallic=1.5), "metallic = 1.5"),
        (lambda: IgiMaterial(base=(2, 0, 0)), "base"),
        (lambda: IgiMaterial(emission=(-1, 0, 0)), "emission"),
        (lambda: IgiMaterial(base_texture=Texture(np.ones((1, 1, 1), np.float32))), "base_texture has 1 channels"),
        (lambda: Texture(np.full((1, 1, 3), np.nan, np.float32)), "not finite"),
        (lambda: Texture(np.ones((1, 1, 3), np.float32), transform=np.full((2, 3), np.inf)), "transform"),
        (lambda: Texture(np.ones((1, 1, 3), np.float32), encoding="srgb"), "only bytes"),
        (lambda: IgiMaterial(alpha=1.5), "alpha = 1.5"),
        (lambda: IgiObject(plane(1), IgiMaterial(), alpha=np.ones(3, np.float32)), "alpha of object"),
        (lambda: IgiObject(plane(1), IgiMaterial(bump_texture=Texture(np.ones((1, 1, 1), np.float32)))), "no texture"),
        (lambda: IgiObject(plane(1), IgiMaterial(), (np.zeros((3, 2), np.float32),)), r"\(4, 2\) are needed"),
        (lambda: IgiObject(plane(1), IgiMaterial(), tangents=np.zeros((3, 4), np.float32)), "tangents"),
        (lambda: PointLight((0, 0, 0), (1, -1, 1)), "power"),
        (lambda: PointLight((0, 0, 0), (1, 1, 1), (0, 0, 1), 0.5, 0.4), "angles"),
        (lambda: Sky(np.full((2, 4, 3), -1, np.float32)), "not negative"),
        (lambda: IgiSettings(sets="4 by 4"), "like 4x4"),
        (lambda: IgiSettings(sets=(17, 1)), "16"),
        (lambda: IgiSettings(vpls=0), "greater than or equal to 1"),
    ],
)
def test_mistakes_are_named(make: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()


def test_two_sided_lamps_shine_from_both_sides() -> None:
    powers = []
    for two_sided in (False, True):
        material = IgiMaterial(base=(0, 0, 0), specular=0, emission=(2.0, 2.0, 2.0), two_sided=two_sided)
        surfaces = flat(material)
        source = EmissiveSurfaces(surfaces)
        powers.append(source.power)
        lights = source.lights(np.random.default_rng(2).random((4000, 3)), 4000, 0.0)
        up = lights.normal[:, 2] > 0
        assert np.mean(up) == pytest.approx(0.5 if two_sided else 1.0, abs=0.03)
        np.testing.assert_array_equal(lights.position[:, 2] > 0, up)  # lifted to the side that they shine from
        np.testing.assert_allclose(lights.flux.sum(axis=0), source.power, rtol=1e-6)
        seen_from = [surfaces.at(np.array([0]), np.full((1, 2), 0.3, np.float32), side * DOWN) for side in (1, -1)]
        assert [float(points.emission[0, 0]) for points in seen_from] == [2.0, 2.0 if two_sided else 0.0]
    np.testing.assert_allclose(powers, [2 * np.pi * 4, 4 * np.pi * 4], rtol=1e-6)


def test_wide_rays_see_means_of_linear_light() -> None:
    """A chequer of texels: black and white are a grey of one half, not of what lies halfway in sRGB."""
    squares = np.indices((64, 64)).sum(axis=0)[..., None] % 2
    uv = np.random.default_rng(1).random((50, 2)).astype(np.float32)
    chequers = (
        Texture(squares.astype(np.float32)),
        Texture(squares.astype(np.uint8) * 255),
        Texture(squares.astype(np.uint8) * 255, encoding="srgb"),
    )
    for texture in chequers:
        for texels in (2.0, 3.0, 17.0, 64.0, 1e6):
            np.testing.assert_allclose(texture.at(uv, np.full(50, texels / 64, np.float32)), 0.5, atol=4e-3)
        for texels in (0.0, 0.5, 1.0):
            np.testing.assert_array_equal(texture.at(uv, np.full(50, texels / 64, np.float32)), texture.at(uv))
        half = texture.at(uv, np.full(50, 1.5 / 64, np.float32))
        np.testing.assert_allclose(half, (texture.at(uv) + 0.5) / 2, atol=4e-3)
    # Of a smooth picture of an odd size, and with a transform: the width is that in the picture.
    smooth = (np.sin(np.linspace(0, 2 * np.pi, 75))[:, None] * np.cos(np.linspace(0, 3, 53))[None, :])[..., None] + 1
    for transform in (None, np.array([[0.5, 0, 0.1], [0, 0.5, 0.2]])):
        texture = Texture(smooth.astype(np.float32), ("clamp", "clamp"), transform=transform)
        np.testing.assert_allclose(texture.at(uv, np.full(50, 4 / 63, np.float32)), texture.at(uv), atol=0.12)
    # Whatever the size, each texel counts alike in what is far away.
    for shape in ((1, 5), (3, 129), (37, 20), (1025, 7)):
        for edge in (0, -1):
            lines = np.zeros((*shape, 1), np.float32)
            lines[:, edge] = 1
            for texture in (Texture(lines), Texture((255 * lines).astype(np.uint8))):
                far = texture.at(uv[:1], np.full(1, 1e6, np.float32))
                np.testing.assert_allclose(far, 1 / shape[1], atol=1e-6 if texture.pixels.dtype == np.float32 else 0.02)
    # Each point by itself, to the last bit.
    widths = np.geomspace(0.001, 1, 50).astype(np.float32)
    apart = [texture.at(uv[k : k + 1], widths[k : k + 1])[0] for k in range(50)]
    np.testing.assert_array_equal(texture.at(uv, widths), apart)
    nearest = Texture(squares.astype(np.float32), is_smooth=False)
    assert set(nearest.at(uv, widths).ravel()) == {0.0, 1.0}


def test_how_wide_rays_are_on_textures() -> None:
    """The square of 2 m has 64 texels: rays of 1/32 m are one wide, and slanting ones as wide as their patch's root."""
    squares = (np.indices((64, 64)).sum(axis=0)[..., None] % 2).repeat(3, 2).astype(np.float32)
    surfaces = flat(IgiMaterial(base=(1, 1, 1), specular=0, base_texture=Texture(squares)))
    origins = np.array([[(k % 8) / 32 + 1 / 64, 1 / 64, 1] for k in range(8)], np.float32)
    for slant, texels, expected in ((0.0, 1.0, None), (0.0, 2.0, 0.5), (0.75**0.5, 2.0 / 2**0.5, 0.5)):
        along = np.tile(np.array([[slant, 0, -np.sqrt(1 - slant * slant)]], np.float32), (8, 1))
        hits = surfaces.rays.intersect(origins, along)
        seen_values = surfaces.at(hits.triangle, hits.barycentric, along, np.full(8, texels / 32, np.float32)).kd
        lines = surfaces.at(hits.triangle, hits.barycentric, along).kd
        np.testing.assert_allclose(seen_values, lines if expected is None else expected, atol=1e-3)
