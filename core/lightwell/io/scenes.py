"""Reading scene files: from TOML to what `lightwell.render.render` takes."""

from __future__ import annotations

import json
import os
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from lightwell.conventions import DEFAULT_BANDS, LUMINANCE, bands_of_count
from lightwell.errors import FrameError, LightwellError, MappingError, RenderError
from lightwell.field.adaptive import AnyGrid
from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.shapes import make_shape
from lightwell.gradients.interpolate import SampleSet
from lightwell.io.grids import open_grid
from lightwell.io.meshes import load_meshes
from lightwell.io.pictures import read_picture
from lightwell.io.recordings import open_recording, read_recorded_picture
from lightwell.probe.factory import make_mapping
from lightwell.probe.projection import projector
from lightwell.probe.samples import repair
from lightwell.probe.unwrap import Unwrapper
from lightwell.render.backdrop import Backdrop, Harmonics, Panorama
from lightwell.render.camera import Camera
from lightwell.render.light import DistantLight, FieldLight, Light, SampledLight, SummedLight, modulate, with_bands
from lightwell.render.material import Material
from lightwell.render.scene import Scene, SceneObject
from lightwell.scene_settings import (
    CameraSettings,
    PictureSettings,
    SceneBackdropSettings,
    SceneLightSettings,
    SceneObjectSettings,
    SceneSettings,
    SceneShadowSettings,
)
from lightwell.settings import WindowSettings, complaint
from lightwell.sh.basis import Y00
from lightwell.sh.window import WindowStage, apply_window, fixed_window
from lightwell.transfer.compute import compute_transfer
from lightwell.transfer.directions import make_directions

Floats = NDArray[np.float64]

METERED_LEVEL = 0.3
"""Mean radiance of the light, exposed, that looks right: the web page's."""
EV_MOST = 24.0
UNWRAPPED_WIDTH = 1024
"""Pixels across the lat-long picture of a probe's."""
MAX_SCENE_BYTES = 1 << 20


@dataclass(frozen=True, eq=False)
class Probe:
    """What a live probe sees now."""

    name: str
    coefficients: Floats
    """``(bands², 3)``."""
    gradients: Floats | None
    """``(bands², 3, 3)`` per metre; None: its stream measures none."""
    position: tuple[float, float, float] | None
    """Metres; None: nobody has said."""


class Server(Protocol):
    """What a scene may take from a Lightwell server."""

    def stream(self, name: str) -> Floats:
        """Return the newest coefficients of a stream, ``(bands², 3)``."""
        ...

    def position(self, name: str) -> tuple[float, float, float] | None:
        """Return where a stream's probe stands, metres; None: nobody has said."""
        ...

    def probe(self, name: str) -> Probe:
        """Return the newest frame of a stream with its gradients."""
        ...

    def field(self, name: str) -> list[Probe]:
        """Return the newest frames of those streams of a field that give light now; at least one, with positions."""
        ...

    def grid(self, grid: str) -> AnyGrid:
        """Return a finished grid."""
        ...

    def transfer(self, job: str) -> Path:
        """Return a folder with the results of a prt-transfer job, which stays while the process runs."""
        ...


@dataclass(frozen=True, eq=False)
class LoadedScene:
    """What a scene file says, ready to be rendered."""

    scene: Scene
    camera: Camera
    picture: PictureSettings
    ev: float
    """Exposure; metered where the file does not say."""


def read_scene_settings(
    path: Path, changes: Mapping[str, Any] | None = None, light: Mapping[str, Any] | None = None
) -> SceneSettings:
    """Read a scene file; ``changes`` and ``light`` as of `scene_settings`.

    A glTF file stands for a scene for igi that holds nothing else.

    Raises
    ------
    RenderError
        With one line for each mistake: file, field, value, remedy.
    """
    if path.suffix.lower() in (".glb", ".gltf"):
        return scene_settings({"method": "igi", "scene": path.name}, str(path), changes, light)
    try:
        if path.stat().st_size > MAX_SCENE_BYTES:
            raise RenderError(f"{path}: is larger than {MAX_SCENE_BYTES >> 20} MiB: this is no scene file")
        document = tomllib.loads(path.read_text("utf-8"))
    except FileNotFoundError:
        raise RenderError(f"{path}: there is no such file") from None
    except (OSError, UnicodeDecodeError) as error:
        raise RenderError(f"{path}: cannot be read: {error}") from None
    except tomllib.TOMLDecodeError as error:
        raise RenderError(f"{path}: is not valid TOML: {error}") from None
    return scene_settings(document, str(path), changes, light)


