"""``lightwell render --method igi``: a picture by virtual point lights."""

from __future__ import annotations

import json as json_module
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

import typer

from lightwell_server.cli.output import progress_bar, quiet_libraries

if TYPE_CHECKING:
    from lightwell.scene_settings import SceneSettings


def render_by_lights(
    settings: SceneSettings,
    scene: Path,
    out: list[Path],
    server: str,
    token: str | None,
    json: bool,
) -> None:
    """Render a scene whose method is igi, write pictures, print a summary.

    Raises
    ------
    LightwellError
        Where the scene or what it names cannot be used.
    """
    from lightwell.igi import render_igi
    from lightwell.io.igi_renders import write_igi_rendering
    from lightwell.io.igi_scenes import load_igi_scene, meter
    from lightwell_client.rendering import ServerSources

    pixels = settings.picture.width, settings.picture.height
    with ServerSources(server, token) as sources, quiet_libraries():
        loaded = load_igi_scene(settings, scene.parent, sources, where=str(scene))
    for remark in loaded.remarks:
        typer.echo(f"lightwell: {remark}", err=True)
    started = time.monotonic()
    with _interruptible() as check, progress_bar("rendering") as report:
        rendering = render_igi(
            loaded.scene, loaded.camera, pixels, loaded.settings, report, check, samples=loaded.samples
        )
    seconds = time.monotonic() - started
    exposure = meter(rendering.shown(loaded.has_backdrop)) if settings.picture.ev is None else settings.picture.ev
    mapped = settings.picture.tone_mapping == "neutral"
    for path in out:
        write_igi_rendering(path, rendering, exposure, tone_mapping=mapped, backdrop=loaded.has_backdrop)
    summary = {
        "out": [{"path": str(path), "bytes": path.stat().st_size} for path in out],
        "method": "igi",
        "width": pixels[0],
        "height": pixels[1],
        "samples": loaded.samples,
        "seconds": round(seconds, 3),
        "ev": exposure,
        "sets": list(loaded.settings.sets),
        "vpls": loaded.settings.vpls,
        "bands": loaded.settings.bands,
        "objects": len(loaded.scene.objects),
        "lamps": len(loaded.scene.lamps),
        "triangles": sum(len(item.mesh.triangles) for item in loaded.scene.objects),
        "rays": rendering.rays,
        "clamp_bias": rendering.clamp_bias,
        "coverage": float(rendering.coverage.mean()),
        "mean": [float(value) for value in rendering.colour.reshape(-1, 3).mean(axis=0)],
        "remarks": list(loaded.remarks),
    }
    if json:
        print(json_module.dumps(summary))
        return
    for path in out:
        print(path)
    typer.echo(
        f"{pixels[0]}×{pixels[1]}, {loaded.settings.vpls} virtual lights, {summary['triangles']} triangles, "
        f"{seconds:.1f} s, exposure {exposure:+.2f} EV, the clamp took {100 * rendering.clamp_bias:.1f} % of the light",
        err=True,
    )


@contextmanager
def _interruptible() -> Iterator[Callable[[], None]]:
    """Give a check that ends work in other threads soon after Ctrl-C, which else would wait for them."""
    stopped = threading.Event()

    def stop(number: int, frame: FrameType | None) -> None:
        stopped.set()
        signal.default_int_handler(number, frame)

    def check() -> None:
        if stopped.is_set():
            raise InterruptedError("stopped")

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield check
    finally:
        signal.signal(signal.SIGINT, before)
