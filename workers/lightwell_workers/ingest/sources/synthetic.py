"""``synthetic:room``: an analytic room with moving lights, whose true coefficients go with every frame."""

from __future__ import annotations

import math
import time
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BeforeValidator, Field

from lightwell.conventions import MAX_STREAM_BANDS
from lightwell.errors import LightwellError, SourceError
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings, Settings
from lightwell.synthetic.room import ORIGIN, Room, RoomCamera
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, READERS, Picture, Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options

SCENES = ("room",)
WALL_SECONDS = 86400.0
"""The wall clock's time starts anew after a day: sines of small numbers are exact."""
PLACES_CHECKED = 65
"""Of a path, evenly spaced."""


def _point(value: Any) -> Any:  # noqa: ANN401
    """Take ``x,y,z``."""
    return tuple(value.split(",")) if isinstance(value, str) else value


Point = Annotated[tuple[float, float, float], BeforeValidator(_point)]


class RoomOptions(Settings):
    """What the query of a ``synthetic:room`` URL may set."""

    fps: float = Field(30.0, gt=0, le=1000, description="frames per second")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")
    frames: int = Field(0, ge=0, description="end after so many frames; 0: never")
    width: int = Field(256, ge=8, le=8192, description="width of the pictures, pixels")
    height: int = Field(0, ge=0, le=8192, description="height of the pictures, pixels; 0: as the mapping has it")
    lights: int = Field(2, ge=0, le=16, description="number of moving lights")
    light_radius: float = Field(0.35, gt=0, description="radius of each light, metres")
    period: float = Field(8.0, gt=0, description="seconds that the first light takes for one turn")
    texture: float = Field(0.5, ge=0, le=1, description="contrast of the walls' texture")
    noise: float = Field(0.0, ge=0, description="standard deviation of the samples' noise, relative to each sample")
    seed: int = Field(0, ge=0, description="seed of the noise")
    wall: bool = Field(False, description="lights where the wall clock has them: the rooms of several streams agree")
    spin: float = Field(0.0, description="turns per second of the camera about world +Z")
    at: Point = Field(ORIGIN, description="where the probe is, x,y,z in metres")
    to: Point | None = Field(None, description="where it moves to and back from, x,y,z in metres")
    travel: float = Field(4.0, gt=0, description="seconds for the way there")

    def position(self, time_seconds: float) -> tuple[float, float, float]:
        """Return where the probe is: it starts and stops softly at both ends."""
        if self.to is None:
            return self.at
        share = 0.5 - 0.5 * math.cos(math.pi * time_seconds / self.travel)
        x, y, z = ((1 - share) * a + share * b for a, b in zip(self.at, self.to, strict=True))
        return x, y, z


def open_synthetic(url: SourceUrl, mapping: MappingSettings, clock: Clock | None = None) -> Playback:
    """Open the room, rendered in the stream's mapping.

    Camera pictures are those of a probe that is small against the room. The room stands in world axes, so that each
    frame has a position; two sources of one room with the same lights, ``at`` different places, see the same light.

    Raises
    ------
    SourceError
        Where the scene is unknown or the options describe an impossible room.
    """
    if url.target not in SCENES:
        raise SourceError(f"source {url.text!r}: no scene {url.target!r}. There is: {', '.join(SCENES)}")
    options = parse_options(url, RoomOptions)
    try:
        reader = _RoomReader(options, mapping)
    except (ValueError, LightwellError) as error:
        raise SourceError(f"source {url.text!r}: {error}") from error
    return Playback(url.text, reader, round(NANOSECONDS / options.fps), realtime=options.realtime, clock=clock)


class _RoomReader:
    threads = READERS

    def __init__(self, options: RoomOptions, mapping_settings: MappingSettings) -> None:
        self._options = options
        self.length = options.frames or None
        self._room = Room(
            lights=options.lights,
            light_radius=options.light_radius,
            period_seconds=options.period,
            texture=options.texture,
        )
        path = [options.at] if options.to is None else np.linspace(options.at, options.to, PLACES_CHECKED)
        self._room.require_free(path)
        height = options.height or (options.width // 2 if mapping_settings.kind == "latlong" else options.width)
        mapping = make_mapping(mapping_settings, height, options.width)
        x, y = mapping.pixel_centres()
        directions, seen = mapping.directions(x, y)
        self._camera = RoomCamera(self._room, directions)
        self._unseen = None if seen.all() else ~seen

    def read(self, position: int) -> Picture:
        time_seconds = time.time() % WALL_SECONDS if self._options.wall else position / self._options.fps
        world_from_camera = None
        if self._options.spin:
            world_from_camera = _turn_about_z(2 * math.pi * self._options.spin * time_seconds)
        at = self._options.position(time_seconds)
        pixels = self._camera.render(time_seconds, world_from_camera, at)
        if self._options.noise:
            generator = np.random.default_rng((self._options.seed, position))
            pixels *= 1 + np.float32(self._options.noise) * generator.standard_normal(pixels.shape, dtype=np.float32)
        if self._unseen is not None:
            pixels[self._unseen] = 0.0
        return Picture(
            pixels=pixels,
            name=f"room {position}",
            truth=self._room.coefficients(MAX_STREAM_BANDS, time_seconds, at),
            world_from_camera=world_from_camera,
            position_m=np.array(at),
        )

    def close(self) -> None:
        pass


def _turn_about_z(angle: float) -> NDArray[np.float64]:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
