"""Rendering a scene file in Python, with light from a server.

The rest of this package is small; this module imports the core's renderer (Embree, numba) when it is called.
"""

from __future__ import annotations

import contextlib
import tempfile
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import Convention
from lightwell.errors import LightwellError
from lightwell_client.errors import ProblemError
from lightwell_client.follow import DEFAULT_SERVER
from lightwell_client.rest import Lightwell

if TYPE_CHECKING:
    from lightwell.field.adaptive import AnyGrid
    from lightwell.igi import IgiRendering
    from lightwell.io.scenes import Probe
    from lightwell.render import Rendering
    from lightwell.scene_settings import SceneSettings


@runtime_checkable
class _Light(Protocol):
    """A `LightFrame`, or what `Lightwell.latest` returns."""

    @property
    def coefficients(self) -> NDArray[np.float32]: ...

    @property
    def convention(self) -> Convention: ...


def render(
    scene: str | Path | Mapping[str, Any],
    *,
    light: _Light | ArrayLike | None = None,
    size: tuple[int, int] | None = None,
    samples: int | None = None,
    out: str | Path | None = None,
    server: str = DEFAULT_SERVER,
    token: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Rendering:
    """Render a scene, as ``lightwell render`` does.

    ::

        from lightwell_client import LightStream, render

        with LightStream("probe") as stream:
            picture = render("scene.toml", light=stream.next(timeout=5), size=(320, 240), out="now.png")
        picture.colour  # (240, 320, 3) float32, linear radiance

    Parameters
    ----------
    scene
        A scene file (TOML), or what would stand in one; paths are relative to it, or to the working directory.
    light
        In place of the scene's own: a frame of a stream, or coefficients ``(bands², 3)`` in Lightwell's convention.
    size, samples
        Width and height in pixels and rays along each side of a pixel, in place of the scene's own.
    out
        Also write it: ``.exr`` or ``.png``.
    server, token
        Where streams, grids and transfers that the scene names come from.
    progress
        Called with the rows that are done and how many there are.

    Raises
    ------
    LightwellError
        Where the scene or what it names cannot be used; names the file, the field and the remedy.
    """
    from lightwell.io.renders import require_format, write_rendering
    from lightwell.io.scenes import load_scene
    from lightwell.render import render as render_scene

    if out is not None:
        require_format(Path(out))
    settings, folder, where = _settings(scene, size, samples)
    with ServerSources(server, token) as sources:
        loaded = load_scene(settings, folder, sources, where=where, light=None if light is None else _radiance(light))
    picture = loaded.picture
    rendering = render_scene(
        loaded.scene,
        loaded.camera,
        (picture.width, picture.height),
        picture.samples,
        progress,
    )
    if out is not None:
        write_rendering(Path(out), rendering, loaded.ev, tone_mapping=picture.tone_mapping == "neutral")
    return rendering


def render_igi(
    scene: str | Path | Mapping[str, Any],
    *,
    light: _Light | ArrayLike | None = None,
    size: tuple[int, int] | None = None,
    samples: int | None = None,
    out: str | Path | None = None,
    server: str = DEFAULT_SERVER,
    token: str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> IgiRendering:
    """Render a scene by virtual point lights, as ``lightwell render --method igi`` does.

    Parameters and errors as of `render`, but ``scene`` may also be a glTF file, ``progress`` is called with tiles, and
    what the picture will not show is a warning.
    """
    from lightwell.igi import render_igi as render_lights
    from lightwell.io.igi_renders import write_igi_rendering
    from lightwell.io.igi_scenes import load_igi_scene, meter
    from lightwell.io.renders import require_format

    if out is not None:
        require_format(Path(out))
    settings, folder, where = _settings(scene, size, samples, method="igi")
    given = None if light is None else _radiance(light)
    with ServerSources(server, token) as sources:
        loaded = load_igi_scene(settings, folder, sources, where=where, light=given)
    for remark in loaded.remarks:
        warnings.warn(remark, stacklevel=2)
    picture = loaded.picture
    rendering = render_lights(
        loaded.scene,
        loaded.camera,
        (picture.width, picture.height),
        loaded.settings,
        progress,
        samples=loaded.samples,
    )
    if out is not None:
        ev = meter(rendering.shown(loaded.has_backdrop)) if picture.ev is None else picture.ev
        mapped = picture.tone_mapping == "neutral"
        write_igi_rendering(Path(out), rendering, ev, tone_mapping=mapped, backdrop=loaded.has_backdrop)
    return rendering


def _settings(
    scene: str | Path | Mapping[str, Any], size: tuple[int, int] | None, samples: int | None, **changes: str
) -> tuple[SceneSettings, Path, str]:
    """Return what a scene says, where its paths begin, and its name in errors."""
    from lightwell.io.scenes import read_scene_settings, scene_settings

    picture = {} if size is None else {"width": size[0], "height": size[1]}
    if samples is not None:
        picture["samples"] = samples
    found = {"picture": picture, **changes}
    if isinstance(scene, Mapping):
        return scene_settings(scene, changes=found), Path(), "scene"
    return read_scene_settings(Path(scene), found), Path(scene).parent, str(scene)


class ServerSources:
    """What scenes take from a server: `lightwell.io.scenes.Server`. Connects when it is asked for something."""

    def __init__(self, server: str = DEFAULT_SERVER, token: str | None = None) -> None:
        self._server = server
        self._token = token
        self._folders: list[tempfile.TemporaryDirectory[str]] = []

    def __enter__(self) -> ServerSources:
        return self

    def __exit__(self, *_: object) -> None:
        for folder in self._folders:
            folder.cleanup()

    def stream(self, name: str) -> NDArray[np.float64]:
        """Return the newest coefficients of a stream, ``(bands², 3)``."""
        with self._connect() as client:
            return client.latest(name).coefficients.astype(np.float64)

    def position(self, name: str) -> tuple[float, float, float] | None:
        """Return where a stream's probe stands, metres; None: nobody has said."""
        with self._connect() as client:
            with contextlib.suppress(ProblemError):  # no frame yet
                if (known := client.latest(name).position) is not None:
                    return known
            found = client.stream(name).settings.get("position_m")
        return None if found is None else (float(found[0]), float(found[1]), float(found[2]))

    def probe(self, name: str) -> Probe:
        """Return the newest frame of a stream with its gradients."""
        from lightwell.io.scenes import Probe

        with self._connect() as client:
            latest = client.latest(name, gradients=True)
        gradients = None if latest.gradients is None else latest.gradients.astype(np.float64)
        place = latest.position or self.position(name)
        return Probe(name, latest.coefficients.astype(np.float64), gradients, place)

    def field(self, name: str) -> list[Probe]:
        """Return the newest frames of those streams of a field that give light now; at least one, with positions."""
        with self._connect() as client:
            members = client.field(name).members
        found = [self.probe(member.stream) for member in members if member.used]
        if not found:
            reasons = "; ".join(f"{member.stream}: {member.problem}" for member in members)
            raise LightwellError(f"no stream of the field {name!r} gives light now: {reasons}")
        return found

    def grid(self, grid: str) -> AnyGrid:
        """Return a finished grid, read into memory."""
        from lightwell.io.grids import open_grid

        place = self._folder() / "grid.zarr"
        with self._connect() as client:
            client.download(grid, place)
        return open_grid(place)

    def transfer(self, job: str) -> Path:
        """Return a folder with the results of a prt-transfer job; it stays until this is closed."""
        folder = self._folder()
        with self._connect() as client:
            found = client.job(job)
            if found.state != "succeeded":
                raise LightwellError(f"job {job} is {found.state}: wait for it, or name another")
            for artifact in found.artifacts:
                place = folder / artifact.path
                place.parent.mkdir(parents=True, exist_ok=True)
                client.download(artifact.id, place)
        return folder

    def _connect(self) -> Lightwell:
        try:
            return Lightwell(self._server, token=self._token)
        except ValueError as error:
            raise LightwellError(f"server {self._server!r}: {error}") from None

    def _folder(self) -> Path:
        folder = tempfile.TemporaryDirectory(prefix="lightwell-")
        self._folders.append(folder)
        return Path(folder.name)


def _radiance(light: _Light | ArrayLike) -> NDArray[np.float64]:
    """Return coefficients in Lightwell's own convention."""
    from lightwell.sh.engines import convert

    if isinstance(light, _Light):
        return convert(light.coefficients, "lightwell", light.convention)
    return np.asarray(light, dtype=np.float64)
