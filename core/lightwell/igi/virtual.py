"""All virtual lights of a scene, in their sets."""

from __future__ import annotations

import numpy as np

from lightwell.igi.bounce import path_counts, trace
from lightwell.igi.captured import CapturedField
from lightwell.igi.emit import EmissiveSurfaces, Lamp
from lightwell.igi.lights import LightSets, VirtualLights, arrange, join, take
from lightwell.igi.scene import IgiScene
from lightwell.igi.sequence import halton
from lightwell.igi.sky import SkySource
from lightwell.igi.sources import POSITION_NUMBERS, RAY_NUMBERS, Floats, Rays, Source, pick
from lightwell.igi.surfaces import Surfaces
from lightwell.igi_settings import IgiSettings

EVEN = 0.5
"""Share of the samples that all sources get alike; the rest goes by their power."""
TRIED_PATHS = 4096
"""So many paths are tried to see how many are lost; what they cost is nothing beside what lights cost at all pixels."""
PATH_SEED, TRIAL_SEED = 1 << 31, 2 << 31
"""Paths have other random numbers than direct lights of the same seed, and those that are but tried have others."""
MOST_REFLECTIVE = 0.95
"""Mean reflectivity counts as no more: paths have to end."""


def make_virtual_lights(scene: IgiScene, surfaces: Surfaces, settings: IgiSettings) -> LightSets:
    """Return the lights that stand for all light of a scene; the same for the same seed."""
    lamps = [Lamp(lamp, surfaces.centre, surfaces.radius) for lamp in scene.lamps]
    sources: list[Source] = [source for source in (*lamps, *_sampled(scene, surfaces)) if source.power > 0]
    sampled = [source for source in sources if source.is_sampled]
    reflectivity = min(surfaces.mean_reflectivity(), MOST_REFLECTIVE)
    bounces = settings.bounces if sources and len(surfaces.areas) else 0
    sets = settings.sets[0] * settings.sets[1]
    landing = _landing(sources, surfaces, reflectivity, bounces, settings.seed)
    direct, reaching = path_counts(settings.vpls, reflectivity, landing, bool(sampled), sets)
    lists: list[VirtualLights] = []
    if direct:
        lists.append(_direct(sampled, halton(direct, POSITION_NUMBERS, settings.seed), settings.clamp))
    if reaching:
        lists += _traced(sources, surfaces, reaching, settings.seed + PATH_SEED, settings.clamp)
    return arrange(lists, join([lamp.light for lamp in lamps]), settings.sets, settings.seed)


def _landing(sources: list[Source], surfaces: Surfaces, reflectivity: float, bounces: int, seed: int) -> list[float]:
    """Return what share of the paths that reach each bounce leaves a light there.

    It is found by other paths than those that are used: were they among them, more would be sent just where they have
    missed by chance, and the others would count for too much.
    """
    tried = [count for k in range(1, bounces + 1) if (count := int(reflectivity**k * TRIED_PATHS)) > 0]
    if not tried:
        return []
    found = _traced(sources, surfaces, tried, seed + TRIAL_SEED, 0.0)
    return [lights.count / count for lights, count in zip(found, tried, strict=True)]


def _traced(
    sources: list[Source], surfaces: Surfaces, reaching: list[int], seed: int, clamp: float
) -> list[VirtualLights]:
    numbers = halton(reaching[0], RAY_NUMBERS + 2 * (len(reaching) - 1), seed)
    return trace(surfaces, _rays(sources, numbers[:, :RAY_NUMBERS]), numbers, reaching, clamp)


def _sampled(scene: IgiScene, surfaces: Surfaces) -> list[Source]:
    found: list[Source] = [EmissiveSurfaces(surfaces)]
    if scene.sky is not None:
        found.append(SkySource(scene.sky, surfaces.centre, surfaces.radius))
    if scene.field is not None:
        found.append(CapturedField(scene.field, surfaces))
    return found


def _choose(
    sources: list[Source], numbers: Floats
) -> tuple[np.ndarray[tuple[int], np.dtype[np.int64]], Floats, Floats]:
    """Return which source each row goes to, the rows with what is left of their first number, and the shares."""
    powers = np.array([source.power for source in sources])
    shares = (1 - EVEN) * powers / powers.sum() + EVEN / len(powers)
    cumulative = np.cumsum(shares)
    cumulative[-1] = 1.0
    chosen, rest = pick(cumulative, numbers[:, 0])
    return chosen, np.concatenate([rest[:, None], numbers[:, 1:]], axis=1), shares


def _direct(sources: list[Source], numbers: Floats, clamp: float) -> VirtualLights:
    chosen, rows, shares = _choose(sources, numbers)
    # Back in the order of the numbers, of which every run is fair, and without what a texture leaves dark.
    parts = [source.lights(rows[chosen == k], len(numbers) * shares[k], clamp) for k, source in enumerate(sources)]
    every = join(parts)
    order = np.argsort(np.concatenate([np.flatnonzero(chosen == k) for k in range(len(sources))]), kind="stable")
    ordered = take(every, order)
    return take(ordered, np.asarray(ordered.flux.any(axis=1)))


def _rays(sources: list[Source], numbers: Floats) -> Rays:
    """Return a ray a row, each with the flux of a single path."""
    chosen, rows, shares = _choose(sources, numbers)
    origins, directions, flux = (np.zeros((len(numbers), 3)) for _ in range(3))
    for k, source in enumerate(sources):
        here = chosen == k
        origins[here], directions[here], flux[here] = source.rays(rows[here], shares[k])
    return Rays(origins, directions, flux)
