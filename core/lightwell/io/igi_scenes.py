"""Scene files for virtual point lights: from TOML and glTF to what `lightwell.igi.render_igi` takes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import LUMINANCE
from lightwell.errors import LightwellError, RenderError
from lightwell.geometry.mesh import make_mesh
from lightwell.geometry.shapes import make_shape
from lightwell.igi.materials import IgiMaterial
from lightwell.igi.scene import DirectionalLight, IgiObject, IgiScene, PointLight
from lightwell.igi.sky import Sky, sky_of_harmonics
from lightwell.igi.textures import Texture
from lightwell.igi_settings import IgiSettings
from lightwell.io.gltf_scene import SCENE_SUFFIXES, GltfScene, load_gltf_scene
from lightwell.io.heights import read_heights
from lightwell.io.meshes import Z_UP, load_meshes
from lightwell.io.scenes import SceneLoader, Server, placed, placed_camera
from lightwell.render.camera import Camera, overview
from lightwell.render.light import DistantLight, FieldLight, ModulatedLight, StaticField, SummedLight
from lightwell.scene_settings import (
    PictureSettings,
    SceneLampSettings,
    SceneLightSettings,
    SceneObjectSettings,
    SceneSettings,
)

Floats = NDArray[np.float64]

KEY = 0.18
"""Geometric mean of a picture's luminance, exposed, that looks right (Reinhard et al. 2002, "Photographic tone
reproduction for digital images", §2)."""
EV_MOST = 24.0


@dataclass(frozen=True, eq=False)
class LoadedIgiScene:
    """What a scene file says, ready to be rendered."""

    scene: IgiScene
    camera: Camera
    picture: PictureSettings
    settings: IgiSettings
    has_backdrop: bool
    """Whether the sky is shown behind the objects; else pictures are transparent there."""
    remarks: tuple[str, ...]
    """What the picture will not show, and that there is no light where there is none: one line each."""

    @property
    def samples(self) -> int:
        """N: a pixel is the mean of N² rays."""
        return self.settings.samples(self.picture.samples)


def load_igi_scene(
    settings: SceneSettings,
    folder: Path,
    server: Server | None = None,
    *,
    where: str = "scene",
    light: Floats | Sky | None = None,
    roots: Sequence[Path] | None = None,
) -> LoadedIgiScene:
    """Read all that a scene names; its ``method`` must be igi.

    Parameters
    ----------
    settings
        What the file says.
    folder
        Where its relative paths begin.
    server
        For streams, and for grids that are no folders.
    where
        The scene's name in errors.
    light
        Distant light in place of the file's ``[light]``: a sky, or coefficients ``(bands², 3)``.
    roots
        Folders, without links, below which all that is named must lie; None: anywhere.

    Raises
    ------
    LightwellError
        Where something cannot be read; names the file and the field.
    """
    loader = SceneLoader(folder, server, where, None if roots is None else tuple(roots))
    found = None if settings.scene is None else _scene_of(loader, settings.scene)
    objects = list(found.objects) if found is not None else []
    remarks = [f"{settings.scene}: {remark}" for remark in (found.remarks if found is not None else ())]
    for number, item in enumerate(settings.objects):
        within = loader.within(f"objects[{number}]")
        objects += _objects(within, item)
        if item.mirror:
            remarks.append(f"{within.where}.mirror: is left out; a high gloss and exponent come near it")
    sky, field = None, None
    if light is not None:
        sky = light if isinstance(light, Sky) else sky_of_harmonics(light)
    elif settings.light is not None:
        try:
            sky, field = _light(loader, settings.light, objects)
        except ValueError as error:  # more than single precision takes
            raise RenderError(f"{where}: light: {error}, or lower light.gain") from None
    if settings.backdrop.file is not None:
        raise RenderError(f"{where}: backdrop.file: igi shows the light itself behind objects: name it as light.file")
    samples = settings.picture.samples
    if "samples" in settings.picture.model_fields_set and settings.igi.samples(samples) != samples:
        remarks.append(
            f"{where}: picture.samples: is left out; with igi.filter = {settings.igi.filter!r} a pixel is one ray:"
            " render larger and shrink"
        )
    lamps = (*(found.lamps if found is not None else ()), *map(_lamp, settings.lamps))
    scene = IgiScene(tuple(objects), lamps, sky, field)
    if _is_dark(scene):
        given = "no [light]" if sky is None else "what [light] names is black"
        remarks.append(
            f"{where}: there is no light: {given}, no lamp shines and nothing emits; the picture is black: give"
            " light.file or light.stream (--light, --stream)"
        )
    if settings.camera.position is not None:
        camera = placed_camera(settings.camera)
    else:
        assert found is not None
        own = _camera_of(found, settings.camera.name, where)
        size = settings.picture.width, settings.picture.height
        camera = own or overview([item.mesh.bounds for item in objects], size)
        if own is None:
            remarks.append(f"{settings.scene}: has no camera: all of it is shown; [camera] of a scene file places one")
    shown = sky is not None and settings.backdrop.kind != "none"
    return LoadedIgiScene(scene, camera, settings.picture, settings.igi, shown, tuple(remarks))


