"""Analytic scenes as a camera sees them: true coefficients and the probe's place go with every frame.

``synthetic:room`` is a room with moving lights; ``synthetic:panel``, ``synthetic:scene1`` and the other scenes of
`lightwell.synthetic.scene` stand still, and the probe may move through them.
"""

from __future__ import annotations

import math
import time
from typing import Annotated, Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import BeforeValidator, Field

from lightwell.conventions import MAX_STREAM_BANDS
from lightwell.errors import LightwellError, SourceError
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings, Settings
from lightwell.synthetic.room import ORIGIN, Room, RoomCamera
from lightwell.synthetic.scene import PRESETS, Scene
from lightwell_workers.ingest.sources.clock import Clock
from lightwell_workers.ingest.sources.playback import NANOSECONDS, READERS, Picture, Playback
from lightwell_workers.ingest.sources.url import SourceUrl, parse_options

ROOM = "room"
SCENES = (ROOM, *PRESETS)
WALL_SECONDS = 86400.0
"""The wall clock's time starts anew after a day: sines of small numbers are exact."""
PLACES_CHECKED = 65
"""Of a path, evenly spaced."""

Place = tuple[float, float, float]
Picture32 = NDArray[np.float32]


def _point(value: Any) -> Any:  # noqa: ANN401
    """Take ``x,y,z``."""
    return tuple(value.split(",")) if isinstance(value, str) else value


Point = Annotated[Place, BeforeValidator(_point)]


class SceneOptions(Settings):
    """What the query of a ``synthetic:`` URL may set, whatever the scene."""

    fps: float = Field(30.0, gt=0, le=1000, description="frames per second")
    realtime: bool = Field(True, description="deliver frames when they are due; 0: all, as fast as possible")
    frames: int = Field(0, ge=0, description="end after so many frames; 0: never")
    width: int = Field(256, ge=8, le=8192, description="width of the pictures, pixels")
    height: int = Field(0, ge=0, le=8192, description="height of the pictures, pixels; 0: as the mapping has it")
    noise: float = Field(0.0, ge=0, description="standard deviation of the samples' noise, relative to each sample")
    seed: int = Field(0, ge=0, description="seed of the noise")
    spin: float = Field(0.0, description="turns per second of the camera about world +Z")
    at: Point = Field(ORIGIN, description="where the probe is, x,y,z in metres")
    to: Point | None = Field(None, description="where it moves to and back from, x,y,z in metres")
    travel: float = Field(4.0, gt=0, description="seconds for the way there")

    def position(self, time_seconds: float) -> Place:
        """Return where the probe is: it starts and stops softly at both ends."""
        if self.to is None:
            return self.at
        share = 0.5 - 0.5 * math.cos(math.pi * time_seconds / self.travel)
        x, y, z = ((1 - share) * a + share * b for a, b in zip(self.at, self.to, strict=True))
        return x, y, z


class RoomOptions(SceneOptions):
    """What the query of a ``synthetic:room`` URL may set."""

    lights: int = Field(2, ge=0, le=16, description="number of moving lights")
    light_radius: float = Field(0.35, gt=0, description="radius of each light, metres")
    period: float = Field(8.0, gt=0, description="seconds that the first light takes for one turn")
    texture: float = Field(0.5, ge=0, le=1, description="contrast of the walls' texture")
    wall: bool = Field(False, description="lights where the wall clock has them: the rooms of several streams agree")


def read_options(url: SourceUrl) -> SceneOptions:
    """Return the options of a ``synthetic:`` URL; raises `SourceError` where scene or options are unknown or wrong."""
    if url.target not in SCENES:
        raise SourceError(f"source {url.text!r}: no scene {url.target!r}. There are: {', '.join(SCENES)}")
    return parse_options(url, RoomOptions if url.target == ROOM else SceneOptions)


def open_synthetic(url: SourceUrl, mapping: MappingSettings, clock: Clock | None = None) -> Playback:
    """Open a scene, rendered in the stream's mapping.

    Camera pictures are those of a probe that is small against the scene, which stands in world axes: two sources of one
    scene, ``at`` different places, see the same light.

    Raises
    ------
    SourceError
        Where the scene is unknown, the options describe an impossible room, or the probe would leave it.
    """
    options = read_options(url)
    try:
        reader = _Reader(url.target, options, mapping)
    except (ValueError, LightwellError) as error:
        raise SourceError(f"source {url.text!r}: {error}") from error
    return Playback(url.text, reader, round(NANOSECONDS / options.fps), realtime=options.realtime, clock=clock)


