"""``prt-transfer``: how each vertex of meshes answers to light (paper 003 §3.7).

prepare (read the meshes; take an earlier job's result where there is one) → compile (kernels, once) → trace (rays of
the vertices, part by part) → bounce (once for each, from the hits of the first rays) → write.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from lightwell.geometry.mesh import Float32s
from lightwell.io.files import write_atomically
from lightwell.job_settings import PrtTransferSettings
from lightwell.transfer.bounces import fill_hidden, reflected
from lightwell.transfer.compute import channels_of
from lightwell.transfer.surface import is_far_away, merge
from lightwell.transfer.visibility import SEEN, error_of_halves, unshadowed
from lightwell_workers.jobs import prt_cache
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.kind import Estimate, Step
from lightwell_workers.jobs.prt_finish import write_results
from lightwell_workers.jobs.prt_plan import Part, Plan, digest_of, estimate, load_scene, make_parts, read_plan
from lightwell_workers.jobs.prt_tasks import (
    bounce_part,
    compile_kernels,
    load_meshes_of,
    load_sums,
    save_scene,
    trace_part,
)

WORTH_SAYING_SECONDS = 2.0


class PrtTransfer:
    """The kind."""

    def estimate(self, settings: PrtTransferSettings, roots: Sequence[Path] | None = None) -> Estimate:
        """Return what the job needs; raises `LightwellError` where the mesh cannot be used."""
        del roots  # no file of its settings names others elsewhere
        return estimate(settings)

    def prepare(self, settings: PrtTransferSettings, context: JobContext) -> None:
        """Read the meshes, and take an earlier job's result or plan the work."""
        context.progress("prepare", 0, 1)
        meshes = load_scene(settings, context.check)
        digest = digest_of(settings, meshes)
        context.check()
        objects = len(meshes) - (1 if settings.ground else 0)
        vertices = sum(len(mesh.positions) for mesh in meshes)
        parts, together = make_parts(settings, vertices, context.processes)
        plan = Plan(digest, objects, vertices, channels_of(meshes, settings.mode), parts, together)
        if settings.reuse:
            plan.reused = prt_cache.take(context.directory.path.parent, digest, context.results)
        for mesh in meshes:
            if is_far_away(mesh):
                context.log(
                    f"{mesh.name!r} is small and far from the origin, where numbers of 32 bits are"
                    f" {float(np.spacing(np.abs(mesh.positions).max())):.2g} m apart: its shadows will be rough;"
                    " move it to the origin in a modelling program",
                    level="warning",
                )
        if plan.reused is None:
            save_scene(_scene(context), meshes)
            triangles = sum(len(mesh.triangles) for mesh in meshes)
            context.log("prepared", meshes=len(meshes), vertices=vertices, triangles=triangles, parts=len(parts))
        else:
            context.log("the result of an earlier job is taken", job=plan.reused, digest=digest)
        write_atomically(_plan(context), msgspec.json.encode(plan))
        context.progress("prepare", 1, 1)

    def steps(self, settings: PrtTransferSettings, context: JobContext) -> list[Step]:
        """Return tracing in groups of parts, each bounce, and the writing; nothing but a note where all is there."""
        plan = read_plan(_plan(context))
        if plan.reused is not None:
            return [Step("reuse", partial(_remember, plan))]
        steps = []
        if settings.mode != "unshadowed":
            groups = [plan.parts[first : first + plan.together] for first in range(0, len(plan.parts), plan.together)]
            steps += [Step(f"trace {group[0].first}", partial(_trace, settings, plan, group)) for group in groups]
        if settings.mode == "interreflected":
            steps += [Step(f"bounce {b}", partial(_bounce, settings, plan, b)) for b in range(1, settings.bounces + 1)]
        return [*steps, Step("write", partial(_write, settings, plan))]


def _plan(context: JobContext) -> Path:
    return context.work / "plan.json"


def _scene(context: JobContext) -> Path:
    return context.work / "scene.npz"


def _direct(context: JobContext, part: Part) -> Path:
    return context.work / f"direct-{part.first:08d}.npz"


def _bounced(context: JobContext, bounce: int) -> Path:
    return context.work / f"bounce-{bounce}.npy"


def _remember(plan: Plan, context: JobContext) -> None:
    prt_cache.remember(context.directory.path.parent, plan.digest, context.id)


