"""Light over time of an ``igi-render`` job: what was recorded, and which picture shows what of it."""

from __future__ import annotations

import io
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


def light_size(settings: IgiRenderSettings) -> LightSize:
    """Return how much light there is; kept for as long as its file is the same.

    Raises
    ------
    JobError
        Where it cannot be used, or has no ``light.frame``.
    """
    light = settings.light
    named = light.map if light.frames is None else light.frames
    if named is None:
        return LightSize(1, 0)
    found = Path(named) if Path(named).exists() else Path(named).parent
    try:
        state = found.stat()
        version = (state.st_mtime_ns, state.st_size)
    except OSError:
        version = (0, 0)
    used = light.model_dump_json(include={"map", "frames", "frame", "stream", "video", "mapping"})
    return _light_size(used, version, settings.fps)


@lru_cache(maxsize=64)
def _light_size(light: str, version: tuple[int, int], fps: float) -> LightSize:
    del version
    settings = IgiLightSettings.model_validate_json(light)
    recording = recording_of(settings)
    if recording is None:
        return LightSize(1, _read(settings, Path(str(settings.map)), None, "light.map").pixels.size)
    first = 0 if settings.frame is None else _frame(recording, settings.frame)
    texels = 0
    if recording.pictures:
        texels = _read(settings, *recording.pictures[first], "light.frames").pixels.size
    return LightSize(recording.film_length(fps), texels)


def _frame(recording: Recording, number: int) -> int:
    try:
        return recording.frame(number)
    except LightwellError as error:
        raise JobError(f"light.frame: {error}") from None


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
        for path in {path for path, _ in shown}:
            if context.roots is not None and not any(path.resolve().is_relative_to(root) for root in context.roots):
                raise JobError(f"light.frames: {path.name}: is a link out of the data roots; put the file itself there")
        return [Shown(str(path), number) for path, number in shown]
    different, rows = np.unique(moments, return_inverse=True)
    file = io.BytesIO()
    np.save(file, np.stack([recording.light_at(float(moment)) for moment in different]))
    write_atomically(context.work / COEFFICIENTS, file.getvalue())
    return [Shown(COEFFICIENTS, int(row)) for row in rows]


def read_sky(light: IgiLightSettings, shown: Shown, work: Path) -> Sky:
    """Return the light of a picture; raises `JobError` that names the frame where it cannot be read."""
    if shown.source == COEFFICIENTS:
        assert shown.number is not None
        return sky_of_harmonics(light.gain * np.load(work / COEFFICIENTS, mmap_mode="r")[shown.number])
    return _read(light, Path(shown.source), shown.number, "light.frames")


def _read(light: IgiLightSettings, path: Path, number: int | None, field: str) -> Sky:
    """Return a picture as a sky; raises `JobError`."""
    try:
        return sky_of_picture(read_recorded_picture(path, number, light.video), light.mapping, light.gain)
    except FrameError as error:
        raise JobError(f"{field}: {error}") from None
    except LightwellError as error:
        raise JobError(f"light.mapping: {path.name}: {error}") from None
