"""Captures from a folder of EXR frames and the poses of a tracker."""

from __future__ import annotations

import math
import os
import shutil
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from lightwell.conventions import Units
from lightwell.errors import FrameError, MappingError
from lightwell.io.captures import DOCUMENT, POSES, CaptureInfo, list_frames
from lightwell.io.exr import ExrPicture, read_rgb
from lightwell.io.poses import CaptureError, Poses, read_poses, read_tum, write_poses
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings


@dataclass(frozen=True)
class ImportSettings:
    """How frames and poses become a capture."""

    mapping: MappingSettings
    gain: float = 1.0
    units: Units = "relative"
    name: str = ""
    tum: bool = False
    fps: float | None = None
    start_seconds: float | None = None
    max_gap_seconds: float = 0.02
    copy: bool = False


def import_capture(
    frames: Path, poses: Path, out: Path, settings: ImportSettings, report: Callable[[int, int], None] | None = None
) -> int:
    """Write a capture to the new folder ``out`` and return its number of probes.

    A CSV names the frame of each pose. A TUM trajectory is matched by time: a frame takes the pose nearest to its
    capture time (EXR ``capDate``), or to ``start_seconds`` plus its number over ``fps``.

    Raises
    ------
    CaptureError
        Naming file, line or frame, field, value and remedy.
    """
    if out.exists():
        raise CaptureError(f"{out}: exists; give another folder with --out")
    paths = list_frames(frames) if frames.is_dir() else []
    if not paths:
        raise CaptureError(f"{frames}: holds no EXR frames")
    by_name = {path.name: path for path in paths}
    pictures = _Pictures()
    first = pictures.read(paths[0])
    height, width = first.pixels.shape[:2]
    try:
        make_mapping(settings.mapping, height, width)
    except MappingError as error:
        raise CaptureError(f"{paths[0].name}: {error}") from None
    if not (math.isfinite(settings.gain) and settings.gain > 0):
        raise CaptureError(f"--gain {settings.gain:g}: must be a positive number")
    chosen = _match(paths, poses, settings, pictures) if settings.tum else _named(by_name, poses)
    info = CaptureInfo(
        name=settings.name or frames.resolve().name,
        mapping=settings.mapping,
        height=height,
        width=width,
        gain=settings.gain,
        units=settings.units,
    )
    partial = out.with_name(f".{out.name}.{os.getpid()}.partial")
    try:
        (partial / "frames").mkdir(parents=True)
        for done, frame in enumerate(chosen.frames, 1):
            source = by_name[Path(frame).name]
            picture = pictures.read(source)
            if picture.pixels.shape[:2] != (height, width):
                raise CaptureError(
                    f"{source}: has {picture.pixels.shape[1]}×{picture.pixels.shape[0]} pixels, the first frame "
                    f"{width}×{height}: take it out, or import it by itself"
                )
            _bring(source, partial / frame, copy=settings.copy)
            if report is not None:
                report(done, len(chosen.frames))
        (partial / DOCUMENT).write_text(info.model_dump_json(indent=2) + "\n")
        write_poses(partial / POSES, chosen)
        partial.rename(out)
    except OSError as error:
        raise CaptureError(f"{out}: cannot be written: {error.strerror}; free space or give another folder") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
    return len(chosen.frames)


class _Pictures:
    """Reads frames, and remembers the last: the first is asked for twice."""

    def __init__(self) -> None:
        self._last: tuple[Path, ExrPicture] | None = None

    def read(self, path: Path) -> ExrPicture:
        if self._last is None or self._last[0] != path:
            try:
                self._last = (path, read_rgb(path))
            except FrameError as error:
                raise CaptureError(str(error)) from None
        return self._last[1]


def _bring(source: Path, place: Path, *, copy: bool) -> None:
    if not copy:
        try:
            os.link(source, place)
        except OSError:
            pass
        else:
            return
    shutil.copyfile(source, place)


def _named(by_name: dict[str, Path], path: Path) -> Poses:
    poses = read_poses(path)
    names = [Path(frame).name for frame in poses.frames]
    if len(set(names)) < len(names):
        twice = Counter(names).most_common(1)[0][0]
        raise CaptureError(f"{path}: several rows name the frame {twice!r}; a folder holds one of that name")
    missing = [name for name in names if name not in by_name]
    if missing:
        raise CaptureError(
            f"{path}: frame {missing[0]!r} is not in the folder ({len(missing)} of {len(names)} are not)"
        )
    without = sorted(set(by_name) - set(names))
    if without:
        raise CaptureError(
            f"{path}: there are fewer poses than frames: {len(without)} frames have none, the first is {without[0]}: "
            "add its row or move the frame away"
        )
    frames = tuple(f"frames/{name}" for name in names)
    return Poses(frames, poses.times_ns, poses.positions, poses.orientations)


def _match(paths: list[Path], trajectory: Path, settings: ImportSettings, pictures: _Pictures) -> Poses:
    times, positions, orientations = read_tum(trajectory)
    order = np.argsort(times, kind="stable")
    times, positions, orientations = times[order], positions[order], orientations[order]
    if settings.fps is not None:
        start = times[0] if settings.start_seconds is None else round(settings.start_seconds * 1e9)
        wanted = start + np.round(np.arange(len(paths)) / settings.fps * 1e9).astype(np.int64)
    else:
        taken = [pictures.read(path).capture_time_ns for path in paths]
        without = next((path for path, time in zip(paths, taken, strict=True) if time is None), None)
        if without is not None:
            raise CaptureError(f"{without.name}: has no capDate to match it with {trajectory}: give --fps")
        wanted = np.array(taken, dtype=np.int64)
    after = np.clip(np.searchsorted(times, wanted), 1, max(len(times) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(times) - 1)
    nearest = np.where(np.abs(times[before] - wanted) <= np.abs(times[after] - wanted), before, after)
    gaps = np.abs(times[nearest] - wanted) / 1e9
    worst = int(gaps.argmax())
    if gaps[worst] > settings.max_gap_seconds:
        raise CaptureError(
            f"{paths[worst].name}: the nearest pose of {trajectory} is {gaps[worst]:.3f} s away, more than "
            f"--max-gap-seconds {settings.max_gap_seconds:g}: check the clocks, --fps and --start-seconds"
        )
    frames = tuple(f"frames/{path.name}" for path in paths)
    return Poses(frames, wanted, positions[nearest], orientations[nearest])