def _trace(settings: PrtTransferSettings, plan: Plan, group: list[Part], context: JobContext) -> None:
    if group[0].first == 0:
        _compile(settings, context)
    context.progress("trace", group[0].first, plan.vertices)
    missing = [part for part in group if not _direct(context, part).exists()]
    document, keep = settings.model_dump_json(), settings.mode == "interreflected"
    items = [
        (document, plan.digest, str(_scene(context)), str(_direct(context, part)), part.first, part.last, keep)
        for part in missing
    ]
    done = group[0].first + sum(part.last - part.first for part in group if part not in missing)
    rays, seconds = 0, 0.0
    for part, (more_rays, more_seconds) in zip(missing, context.map(trace_part, items), strict=True):
        rays, seconds = rays + more_rays, seconds + more_seconds
        done += part.last - part.first
        context.progress("trace", done, plan.vertices)
    context.log("traced", rays=rays, core_seconds=round(seconds, 3))


def _compile(settings: PrtTransferSettings, context: JobContext) -> None:
    """Have the kernels compiled, so that it is said what takes so long on a fresh installation."""
    total = context.processes
    context.progress("compile", 0, total)
    items = [(settings.model_dump_json(),)] * total
    seconds = 0.0
    for done, took in enumerate(context.map(compile_kernels, items), 1):
        seconds = max(seconds, took)
        context.progress("compile", done, total)
    if seconds > WORTH_SAYING_SECONDS:
        context.log("kernels compiled", seconds=round(seconds, 1))


def _load_direct_sums(plan: Plan, context: JobContext) -> tuple[Float32s, Float32s, Any]:
    """Return the direct transfer ``(V, bands²)``, its estimated error and the state of all vertices."""
    sums, errors, states = [], [], []
    for part in plan.parts:
        context.check()
        halves, state = load_sums(_direct(context, part))
        sums.append(halves.sum(axis=1))
        errors.append(error_of_halves(halves, round(halves.shape[2] ** 0.5)))
        states.append(state)
    return np.concatenate(sums), np.concatenate(errors), np.concatenate(states)


def _bounce(settings: PrtTransferSettings, plan: Plan, bounce: int, context: JobContext) -> None:
    """Make the bounce from the one before; each is kept, with what is hidden filled in."""
    if _bounced(context, bounce).exists():
        return
    total = len(plan.parts)
    stage = f"bounce {bounce} of {settings.bounces}"
    context.progress(stage, 0, total)
    scene = merge(load_meshes_of(_scene(context)))
    sums, _, state = _load_direct_sums(plan, context)
    if bounce == 1:
        before = np.repeat(fill_hidden(sums, state, scene.triangles)[:, :, None], plan.channels, axis=2)
    else:
        before = np.load(_bounced(context, bounce - 1))
    source = context.work / f"source-{bounce}.npy"
    _save(source, reflected(before, scene.albedo[:, : plan.channels]))
    outs = [context.work / f"bounce-{bounce}-{part.first:08d}.npz" for part in plan.parts]
    items = [
        (str(_scene(context)), str(_direct(context, part)), str(source), str(out))
        for part, out in zip(plan.parts, outs, strict=True)
        if not out.exists()
    ]
    for done, _ in enumerate(context.map(bounce_part, items), 1):
        context.progress(stage, total - len(items) + done, total)
    rows = []
    for out in outs:
        with np.load(out) as file:
            rows.append(file["bounce"])
    _save(_bounced(context, bounce), fill_hidden(np.concatenate(rows), state, scene.triangles))
    for path in (*outs, source):
        path.unlink()


def _save(path: Path, array: Float32s) -> None:
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with unfinished.open("wb") as file:
            np.save(file, array)
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def _write(settings: PrtTransferSettings, plan: Plan, context: JobContext) -> None:
    context.progress("write", 0, 1)
    meshes = load_meshes_of(_scene(context))
    scene = merge(meshes)
    if settings.mode == "unshadowed":
        transfer = unshadowed(scene.normals, settings.bands)[:, :, None]
        error, state = np.zeros(plan.vertices, np.float32), np.full(plan.vertices, SEEN, np.uint8)
    else:
        sums, error, state = _load_direct_sums(plan, context)
        transfer = np.repeat(fill_hidden(sums, state, scene.triangles)[:, :, None], plan.channels, axis=2)
    if settings.mode == "interreflected":
        for bounce in range(1, settings.bounces + 1):
            transfer = transfer + np.load(_bounced(context, bounce))
    write_results(settings, plan, meshes, transfer, error, state, context)
    prt_cache.remember(context.directory.path.parent, plan.digest, context.id)
