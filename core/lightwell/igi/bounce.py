"""Light after bounces: paths of which ever fewer go on (Keller 1997; MATHS §10).

With the mean reflectivity ρ̄, ``⌊ρ̄^k N⌋`` of N paths reach bounce k. What a path carries is what its source sent times
the reflectivities on its way, as one of the paths that got so far; so the flux of a light is about the same after any
number of bounces, and none is lost on weak ones.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.lights import SURFACE, VirtualLights, make_lights
from lightwell.igi.sources import RAY_NUMBERS, Floats, Rays, cosine_directions
from lightwell.igi.surfaces import Surfaces

DIRECT_LIGHTS = 0.5
"""Direct lights for each path that lands: lamps are small, and what is left of the error is in the bounces."""
MOST_PATHS = 1 << 17
"""Where paths miss everything, no more are sent than so many."""


def path_counts(
    total: int, reflectivity: float, landing: Sequence[float], direct: bool, sets: int = 1
) -> tuple[int, list[int]]:
    """Return how many of ``total`` lights are direct, and how many paths reach each bounce.

    Parameters
    ----------
    reflectivity
        ρ̄.
    landing
        What share of the paths that reach each bounce leaves a light there: 1 in a closed room; in the open most paths
        miss everything, and as many more are sent.
    direct
        Whether there are sources whose direct light is by samples, `DIRECT_LIGHTS` for each path that lands.
    sets
        Counts go by whole sets where they can (`in_sets`).
    """
    series = [reflectivity**k for k in range(1, len(landing) + 1)]
    bounced = sum(factor * share for factor, share in zip(series, landing, strict=True))
    if bounced == 0:
        return (in_sets(total, sets) if direct else 0), []
    paths = min(total / (bounced + (DIRECT_LIGHTS * landing[0] if direct else 0)), max(MOST_PATHS, total))
    reaching = [in_sets(int(factor * paths), sets) for factor in series if int(factor * paths) > 0]
    left = total - sum(count * share for count, share in zip(reaching, landing, strict=False))
    return (in_sets(round(left), sets) if direct else 0), reaching


def in_sets(count: int, sets: int) -> int:
    """Return a count of which every set gets as many, or the same where there are too few.

    With unlike numbers of lights the sets would not be as bright as each other.
    """
    return count - count % sets if count >= sets else count


def trace(surfaces: Surfaces, rays: Rays, numbers: Floats, reaching: list[int], clamp: float) -> list[VirtualLights]:
    """Return the lights of each bounce.

    Parameters
    ----------
    rays
        First parts of the paths, at least ``reaching[0]``; their flux is that of one of a single path.
    numbers
        ``(paths, 5 + 2 (bounces − 1))`` random numbers; those behind the first 5 choose directions after bounces.
    reaching
        How many paths reach each bounce; falling.
    clamp
        As in `IgiSettings`: a light stands for a part of the whole scene's area.

    Paths that meet nothing, a back or something black are lost: of such there may be fewer lights than paths.
    """
    found: list[VirtualLights] = []
    alive: NDArray[np.int64] = np.arange(len(rays.flux))
    origins, directions, flux = rays
    for bounce, count in enumerate(reaching):
        alive = alive[alive < count]
        hits = surfaces.rays.intersect(origins[alive].astype(np.float32), directions[alive].astype(np.float32))
        met = hits.triangle >= 0
        alive = alive[met]
        along = directions[alive].astype(np.float32)
        points = surfaces.at(hits.triangle[met], hits.barycentric[met], along)
        front = points.reflects
        alive = alive[front]
        normals = points.geometric[front].astype(np.float64)
        places = points.position[front] + surfaces.lift * normals
        flux = flux.copy()
        # A light stands for its part of the surface; paths that are lost are lost to lights.
        least = clamp**2 * surfaces.area / (np.pi * max(len(alive), 1))
        # Of the lobe only its reflectivity is known to a matte light.
        flux[alive] *= (points.kd + points.ks)[front]
        shines = flux[alive].any(axis=1)
        alive, places, normals = alive[shines], places[shines], normals[shines]
        found.append(make_lights(SURFACE, places, normals, flux[alive] / count, least=least, direct=False))
        if bounce + 1 < len(reaching):
            origins, directions = origins.copy(), directions.copy()
            a, b = numbers[alive, RAY_NUMBERS + 2 * bounce], numbers[alive, RAY_NUMBERS + 2 * bounce + 1]
            origins[alive] = places
            directions[alive] = cosine_directions(normals, a, b)
    return found
