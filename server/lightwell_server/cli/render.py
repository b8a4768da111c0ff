"""``lightwell render``: a picture of a scene file."""

from __future__ import annotations

import json as json_module
import time
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import typer

from lightwell_server.cli.connection import JSON, SERVER, TOKEN
from lightwell_server.cli.output import progress_bar, quiet_libraries
from lightwell_server.cli.render_igi import render_by_lights

if TYPE_CHECKING:
    from lightwell.io.scenes import LoadedScene
    from lightwell.scene_settings import SceneSettings


class Method(StrEnum):
    """How a picture is made."""

    harmonics = "harmonics"
    igi = "igi"


def render(
    scene: Path = typer.Argument(help="Scene file, TOML (docs/render.md), or with igi also .glb or .gltf."),
    out: list[Path] = typer.Option(..., "--out", "-o", help="Picture, .exr or .png; may be repeated."),
    method: Method | None = typer.Option(
        None, help="harmonics: as the web page. igi: virtual point lights, slower, with light that surfaces reflect."
    ),
    size: str | None = typer.Option(None, metavar="WxH", help="Pixels, such as 640x480, in place of the scene's own."),
    samples: int | None = typer.Option(None, min=1, max=16, help="N: a pixel is the mean of N² rays."),
    light: Path | None = typer.Option(
        None,
        help="Picture (.exr, .hdr), JSON of coefficients or a recording (a video, lines of watch --json, a folder of"
        " pictures), in place of the scene's own light.",
    ),
    frame: int | None = typer.Option(
        None, help="Which frame of the recording, from 0, or from the end where negative; lines: the last by default."
    ),
    stream: str | None = typer.Option(
        None, help="Stream of the server: its newest frame is the light; of recorded lines: which stream."
    ),
    sets: str | None = typer.Option(None, metavar="NxM", help="igi: sets of virtual lights, interleaved so."),
    vpls: int | None = typer.Option(None, min=1, help="igi: virtual lights, all sets together."),
    coefficients: bool = typer.Option(False, "--coefficients", help="igi: also write incident radiance to the EXR."),
    ev: float | None = typer.Option(None, min=-64, max=64, help="Exposure of a PNG, EV, in place of the scene's own."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Render SCENE: objects lit by a probe, by a stream's last frame or by a grid, with igi also by lamps."""
    from lightwell.io.renders import require_format
    from lightwell.io.scenes import read_scene_settings

    for path in out:
        require_format(path)
    width, height = (None, None) if size is None else _size(size)
    igi = _given(sets=sets, vpls=vpls)
    changes = _given(method=method and method.value, igi=igi)
    changes["picture"] = _given(width=width, height=height, samples=samples, ev=ev)
    lit_by = _given(file=light and light.resolve(), stream=stream, frame=frame)
    if light is None and stream is None and lit_by:
        # Of the scene's own recording.
        changes["light"], lit_by = lit_by, {}
    settings = read_scene_settings(scene, changes, lit_by or None)
    if settings.method == "igi":
        if coefficients:
            layers = tuple(dict.fromkeys((*settings.igi.layers, "coefficients")))
            settings = settings.model_copy(update={"igi": settings.igi.model_copy(update={"layers": layers})})
        render_by_lights(settings, scene, out, server, token, json)
        return
    if igi or coefficients:
        _refuse("--sets, --vpls and --coefficients", "add --method igi")
    _render_by_harmonics(settings, scene, out, server, token, json)


def _given(**values: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return those options that are given."""
    return {name: value for name, value in values.items() if value is not None}


def _render_by_harmonics(
    settings: SceneSettings,
    scene: Path,
    out: list[Path],
    server: str,
    token: str | None,
    json: bool,
) -> None:
    from lightwell.io.renders import write_rendering
    from lightwell.io.scenes import add_shadows, load_scene
    from lightwell.render import render as render_scene
    from lightwell_client.rendering import ServerSources

    pixels = settings.picture.width, settings.picture.height
    with ServerSources(server, token) as sources, quiet_libraries():
        loaded = load_scene(settings, scene.parent, sources, where=str(scene), shadows=False)
    rays = settings.picture.samples
    started = time.monotonic()
    if settings.shadows.mode != "none":
        with progress_bar("shadows"):
            loaded = add_shadows(loaded, settings.shadows)
    with progress_bar("rendering") as report:
        rendering = render_scene(loaded.scene, loaded.camera, pixels, rays, report)
    seconds = time.monotonic() - started
    for path in out:
        write_rendering(path, rendering, loaded.ev, tone_mapping=settings.picture.tone_mapping == "neutral")
    summary = {
        "out": [{"path": str(path), "bytes": path.stat().st_size} for path in out],
        "width": pixels[0],
        "height": pixels[1],
        "samples": rays,
        "seconds": round(seconds, 3),
        "ev": loaded.ev,
        "bands": loaded.scene.light.bands,
        "objects": len(loaded.scene.objects),
        "triangles": _triangles(loaded),
        "coverage": float(rendering.coverage.mean()),
        "mean": [float(value) for value in rendering.colour.reshape(-1, 3).mean(axis=0)],
    }
    if json:
        print(json_module.dumps(summary))
        return
    for path in out:
        print(path)
    typer.echo(
        f"{pixels[0]}×{pixels[1]}, {rays}² rays a pixel, {summary['triangles']} triangles, {seconds:.1f} s, "
        f"exposure {loaded.ev:+.2f} EV",
        err=True,
    )


def _refuse(option: str, remedy: str) -> NoReturn:
    from lightwell.errors import LightwellError

    raise LightwellError(f"{option}: {remedy}")


def _triangles(loaded: LoadedScene) -> int:
    return sum(len(item.mesh.triangles) for item in loaded.scene.objects)


def _size(text: str) -> tuple[int, int]:
    from lightwell.errors import LightwellError
    from lightwell.scene_settings import MAX_PIXELS, MAX_SIDE

    try:
        width, height = (int(part) for part in text.lower().replace("×", "x").split("x"))
    except ValueError:
        raise LightwellError(f"--size: {text!r}: must be width and height in pixels, such as 640x480") from None
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise LightwellError(f"--size: {text!r}: must lie between 1x1 and {MAX_SIDE}x{MAX_SIDE}")
    if width * height > MAX_PIXELS:
        raise LightwellError(f"--size: {text!r}: must have at most {MAX_PIXELS} pixels")
    return width, height
