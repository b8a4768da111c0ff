"""Writing simulated captures."""

from __future__ import annotations

import math
import os
import shutil
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.field.buckets import angular_order, bucket_directions
from lightwell.io.angular import AngularStore
from lightwell.io.captures import DOCUMENT, POSES, SORTED, CaptureInfo
from lightwell.io.exr import write_rgb
from lightwell.io.poses import CaptureError, Poses, write_poses
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings
from lightwell.synthetic.rig import Layout, VirtualProbe, place_probes, turns
from lightwell.synthetic.scene import Scene, Vector

MARGIN = 1.01
"""The sphere fills the picture but for 1 %."""
LARGEST_HALF = 65504.0
ANGULAR_BATCH = 256


@dataclass(frozen=True)
class RigSettings:
    """A virtual rig."""

    probes: int
    size: int = 250
    """Height of a frame in pixels; a lat-long frame is twice as wide."""
    probe: Literal["mirror-sphere", "latlong"] = "mirror-sphere"
    sphere_radius_m: float = 0.0458
    sphere_distance_m: float = 1.25
    """Camera to the sphere's centre. The defaults hide a cone of 4.2° (paper 000 §5.1)."""
    forward: Vector = (0.0, 1.0, 0.0)
    """Where the unturned camera looks; its picture's top points up."""
    layout: Layout = "random"
    planes: int = 3
    rotating: bool = False
    samples: int = 2
    """Rays along each side of a pixel."""
    seed: int = 0
    compression: str = "none"

    def mapping(self) -> MappingSettings:
        """Return the mapping of its frames."""
        if self.probe == "latlong":
            return MappingSettings(kind="latlong")
        half = math.asin(self.sphere_radius_m / self.sphere_distance_m)
        return MappingSettings(
            kind="mirror-sphere",
            forward=self.forward,
            up=(0.0, 0.0, 1.0) if abs(self.forward[2]) < 0.9 else (0.0, 1.0, 0.0),
            fov_degrees=2 * math.degrees(math.atan(math.tan(half) * MARGIN)),
            sphere_radius_m=self.sphere_radius_m,
            sphere_distance_m=self.sphere_distance_m,
        )


def simulate_capture(
    directory: Path,
    scene: Scene,
    rig: RigSettings,
    report: Callable[[int, int], None] | None = None,
    *,
    angular: bool = False,
) -> None:
    """Write the capture of a scene to a new folder; ``report(done, total)`` is called as frames are written.

    With ``angular`` there are no frames: samples are stored in angular order as they come, and need not be sorted
    (paper 000 §5.2). The same scene and rig give the same bytes. The folder appears whole or not at all.

    Raises
    ------
    CaptureError
        Where the folder exists, cannot be written, or the sphere is not smaller than its distance.
    """
    if directory.exists():
        raise CaptureError(f"{directory}: exists; give another folder, or delete this one")
    if rig.probe == "mirror-sphere" and not 0 < rig.sphere_radius_m < rig.sphere_distance_m:
        raise CaptureError("--sphere-radius-m must be positive and smaller than --sphere-distance-m")
    width = 2 * rig.size if rig.probe == "latlong" else rig.size
    info = CaptureInfo(name=scene.name, mapping=rig.mapping(), height=rig.size, width=width, scene=scene.to_json())
    mapping = make_mapping(info.mapping, rig.size, width)
    probe = VirtualProbe(mapping, rig.sphere_radius_m, rig.samples)
    positions = place_probes(rig.layout, rig.probes, scene.bounds, rig.seed, rig.planes)
    orientations = np.tile([0.0, 0.0, 0.0, 1.0], (rig.probes, 1))
    if rig.rotating:
        orientations = turns(rig.probes, rig.seed + 1)
    poses = Poses(
        tuple(f"frames/{index:06d}.exr" for index in range(rig.probes)),
        np.arange(rig.probes, dtype=np.int64) * 40_000_000,
        positions,
        orientations,
    )
    partial = directory.with_name(f".{directory.name}.{os.getpid()}.partial")
    try:
        (partial if angular else partial / "frames").mkdir(parents=True)
        (partial / DOCUMENT).write_text(info.model_dump_json(indent=2) + "\n")
        write_poses(partial / POSES, poses)

        def render(index: int) -> NDArray[np.float32]:
            return probe.render(scene, positions[index], orientations[index] if rig.rotating else None)

        def write(index: int) -> None:
            half = np.clip(render(index), -LARGEST_HALF, LARGEST_HALF).astype(np.float16)
            write_rgb(partial / poses.frames[index], half, compression=rig.compression)

        with ThreadPoolExecutor(os.cpu_count()) as pool:
            if angular:
                pixels = probe.rays.pixels
                order = angular_order(bucket_directions(mapping)[1])
                store = AngularStore.create(partial / SORTED, order, rig.probes, ANGULAR_BATCH)
                for first in range(0, rig.probes, ANGULAR_BATCH):
                    batch = range(first, min(first + ANGULAR_BATCH, rig.probes))
                    rows = [picture.reshape(-1, 3)[pixels] for picture in pool.map(render, batch)]
                    store.write_probes(first, np.stack(rows))
                    if report is not None:
                        report(batch.stop, rig.probes)
            else:
                for done, _ in enumerate(pool.map(write, range(rig.probes)), 1):
                    if report is not None:
                        report(done, rig.probes)
        partial.rename(directory)
    except OSError as error:
        raise CaptureError(f"{directory}: cannot be written: {error.strerror}; free space or give another") from None
    finally:
        shutil.rmtree(partial, ignore_errors=True)
