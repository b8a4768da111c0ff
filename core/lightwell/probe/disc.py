"""What the round mappings share: a disc in the picture, its outline, and the pixels that straddle it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from lightwell.conventions import DEFAULT_FORWARD, DEFAULT_UP, world_from_camera
from lightwell.errors import MappingError
from lightwell.probe.footprint import centre_footprints, gauss_footprints, rim_footprints, sum_solid_angles
from lightwell.probe.mapping import Bools, Floats, Mapping, Samples

Disc = tuple[float, float, float]


def camera_rotation(forward: tuple[float, float, float], up: tuple[float, float, float]) -> Floats:
    """Return `world_from_camera`, with a `MappingError` that names the options where the axes are bad."""
    try:
        return world_from_camera(forward, up)
    except ValueError as error:
        raise MappingError(f"--forward and --up do not span a camera's axes: {error}") from None


class RoundMapping(Mapping):
    """A probe that a camera sees as a round spot.

    Subclasses give directions, pixels and density; the outline and the rim are handled here.
    """

    is_round = True

    @property
    def rim_is_weightless(self) -> bool:
        """Whether pixels at the outline see next to nothing, so that the background mixed into them does no harm."""
        return False

    def __init__(
        self,
        height: int,
        width: int,
        centre: tuple[float, float],
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        super().__init__(height, width)
        self.centre = centre
        self.world_from_camera = camera_rotation(forward, up)

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, self.centre, self.world_from_camera.tobytes())

    @cached_property
    def _corners_seen(self) -> Bools:
        """Whether the probe is seen at each corner of the pixel grid, ``(H+1, W+1)``."""
        return self.sees(np.arange(self.width + 1)[None, :], np.arange(self.height + 1)[:, None])

    @cached_property
    def _coverage(self) -> Bools:
        if self.rim_is_weightless:
            return self.sees(*self.pixel_centres())
        seen = self._corners_seen
        return seen[:-1, :-1] & seen[1:, :-1] & seen[:-1, 1:] & seen[1:, 1:]

    def coverage(self) -> Bools:
        """Return which pixels are read, ``(H, W)``: those with all four corners on the probe (outlines are convex).

        Where the rim is weightless, those with their centre on the probe.
        """
        return self._coverage

    def _straddling(self) -> Bools:
        """Return which pixels may show some of the probe without being covered, ``(H, W)``."""
        seen = self._corners_seen
        touching = seen[:-1, :-1] | seen[1:, :-1] | seen[:-1, 1:] | seen[1:, 1:]
        # An outline may cut an edge twice and leave both corners outside: take the neighbours too.
        wide = touching.copy()
        wide[1:] |= touching[:-1]
        wide[:-1] |= touching[1:]
        wide[:, 1:] |= touching[:, :-1]
        wide[:, :-1] |= touching[:, 1:]
        return wide & ~self._coverage

    def _holds_outline(self) -> bool:
        """Return whether the outline lies within the picture; it may touch the frame in a point."""
        seen = self._corners_seen
        return all(np.count_nonzero(side) <= 2 for side in (seen[0], seen[-1], seen[:, 0], seen[:, -1]))

    def nearest_covered(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Move points that lie in no covered pixel towards the disc's centre until they do, in quarter-pixel steps."""
        points = np.array(np.broadcast_arrays(x, y), dtype=np.float64)
        flat_x = np.clip(points[0], 0, self.width - 1e-9).reshape(-1)
        flat_y = np.clip(points[1], 0, self.height - 1e-9).reshape(-1)
        todo = np.arange(flat_x.size)
        while True:
            covered = self._coverage[flat_y[todo].astype(np.intp), flat_x[todo].astype(np.intp)]
            dx, dy = self.centre[0] - flat_x[todo], self.centre[1] - flat_y[todo]
            distance = np.hypot(dx, dy)
            moving = ~covered & (distance > 0.25)
            if not moving.any():
                return flat_x.reshape(points.shape[1:]), flat_y.reshape(points.shape[1:])
            todo, step = todo[moving], 0.25 / distance[moving]
            flat_x[todo] += step * dx[moving]
            flat_y[todo] += step * dy[moving]

    def footprints(self) -> Iterator[Samples]:
        """Yield Gauss–Legendre samples of the covered pixels, then those of the pixels that straddle the outline.

        The latter go to the nearest covered pixel. Where the picture holds the whole outline they are scaled so that
        everything makes up the solid angle that the probe shows. Where the rim is weightless, every pixel that is
        read has one sample, its centre.
        """
        if self.rim_is_weightless:
            pixel, direction, solid_angle = centre_footprints(self, self._coverage, self.density(*self.pixel_centres()))
            if self._holds_outline():
                solid_angle = solid_angle * (self.seen_solid_angle / solid_angle.sum())
            yield pixel, direction, solid_angle
            return
        total = 0.0
        for samples in gauss_footprints(self, self._coverage):
            total += float(samples[2].sum())
            yield samples
        pixel, direction, solid_angle = rim_footprints(self, self._straddling())
        if self._holds_outline() and pixel.size:
            solid_angle = solid_angle * ((self.seen_solid_angle - total) / solid_angle.sum())
        yield pixel, direction, solid_angle

    @cached_property
    def _solid_angles(self) -> Floats:
        return sum_solid_angles(self)

    def solid_angles(self) -> Floats:
        """Return the solid angles ``(H, W)``: footprints of covered pixels, the rim's share given to its neighbours."""
        return self._solid_angles