def _changed(document: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    changed = dict(document)
    for key, value in changes.items():
        below = changed.get(key)
        inner = isinstance(value, Mapping) and isinstance(below, Mapping)
        changed[key] = _changed(below, value) if inner else value  # type: ignore[arg-type]
    return changed


def scene_settings(
    document: Mapping[str, Any],
    where: str = "scene",
    changes: Mapping[str, Any] | None = None,
    light: Mapping[str, Any] | None = None,
) -> SceneSettings:
    """Return checked settings; raises as `read_scene_settings`.

    ``changes`` are put over what the scene says, tables over tables; ``light``, where it is given, in place of the
    scene's whole table of that name.
    """
    changed = _changed(document, changes or {}) | ({} if light is None else {"light": light})
    try:
        return SceneSettings.model_validate(changed)
    except ValidationError as error:
        lines = [
            f"{where}: {' '.join(filter(None, (_field(item['loc']), complaint(item))))}" for item in error.errors()
        ]
        raise RenderError("\n".join(lines)) from None


def _field(place: tuple[int | str, ...]) -> str:
    """Return the place of a mistake as ``objects[0].gloss``."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")


def load_scene(
    settings: SceneSettings,
    folder: Path,
    server: Server | None = None,
    *,
    where: str = "scene",
    light: Floats | None = None,
    shadows: bool = True,
) -> LoadedScene:
    """Read all that a scene names.

    Parameters
    ----------
    settings
        What the file says.
    folder
        Where its relative paths begin.
    server
        For streams, and for grids and transfers that are no folders.
    where
        The scene's name in errors.
    light
        Coefficients ``(bands², 3)`` in place of the file's light.
    shadows
        Compute the transfer that the file asks for; False leaves that to `add_shadows`.

    Raises
    ------
    LightwellError
        Where something cannot be read; names the file and the field.
    """
    if settings.method != "harmonics":
        raise RenderError(f"{where}: method = {settings.method!r}: this renders by harmonics: call render_igi")
    loader = SceneLoader(folder, server, where)
    if light is None:
        assert settings.light is not None
        lit, picture = loader.light(settings.light)
    else:
        lit, picture = DistantLight(light), None
    camera = placed_camera(settings.camera)
    objects = tuple(
        made
        for number, item in enumerate(settings.objects)
        for made in loader.within(f"objects[{number}]").objects(item)
    )
    backdrop = loader.within("backdrop").backdrop(settings.backdrop, lit, picture, camera)
    scene = Scene(objects, lit, backdrop, settings.negatives, settings.sampling)
    ev = settings.picture.ev
    loaded = LoadedScene(scene, camera, settings.picture, meter(scene) if ev is None else ev)
    return add_shadows(loaded, settings.shadows) if shadows else loaded


def add_shadows(loaded: LoadedScene, settings: SceneShadowSettings) -> LoadedScene:
    """Return the scene with the transfer that its objects have among each other, where they have none of their own.

    This takes as long as so many rays a vertex take, with all cores.
    """
    objects = loaded.scene.objects
    if settings.mode == "none" or not objects:
        return loaded
    meshes = [
        item.mesh
        if item.material.albedo is None
        else replace(
            item.mesh, albedo=np.tile(np.array(item.material.albedo, np.float32), (len(item.mesh.positions), 1))
        )
        for item in objects
    ]
    found = compute_transfer(
        meshes,
        make_directions("fibonacci", settings.directions),
        loaded.scene.light.bands,
        settings.mode,
        settings.bounces,
        threads=os.cpu_count() or 1,
    ).coefficients
    ends = np.cumsum([len(mesh.positions) for mesh in meshes])
    shadowed = tuple(
        item if item.transfer is not None else replace(item, transfer=part)
        for item, part in zip(objects, np.split(found, ends[:-1]), strict=True)
    )
    return replace(loaded, scene=replace(loaded.scene, objects=shadowed))


def meter(scene: Scene) -> float:
    """Return the exposure that fits the light, EV: its mean luminance at the objects becomes `METERED_LEVEL`."""
    centres = [np.stack(item.mesh.bounds).astype(np.float64).mean(axis=0) for item in scene.objects]
    found = scene.light.at(np.array(centres or [np.zeros(3)]))
    mean = float(np.mean(found[..., 0, :] @ LUMINANCE)) * Y00
    return float(np.clip(np.log2(METERED_LEVEL / mean), -EV_MOST, EV_MOST)) if mean > 0 else 0.0


def placed_camera(settings: CameraSettings) -> Camera:
    """Return a camera whose position is given."""
    assert settings.position is not None
    return Camera(settings.position, settings.target, settings.up, settings.fov_degrees)


@dataclass(frozen=True)
class SceneLoader:
    """Finds what a scene names."""

    folder: Path
    server: Server | None
    where: str
    roots: tuple[Path, ...] | None = None
    """Folders below which files must lie; None: anywhere."""

    def within(self, field: str) -> SceneLoader:
        """Return a loader whose errors name a field."""
        return replace(self, where=f"{self.where}: {field}")

    def light(self, settings: SceneLightSettings) -> tuple[Light, NDArray[np.floating] | None]:
        """Return the light, and its picture where it is from one."""
        at = self.within("light")
        if settings.field is not None or settings.gradients:
            return at._sampled(settings), None
        fields = at._fields(settings)
        if settings.file is None and settings.stream is None:
            return fields[0] if len(fields) == 1 else SummedLight(fields), None
        live, picture = at._probe(settings)
        light = modulate(fields, live, at._place(settings)) if fields else DistantLight(live)
        return light, picture

    def backdrop(
        self,
        settings: SceneBackdropSettings,
        light: Light,
        picture: NDArray[np.floating] | None,
        camera: Camera,
    ) -> Backdrop | None:
        """Return what is behind the objects."""
        if settings.file is not None:
            if settings.kind not in ("auto", "picture"):
                raise RenderError(f"{self.where}.file: means nothing with kind = {settings.kind!r}: leave one out")
            return Panorama(self._picture(self.path(settings.file)), settings.filter)
        kind = settings.kind
        if kind == "auto":
            kind = "picture" if picture is not None else "harmonics" if isinstance(light, DistantLight) else "none"
        match kind:
            case "none":
                return None
            case "picture":
                if picture is None:
                    raise RenderError(f"{self.where}.kind = 'picture': this light has no picture: name a file")
                return Panorama(picture, settings.filter)
            case _:
                found = light.at(np.array([camera.position], dtype=np.float64))
                return Harmonics(found if found.ndim == 2 else found[0])

    def objects(self, settings: SceneObjectSettings) -> list[SceneObject]:
        """Return the objects of one entry."""
        material = Material(
            **settings.model_dump(
                include={"albedo", "gloss", "exponent", "normalised", "horizon", "mirror", "two_sided"}
            )
        )
        if settings.transfer is not None:
            return [
                SceneObject(placed(mesh, settings), material, transfer)
                for mesh, transfer in self._transferred(settings.transfer)
            ]
        if settings.shape is not None:
            meshes = [make_shape(settings.shape)]
        else:
            assert settings.mesh is not None
            try:
                meshes = load_meshes(self.path(settings.mesh), settings.up_axis)
            except LightwellError as error:
                raise RenderError(f"{self.where}.mesh: {error}") from None
        return [SceneObject(placed(mesh, settings), material) for mesh in meshes]

    def _probe(self, settings: SceneLightSettings) -> tuple[Floats, NDArray[np.floating] | None]:
        """Return the coefficients of a file or a stream, and the picture where there is one."""
        picture: NDArray[np.floating] | None = None
        if settings.file is None:
            assert settings.stream is not None
            coefficients = self._require_server("stream").stream(settings.stream)
        else:
            found = self._recorded(settings, self.path(settings.file))
            if found.ndim == 2:
                coefficients = np.asarray(found, np.float64)
            else:
                picture = found
                bands = settings.bands or DEFAULT_BANDS
                try:
                    mapping = make_mapping(settings.mapping, *picture.shape[:2])
                except MappingError as error:
                    raise RenderError(f"{self.where}.mapping: {settings.file}: {error}") from None
                coefficients = projector(mapping, bands, "solid-angle", settings.mapping.blind).project(picture)
                if settings.mapping.kind != "latlong":
                    picture = Unwrapper(mapping, UNWRAPPED_WIDTH)(np.ascontiguousarray(picture))
        coefficients = settings.gain * with_bands(
            coefficients, self._bands(settings, bands_of_count(len(coefficients)))
        )
        windowed, _, _ = WindowStage(settings.window, bands_of_count(len(coefficients))).update(coefficients, 0)
        return windowed, None if picture is None else settings.gain * picture

    def _sampled(self, settings: SceneLightSettings) -> SampledLight:
        """Return the light beside the probe of a stream, or among those of a field."""
        if settings.field is not None:
            probes = self._require_server("field").field(settings.field)
        else:
            assert settings.stream is not None
            probes = [self._require_server("stream").probe(settings.stream)]
            if probes[0].gradients is None:
                raise RenderError(
                    f"{self.where}.gradients: the stream {settings.stream!r} has none: give it a proxy in its settings"
                    " ([gradients]), or leave this out"
                )
        bands = self._bands(settings, min(bands_of_count(len(probe.coefficients)) for probe in probes))
        coefficients = np.stack([with_bands(probe.coefficients, bands) for probe in probes])
        gradients: list[NDArray[np.float64] | None] = [
            None
            if probe.gradients is None or settings.gradients is False
            else settings.gain * probe.gradients[: bands * bands]
            for probe in probes
        ]
        window = _window_of(settings.window, coefficients[0])
        if window is not None:
            coefficients = np.stack([apply_window(values, window) for values in coefficients])
            gradients = [None if values is None else apply_window(values, window) for values in gradients]
        return SampledLight(
            SampleSet(
                [settings.probe_at or probe.position or (0.0, 0.0, 0.0) for probe in probes],
                settings.gain * coefficients,
                gradients,
            )
        )

    def _fields(self, settings: SceneLightSettings) -> tuple[FieldLight, ...]:
        return tuple(self._field(name, settings) for name in settings.grid or ())

    def _field(self, name: str, settings: SceneLightSettings) -> FieldLight:
        path = self.path(Path(name))
        if path.exists() or "/" in name or name.endswith(".zarr"):
            grid = open_grid(path)
        else:
            grid = self._require_server("grid").grid(name)
        bands = self._bands(settings, grid.bands)
        return FieldLight(grid, bands, _fixed(settings.window, bands), settings.gain)

    def _place(self, settings: SceneLightSettings) -> tuple[float, float, float] | None:
        """Return where the live probe stands, as far as anybody says."""
        if settings.probe_at is not None or settings.file is not None or settings.stream is None:
            return settings.probe_at
        return self._require_server("stream").position(settings.stream)

    def _bands(self, settings: SceneLightSettings, there: int) -> int:
        if settings.bands is not None and settings.bands > there:
            raise RenderError(f"{self.where}.bands = {settings.bands}: this light has {there}: ask for no more")
        return settings.bands or there

    def path(self, path: Path) -> Path:
        """Return where a path of the scene file leads; raises `RenderError` where that is outside the roots."""
        if "\0" in str(path):
            raise RenderError(f"{self.where}: {str(path)!r} is no path: it holds a null character")
        try:
            found = self.folder / path.expanduser()
            self._require_inside(found, path)
            return found
        except RuntimeError as error:
            raise RenderError(f"{self.where}: {path}: {error}") from None

    def _require_inside(self, found: Path, named: Path) -> None:
        """Raise `RenderError` where a file, all links followed, lies outside the roots."""
        if self.roots is None or any(found.resolve().is_relative_to(root) for root in self.roots):
            return
        raise RenderError(
            f"{self.where}: {named}: lies outside the folders from which a server takes files: put it beside the scene,"
            " or add its folder to [jobs] data_roots"
        )

    def _picture(self, path: Path) -> NDArray[np.floating]:
        try:
            return repair(read_picture(path).pixels)
        except FrameError as error:
            raise RenderError(f"{self.where}.file: {path}: {error.reason}") from None

    def _recorded(self, settings: SceneLightSettings, path: Path) -> NDArray[np.floating]:
        """Return a file's coefficients ``(bands², 3)``, or its picture ``(H, W, 3)``, of the frame asked for."""
        try:
            recording = open_recording(str(path), settings.video, settings.stream)
            default = 0 if recording.coefficients is None else -1
            index = recording.frame(default if settings.frame is None else settings.frame)
        except FrameError as error:
            raise RenderError(f"{self.where}.file: {path}: {error.reason}") from None
        except LightwellError as error:
            raise RenderError(f"{self.where}.file: {error}") from None
        if recording.coefficients is not None:
            return recording.light_at(index)
        place, number = recording.pictures[index]
        self._require_inside(place, Path(place.name))  # it may be a link
        try:
            return repair(read_recorded_picture(place, number, settings.video))
        except FrameError as error:
            raise RenderError(f"{self.where}.file: {place}: {error.reason}") from None

    def _transferred(self, name: str) -> list[tuple[Mesh, NDArray[np.floating]]]:
        path = self.path(Path(name))
        folder = path if path.exists() or "/" in name else self._require_server("transfer").transfer(name)
        return read_transfer(folder, self.where)

    def _require_server(self, field: str) -> Server:
        if self.server is None:
            raise RenderError(f"{self.where}.{field}: needs a server: give --server, or a folder or file")
        return self.server


def read_transfer(folder: Path, where: str = "transfer") -> list[tuple[Mesh, NDArray[np.floating]]]:
    """Read the meshes of a prt-transfer job with their transfer ``(V, bands², C)``, float32.

    Raises
    ------
    RenderError
        Where the folder holds no such results, or they do not belong together.
    """
    try:
        document = json.loads((folder / "transfer.json").read_text("utf-8"))
        bands, channels = int(document["bands"]), int(document["channels"])
        entries = list(document["meshes"])
        blobs = [np.fromfile(folder / entry["float32"], dtype="<f4") for entry in entries]
        meshes = load_meshes(folder / document["glb"])
    except (OSError, ValueError, KeyError, TypeError, LightwellError) as error:
        raise RenderError(
            f"{where}: {folder}: holds no results of a prt-transfer job (transfer.json and what it names): {error}"
        ) from None
    if len(meshes) != len(entries):
        raise RenderError(f"{where}: {folder}: has {len(meshes)} meshes and {len(entries)} transfers: make it anew")
    found = []
    for mesh, blob in zip(meshes, blobs, strict=True):
        wanted = len(mesh.positions) * bands * bands * channels
        if blob.size != wanted:
            raise RenderError(
                f"{where}: {folder}: the transfer of {mesh.name!r} has {blob.size} numbers, not {wanted}: make it anew"
            )
        found.append((mesh, blob.reshape(len(mesh.positions), bands * bands, channels)))
    return found


def placed(mesh: Mesh, settings: SceneObjectSettings) -> Mesh:
    """Return a mesh scaled, then turned, then moved, as an entry says."""
    angle = np.radians(settings.turn_degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    positions = settings.scale * mesh.positions.astype(np.float64) @ turn.T + np.array(settings.position)
    return make_mesh(mesh.name, positions, mesh.triangles, mesh.normals.astype(np.float64) @ turn.T, mesh.albedo)


def _window_of(settings: WindowSettings, coefficients: Floats) -> Floats | None:
    """Return the weights ``(bands,)`` that these coefficients ``(bands², 3)`` get; None where none are applied."""
    if settings.kind == "none":
        return None
    _, weights, _ = WindowStage(settings, bands_of_count(len(coefficients))).update(coefficients, 0)
    return weights


def _fixed(window: WindowSettings, bands: int) -> Floats | None:
    if window.kind == "none":
        return None
    return fixed_window(window.kind, bands, window.width, window.target)
