"""Incident radiance of pixels: what each gets of its set of virtual lights (paper 004 §3.2; MATHS §10).

A block of pixels that are neighbours in the pattern of one set looks at all lights of the set: those above its
geometric horizon that shine its way get a shadow ray each, all rays of a batch go to Embree in one call, and what
arrives is added to the pixels' coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from lightwell.conventions import coefficient_count
from lightwell.geometry.rays import RayScene
from lightwell.igi import kernels
from lightwell.igi.lights import CAPTURED, LightSets
from lightwell.render.light import StaticField
from lightwell.sh.basis import RECURRENCE_A, RECURRENCE_AB, SECTORAL_RATIO, Y00, evaluate

BLOCK_SIDE = 16
"""Pixels of one set along each side of a block; the results do not depend on it."""
MOST_PIXELS = 592
"""Room for those of a block, whose sides may be half as long again; no power of two, so that rows do not fall on each
other in the cache."""
LIGHTS_AT_ONCE = 64
"""16,384 rays a batch: with what else is needed they stay in the cache."""


class Gathered(NamedTuple):
    """What pixels get."""

    coefficients: NDArray[Any]
    """``(H, W, G, bands², 3)``: of incident radiance; G = 2: direct and bounced apart, 1: together."""
    arrived: float
    """Light that arrived, summed over pixels, lights and channels."""
    clamped: float
    """What would have come on top without the clamp."""
    rays: int
    """Shadow rays that were sent."""


@dataclass(frozen=True, eq=False)
class _Lights:
    """`LightSets` as the kernels read them: of one dtype, components first."""

    kind: NDArray[np.uint8]
    position: NDArray[Any]
    normal: NDArray[Any]
    flux: NDArray[Any]
    least: NDArray[Any]
    falloff: NDArray[Any]
    harmonics: NDArray[Any]


class Gatherer:
    """Gathers for one scene and its lights; immutable, for any number of threads."""

    def __init__(
        self,
        rays: RayScene,
        sets: LightSets,
        bands: int,
        dtype: DTypeLike = np.float32,
        field: StaticField | None = None,
    ) -> None:
        """Take the field that captured lights are of.

        With float64 as ``dtype`` identities can be checked to the last digits; rays are in single precision always.
        """
        self._field = field
        self._rays = rays
        self._sets = sets
        self._bands = bands
        self._dtype = np.dtype(dtype)

        def columns(array: NDArray[Any]) -> NDArray[Any]:
            return np.ascontiguousarray(array.T, dtype=self._dtype)

        lights = sets.lights
        self._lights = _Lights(
            lights.kind,
            columns(lights.position),
            columns(lights.normal),
            columns(lights.flux),
            lights.least.astype(self._dtype),
            columns(lights.falloff),
            self._harmonics(),
        )
        tables = (RECURRENCE_A[:bands, :bands], RECURRENCE_AB[:bands, :bands], SECTORAL_RATIO[:bands], np.array([Y00]))
        self._tables = tuple(np.ascontiguousarray(table, dtype=self._dtype) for table in tables)

    def gather(
        self,
        places: NDArray[np.floating],
        normals: NDArray[np.floating],
        seen: NDArray[np.bool_],
        corner: tuple[int, int] = (0, 0),
        groups: int = 2,
        check: Callable[[], None] | None = None,
    ) -> Gathered:
        """Return what the pixels of a rectangle get.

        Parameters
        ----------
        places, normals
            ``(H, W, 3)`` metres, lifted off the surface, and geometric normals, on the side that is seen.
        seen
            ``(H, W)``: which pixels show a surface; the others get nothing.
        corner
            Column x and row y of the first pixel in the picture: they say whose turn which set is. May be negative.
        groups
            2: light straight from sources and after bounces apart; 1: together.
        check
            Called between blocks; what it raises ends the work.
        """
        height, width = seen.shape
        out = np.zeros((height, width, groups, self._bands**2, 3), self._dtype)
        room = _Room(self._dtype, groups)
        clamped, rays = 0.0, 0
        for which, rows, columns in self._blocks(height, width, corner):
            if check is not None:
                check()
            part = seen[: rows.stop, : columns.stop]
            found = kernels.find(part, rows.start, columns.start, rows.step, columns.step, room.rows, room.columns)
            if found:
                chosen = room.rows[:found], room.columns[:found]
                pixels = np.empty((6, found), self._dtype)
                kernels.load(places, normals, chosen[0], chosen[1], pixels)
                sums = self._block(which, pixels, self._captured(places[chosen]), room)
                kernels.store(sums.values, chosen[0], chosen[1], out)
                clamped, rays = clamped + sums.clamped, rays + sums.rays
        return Gathered(out, float(out[..., 0, :].sum(dtype=np.float64) / Y00), clamped, rays)

    def _blocks(self, height: int, width: int, corner: tuple[int, int]) -> Iterator[tuple[int, slice, slice]]:
        """Yield sets and the rows and columns of their blocks."""
        n, m = self._sets.pattern
        for down in _runs(height, m):
            for across in _runs(width, n):
                for first_row in range(min(m, down.stop - down.start)):
                    for first_column in range(min(n, across.stop - across.start)):
                        row, column = down.start + first_row, across.start + first_column
                        which = (column + corner[0]) % n + n * ((row + corner[1]) % m)
                        yield which, slice(row, down.stop, m), slice(column, across.stop, n)

    def _harmonics(self) -> NDArray[Any]:
        """Return what makes radiance of the field's coefficients, ``(N, bands'²)``; zero for lights of other kinds."""
        lights = self._sets.lights
        if self._field is None:
            return np.empty((0, 0), self._dtype)
        found = np.zeros((lights.count, coefficient_count(self._field.bands)), self._dtype)
        captured = lights.kind == CAPTURED
        found[captured] = evaluate(lights.normal[captured], self._field.bands)
        return found

    def _captured(self, places: NDArray[np.floating]) -> NDArray[Any]:
        """Return the field's coefficients at places ``(P, 3)``, ``(bands'², 3, P)``."""
        if self._field is None:
            return np.empty((0, 3, len(places)), self._dtype)
        found = self._field.at(places.astype(np.float64))
        return np.ascontiguousarray(np.moveaxis(found, 0, -1), self._dtype)

    def _block(self, which: int, pixels: NDArray[Any], own: NDArray[Any], room: _Room) -> _BlockSums:
        count = pixels.shape[1]
        sets, lights = self._sets, self._lights
        a, ab, diagonal, lowest = self._tables
        start, middle, stop = int(sets.starts[which]), int(sets.bounced[which]), int(sets.starts[which + 1])
        values = np.zeros((room.groups, self._bands**2, 3, count), self._dtype)
        clamped, rays = 0.0, 0
        basis, scratch = np.empty((self._bands**2, count), self._dtype), np.empty((4, count), self._dtype)
        for first in range(start, stop, LIGHTS_AT_ONCE):
            last = min(first + LIGHTS_AT_ONCE, stop)
            kernels.look_at_lights(
                pixels,
                lights.kind,
                lights.position,
                lights.normal,
                lights.least,
                lights.falloff,
                first,
                last,
                room.sight,
                scratch,
            )
            used = kernels.shadow_rays(
                pixels,
                lights.kind,
                lights.position,
                lights.normal,
                first,
                last,
                room.sight,
                room.origins,
                room.directions,
                room.ends,
                room.index,
            )
            blocked = self._rays.occluded(room.origins[:used], room.directions[:used], room.ends[:used])
            kernels.darken(blocked, used, room.index, count, room.sight)
            rays += used
            split = min(max(middle, first), last) if room.groups == 2 else last
            for group, begin, end in ((0, first, split), (1, split, last)):
                if begin == end:
                    continue
                clamped += kernels.add_lights(
                    room.sight,
                    begin - first,
                    count,
                    lights.kind,
                    lights.flux,
                    lights.least,
                    lights.harmonics,
                    own,
                    begin,
                    end,
                    self._bands,
                    a,
                    ab,
                    diagonal,
                    lowest,
                    basis,
                    scratch,
                    values[group],
                )
        return _BlockSums(values, clamped, rays)


class _BlockSums(NamedTuple):
    values: NDArray[Any]
    """``(G, bands², 3, P)``."""
    clamped: float
    rays: int


class _Room:
    """Memory of one thread."""

    def __init__(self, dtype: np.dtype[Any], groups: int) -> None:
        most = MOST_PIXELS * LIGHTS_AT_ONCE
        self.groups = groups
        self.rows = np.empty(MOST_PIXELS, np.int32)
        self.columns = np.empty(MOST_PIXELS, np.int32)
        self.origins = np.empty((most, 3), np.float32)
        self.directions = np.empty((most, 3), np.float32)
        self.ends = np.empty(most, np.float32)
        self.index = np.empty(most, np.int32)
        self.sight = np.empty((LIGHTS_AT_ONCE, 5, MOST_PIXELS), dtype)


def _runs(length: int, step: int) -> list[slice]:
    """Return parts of about `BLOCK_SIDE` steps, at most half as many more, which cover a length."""
    count = max(1, round(length / (step * BLOCK_SIDE)))
    edges = [round(k * (length / step) / count) * step for k in range(count)] + [length]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]
