"""What an ``igi-render`` job renders: its scene's file with what the job says put over it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AnyGrid
from lightwell.igi.sky import Sky
from lightwell.igi_settings import IgiSettings
from lightwell.io.grids import open_grid
from lightwell.io.igi_scenes import LoadedIgiScene, load_igi_scene, middle_of
from lightwell.io.meshes import MESH_SUFFIXES
from lightwell.io.scenes import Probe, read_scene_settings, scene_settings
from lightwell.job_settings import MAX_FRAMES, IgiCameraSettings, IgiLightSettings, IgiRenderSettings
from lightwell.render.camera import Camera
from lightwell.render.path import camera_path, orbit
from lightwell.scene_settings import CameraSettings, SceneLightSettings, SceneSettings
from lightwell_workers.jobs.directory import JOB_ID, JobDirectory
from lightwell_workers.jobs.igi_light import changes_light, light_size
from lightwell_workers.jobs.kind import JobError

FRAMES_OF_A_MOVE = 48
SCENE_FILES = (".toml", ".glb", ".gltf")


class SceneSize(NamedTuple):
    """How much a scene is."""

    triangles: int
    lamps: int
    texels: int
    middle: tuple[float, float, float]
    """Of the box round the objects, metres."""


class Snapshot:
    """What a job may name of a server (`lightwell.io.scenes.Server`): what it was given when it was submitted."""

    def __init__(self, light: IgiLightSettings, root: Path) -> None:
        """Take the light of a job, and the folder of all jobs."""
        self._light = light
        self._root = root

    def stream(self, name: str) -> NDArray[np.float64]:
        """Return what the stream showed, ``(bands², 3)``."""
        if self._light.coefficients is None:
            raise JobError(
                f"light: what {name!r} shows is asked for when a server takes the job: submit it to one, or give"
                " light.coefficients"
            )
        return np.array(self._light.coefficients, np.float64)

    def position(self, name: str) -> tuple[float, float, float] | None:
        """Return where its probe stood."""
        del name
        return self._light.probe_at

    def probe(self, name: str) -> Probe:
        """Return what arrived from the stream in the middle of the scene: it changes no further."""
        coefficients = self.stream(name)
        return Probe(name, coefficients, np.zeros((*coefficients.shape, 3)), self.position(name))

    def field(self, name: str) -> list[Probe]:
        """Return what arrived among the streams in the middle of the scene."""
        return [Probe(name, self.stream(name), None, (0.0, 0.0, 0.0))]

    def grid(self, grid: str) -> AnyGrid:
        """Return a grid of another job."""
        job = grid.partition(".")[0]
        if JOB_ID.match(job):
            directory = JobDirectory(self._root, job)
            for artifact in directory.read_manifest():
                if artifact.id == grid:
                    return open_grid(directory.artifacts / artifact.path)
        raise JobError(f"light.grid: there is no grid {grid!r} any more")

    def transfer(self, job: str) -> Path:
        """Raise `JobError`."""
        raise JobError(f"objects.transfer: virtual lights need no transfer ({job}): name the mesh")


def scene_of(settings: IgiRenderSettings) -> SceneSettings:
    """Return what is rendered: the file's settings, and over them those of the job that have been set.

    Raises
    ------
    LightwellError
        Where the file cannot be read, or cannot be rendered by virtual lights.
    """
    path = Path(settings.scene)
    suffix = path.suffix.lower()
    if suffix in SCENE_FILES:
        found = read_scene_settings(path, {"method": "igi"})
    elif suffix in MESH_SUFFIXES:
        if settings.camera.position is None and not settings.camera.path:
            raise JobError(f"camera: {path.name} has none: give camera.position and camera.target")
        found = scene_settings(
            {"method": "igi", "objects": [{"mesh": str(path)}], "camera": {"position": (0, 0, 1)}}, path.name
        )
    else:
        raise JobError(
            f"scene: {path.name} has the type {suffix or '(none)'}; scenes are {', '.join(SCENE_FILES)}, or meshes"
            f" {', '.join(MESH_SUFFIXES)}"
        )
    picture = found.picture.model_copy(
        update={
            name: getattr(settings, name)
            for name in ("width", "height", "samples", "ev", "tone_mapping")
            if getattr(settings, name) is not None
        }
    )
    changes: dict[str, Any] = {
        "picture": picture,
        "igi": _merged(found.igi, settings.igi),
        "light": _light(settings.light, found.light),
    }
    camera = _camera(settings.camera)
    if camera is not None:
        changes["camera"] = camera
    return found.model_copy(update=changes)


def load(
    settings: IgiRenderSettings, root: Path, roots: Sequence[Path] | None = None, light: Sky | None = None
) -> LoadedIgiScene:
    """Read all that is rendered.

    ``root`` is the folder of all jobs, ``roots`` are those below which files must lie, ``light`` is taken in place of
    the scene's.
    """
    path, server = Path(settings.scene), Snapshot(settings.light, root)
    return load_igi_scene(scene_of(settings), path.parent, server, where=path.name, light=light, roots=roots)


def size_of(settings: IgiRenderSettings, roots: Sequence[Path] | None = None) -> SceneSize:
    """Return how much a scene is, without its light; kept for as long as the file is the same."""
    path = Path(settings.scene)
    try:
        state = path.stat()
        version = (state.st_mtime_ns, state.st_size)
    except OSError:
        version = (0, 0)
    camera = settings.camera.model_dump_json(include={"name", "position", "path"})
    return _size(settings.scene, version, camera, None if roots is None else tuple(roots))


@lru_cache(maxsize=64)
def _size(scene: str, version: tuple[int, int], camera: str, roots: tuple[Path, ...] | None) -> SceneSize:
    del version
    path = Path(scene)
    settings = IgiRenderSettings(scene=scene, camera=IgiCameraSettings.model_validate_json(camera))
    found = scene_of(settings).model_copy(update={"light": None})
    loaded = load_igi_scene(found, path.parent, where=path.name, roots=roots).scene
    used = (texture.pixels for item in loaded.objects for texture in item.material.textures)
    textures = {id(pixels): pixels.size for pixels in used}
    return SceneSize(
        sum(len(item.mesh.triangles) for item in loaded.objects),
        len(loaded.lamps),
        sum(textures.values()),
        middle_of(loaded.objects),
    )


def frame_count(settings: IgiRenderSettings, roots: Sequence[Path] | None = None) -> int:
    """Return how many pictures there are; raises `LightwellError` where the recording cannot be used."""
    length = light_size(settings, roots).pictures
    moves = bool(settings.camera.path or settings.camera.orbit_degrees)
    if settings.frames is not None:
        if settings.frames > 1 and not moves and not changes_light(settings):
            raise JobError(
                f"frames = {settings.frames}: nothing changes from picture to picture: give camera.path,"
                " camera.orbit_degrees or light.frames"
            )
        return settings.frames
    if changes_light(settings):
        if length > MAX_FRAMES:
            raise JobError(
                f"light.frames: a film of it has {length} pictures; at most {MAX_FRAMES} are rendered: give frames, or"
                " a lower fps"
            )
        return length
    return FRAMES_OF_A_MOVE if moves else 1


def cameras_of(settings: IgiCameraSettings, camera: Camera, count: int) -> list[Camera]:
    """Return the camera of each picture; ``camera`` is the scene's. Raises `JobError` where the path cannot be."""
    if settings.path:
        keys = [Camera(key.position, key.target, key.up, key.fov_degrees) for key in settings.path]
        try:
            return camera_path(keys, count)
        except ValueError as error:
            raise JobError(f"camera.path: between its cameras: {error}") from None
    if settings.orbit_degrees:
        return orbit(camera, settings.orbit_degrees, count)
    return [camera] * count


