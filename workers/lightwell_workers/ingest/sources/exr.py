"""``exr:PATTERN``: a recorded sequence of EXR files, played as a fake camera."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from lightwell.errors import FrameError, SourceError
from lightwell.io.captures import DOCUMENT, open_capture
from lightwell.io.exr import read_rgb
from lightwell.io.poses import CaptureError, Poses, read_poses
from lightwell.io.sequences import SequenceEntry, find_sequence
from lightwell.settings import MappingSettings, Settings
from lightwell.synthetic.rig import rotation_of
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, READERS, Picture, Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options

STILL = 1e-9
"""A camera turned by less than this (1 − cos of half the angle) is taken as not turned."""


class ExrOptions(Settings):
    """What the query of an ``exr:`` URL may set."""

    fps: float = Field(30.0, gt=0, le=1000, description="frame rate of the recording")
    loop: bool = Field(False, description="start again at the end")
    speed: float = Field(1.0, gt=0, le=1000, description="pace: 2 plays twice as fast")
    step: int = Field(1, ge=1, description="play every n-th frame, at the recording's own pace")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")
    first: int | None = Field(None, ge=0, description="first frame: its number in a printf pattern, else its position")
    last: int | None = Field(None, ge=0, description="last frame, inclusive")
    poses: str | None = Field(
        None, description="poses.csv that says where each frame was taken; a capture's folder brings its own"
    )


def open_exr(url: SourceUrl, clock: Clock | None = None, mapping: MappingSettings | None = None) -> Playback:
    """Open a sequence.

    A frame is due every ``step / (fps · speed)`` seconds. The folder of a capture is played in the order of its poses;
    ``mapping`` is the stream's, which must be the capture's.

    Raises
    ------
    SourceError
        Where nothing matches the pattern, none of the first files can be read, poses are missing or wrong, or a capture
        has another mapping.
    """
    options = parse_options(url, ExrOptions)
    if not url.target:
        raise SourceError(f"source {url.text!r} names no files: exr:FOLDER, exr:dir/*.exr or exr:dir/frame.%04d.exr")
    folder = Path(url.target)
    poses: Poses | None
    try:
        if options.poses is None and (folder / DOCUMENT).is_file():
            capture = open_capture(folder)
            if mapping is not None and mapping != capture.info.mapping:
                wanted = capture.info.mapping.model_dump_json(exclude_defaults=True, exclude_none=True)
                kind = capture.info.mapping.kind
                raise CaptureError(
                    f"its frames are {kind} pictures: set the stream's mapping to {wanted} (kind {kind})"
                )
            poses = capture.poses
            entries = [SequenceEntry(frame, folder / frame) for frame in poses.frames]
            entries = entries[options.first or 0 : None if options.last is None else options.last + 1]
        else:
            poses = None if options.poses is None else read_poses(Path(options.poses))
            entries = find_sequence(url.target, options.first, options.last)
    except CaptureError as error:
        raise SourceError(f"source {url.text!r}: {error}") from None
    entries = entries[:: options.step]
    places = {} if poses is None else _places(url, poses, entries)
    _require_one_readable(url, entries)
    interval_ns = round(NANOSECONDS * options.step / (options.fps * options.speed))
    return Playback(
        url.text, _ExrReader(entries, places, options.loop), interval_ns, realtime=options.realtime, clock=clock
    )


class _Place(NamedTuple):
    position_m: NDArray[np.float64] | None
    world_from_camera: NDArray[np.float64] | None


_NOWHERE = _Place(None, None)


class _ExrReader:
    threads = READERS

    def __init__(self, entries: list[SequenceEntry], places: dict[str, _Place], loop: bool) -> None:
        self._entries = entries
        self._places = places
        self.length = None if loop else len(entries)

    def read(self, position: int) -> Picture:
        entry = self._entries[position % len(self._entries)]
        if entry.path is None:
            raise FrameError(entry.name, "is missing from the sequence")
        try:
            picture = read_rgb(entry.path)
        except FrameError as error:
            raise FrameError(entry.name, error.reason) from error
        place = self._places.get(entry.name, _NOWHERE)
        return Picture(
            pixels=picture.pixels,
            name=entry.name,
            capture_time_ns=picture.capture_time_ns,
            world_from_camera=place.world_from_camera,
            position_m=place.position_m,
        )

    def close(self) -> None:
        pass


def _places(url: SourceUrl, poses: Poses, entries: list[SequenceEntry]) -> dict[str, _Place]:
    """Return where each frame was taken, by its name; raises `SourceError` where one that is there has no pose."""
    turned = rotation_of(poses.orientations)
    still = np.abs(poses.orientations[:, 3]) > 1 - STILL
    by_name: dict[str, _Place] = {}
    for index, frame in enumerate(poses.frames):
        place = _Place(poses.positions[index], None if still[index] else turned[index])
        by_name[frame] = by_name[Path(frame).name] = place
    missing = [entry.name for entry in entries if entry.path is not None and entry.name not in by_name]
    if missing:
        raise SourceError(
            f"source {url.text!r}: {len(missing)} of {len(entries)} frames have no pose, the first is {missing[0]}: "
            "add its row to the poses, or play only the frames that have one (first=, last=)"
        )
    return by_name


def _require_one_readable(url: SourceUrl, entries: list[SequenceEntry]) -> None:
    reason = ""
    for entry in entries:
        if entry.path is None:
            continue
        try:
            read_rgb(entry.path)
        except FrameError as error:
            reason = reason or str(error)
        else:
            return
    raise SourceError(f"source {url.text!r} has no frame that can be read ({reason}): is it a folder of EXR pictures?")