class _Light(Protocol):
    """A scene, seen along fixed directions in camera axes."""

    def require_free(self, at: ArrayLike) -> None:
        """Raise ``ValueError`` where a probe cannot be at one of the places ``(n, 3)``."""

    def render(self, time_seconds: float, world_from_camera: NDArray[np.float64] | None, at: Place) -> Picture32:
        """Return the radiance at every pixel centre, ``(height, width, 3)``."""

    def coefficients(self, time_seconds: float, at: Place) -> NDArray[np.float64]:
        """Return the exact coefficients."""


class _RoomLight:
    def __init__(self, options: RoomOptions, directions: NDArray[np.float64]) -> None:
        self._room = Room(
            lights=options.lights,
            light_radius=options.light_radius,
            period_seconds=options.period,
            texture=options.texture,
        )
        self.require_free = self._room.require_free
        self.render = RoomCamera(self._room, directions).render

    def coefficients(self, time_seconds: float, at: Place) -> NDArray[np.float64]:
        return self._room.coefficients(MAX_STREAM_BANDS, time_seconds, at)


class _SceneLight:
    def __init__(self, scene: Scene, directions: NDArray[np.float64]) -> None:
        self._scene = scene
        self._directions = directions
        self._known: tuple[Place, NDArray[np.float64]] | None = None

    def require_free(self, at: ArrayLike) -> None:
        if self._scene.room_half is not None:
            places, half = np.asarray(at, dtype=np.float64), np.array(self._scene.room_half)
            outside = (np.abs(places) >= half).any(axis=1)
            if outside.any():
                raise ValueError(f"the probe at {_text(places[outside][0])} m is not inside the room ±{_text(half)} m")

    def render(self, time_seconds: float, world_from_camera: NDArray[np.float64] | None, at: Place) -> Picture32:
        turned = self._directions if world_from_camera is None else self._directions @ world_from_camera.T
        return self._scene.radiance(at, turned).astype(np.float32)

    def coefficients(self, time_seconds: float, at: Place) -> NDArray[np.float64]:
        known = self._known
        if known is None or known[0] != at:
            known = self._known = at, self._scene.coefficients(at, MAX_STREAM_BANDS)
        return known[1]


def _text(place: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{value:g}" for value in place) + ")"


class _Reader:
    threads = READERS

    def __init__(self, name: str, options: SceneOptions, mapping_settings: MappingSettings) -> None:
        self._name = name
        self._options = options
        self.length = options.frames or None
        height = options.height or (options.width // 2 if mapping_settings.kind == "latlong" else options.width)
        mapping = make_mapping(mapping_settings, height, options.width)
        x, y = mapping.pixel_centres()
        directions, seen = mapping.directions(x, y)
        self._unseen = None if seen.all() else ~seen
        self._follows_clock = isinstance(options, RoomOptions) and options.wall
        self._light: _Light
        if isinstance(options, RoomOptions):
            self._light = _RoomLight(options, directions)
        else:
            self._light = _SceneLight(PRESETS[name], directions)
        self._light.require_free(np.linspace(options.at, options.to or options.at, PLACES_CHECKED))

    def read(self, position: int) -> Picture:
        time_seconds = time.time() % WALL_SECONDS if self._follows_clock else position / self._options.fps
        world_from_camera = None
        if self._options.spin:
            world_from_camera = _turn_about_z(2 * math.pi * self._options.spin * time_seconds)
        at = self._options.position(time_seconds)
        pixels = self._light.render(time_seconds, world_from_camera, at)
        if self._options.noise:
            generator = np.random.default_rng((self._options.seed, position))
            pixels *= 1 + np.float32(self._options.noise) * generator.standard_normal(pixels.shape, dtype=np.float32)
        if self._unseen is not None:
            pixels[self._unseen] = 0.0
        return Picture(
            pixels=pixels,
            name=f"{self._name} {position}",
            truth=self._light.coefficients(time_seconds, at),
            world_from_camera=world_from_camera,
            position_m=np.array(at),
        )

    def close(self) -> None:
        pass


def _turn_about_z(angle: float) -> NDArray[np.float64]:
    cos, sin = math.cos(angle), math.sin(angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
