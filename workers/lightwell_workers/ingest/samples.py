"""Sample recordings, made on the first run from the real maps that ship with the package.

Two sequences, each a loop:

``sunset-walk``
    A lat-long panorama of a square through one day: the sun crosses the sky as a disc that reddens towards the
    horizon, and the surroundings pass from night through dusk to day and back.
``mirror-sphere``
    A mirror sphere that turns with its camera through a hall, seen at a finite distance: the picture that a real probe
    camera takes, black behind the sphere.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import LightwellError
from lightwell.io.exr import read_rgb, write_rgb
from lightwell.probe.factory import make_mapping
from lightwell.probe.unwrap import Lookup
from lightwell.settings import BackdropSettings, FieldSettings, GradientsSettings, MappingSettings, StreamSettings
from lightwell.synthetic.room import Room

FRAMES = 120
"""Length of each sequence: four seconds."""
FPS = 30
SPHERE_PIXELS = 256
WRITERS = 2

_MAPS = Path(__file__).resolve().parent.parent / "samples" / "hdri"
_VERSION = 1
"""Part of the folders' names: recordings of an older version are not taken for these."""

MAP_NAMES = ("esplanade", "forest", "hall", "lobby", "night", "studio", "sunset", "venice")

FIELDS = {"room": FieldSettings(streams=("room", "room-side"))}
"""Of the sample streams."""

MIRROR_SPHERE = MappingSettings(kind="mirror-sphere", sphere_radius_m=0.05, sphere_distance_m=1.25, fov_degrees=4.8)
"""A sphere at 1.25 m from the camera, as in paper 003, that all but fills the picture."""

_DAY, _DUSK, _NIGHT = np.array([[1.5, 1.7, 2.0], [1.0, 0.75, 0.55], [0.03, 0.04, 0.08]], dtype=np.float32)
"""Tint of the surroundings with the sun at its highest, at the horizon and at its lowest."""

Image = NDArray[np.float32]


def map_path(name: str) -> Path:
    """Return the path of a real HDR map: lat-long, 512×256, half float, CC0.

    Raises
    ------
    LightwellError
        Where there is no such map; lists those there are.
    """
    if name not in MAP_NAMES:
        raise LightwellError(f"there is no sample map {name!r}; there are: {', '.join(MAP_NAMES)}")
    return _MAPS / f"{name}.exr"


def make_samples(
    directory: str | Path, progress: Callable[[str, int, int], None] | None = None
) -> dict[str, StreamSettings]:
    """Make the sample recordings in ``directory`` where they are missing, and return a stream for each by name.

    A recording appears whole or not at all, and is the same on every machine but for rounding. ``progress`` is called
    with the recording's name, the frames done and the frames in all. The other streams are two probes in the synthetic
    room, with gradients: `FIELDS` combines them.
    """
    directory = Path(directory).resolve()
    streams = {}
    for name, (renderer, mapping) in _RECORDINGS.items():
        folder = directory / f"{name}-v{_VERSION}"
        if not folder.is_dir():
            _record(name, folder, renderer(), progress)
        streams[name] = StreamSettings(source=f"exr:{folder}?fps={FPS}&loop=1", mapping=mapping)
    lower, upper = (tuple(corner.tolist()) for corner in Room().bounds())
    box = GradientsSettings(proxy="box", box_lower_m=lower, box_upper_m=upper)
    streams["room"] = StreamSettings(source="synthetic:room?wall=1", gradients=box)
    streams["room-side"] = StreamSettings(
        source="synthetic:room?wall=1&fps=15&width=128&at=0.7,-0.5,0",
        gradients=box,
        backdrop=BackdropSettings(enabled=False),
    )
    return streams


def _record(
    name: str,
    folder: Path,
    render: Callable[[int], Image],
    progress: Callable[[str, int, int], None] | None,
) -> None:
    """Write the frames to a temporary folder beside ``folder``, then rename it."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = Path(mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))

    def write(number: int) -> None:
        write_rgb(temporary / f"frame.{number:04d}.exr", render(number).astype(np.float16))

    try:
        with ThreadPoolExecutor(WRITERS) as writers:
            for done, _ in enumerate(writers.map(write, range(FRAMES)), start=1):
                if progress is not None:
                    progress(name, done, FRAMES)
        temporary.chmod(0o755)
        temporary.rename(folder)
    except OSError:
        if not folder.is_dir():  # somebody else's recording is as good as ours
            raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _sunset_walk() -> Callable[[int], Image]:
    square = np.minimum(_radiance("sunset"), 8.0)  # the photographed sun gives way to the moving one
    latlong = make_mapping(MappingSettings(), square.shape[0], square.shape[1])
    x, y = latlong.pixel_centres()
    directions = latlong.directions(x, y)[0].astype(np.float32)

    def render(number: int) -> Image:
        phase = 2 * math.pi * number / FRAMES  # the loop begins and ends with the sun below the horizon
        height = -math.cos(phase)
        elevation = math.radians(65) * height
        azimuth = math.pi * (1.0 + math.sin(phase / 2 - math.pi / 2) * 0.6)
        day, night = max(height, 0.0), max(-height, 0.0)
        dusk = 1.0 - day - night
        tint = day * _DAY + dusk * _DUSK + night * _NIGHT
        towards_sun = np.array(
            [math.cos(elevation) * math.cos(azimuth), math.cos(elevation) * math.sin(azimuth), math.sin(elevation)],
            dtype=np.float32,
        )
        return np.asarray(square * tint + _sun_disc(directions @ towards_sun, height), dtype=np.float32)

    return render


def _sun_disc(cosine: Image, height: float) -> Image:
    """Return the light of a sun of 3° radius with a soft rim; blue is lost first as it sinks."""
    rim, core = math.cos(math.radians(4.0)), math.cos(math.radians(3.0))
    disc = np.clip((cosine - rim) / (core - rim), 0.0, 1.0)
    path = 1.0 / max(height + 0.08, 0.04)  # of the sun's rays through the air, in vertical depths
    colour = 400.0 * np.exp(-np.array([0.08, 0.17, 0.32]) * path) * min(max((height + 0.08) / 0.16, 0.0), 1.0)
    return np.asarray(disc[..., None] * colour, dtype=np.float32)


def _mirror_sphere() -> Callable[[int], Image]:
    surroundings = _radiance("hall")
    height, width = surroundings.shape[:2]
    latlong = make_mapping(MappingSettings(), height, width)
    sphere = make_mapping(MIRROR_SPHERE, SPHERE_PIXELS, SPHERE_PIXELS)
    rays = np.arange(2 * SPHERE_PIXELS) / 2 + 0.25  # two by two a pixel
    directions, seen = sphere.directions(rays[None, :], rays[:, None])
    lookup = Lookup(latlong, directions.reshape(-1, 3))

    def render(number: int) -> Image:
        turned = np.roll(surroundings, round(width * number / FRAMES), axis=1)  # about world +Z
        light = lookup(turned).reshape(directions.shape) * seen[..., None]
        return np.asarray(light.reshape(SPHERE_PIXELS, 2, SPHERE_PIXELS, 2, 3).mean(axis=(1, 3)), dtype=np.float32)

    return render


def _radiance(name: str) -> Image:
    return np.maximum(read_rgb(map_path(name)).pixels.astype(np.float32), 0.0)


_RECORDINGS: dict[str, tuple[Callable[[], Callable[[int], Image]], MappingSettings]] = {
    "sunset-walk": (_sunset_walk, MappingSettings()),
    "mirror-sphere": (_mirror_sphere, MIRROR_SPHERE),
}
