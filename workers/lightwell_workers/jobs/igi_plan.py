"""What an ``igi-render`` job works on and in which order: fixed before it starts, whatever computes it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from lightwell.igi.filter import margins
from lightwell.igi.rendering import TILE, Tile, cut
from lightwell.igi_settings import IgiSettings
from lightwell.job_settings import IgiRenderSettings
from lightwell.render.camera import Camera
from lightwell_workers.jobs.igi_light import Shown, changes_light, light_size
from lightwell_workers.jobs.igi_scene import frame_count, scene_of, size_of
from lightwell_workers.jobs.kind import Estimate

MEGABYTE = 1 << 20
LIGHT_SECONDS = 0.12e-6
"""Core time of one virtual light at one pixel: its shadow ray, and what it adds."""
PIXEL_SECONDS = 2.5e-6
"""Core time of a pixel: what is seen, two passes of the filter, the shading, and the files."""
RAY_SECONDS = 1.5e-6
"""Core time of one of several rays of a pixel."""
LIGHTS_SECONDS = 4e-6
"""Core time to make a virtual light."""
LEAST_SECONDS = 0.2
TILE_SECONDS = 4.0
"""A tile that would take longer is cut in four: it is what a kill costs."""
LEAST_TILE = 32
PROCESS_BYTES = 350 * MEGABYTE
TRIANGLE_BYTES = 500
LAYER_CHANNELS = {"normal": 3, "depth": 1, "albedo": 3, "direct": 3, "indirect": 3, "set": 1}
COARSE_SIDE = 96
"""Longer side of the first, coarse picture, pixels."""


class Shot(msgspec.Struct, array_like=True):
    """One picture."""

    position: tuple[float, float, float]
    target: tuple[float, float, float]
    up: tuple[float, float, float]
    fov_degrees: float
    light: Shown | None
    """Recorded light that it shows; None: the scene's."""

    @property
    def camera(self) -> Camera:
        """From where it is seen."""
        return Camera(self.position, self.target, self.up, self.fov_degrees)


class Plan(msgspec.Struct):
    """Written once, when the job is prepared."""

    width: int
    height: int
    side: int
    """Of the tiles, pixels."""
    together: int
    """Tiles in one checkpoint."""
    shots: list[Shot]
    samples: int
    """N: a pixel is the mean of N² rays."""
    igi: str
    """`IgiSettings` as JSON: of the scene's file and the job together."""
    light: str
    """`IgiLightSettings` as JSON: how recorded light is read."""
    backdrop: bool
    ev: float | None
    tone_mapping: bool
    remarks: list[str]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the pictures."""
        return self.width, self.height

    @property
    def tiles(self) -> list[Tile]:
        """Those of each picture."""
        return cut(self.size, self.side)

    @property
    def total(self) -> int:
        """Tiles of all pictures."""
        return len(self.tiles) * len(self.shots)

    @property
    def coarse(self) -> tuple[int, int]:
        """Size of the first, coarse picture."""
        scale = min(1.0, COARSE_SIDE / max(self.size))
        return max(1, round(self.width * scale)), max(1, round(self.height * scale))


def exposure_path(work: Path) -> Path:
    """Return where the exposure lies that the first picture was metered for."""
    return work / "exposure.json"


def known_exposure(plan: Plan, work: Path) -> float | None:
    """Return the exposure of all pictures, EV; None before the first one has been metered."""
    if plan.ev is not None:
        return plan.ev
    try:
        return float(msgspec.json.decode(exposure_path(work).read_bytes()))
    except OSError:
        return None


def pixel_seconds(igi: IgiSettings, lamps: int) -> float:
    """Return the core time of a pixel of one ray."""
    n, m = igi.sets
    return PIXEL_SECONDS * (1 if igi.filter == "none" else igi.window**2) + LIGHT_SECONDS * (igi.vpls / (n * m) + lamps)


def tile_seconds(igi: IgiSettings, lamps: int, samples: int, side: int) -> float:
    """Return the core time of a tile, with the pixels that its filter needs around it."""
    left, right, up, down = margins(igi)
    rays = samples**2 if samples > 1 else 0
    return (side + left + right) * (side + up + down) * pixel_seconds(igi, lamps) + side**2 * rays * RAY_SECONDS


def tile_side(igi: IgiSettings, lamps: int, samples: int) -> int:
    """Return how large tiles are: the results do not depend on it."""
    side = TILE
    while side > LEAST_TILE and tile_seconds(igi, lamps, samples, side) > TILE_SECONDS:
        side //= 2
    return side


def channels_of(igi: IgiSettings) -> int:
    """Return how many channels a tile has; a picture has two less."""
    coefficients = 3 * igi.bands**2 if "coefficients" in igi.layers else 0
    return 7 + coefficients + sum(LAYER_CHANNELS.get(layer, 0) for layer in igi.layers)


def estimate(settings: IgiRenderSettings, roots: Sequence[Path] | None = None) -> Estimate:
    """Return what a job needs; raises `LightwellError` where its scene or its frames cannot be used."""
    scene, size = scene_of(settings), size_of(settings, roots)
    igi, width, height = scene.igi, scene.picture.width, scene.picture.height
    samples = igi.samples(scene.picture.samples)
    frames = frame_count(settings, roots)
    texels = size.texels + light_size(settings, roots).texels
    side = tile_side(igi, size.lamps, samples)
    tiles = -(-width // side) * -(-height // side)
    # Tiles at the edges may be smaller, and all have margins.
    share = min(1.0, width * height / (tiles * side * side))
    lights = frames if changes_light(settings) else 1
    pixels, channels = width * height, channels_of(igi)
    reach = sum(margins(igi)[:2])
    tile_bytes = (side + reach) ** 2 * (24 * 3 * igi.bands**2 + 400)
    group = max(1.0, settings.checkpoint_seconds / max(1e-6, tiles * tile_seconds(igi, size.lamps, samples, side)))
    return Estimate(
        seconds=LEAST_SECONDS
        + frames * tiles * share * tile_seconds(igi, size.lamps, samples, side)
        + lights * LIGHTS_SECONDS * igi.vpls,
        memory_bytes=round(
            PROCESS_BYTES
            + TRIANGLE_BYTES * size.triangles
            + 4 * texels
            + max(tile_bytes, 10 * channels * min(pixels, side * side * tiles))
        ),
        disk_bytes=round(MEGABYTE + pixels * (4 * channels + 4) * (frames + min(frames, 1 + group))),
    )


def read_plan(path: Path) -> Plan:
    """Read a plan."""
    return msgspec.json.decode(path.read_bytes(), type=Plan)
