"""Samples of every pixel's footprint on the sphere: the quadrature behind solid angles and projection matrices.

Where all pixels see little of the sphere, one sample does: the centre, with the pixel's solid angle. But a pixel of a
mirror can see a large and curved piece: at the rim of a mirror sphere of 250 pixels the last ring of pixels spans 14°
(MATHS §3). Such footprints are integrated with several points.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from lightwell.probe.mapping import Bools, Floats, Mapping, Samples

RIM_SAMPLES = 16
"""Samples a side in pixels that straddle the outline."""
BLOCK_SAMPLES = 1 << 16
"""Samples worked on at a time; their arrays stay in the cache."""
TOTAL_SAMPLES = 1 << 21
"""Aim for the whole picture: small pictures get more points a pixel."""


def samples_a_side(pixels: int) -> int:
    """Return how many Gauss points a pixel gets along each axis: 4 for small pictures, 1 for full frames."""
    return int(np.clip(np.sqrt(TOTAL_SAMPLES / max(pixels, 1)), 1, 4))


def gauss_footprints(mapping: Mapping, pixels: Bools) -> Iterator[Samples]:
    """Yield a Gauss–Legendre grid of samples in each of the chosen pixels ``(H, W)``."""
    rows, cols = np.nonzero(pixels)
    points = samples_a_side(rows.size)
    nodes, weights = np.polynomial.legendre.leggauss(points)
    across, down = (grid.reshape(-1) for grid in np.meshgrid(nodes / 2 + 0.5, nodes / 2 + 0.5))
    area = np.outer(weights / 2, weights / 2).reshape(-1)
    block = BLOCK_SAMPLES // points**2
    for start in range(0, rows.size, block):
        i, j = rows[start : start + block, None], cols[start : start + block, None]
        x, y = (j + across).reshape(-1), (i + down).reshape(-1)
        solid_angle = mapping.density(x, y) * np.tile(area, i.size)
        yield np.repeat((i * mapping.width + j)[:, 0], points**2), mapping.directions(x, y)[0], solid_angle


def centre_footprints(mapping: Mapping, pixels: Bools, solid_angles: Floats) -> Samples:
    """Return one sample for each of the chosen pixels ``(H, W)``: its centre, with its solid angle of ``(H, W)``."""
    rows, cols = np.nonzero(pixels)
    return rows * mapping.width + cols, mapping.directions(cols + 0.5, rows + 0.5)[0], solid_angles[rows, cols]


def rim_footprints(mapping: Mapping, pixels: Bools) -> Samples:
    """Return samples of the chosen pixels ``(H, W)`` that see the probe, given to the nearest covered pixel."""
    offsets = (np.arange(RIM_SAMPLES) + 0.5) / RIM_SAMPLES
    across, down = (grid.reshape(-1) for grid in np.meshgrid(offsets, offsets))
    rows, cols = np.nonzero(pixels)
    x, y = (cols[:, None] + across).reshape(-1), (rows[:, None] + down).reshape(-1)
    directions, seen = mapping.directions(x, y)
    x, y = x[seen], y[seen]
    near_x, near_y = mapping.nearest_covered(x, y)
    pixel = np.floor(near_y).astype(np.intp) * mapping.width + np.floor(near_x).astype(np.intp)
    return pixel, directions[seen], mapping.density(x, y) / RIM_SAMPLES**2


def sum_solid_angles(mapping: Mapping) -> Floats:
    """Return the solid angle of each pixel ``(H, W)``: the sum over its samples."""
    table = np.zeros(mapping.height * mapping.width)
    for pixel, _, solid_angle in mapping.footprints():
        np.add.at(table, pixel, solid_angle)
    return table.reshape(mapping.height, mapping.width)
