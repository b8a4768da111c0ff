"""The results of an ``igi-render`` job: pictures of their tiles, the film, the report."""

from __future__ import annotations

import errno
import json
import math
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import msgspec
import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import LUMINANCE
from lightwell.errors import RenderError
from lightwell.igi.rendering import IgiRendering, Tile, assemble
from lightwell.igi_settings import IgiSettings
from lightwell.io.files import write_atomically
from lightwell.io.films import write_film
from lightwell.io.igi_renders import write_igi_rendering
from lightwell.io.igi_scenes import KEY, meter
from lightwell.io.preview import encode_png
from lightwell.job_settings import IgiRenderSettings
from lightwell_workers.jobs.context import JobContext, stop_if_cancelled
from lightwell_workers.jobs.igi_plan import Plan, exposure_path, known_exposure
from lightwell_workers.jobs.igi_tasks import load_tile, plan_of, tile_path
from lightwell_workers.jobs.kind import JobError

PREVIEW_SIDE = 1024
WIDE_EV = 4.0
"""Pictures that are so much brighter than the one that was metered are all but white."""


class Counted(msgspec.Struct):
    """What is known of a picture that has been written."""

    arrived: float
    clamped: float
    rays: int
    mean: list[float]
    """Linear red, green and blue of its pixels."""
    coverage: float


def frame_files(plan: Plan, results: Path, frame: int) -> tuple[Path, Path]:
    """Return where a picture goes: EXR and PNG, which are two artefacts, or lie in a folder with all others."""
    if len(plan.shots) == 1:
        return results / "layers.exr", results / "picture.png"
    return results / "frames" / f"{frame:05d}.exr", results / "frames" / f"{frame:05d}.png"


def counted_path(work: Path, frame: int) -> Path:
    """Return the file that is there when a picture has been written."""
    return work / f"frame-{frame:05d}.json"


def finish_frames(plan: Plan, frames: Sequence[int], context: JobContext) -> None:
    """Write pictures of their tiles, which are forgotten then; the first one also meters the exposure of all."""
    missing = [frame for frame in frames if not counted_path(context.work, frame).exists()]
    for some in (missing[:1], missing[1:]) if 0 in missing else (missing,):
        for _ in context.map(write_frame, [(str(context.work), str(context.results), frame) for frame in some]):
            pass
    for frame in frames:
        for index in range(len(plan.tiles)):
            tile_path(context.work, frame, index).unlink(missing_ok=True)


def write_frame(cancel: Path, work: str, results: str, frame: int) -> None:
    """Write one picture. A task: it takes seconds where the picture is large, and a cancelled job ends before it."""
    plan, place = plan_of(work), Path(work)

    def parts() -> Iterator[tuple[Tile, IgiRendering]]:
        for index, tile in enumerate(plan.tiles):
            stop_if_cancelled(cancel)
            yield tile, load_tile(tile_path(place, frame, index))

    rendering = assemble(plan.size, parts())
    if not np.isfinite(rendering.colour).all():
        raise JobError(f"picture {frame} is not finite: the light or an emission is too strong; lower light.gain")
    ev = known_exposure(plan, place)
    if ev is None:  # this is the first picture, which all others wait for
        ev = meter(rendering.shown(plan.backdrop))
        write_atomically(exposure_path(place), json.dumps(ev).encode())
    exr, png = frame_files(plan, Path(results), frame)
    exr.parent.mkdir(parents=True, exist_ok=True)
    for path in (exr, png):
        stop_if_cancelled(cancel)
        try:
            write_igi_rendering(path, rendering, ev, tone_mapping=plan.tone_mapping, backdrop=plan.backdrop)
        except RenderError as error:
            full = os.strerror(errno.ENOSPC)  # OpenEXR says it in words only
            if full not in str(error):
                raise
            raise OSError(errno.ENOSPC, full, str(path)) from error
    counted = Counted(
        rendering.arrived,
        rendering.clamped,
        rendering.rays,
        [float(value) for value in rendering.colour.reshape(-1, 3).mean(axis=0, dtype=np.float64)],
        float(rendering.coverage.mean(dtype=np.float64)),
    )
    write_atomically(counted_path(place, frame), msgspec.json.encode(counted))


def write_results(settings: IgiRenderSettings, plan: Plan, context: JobContext) -> None:
    """Write film, preview and report."""
    count = len(plan.shots)
    total = count + 1
    context.progress("write", 0, total)
    results = context.results
    for unfinished in (results / "frames").glob(".*.partial"):  # of a step that was killed while it wrote
        unfinished.unlink()
    shown = _opaque(frame_files(plan, results, 0)[1])
    scale = min(1.0, PREVIEW_SIDE / max(plan.size))
    if scale < 1:
        shown = cv2.resize(
            shown, (round(plan.width * scale) or 1, round(plan.height * scale) or 1), interpolation=cv2.INTER_AREA
        ).astype(np.uint8)
    write_atomically(results / "preview.png", encode_png(shown))
    context.progress("write", 1, total)
    if count > 1:

        def pictures() -> Iterator[NDArray[np.uint8]]:
            for frame in range(count):
                yield _opaque(frame_files(plan, results, frame)[1])
                context.progress("write", frame + 2, total)

        write_film(results / "film.mp4", pictures(), settings.fps)
    report = _report(settings, plan, context)
    remark = (
        None if plan.ev is not None else exposure_remark([float(np.dot(mean, LUMINANCE)) for mean in report["mean"]])
    )
    if remark is not None:
        context.log(remark, level="warning")
        report["remarks"].append(remark)
    write_atomically(results / "report.json", (json.dumps(report, indent=1) + "\n").encode())
    context.progress("write", total, total)


def exposure_remark(levels: Sequence[float]) -> str | None:
    """Return what is to be said of a film whose first picture, for which all are exposed, is much darker than others.

    ``levels``: mean luminance of each picture.
    """
    brightest, middle = max(levels), float(np.median(levels))
    if brightest <= levels[0] * 2**WIDE_EV:
        return None
    fits = math.log2(KEY / (middle or brightest))
    return (
        "ev: is metered from the first picture, which is much darker than others: they may be all but white:"
        f" give ev, about {fits:.1f}"
    )


def _opaque(path: Path) -> NDArray[np.uint8]:
    """Return a picture ``(H, W, 3)`` RGB, over black."""
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if found is None:
        raise JobError(f"{path.name}: has gone or is damaged: submit the job again")
    colour = found[..., 2::-1]
    if found.shape[2] == 4:
        return np.rint(colour * (found[..., 3:] / 255)).astype(np.uint8)
    return np.ascontiguousarray(colour, np.uint8)


def _report(settings: IgiRenderSettings, plan: Plan, context: JobContext) -> dict[str, Any]:
    counted = [
        msgspec.json.decode(counted_path(context.work, frame).read_bytes(), type=Counted)
        for frame in range(len(plan.shots))
    ]
    arrived, clamped = math.fsum(one.arrived for one in counted), math.fsum(one.clamped for one in counted)
    igi = IgiSettings.model_validate_json(plan.igi)
    return {
        "frames": len(plan.shots),
        "fps": settings.fps if len(plan.shots) > 1 else None,
        "width": plan.width,
        "height": plan.height,
        "samples": plan.samples,
        "igi": igi.model_dump(mode="json"),
        "ev": known_exposure(plan, context.work),
        "rays": sum(one.rays for one in counted),
        "clamp_bias": clamped / (arrived + clamped) if arrived + clamped > 0 else 0.0,
        "coverage": [one.coverage for one in counted],
        "mean": [one.mean for one in counted],
        "remarks": list(plan.remarks),
    }
