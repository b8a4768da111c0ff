"""Direction buckets: every pixel of a fixed probe always looks along the same direction (paper 000 §3).

All samples of a capture that one pixel took form a bucket. For a mirror sphere the ray of a pixel misses the sphere's
centre by a constant offset, so that the correction of its non-single viewpoint is one shift of the bucket's sample
points (MATHS §3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.field.plane import AXES, layer_axes
from lightwell.probe.mapping import Mapping
from lightwell.probe.matrix import footprint_matrix, unseen_moments
from lightwell.probe.mirror_sphere import MirrorSphere
from lightwell.probe.reduced import ReducedMapping
from lightwell.probe.rim import rim_weights
from lightwell.sh.basis import evaluate

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Buckets:
    """What the Q directions of a capture stand for."""

    directions: Floats
    """``(Q, 3)`` unit vectors in world axes, towards the light."""
    rows: Floats
    """``(Q, bands²)``: what radiance 1 in a bucket adds to each coefficient."""
    weights: Floats
    """``(Q,)`` solid angles, steradian."""
    offsets: Floats
    """``(Q, 3)`` metres: from the probe's position to the nearest point of the bucket's ray; ⟂ to its direction."""
    pixels: NDArray[np.int64]
    """``(Q,)`` flat index of the pixel in the frame; empty where frames are gathered to common directions."""


def make_buckets(
    mapping: Mapping,
    bands: int,
    weights: Literal["solid-angle", "paper"] = "solid-angle",
    blind: Literal["fill", "zero"] = "fill",
    sphere_radius_m: float | None = None,
) -> Buckets:
    """Return the buckets of a probe of fixed orientation: one for each pixel that is read.

    ``weights`` = ``solid-angle`` integrates the basis over each pixel's footprint; ``paper`` takes the basis at its
    centre times the constant 4π/N. With ``blind`` = ``fill``, what no pixel sees has the mean radiance of the rim.
    ``sphere_radius_m`` scales the offsets of a mirror sphere; None leaves them out (a single viewpoint).
    """
    pixels, directions = bucket_directions(mapping)
    row, column = np.divmod(pixels, mapping.width)
    if weights == "paper":
        rows = evaluate(directions, bands) * (4 * math.pi / pixels.size)
        if blind == "fill":
            rows += np.outer(rim_weights(mapping)[pixels], unseen_moments(rows.sum(axis=0)))
        solid_angles = np.full(pixels.size, 4 * math.pi / pixels.size)
    else:
        region = mapping.region
        width = region.col1 - region.col0
        matrix = footprint_matrix(mapping, bands)
        if blind == "fill":
            rim = rim_weights(mapping).reshape(mapping.height, mapping.width)
            inner = rim[region.row0 : region.row1, region.col0 : region.col1]
            matrix += np.outer(inner, unseen_moments(matrix.sum(axis=0)))
        rows = matrix[(row - region.row0) * width + column - region.col0]
        solid_angles = rows[:, 0] * math.sqrt(4 * math.pi)
    offsets = np.zeros((pixels.size, 3))
    if sphere_radius_m is not None:
        offsets = sphere_radius_m * unit_offsets(mapping, directions)
    return Buckets(directions, rows, solid_angles, offsets, pixels)


def bucket_directions(mapping: Mapping) -> tuple[NDArray[np.int64], Floats]:
    """Return the flat indices ``(Q,)`` of the pixels that are read, and their directions ``(Q, 3)``."""
    pixels = np.flatnonzero(mapping.solid_angles().reshape(-1) > 0)
    row, column = np.divmod(pixels, mapping.width)
    return pixels, mapping.directions(*mapping.nearest_covered(column + 0.5, row + 0.5))[0]


def angular_order(directions: Floats) -> NDArray[np.int64]:
    """Return an order of directions ``(Q, 3)``, such that those that are resampled together lie together.

    Directions of one layer axis follow each other by their slope along v (`lightwell.field.plane`).
    """
    axis = layer_axes(directions)
    v_axis = np.array([v for _, v in AXES])[axis]
    rows = np.arange(len(directions))
    slope = directions[rows, v_axis] / directions[rows, axis]
    return np.lexsort([slope, axis]).astype(np.int64)


def unit_offsets(mapping: Mapping, directions: Floats) -> Floats:
    """Return the offsets ``(Q, 3)`` of the rays of a mirror sphere of radius 1 m; zero for every other mapping.

    ``o = R (n − (n·ω) ω)`` with the normal n of the point that reflects ω to the camera; ``|o| = R sin i`` (MATHS §3).
    """
    source = mapping.source if isinstance(mapping, ReducedMapping) else mapping
    if not isinstance(source, MirrorSphere):
        return np.zeros_like(directions)
    assert source.blind_axis is not None
    return sphere_offsets(directions, source.blind_axis, source.view.ratio)


def sphere_offsets(directions: Floats, axis: Floats, ratio: float) -> Floats:
    """Return ``n − (n·ω) ω`` for directions ω ``(…, 3)`` seen in a sphere of radius over distance ``ratio``.

    ``axis`` ``(…, 3)`` is the unit vector from the camera to the sphere's centre. With β = ∠(ω, −axis), the angle of
    incidence solves ``2i − asin(k sin i) = β``; the offset has the length sin i and is perpendicular to ω.
    """
    along = np.sum(directions * axis, axis=-1)
    across = directions - along[..., None] * axis
    sine = np.linalg.norm(across, axis=-1)
    beta = np.arctan2(sine, -along)
    incidence = beta / 2
    for _ in range(4):
        k_sine = ratio * np.sin(incidence)
        slope = 2 - ratio * np.cos(incidence) / np.sqrt(1 - k_sine * k_sine)
        incidence = incidence - (2 * incidence - np.arcsin(k_sine) - beta) / slope
    sideways = across / np.maximum(sine, 1e-300)[..., None]
    # The normal lies between −axis and ω: from ω it is turned by the angle i towards −axis.
    perpendicular = -(np.cos(beta)[..., None] * sideways + np.sin(beta)[..., None] * axis)
    return np.asarray(np.sin(np.minimum(incidence, math.pi / 2))[..., None] * perpendicular)