class CentredDiscMapping(RoundMapping):
    """A disc of given centre and radius, scaled to ``[−1, 1]²`` with x right and y up."""

    def __init__(
        self,
        height: int,
        width: int,
        disc: Disc | None = None,
        forward: tuple[float, float, float] = DEFAULT_FORWARD,
        up: tuple[float, float, float] = DEFAULT_UP,
    ) -> None:
        cx, cy, radius = disc if disc is not None else (width / 2, height / 2, min(width, height) / 2)
        super().__init__(height, width, (cx, cy), forward, up)
        if radius <= 0:
            raise MappingError(f"--disc: the radius must be positive, not {radius:g} pixels")
        self.radius = radius
        check_disc_is_imaged(self, (cx, cy, radius))

    @property
    def key(self) -> tuple[object, ...]:
        """Hashable identity."""
        return (*super().key, self.radius)

    def disc_from_picture(self, x: ArrayLike, y: ArrayLike) -> tuple[Floats, Floats]:
        """Return picture points in disc coordinates: centre (0, 0), outline at radius 1, x right, y up."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
        return (x - self.centre[0]) / self.radius, (self.centre[1] - y) / self.radius

    def sees(self, x: ArrayLike, y: ArrayLike) -> Bools:
        """Return whether picture points lie on the disc."""
        u, v = self.disc_from_picture(x, y)
        return u * u + v * v <= 1 + 1e-12

    def picture_from_disc(self, u: Floats, v: Floats) -> tuple[Floats, Floats]:
        """Return disc coordinates as picture points."""
        return self.centre[0] + u * self.radius, self.centre[1] - v * self.radius


def check_disc_is_imaged(mapping: RoundMapping, disc: Disc) -> None:
    """Raise `MappingError` where the picture does not hold the disc's centre or no pixel fits into the disc."""
    cx, cy, radius = disc
    if not (0 <= cx <= mapping.width and 0 <= cy <= mapping.height):
        raise MappingError(
            f"--disc: the centre ({cx:g}, {cy:g}) lies outside the picture of {mapping.width}×{mapping.height} pixels"
        )
    if radius < 2:
        raise MappingError(f"the probe's disc has a radius of {radius:g} pixels: too small to read")
    if radius > 4 * max(mapping.height, mapping.width):
        raise MappingError(
            f"the probe's disc has a radius of {radius:g} pixels: far larger than the picture of "
            f"{mapping.width}×{mapping.height}; check --disc and --fov-degrees"
        )
