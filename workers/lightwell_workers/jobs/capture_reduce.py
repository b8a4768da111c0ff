"""``capture-reduce``: a capture without the probes that say nothing new (paper 000 §5.1)."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from lightwell.field.reduce import Decision, Frame, decide
from lightwell.field.spec import Floats
from lightwell.io.captures import DOCUMENT, POSES, Capture, open_capture
from lightwell.io.files import write_atomically
from lightwell.io.poses import Poses, write_poses
from lightwell.io.preview import encode_png
from lightwell.job_settings import CaptureReduceSettings
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.kind import Estimate, JobError, Step

FRAME_SECONDS = 3e-3
FRAMES_A_STEP = 2000
PREVIEW = 480


class CaptureReduce:
    """The kind."""

    def estimate(self, settings: CaptureReduceSettings, roots: Sequence[Path] | None = None) -> Estimate:
        """Return what the job needs; raises `LightwellError` where the capture cannot be used."""
        del roots  # no file of its settings names others elsewhere
        capture = require_frames(open_capture(Path(settings.capture)))
        pixels = capture.info.width * capture.info.height
        return Estimate(
            seconds=capture.count * FRAME_SECONDS * pixels / 62_500,
            memory_bytes=8 * pixels * 12,
            disk_bytes=capture.count * pixels * 6,
        )

    def prepare(self, settings: CaptureReduceSettings, context: JobContext) -> None:
        """Check the capture."""
        capture = require_frames(open_capture(Path(settings.capture)))
        context.log("prepared", probes=capture.count)

    def steps(self, settings: CaptureReduceSettings, context: JobContext) -> list[Step]:
        """Return the comparison, some frames a step, and the writing."""
        total = open_capture(Path(settings.capture)).count
        compare = [
            Step(f"compare {first}", partial(_compare, settings, first, min(first + FRAMES_A_STEP, total)))
            for first in range(0, total, FRAMES_A_STEP)
        ]
        return [*compare, Step("write", partial(_write, settings))]


def require_frames(capture: Capture) -> Capture:
    """Return a capture that can be thinned out; raises `JobError` where it is in angular order."""
    if capture.sorted_samples is not None:
        raise JobError(f"{capture.directory}: is in angular order and has no frames to compare")
    return capture


def default_distance(positions: Floats) -> float:
    """Return the gap that dropping may leave: the kernel's radius on a grid of 32 cells round the probes."""
    return 1.5 * float(np.ptp(positions, axis=0).max()) / 32


def reduce_capture(
    capture: Capture,
    settings: CaptureReduceSettings,
    first: int,
    last: int,
    kept: int | None,
    report: Callable[[int, int], None],
) -> list[Decision]:
    """Decide on the probes ``first`` … ``last − 1``; ``kept`` is the last one kept before them."""
    weights = capture.mapping().solid_angles().reshape(-1)
    seen = np.flatnonzero(weights > 0)

    def frame(index: int) -> Frame:
        pixels = capture.read_frame(index).reshape(-1, 3)[seen].astype(np.float32)
        return np.nan_to_num(pixels, nan=0.0, posinf=65504.0, neginf=0.0)

    def frames() -> Iterator[Frame]:
        for index in range(first, capture.count):
            report(index, capture.count)
            yield frame(index)

    decisions = []
    positions = capture.poses.positions
    distance = settings.max_distance_m or default_distance(positions)
    before = None if kept is None else (kept, frame(kept))
    for decision in decide(frames(), positions, weights[seen], settings.tolerance, distance, first, before):
        decisions.append(decision)
        if decision.index + 1 == last:
            break
    return decisions


def write_reduced(capture: Capture, decisions: list[Decision], target: Path) -> dict[str, Any]:
    """Write the capture of the kept probes to a new folder, frames linked where possible; return the report."""
    kept = [decision.index for decision in decisions if decision.kept]
    partial_folder = target.with_name(f".{target.name}.{os.getpid()}.partial")
    shutil.rmtree(partial_folder, ignore_errors=True)
    try:
        partial_folder.mkdir(parents=True)
        shutil.copyfile(capture.directory / DOCUMENT, partial_folder / DOCUMENT)
        poses = capture.poses
        frames = tuple(poses.frames[index] for index in kept)
        for frame in frames:
            place = partial_folder / frame
            place.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(capture.directory / frame, place)
            except OSError:
                shutil.copyfile(capture.directory / frame, place)
        write_poses(
            partial_folder / POSES, Poses(frames, poses.times_ns[kept], poses.positions[kept], poses.orientations[kept])
        )
        if target.exists():
            shutil.rmtree(target)
        partial_folder.rename(target)
    finally:
        with contextlib.suppress(OSError):
            shutil.rmtree(partial_folder, ignore_errors=True)
    costs = np.array([decision.difference for decision in decisions if not decision.kept])
    return {
        "probes": capture.count,
        "kept": len(kept),
        "dropped": capture.count - len(kept),
        "difference_mean": float(costs.mean()) if costs.size else 0.0,
        "difference_max": float(costs.max()) if costs.size else 0.0,
        "dropped_frames": [
            {"frame": capture.poses.frames[decision.index], "difference": decision.difference}
            for decision in decisions
            if not decision.kept
        ],
    }


def _state(context: JobContext, last: int) -> Path:
    return context.work / f"decided-{last:07d}.json"


def _read(context: JobContext, last: int) -> list[Decision]:
    return [Decision(*item) for item in json.loads(_state(context, last).read_text())]


def _compare(settings: CaptureReduceSettings, first: int, last: int, context: JobContext) -> None:
    capture = open_capture(Path(settings.capture))
    before = _read(context, first) if first else []
    kept = max((decision.index for decision in before if decision.kept), default=None)
    decisions = before + reduce_capture(
        capture, settings, first, last, kept, lambda done, total: context.progress("compare", done, total)
    )
    document = [[decision.index, decision.kept, decision.difference] for decision in decisions]
    write_atomically(_state(context, last), json.dumps(document).encode())


def _write(settings: CaptureReduceSettings, context: JobContext) -> None:
    capture = open_capture(Path(settings.capture))
    decisions = _read(context, capture.count)
    context.progress("write", 0, capture.count)
    report = write_reduced(capture, decisions, context.results / "capture")
    write_atomically(context.results / "report.json", (json.dumps(report, indent=1) + "\n").encode())
    kept = np.array([decision.kept for decision in decisions])
    write_atomically(context.results / "preview.png", _picture(capture.poses.positions, kept))
    context.progress("write", capture.count, capture.count)


def _picture(positions: Floats, kept: np.ndarray[Any, np.dtype[np.bool_]]) -> bytes:
    """Return a plan of the probes from above: kept ones dark, dropped ones light."""
    size = np.maximum(np.ptp(positions, axis=0), 1e-9)
    scale = (PREVIEW - 32) / max(size[0], size[1])
    canvas = np.full((PREVIEW, PREVIEW, 3), 255, np.uint8)
    plan = 16 + (positions[:, :2] - positions[:, :2].min(axis=0)) * scale
    for order, colour in ((~kept, (205, 205, 205)), (kept, (30, 70, 160))):
        for x, y in plan[order]:
            cv2.circle(canvas, (round(x), PREVIEW - round(y)), 2, colour, -1, cv2.LINE_AA)
    return encode_png(canvas)
