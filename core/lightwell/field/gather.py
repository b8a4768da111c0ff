"""Probes that are turned: all alike, or differently and sampled at common world directions (MATHS §3, rotating rig)."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count
from lightwell.field.buckets import Buckets, sphere_offsets
from lightwell.field.spec import Floats
from lightwell.probe.mapping import Mapping
from lightwell.probe.mirror_sphere import MirrorSphere
from lightwell.probe.reduced import ReducedMapping
from lightwell.sh.basis import evaluate
from lightwell.sh.rotation import rotation_matrix

GOLDEN_ANGLE = math.pi * (3 - math.sqrt(5))


def gathered_buckets(count: int, bands: int) -> Buckets:
    """Return ``count`` directions of equal solid angle on a Fibonacci spiral."""
    z = 1 - (2 * np.arange(count) + 1) / count
    phi = GOLDEN_ANGLE * np.arange(count)
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], axis=1)
    weights = np.full(count, 4 * math.pi / count)
    rows = evaluate(directions, bands) * weights[:, None]
    return Buckets(directions, rows, weights, np.zeros((count, 3)), np.empty(0, np.int64))


def turn_buckets(buckets: Buckets, turn: Floats) -> Buckets:
    """Return the buckets of a probe that stands turned by ``turn`` ``(3, 3)``, which takes its axes to the world's."""
    bands = bands_of_count(buckets.rows.shape[1])
    return replace(
        buckets,
        directions=buckets.directions @ turn.T,
        rows=buckets.rows @ rotation_matrix(turn, bands).T,
        offsets=buckets.offsets @ turn.T,
    )


def gather(frame: NDArray[np.float32], mapping: Mapping, directions: Floats, turn: Floats) -> NDArray[np.float32]:
    """Return a frame's samples ``(Q, 3)`` float32 in world ``directions`` ``(Q, 3)``; NaN where the probe sees nothing.

    ``turn`` ``(3, 3)`` takes the unturned rig's axes to the world's. Bilinear between the pixels that are read.
    """
    x, y, seen = mapping.pixels(directions @ turn)
    left, top = np.floor(x - 0.5), np.floor(y - 0.5)
    fx, fy = (x - 0.5 - left)[:, None], (y - 0.5 - top)[:, None]
    covered = mapping.coverage()
    total, weight = np.zeros((len(x), 3)), np.zeros((len(x), 1))
    for dy, wy in ((0, 1 - fy), (1, fy)):
        for dx, wx in ((0, 1 - fx), (1, fx)):
            column, row = left + dx, top + dy
            if mapping.is_round:
                column = np.clip(column, 0, mapping.width - 1)
            column = (column % mapping.width).astype(np.intp)  # a lat-long picture goes round
            row = np.clip(row, 0, mapping.height - 1).astype(np.intp)
            w = wx * wy * covered[row, column][:, None]
            total += np.where(w > 0, w * frame[row, column], 0)
            weight += w
    out = np.full((len(x), 3), np.nan, np.float32)
    known = seen & (weight[:, 0] > 0.25)
    out[known] = (total[known] / weight[known]).astype(np.float32)
    return out


def turned_offsets(mapping: Mapping, directions: Floats, turns: Floats, sphere_radius_m: float) -> Floats:
    """Return the offsets ``(K, P, 3)`` in metres of the rays of P turned mirror spheres; zero for other mappings."""
    source = mapping.source if isinstance(mapping, ReducedMapping) else mapping
    if not isinstance(source, MirrorSphere):
        return np.zeros((len(directions), len(turns), 3))
    assert source.blind_axis is not None
    axes = turns @ source.blind_axis
    ratio = source.view.ratio
    spread = np.broadcast_to(directions[:, None], (len(directions), len(turns), 3))
    return sphere_radius_m * sphere_offsets(spread, np.broadcast_to(axes, spread.shape), ratio)