def meter(colour: NDArray[np.float32]) -> float:
    """Return the exposure that fits linear radiance ``(H, W, 3)``, EV.

    The geometric mean of the luminance, where there is some, becomes `KEY`; black gets 0.
    """
    luminance = colour.astype(np.float64).reshape(-1, 3) @ LUMINANCE
    lit = luminance[luminance > 0]
    if not lit.size:
        return 0.0
    # What is all but black would count as much as what is white.
    mean = float(np.exp(np.log(np.maximum(lit, 1e-4 * lit.mean())).mean()))
    return float(np.clip(np.log2(KEY / mean), -EV_MOST, EV_MOST))


def _scene_of(loader: SceneLoader, path: Path) -> GltfScene:
    try:
        return load_gltf_scene(loader.path(path))
    except LightwellError as error:
        raise RenderError(f"{loader.where}: scene: {error}") from None


def _camera_of(scene: GltfScene, name: str | None, where: str) -> Camera | None:
    if name is None:
        return scene.first_camera
    try:
        return scene.camera(name)
    except LightwellError as error:
        raise RenderError(f"{where}: camera: {error}") from None


def _light(
    loader: SceneLoader, settings: SceneLightSettings, objects: list[IgiObject]
) -> tuple[Sky | None, StaticField | None]:
    """Return the distant part of the light, and its grid."""
    light, picture = loader.light(settings)
    match light:
        case FieldLight() | SummedLight():
            return None, light
        case ModulatedLight(fields=fields, rest=rest):
            field = fields[0] if len(fields) == 1 else SummedLight(fields)
            return sky_of_harmonics(rest) if rest.any() else None, field
        case DistantLight() if picture is not None:
            return Sky(np.maximum(picture, 0).astype(np.float32)), None
        case DistantLight():
            return sky_of_harmonics(light.coefficients), None
        case _:
            # Probes with places: what arrives in the middle of the objects is taken for distant.
            found = light.at(np.array([middle_of(objects)]))
            return sky_of_harmonics(found if found.ndim == 2 else found[0]), None


def middle_of(objects: Sequence[IgiObject]) -> tuple[float, float, float]:
    """Return the middle of the box round the objects, metres; the origin where there are none."""
    bounds = np.array([item.mesh.bounds for item in objects] or np.zeros((1, 2, 3)), np.float64)
    x, y, z = (bounds[:, 0].min(axis=0) + bounds[:, 1].max(axis=0)) / 2
    return float(x), float(y), float(z)


def _is_dark(scene: IgiScene) -> bool:
    powers = [lamp.irradiance if isinstance(lamp, DirectionalLight) else lamp.intensity for lamp in scene.lamps]
    return not (
        any(any(power) for power in powers)
        or any(item.material.emits for item in scene.objects)
        or (scene.sky is not None and bool(scene.sky.pixels.any()))
        or scene.field is not None
    )


