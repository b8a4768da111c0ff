"""Virtual point lights: what the sources of light turn into, and the sets that pixels take turns with (MATHS §10)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SURFACE, POINT, DIRECTIONAL, CAPTURED = 0, 1, 2, 3
"""Kinds of light."""


@dataclass(frozen=True, eq=False)
class VirtualLights:
    """N lights.

    What light j adds to a point x, seen from there along the unit vector ω at the distance r:

    - `SURFACE`: ``flux cosθ / (π r²)``, θ at the light: a sample of a lamp, or of a lit matte surface;
    - `POINT`: ``flux / r²``, for a spot times ``clip(a cosθ + b, 0, 1)²``;
    - `DIRECTIONAL`: ``flux``, from the same direction everywhere;
    - `CAPTURED`: ``flux`` times the radiance that a captured field has at x from that direction, which is the same
      everywhere.
    """

    kind: NDArray[np.uint8]
    """``(N,)``."""
    position: Floats
    """``(N, 3)`` metres, lifted off the surface; those of directions have none."""
    normal: Floats
    """``(N, 3)``: of the surface, outwards; axis of a spot; the direction from which light comes."""
    flux: Floats
    """``(N, 3)``: W; point: W/sr; directional: W/m²; captured: sr."""
    least: Floats
    """``(N,)`` m²: the clamp. ``cosθ cosα / r²``, α at the point, counts as no more than one over it; 0: no clamp."""
    falloff: Floats
    """``(N, 2)``: a and b; (0, 1) where the light is the same in all directions."""
    direct: NDArray[np.bool_]
    """``(N,)``: straight from a source, or after bounces."""

    @property
    def count(self) -> int:
        """N."""
        return len(self.kind)


def make_lights(
    kind: int,
    position: Floats,
    normal: Floats,
    flux: Floats,
    *,
    least: Floats | float = 0.0,
    falloff: tuple[float, float] = (0.0, 1.0),
    direct: bool = True,
) -> VirtualLights:
    """Return lights of one kind; arrays as in `VirtualLights`."""
    count = len(flux)
    return VirtualLights(
        np.full(count, kind, np.uint8),
        np.broadcast_to(position, (count, 3)).astype(np.float64),
        np.broadcast_to(normal, (count, 3)).astype(np.float64),
        np.asarray(flux, np.float64).reshape(count, 3),
        np.broadcast_to(np.asarray(least, np.float64), (count,)).copy(),
        np.broadcast_to(np.array(falloff), (count, 2)).copy(),
        np.full(count, direct),
    )


NONE = make_lights(SURFACE, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)))


def join(parts: Sequence[VirtualLights]) -> VirtualLights:
    """Return all lights, in order."""
    parts = [part for part in parts if part.count] or [NONE]
    columns = ([getattr(part, item.name) for part in parts] for item in fields(VirtualLights))
    return VirtualLights(*(np.concatenate(column) for column in columns))


def take(lights: VirtualLights, chosen: NDArray[np.int64] | NDArray[np.bool_]) -> VirtualLights:
    """Return some of the lights."""
    return VirtualLights(*(getattr(lights, item.name)[chosen] for item in fields(VirtualLights)))


@dataclass(frozen=True, eq=False)
class LightSets:
    """Lights sorted into sets; each set alone is an estimate of all the light, and their mean is all of it."""

    lights: VirtualLights
    """Set after set, in each the direct ones first; flux multiplied with the number of sets."""
    starts: NDArray[np.int64]
    """``(sets + 1,)``: where each set begins."""
    bounced: NDArray[np.int64]
    """``(sets,)``: where in each set the lights after bounces begin."""
    pattern: tuple[int, int]
    """n and m: pixel (x, y) takes the set ``x mod n + n (y mod m)``."""

    @property
    def count(self) -> int:
        """How many sets."""
        return len(self.bounced)


def arrange(sampled: Sequence[VirtualLights], common: VirtualLights, pattern: tuple[int, int], seed: int) -> LightSets:
    """Sort lights into n × m sets.

    Parameters
    ----------
    sampled
        Lists of lights, each in an order of which every run is a fair sample. A set gets one run of each list, and
        which set gets which is shuffled, so that neighbouring pixels have runs that are not neighbours.
    common
        Lights that every set has, whole: lamps at points, of which there are few.
    pattern
        n and m.
    seed
        Of the shuffling.
    """
    number = pattern[0] * pattern[1]
    random = np.random.default_rng([seed, 1 << 20])
    parts, owners = [], []
    for lights in sampled:
        order = random.permutation(number)
        parts.append(lights)
        owners.append(order[np.arange(lights.count) * number // max(lights.count, 1)])
    every = join(parts)
    every = replace(every, flux=every.flux * number)
    parts = [every, *[common] * number]
    owners = [*owners, *(np.full(common.count, which) for which in range(number))]
    owner = np.concatenate(owners).astype(np.int64)
    total = join(parts)
    order = np.lexsort((np.arange(total.count), ~total.direct, owner))
    lights = take(total, order)
    starts = np.searchsorted(owner[order], np.arange(number + 1))
    direct = np.concatenate([[0], np.cumsum(lights.direct)])
    bounced = starts[:-1] + direct[starts[1:]] - direct[starts[:-1]]
    return LightSets(lights, starts.astype(np.int64), bounced.astype(np.int64), pattern)
