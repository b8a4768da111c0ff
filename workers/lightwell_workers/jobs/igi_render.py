"""``igi-render``: pictures and films by virtual point lights (paper 004).

prepare (read and check the scene, plan) → coarse (a first picture of few pixels) → render (tiles of the pictures, each
a file; a picture is written when it has all) → write (film, report).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec

from lightwell.errors import RenderError
from lightwell.igi.gbuffer import require_outside
from lightwell.igi.surfaces import Surfaces
from lightwell.io.files import write_atomically
from lightwell.job_settings import IgiRenderSettings
from lightwell_workers.jobs.compute import InlineCompute
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.igi_finish import counted_path, finish_frames, write_results
from lightwell_workers.jobs.igi_light import Shown, assign, read_sky, recording_of
from lightwell_workers.jobs.igi_plan import Plan, Shot, estimate, read_plan, tile_seconds, tile_side
from lightwell_workers.jobs.igi_preview import Preview
from lightwell_workers.jobs.igi_scene import cameras_of, frame_count, load
from lightwell_workers.jobs.igi_tasks import (
    forget,
    load_tile,
    plan_path,
    render_coarse,
    render_tile,
    save_scene,
    tile_path,
)
from lightwell_workers.jobs.kind import Estimate, JobError, Step


class IgiRender:
    """The kind."""

    def estimate(self, settings: IgiRenderSettings, roots: Sequence[Path] | None = None) -> Estimate:
        """Return what the job needs; raises `LightwellError` where the scene cannot be used."""
        return estimate(settings, roots)

    def prepare(self, settings: IgiRenderSettings, context: JobContext) -> None:
        """Read the scene and its light, look whether all cameras stand where something is seen, and plan."""
        context.progress("prepare", 0, 1)
        recording = recording_of(settings.light)
        count = frame_count(settings, context.roots)
        lights: list[Shown | None] = [None] * count
        first = None
        if recording is not None:
            lights[:] = assign(settings, recording, count, context)
            assert lights[0] is not None
            first = read_sky(settings.light, lights[0], context.work, context.check)
        context.check()
        loaded = load(settings, context.directory.path.parent, context.roots, first)
        remarks = [*(recording.remarks if recording is not None else ()), *loaded.remarks]
        for remark in remarks:
            context.log(remark, level="warning")
        context.check()
        cameras = cameras_of(settings.camera, loaded.camera, count)
        surfaces = Surfaces(loaded.scene)
        for frame, camera in enumerate(cameras):
            if frame and camera == cameras[frame - 1]:
                continue
            context.check()
            try:
                require_outside(surfaces, camera)
            except RenderError as error:
                raise JobError(f"{error}" if count == 1 else f"picture {frame}: {error}") from None
        igi, lamps = loaded.settings, len(loaded.scene.lamps)
        side = tile_side(igi, lamps, loaded.samples)
        plan = Plan(
            loaded.picture.width,
            loaded.picture.height,
            side,
            max(
                1,
                round(context.processes * settings.checkpoint_seconds / tile_seconds(igi, lamps, loaded.samples, side)),
            ),
            [
                Shot(camera.position, camera.target, camera.up, camera.fov_degrees, light)
                for camera, light in zip(cameras, lights, strict=True)
            ],
            loaded.samples,
            igi.model_dump_json(),
            settings.light.model_dump_json(include={"mapping", "gain", "video"}),
            loaded.has_backdrop,
            loaded.picture.ev,
            loaded.picture.tone_mapping == "neutral",
            remarks,
        )
        scene = replace(loaded.scene, sky=None) if recording is not None else loaded.scene
        save_scene(context.work, scene)
        triangles = sum(len(item.mesh.triangles) for item in scene.objects)
        context.log("prepared", objects=len(scene.objects), triangles=triangles, lamps=lamps, pictures=count)
        write_atomically(plan_path(context.work), msgspec.json.encode(plan))
        context.progress("prepare", 1, 1)

    def steps(self, settings: IgiRenderSettings, context: JobContext) -> list[Step]:
        """Return the coarse picture, the tiles in groups, and the writing."""
        plan = read_plan(plan_path(context.work))
        groups = [
            Step(f"render {first}", partial(_render, plan, first, min(first + plan.together, plan.total)))
            for first in range(0, plan.total, plan.together)
        ]
        return [Step("coarse", partial(_coarse, plan)), *groups, Step("write", partial(write_results, settings, plan))]


def _coarse(plan: Plan, context: JobContext) -> None:
    context.progress("coarse", 0, 1)
    path = context.work / "coarse.npz"
    if not path.exists():
        # Here, where the scene has just been read: processes for the tiles may take seconds to start.
        for _ in InlineCompute().map(
            render_coarse, [(context.directory.cancel, str(context.work), str(path))], context.check
        ):
            pass
        if context.processes > 1:
            forget()
    Preview(plan, context).lay(load_tile(path).shown(plan.backdrop))
    context.progress("coarse", 1, 1)


def _render(plan: Plan, first: int, last: int, context: JobContext) -> None:
    """Render tiles ``first`` … ``last − 1`` of all pictures, and write the pictures that have all of theirs."""
    tiles = plan.tiles
    wanted = [divmod(index, len(tiles)) for index in range(first, last)]
    missing = [
        (frame, tile)
        for frame, tile in wanted
        if not counted_path(context.work, frame).exists() and not tile_path(context.work, frame, tile).exists()
    ]
    preview = Preview(plan, context)
    done = last - len(missing)
    context.progress("render", done, plan.total)
    results = context.map(render_tile, [(str(context.work), frame, tile) for frame, tile in missing])
    for (frame, tile), _ in zip(missing, results, strict=True):
        done += 1
        preview.put(tiles[tile], tile_path(context.work, frame, tile))
        context.progress("render", done, plan.total)
    preview.draw()
    finish_frames(plan, range(first // len(tiles), last // len(tiles)), context)