def _objects(loader: SceneLoader, settings: SceneObjectSettings) -> list[IgiObject]:
    if settings.shape is not None:
        found = [IgiObject(make_shape(settings.shape), IgiMaterial(specular=0))]
    else:
        assert settings.mesh is not None
        path = loader.path(settings.mesh)
        try:
            if path.suffix.lower() in SCENE_SUFFIXES:
                scene = load_gltf_scene(path, keep_uv=settings.bump is not None)
                found = [_turned(item, settings) for item in scene.objects]
            else:
                found = [IgiObject(mesh, IgiMaterial(specular=0)) for mesh in load_meshes(path, settings.up_axis)]
        except LightwellError as error:
            raise RenderError(f"{loader.where}.mesh: {error}") from None
    if settings.bump is not None:
        bump = _bump(loader, settings.bump)
        found = [_bumpy(loader, item, bump, settings.bump_metres) for item in found]
    return [_finished(item, settings) for item in found]


def _bump(loader: SceneLoader, path: Path) -> Texture:
    try:
        return Texture(read_heights(loader.path(path)))
    except LightwellError as error:
        raise RenderError(f"{loader.where}.bump: {error}") from None


def _bumpy(loader: SceneLoader, item: IgiObject, bump: Texture, metres: float) -> IgiObject:
    if not item.uv:
        raise RenderError(
            f"{loader.where}.bump: object {item.mesh.name!r} has no texture coordinates: take a mesh of glTF with some"
        )
    return replace(item, material=replace(item.material, normal_texture=None, bump_texture=bump, bump_metres=metres))


def _lamp(settings: SceneLampSettings) -> PointLight | DirectionalLight:
    if settings.kind == "directional":
        assert settings.direction is not None
        x, y, z = settings.direction
        return DirectionalLight((-x, -y, -z), settings.intensity)
    assert settings.position is not None
    angles = np.radians([settings.inner_degrees, settings.outer_degrees]).tolist()
    return PointLight(settings.position, settings.intensity, settings.direction, *angles)


def _turned(item: IgiObject, settings: SceneObjectSettings) -> IgiObject:
    """Return an object of a glTF file as if its axes were the world's, where the entry says so."""
    if settings.up_axis == "y":
        return item
    mesh, tangents = item.mesh, item.tangents
    back = Z_UP.astype(np.float32)
    if tangents is not None:
        tangents = np.concatenate([tangents[:, :3] @ back, tangents[:, 3:]], axis=1)
    turned = make_mesh(mesh.name, mesh.positions @ back, mesh.triangles, mesh.normals @ back, mesh.albedo)
    return replace(item, mesh=turned, tangents=tangents)


def _finished(item: IgiObject, settings: SceneObjectSettings) -> IgiObject:
    """Return an object where its entry puts it, made of what that says: only what it says replaces the file's own."""
    said, material = settings.model_fields_set, item.material
    if settings.albedo is not None:
        material = replace(material, base=settings.albedo, base_texture=None, metallic=0.0)
    if "gloss" in said:
        material = replace(material, specular=settings.gloss, metallic=0.0, metallic_roughness_texture=None)
    if "gloss" in said or "exponent" in said:
        # The other way round than `lightwell.igi.materials.phong_exponent`.
        material = replace(material, roughness=float((2 * settings.exponent + 1) ** -0.25))
    if "emission" in said:
        material = replace(material, emission=settings.emission, emission_texture=None)
    if settings.two_sided:
        material = replace(material, two_sided=True)
    tangents = item.tangents
    if tangents is not None and settings.turn_degrees:
        angle = np.radians(settings.turn_degrees)
        turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
        tangents = np.concatenate([tangents[:, :3] @ turn.T, tangents[:, 3:]], axis=1).astype(np.float32)
    return replace(item, mesh=placed(item.mesh, settings), material=material, tangents=tangents)