def _merged(file: IgiSettings, job: IgiSettings) -> IgiSettings:
    return file.model_copy(update={name: getattr(job, name) for name in job.model_fields_set})


def _light(light: IgiLightSettings, before: SceneLightSettings | None) -> SceneLightSettings | None:
    found = _distant(light, before)
    live = found is not None and found.file is None and (found.stream is not None or found.field is not None)
    if light.coefficients is not None and not live:
        raise JobError("light.coefficients: are what a stream or a field showed: give light.stream with any name")
    return found


def _distant(light: IgiLightSettings, before: SceneLightSettings | None) -> SceneLightSettings | None:
    if light.frames is not None:
        return None  # each picture has its own
    if light.map is None and light.stream is None and light.field is None and light.grid is None:
        if before is None or light.gain == 1:
            return before
        return before.model_copy(update={"gain": before.gain * light.gain})
    follows = light.grid is not None and (light.map is not None or light.stream is not None)
    return SceneLightSettings(
        file=None if light.map is None else Path(light.map),
        mapping=light.mapping,
        stream=light.stream,
        field=light.field,
        grid=light.grid,
        gain=light.gain,
        probe_at=light.probe_at if follows else None,
    )


def _camera(settings: IgiCameraSettings) -> CameraSettings | None:
    """Return the job's own camera, if it has one."""
    if settings.name is not None:
        return CameraSettings(name=settings.name)
    placed = settings.path[0] if settings.path else settings
    if placed.position is None:
        return None
    return CameraSettings(position=placed.position, target=placed.target, up=placed.up, fov_degrees=placed.fov_degrees)
