"""The tasks of an ``igi-render`` job: what runs on the compute processes. They exchange data through files."""

from __future__ import annotations

import os
import pickle
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.render import IgiRenderer
from lightwell.igi.rendering import LAYERS, IgiRendering, Tile
from lightwell.igi.scene import IgiScene
from lightwell.igi.surfaces import Surfaces
from lightwell.igi_settings import IgiSettings
from lightwell.job_settings import IgiLightSettings
from lightwell_workers.jobs.context import stop_if_cancelled
from lightwell_workers.jobs.igi_light import Shown, read_sky
from lightwell_workers.jobs.igi_plan import Plan, read_plan

COUNTS = ("arrived", "clamped", "rays")
COARSE_SETS, COARSE_VPLS = (4, 4), 1024
"""Of the first picture, which is to be there at once whatever the job asks for."""


def plan_path(work: Path) -> Path:
    """Return where a job's plan lies."""
    return work / "plan.json"


def scene_path(work: Path) -> Path:
    """Return where its scene lies, as it was when the job was prepared."""
    return work / "scene.pickle"


def tile_path(work: Path, frame: int, tile: int) -> Path:
    """Return where a tile lies."""
    return work / f"tile-{frame:05d}-{tile:05d}.npz"


def save_scene(work: Path, scene: IgiScene) -> None:
    """Keep a scene for the tasks: its files may change while they work."""
    path = scene_path(work)
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with unfinished.open("wb") as file:
            pickle.dump(scene, file, protocol=pickle.HIGHEST_PROTOCOL)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def save_tile(path: Path, rendering: IgiRendering) -> None:
    """Write a tile; the file appears whole or not at all."""
    arrays: dict[str, NDArray[Any]] = {
        name: getattr(rendering, name) for name in LAYERS if getattr(rendering, name) is not None
    }
    arrays |= {name: np.array(getattr(rendering, name)) for name in COUNTS}
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with unfinished.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def load_tile(path: Path) -> IgiRendering:
    """Read what `save_tile` wrote."""
    with np.load(path) as file:
        layers: dict[str, Any] = {name: file.get(name) for name in LAYERS}
        return IgiRendering(
            **layers, arrived=float(file["arrived"]), clamped=float(file["clamped"]), rays=int(file["rays"])
        )


def render_tile(cancel: Path, work: str, frame: int, tile: int) -> float:
    """Render and write one tile; return the light in it, W m⁻² sr⁻¹ summed."""
    plan, stamp = _plan(work)
    shot = plan.shots[frame]
    stop = partial(stop_if_cancelled, cancel)
    stop()
    renderer = _renderer(cancel, work, stamp, shot.light)
    stop()
    rendering = renderer.tile(shot.camera, plan.size, plan.tiles[tile], stop, plan.samples)
    save_tile(tile_path(Path(work), frame, tile), rendering)
    return float(rendering.colour.sum(dtype=np.float64))


def render_coarse(cancel: Path, work: str, out: str) -> None:
    """Write the first picture with few pixels and lights: what is to be expected, long before it is there."""
    plan, stamp = _plan(work)
    width, height = plan.coarse
    renderer = _renderer(cancel, work, stamp, plan.shots[0].light, coarse=True)
    rendering = renderer.tile(
        plan.shots[0].camera, (width, height), Tile(0, height, 0, width), partial(stop_if_cancelled, cancel)
    )
    save_tile(Path(out), rendering)


def plan_of(work: str) -> Plan:
    """Return a job's plan."""
    return _plan(work)[0]


def _plan(work: str) -> tuple[Plan, int]:
    path = plan_path(Path(work))
    stamp = path.stat().st_mtime_ns
    return _read_plan(path, stamp), stamp


@lru_cache(maxsize=2)
def _read_plan(path: Path, stamp: int) -> Plan:
    del stamp  # tells apart what may lie at the path one after the other
    return read_plan(path)


def forget() -> None:
    """Let go of scenes: other processes go on with them."""
    _renderer.cache_clear()
    _opened.cache_clear()


@lru_cache(maxsize=1)
def _opened(work: str, stamp: int) -> tuple[IgiScene, Surfaces]:
    del stamp
    with scene_path(Path(work)).open("rb") as file:
        scene: IgiScene = pickle.load(file)  # noqa: S301 (the job wrote it itself)
    return scene, Surfaces(scene)


@lru_cache(maxsize=2)
def _renderer(cancel: Path, work: str, stamp: int, light: Shown | None, coarse: bool = False) -> IgiRenderer:
    """Return the scene with its virtual lights, for all tiles of pictures in that light."""
    plan, _ = _plan(work)
    scene, surfaces = _opened(work, stamp)
    if light is not None:
        sky = read_sky(
            IgiLightSettings.model_validate_json(plan.light), light, Path(work), partial(stop_if_cancelled, cancel)
        )
        scene = IgiScene(scene.objects, scene.lamps, sky, scene.field)
    igi = IgiSettings.model_validate_json(plan.igi)
    if coarse:
        igi = igi.model_copy(update={"sets": COARSE_SETS, "vpls": min(igi.vpls, COARSE_VPLS), "layers": ()})
    return IgiRenderer(scene, igi, surfaces)
