"""The virtual capture rig: where probes stand, and what a probe shows there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numba import njit
from numpy.typing import NDArray

from lightwell.field.buckets import unit_offsets
from lightwell.probe.mapping import Mapping
from lightwell.probe.mirror_sphere import MirrorSphere
from lightwell.synthetic.scene import Floats, Scene, Vector
from lightwell.synthetic.tracing import trace_one

Layout = Literal["random", "planes", "raster"]


def place_probes(layout: Layout, count: int, bounds: tuple[Vector, Vector], seed: int, planes: int = 3) -> Floats:
    """Return positions ``(count, 3)`` in metres within the box ``bounds``.

    ``random`` fills the volume evenly; ``planes`` scatters over horizontal planes, as in the paper's figure 2;
    ``raster`` moves to and fro through the volume as a translation stage does.
    """
    generator = np.random.default_rng(seed)
    lower, size = np.array(bounds[0]), np.subtract(bounds[1], bounds[0])
    if layout == "random":
        unit = generator.random((count, 3))
    elif layout == "planes":
        unit = generator.random((count, 3))
        unit[:, 2] = (np.arange(count) % planes + 0.5) / planes
    else:
        side = int(np.ceil(count ** (1 / 3)))
        x, y, z = np.unravel_index(np.arange(count), (side, side, side))[::-1]
        y = np.where(z % 2 == 1, side - 1 - y, y)
        x = np.where((y + z) % 2 == 1, side - 1 - x, x)
        unit = (np.stack([x, y, z], axis=1) + 0.5) / side
    return np.asarray(lower + unit * size)


def turns(count: int, seed: int) -> Floats:
    """Return random rotations as quaternions ``(count, 4)``, x y z w (Shoemake 1992)."""
    u = np.random.default_rng(seed).random((count, 3))
    a, b = 2 * np.pi * u[:, 1], 2 * np.pi * u[:, 2]
    short, long = np.sqrt(1 - u[:, 0]), np.sqrt(u[:, 0])
    return np.stack([short * np.sin(a), short * np.cos(a), long * np.sin(b), long * np.cos(b)], axis=1)


def rotation_of(quaternion: Floats) -> Floats:
    """Return the rotation matrix ``(…, 3, 3)`` of unit quaternions ``(…, 4)``, x y z w."""
    x, y, z, w = np.moveaxis(np.asarray(quaternion, dtype=np.float64), -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


@dataclass(frozen=True)
class Rays:
    """The rays of a probe at the origin, unturned: ``(pixels, samples, 3)`` each."""

    pixels: NDArray[np.int64]
    starts: Floats
    directions: Floats


class VirtualProbe:
    """A mirror sphere and its camera, or an ideal probe of a single viewpoint."""

    def __init__(self, mapping: Mapping, sphere_radius_m: float, samples: int = 2) -> None:
        """Prepare the rays: ``samples``² a pixel; a mirror sphere's rays start on its surface."""
        self.shape = (mapping.height, mapping.width)
        pixels = np.flatnonzero(mapping.solid_angles().reshape(-1) > 0)
        step = (np.arange(samples) + 0.5) / samples
        y, x = (part.reshape(-1) for part in np.meshgrid(step, step, indexing="ij"))
        row, column = np.divmod(pixels, mapping.width)
        directions, _ = mapping.directions(column[:, None] + x, row[:, None] + y)
        starts = np.zeros_like(directions)
        if isinstance(mapping, MirrorSphere):
            # A ray is the same wherever on it one starts: take the point next to the sphere's centre.
            starts = sphere_radius_m * unit_offsets(mapping, directions)
        self.rays = Rays(pixels, starts, directions)

    def render(self, scene: Scene, position: Floats, quaternion: Floats | None = None) -> NDArray[np.float32]:
        """Return the probe's picture at ``position``, ``(H, W, 3)`` float32; black where no probe is seen."""
        out = np.zeros((self.shape[0] * self.shape[1], 3), np.float32)
        turn = np.eye(3) if quaternion is None else rotation_of(quaternion)
        _render(
            np.asarray(position, dtype=np.float64),
            turn,
            self.rays.pixels,
            self.rays.starts,
            self.rays.directions,
            *scene.tables(),
            out,
        )
        return out.reshape(*self.shape, 3)


@njit(cache=True, nogil=True)
def _render(position, turn, pixels, starts, directions, emitters, room, far, out):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    o, d, total, light, scratch = np.empty(3), np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for i in range(pixels.shape[0]):
        total[:] = 0.0
        for j in range(directions.shape[1]):
            for axis in range(3):
                o[axis], d[axis] = position[axis], 0.0
                for k in range(3):
                    o[axis] += turn[axis, k] * starts[i, j, k]
                    d[axis] += turn[axis, k] * directions[i, j, k]
            trace_one(o, d, emitters, room, far, light, scratch)
            for channel in range(3):
                total[channel] += light[channel]
        for channel in range(3):
            out[pixels[i], channel] = total[channel] / directions.shape[1]
