"""Light over time of an ``igi-render`` job: what was recorded, and which picture shows what of it."""

from __future__ import annotations

import io
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lightwell.errors import FrameError, LightwellError
from lightwell.igi.sky import Sky, sky_of_harmonics
from lightwell.io.files import write_atomically
from lightwell.io.recorded_sky import sky_of_picture
from lightwell.io.recordings import Recording, open_recording, read_recorded_picture
from lightwell.job_settings import IgiLightSettings, IgiRenderSettings
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.kind import JobError

COEFFICIENTS = "light.npy"
"""File in the work folder: a row for each light that is not a picture."""


class Shown(NamedTuple):
    """The light of one picture."""

    source: str
    """Path of a recorded picture or a video, or `COEFFICIENTS`."""
    number: int | None
    """Which frame of the video, or which row; None: the picture is the whole file."""
    changed_ns: int
    """When the file was changed last: what the job shows does not depend on when a picture's turn comes."""


def recording_of(light: IgiLightSettings) -> Recording | None:
    """Return what was recorded, None where light does not change; raises `JobError` that names file and line."""
    if light.frames is None:
        return None
    try:
        return open_recording(light.frames, light.video, light.stream)
    except LightwellError as error:
        raise JobError(f"light.frames: {error}") from None


def changes_light(settings: IgiRenderSettings) -> bool:
    """Return whether pictures follow a recording, instead of being in the light of one of its frames."""
    return settings.light.frames is not None and settings.light.frame is None


class LightSize(NamedTuple):
    """How much light there is."""

    pictures: int
    """That show the whole of a recording; 1 where light does not change."""
    texels: int
    """Of the map or the first recorded picture."""


def light_size(settings: IgiRenderSettings, roots: Sequence[Path] | None = None) -> LightSize:
    """Return how much light there is; kept for as long as its file is the same.

    Raises
    ------
    JobError
        Where it cannot be used, has no ``light.frame``, or lies outside ``roots``.
    """
    light = settings.light
    named = light.map if light.frames is None else light.frames
    if named is None:
        return LightSize(1, 0)
    try:
        found = Path(named) if Path(named).exists() else Path(named).parent
        state = found.stat()
        version = (state.st_mtime_ns, state.st_size)
    except OSError:
        version = (0, 0)
    used = light.model_dump_json(include={"map", "frames", "frame", "stream", "video", "mapping", "gain"})
    return _light_size(used, version, settings.fps, None if roots is None else tuple(roots))


@lru_cache(maxsize=64)
def _light_size(light: str, version: tuple[int, int], fps: float, roots: tuple[Path, ...] | None) -> LightSize:
    del version
    settings = IgiLightSettings.model_validate_json(light)
    recording = recording_of(settings)
    if recording is None:
        path = Path(str(settings.map))
        _require_inside(path, roots, "light.map")
        return LightSize(1, _read(settings, path, None, "light.map").pixels.size)
    first = 0 if settings.frame is None else _frame(recording, settings.frame)
    texels = 0
    if recording.pictures:
        path, number = recording.pictures[first]
        _require_inside(path, roots)
        # All frames of a video are of one size, and its first is there at once.
        texels = _read(settings, path, None if number is None else 0, "light.frames").pixels.size
    return LightSize(recording.film_length(fps), texels)


def _frame(recording: Recording, number: int) -> int:
    try:
        return recording.frame(number)
    except LightwellError as error:
        raise JobError(f"light.frame: {error}") from None


def _require_inside(path: Path, roots: Sequence[Path] | None, field: str = "light.frames") -> None:
    if roots is not None and not any(path.resolve().is_relative_to(root) for root in roots):
        raise JobError(f"{field}: {path.name}: lies outside the data roots, links followed: put the file itself there")


def assign(settings: IgiRenderSettings, recording: Recording, count: int, context: JobContext) -> list[Shown]:
    """Return the light of each of ``count`` pictures; coefficients are written to the work folder.

    Raises
    ------
    JobError
        Where ``light.frame`` is none of the recording's, or a picture is a link to what the job may not read.
    """
    if settings.light.frame is None:
        moments = recording.moments(count, settings.fps)
    else:
        moments = np.full(count, float(_frame(recording, settings.light.frame)))
    if recording.coefficients is None:
        shown = [recording.pictures[int(moment)] for moment in moments]
        files = sorted({path for path, _ in shown})
        for path in files:
            _require_inside(path, context.roots)
        changed = {path: _changed_ns(path) for path in files}
        return [Shown(str(path), number, changed[path]) for path, number in shown]
    different, rows = np.unique(moments, return_inverse=True)
    file = io.BytesIO()
    np.save(file, np.stack([recording.light_at(float(moment)) for moment in different]))
    write_atomically(context.work / COEFFICIENTS, file.getvalue())
    return [Shown(COEFFICIENTS, int(row), 0) for row in rows]


def _changed_ns(path: Path) -> int:
    try:
        return path.stat().st_mtime_ns
    except OSError as error:
        raise JobError(f"light.frames: {path.name}: cannot be read: {error.strerror}") from None


def read_sky(light: IgiLightSettings, shown: Shown, work: Path, check: Callable[[], None]) -> Sky:
    """Return the light of a picture; ``check`` is called often, as there may be much of a video before its frame.

    Raises
    ------
    JobError
        Names the frame where it cannot be read, or has changed since the job began.
    """
    if shown.source == COEFFICIENTS:
        assert shown.number is not None
        found = light.gain * np.load(work / COEFFICIENTS, mmap_mode="r")[shown.number]
        try:
            return sky_of_harmonics(found)
        except ValueError as error:
            raise JobError(f"light.gain = {light.gain:g}: with it {error}, or lower it") from None
    path = Path(shown.source)
    if _changed_ns(path) != shown.changed_ns:
        raise JobError(f"light.frames: {path.name}: has changed since the job began: submit it again")
    return _read(light, path, shown.number, "light.frames", check)


def _read(
    light: IgiLightSettings, path: Path, number: int | None, field: str, check: Callable[[], None] | None = None
) -> Sky:
    """Return a picture as a sky; raises `JobError`, and what ``check`` raises."""
    try:
        return sky_of_picture(read_recorded_picture(path, number, light.video, check), light.mapping, light.gain)
    except FrameError as error:
        raise JobError(f"{field}: {error}") from None
    except LightwellError as error:
        raise JobError(f"light.mapping: {path.name}: {error}") from None
    except ValueError as error:
        raise JobError(f"{field}: {path.name}: {error}, or lower light.gain") from None
