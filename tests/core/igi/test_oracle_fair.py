"""Statistics over seeds: few lights are as bright, on average, as many; so is every set of them; and evenness pays."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.core.igi.test_oracle_grid import NEAR, field_of
from tests.core.igi.test_oracle_sky import in_the_open
from tests.support.igi_scenes import lamp, matte, panel, placed

from lightwell.geometry.shapes import box, plane
from lightwell.igi import DirectionalLight, IgiObject, IgiScene, PointLight
from lightwell.igi.gather import Gatherer
from lightwell.igi.surfaces import Surfaces
from lightwell.igi.virtual import make_virtual_lights
from lightwell.igi_settings import IgiSettings

SEEDS = 32
PLACES = np.array([[-0.33, -0.2, 1e-3], [0.3, -0.3, 1e-3], [-0.1, 0.35, 1e-3], [0.35, 0.1, 1e-3]])


def corner() -> tuple[IgiObject, ...]:
    """A ground with a block, open to all sides."""
    return (
        IgiObject(placed(plane(1), 0.45, [0, 0, 0], "ground"), matte(0.7, 0.7, 0.7)),
        IgiObject(placed(box(), [0.1, 0.1, 0.2], [0.05, 0, 0.2], "block"), matte(0.8, 0.8, 0.8)),
    )


def lit_by(kind: str) -> IgiScene:
    match kind:
        case "panel":
            return IgiScene((*corner(), IgiObject(panel((0.5, 0.3), [-0.2, 0.1, 0.9]), lamp(9, 9, 9))))
        case "point":
            return IgiScene(corner(), lamps=(PointLight((-0.3, -0.2, 0.7), (5.0, 5.0, 5.0)),))
        case "sun":
            return IgiScene(corner(), lamps=(DirectionalLight((-1, -0.5, 1.5), (5.0, 5.0, 5.0)),))
        case "sky":
            return IgiScene(corner(), sky=in_the_open("venice").sky)
        case _:
            return IgiScene(corner(), field=field_of(NEAR, 3))


def irradiance(scene: IgiScene, surfaces: Surfaces, settings: IgiSettings) -> NDArray[np.float64]:
    """Mean over the places, ``(sets, 2)``: straight from sources and after bounces."""
    n, m = settings.sets
    sets = make_virtual_lights(scene, surfaces, settings)
    up = np.broadcast_to([0.0, 0.0, 1.0], (m, n, 3))
    total = np.zeros((n * m, 2))
    for place in PLACES:
        here = np.broadcast_to(place, (m, n, 3))
        got = Gatherer(surfaces.rays, sets, 2, np.float64).gather(here, up, np.ones((m, n), bool))
        total += np.sqrt(4 * np.pi / 3) * got.coefficients[:, :, :, 2].mean(axis=-1).reshape(n * m, 2)
    return total / len(PLACES)


@pytest.mark.parametrize("kind", ["panel", "point", "sun", "sky", "grid"])
def test_few_lights_and_each_of_their_sets_are_as_bright_as_many(kind: str) -> None:
    """Within four standard errors; without the clamp, whose bias is meant."""
    scene = lit_by(kind)
    surfaces = Surfaces(scene)
    plain = IgiSettings(sets=(1, 1), clamp=0.0, bounces=2, vpls=1 << 13)
    truth = irradiance(scene, surfaces, plain)[0]
    few = plain.model_copy(update={"vpls": 96, "sets": (2, 2)})
    runs = np.array([irradiance(scene, surfaces, few.model_copy(update={"seed": seed})) for seed in range(SEEDS)])
    for values in (runs.mean(axis=1), *runs.transpose(1, 0, 2)):
        error = values.std(axis=0) / np.sqrt(SEEDS)
        assert (np.abs(values.mean(axis=0) - truth) <= 4 * error + 0.01 * truth).all()


def test_errors_fall_faster_than_those_of_chance() -> None:
    """Direct light of a soft map: 16 times the lights leave less than a tenth of the error; chance leaves a quarter."""
    scene = IgiScene(corner()[:1], sky=in_the_open("venice").sky)
    surfaces = Surfaces(scene)
    errors = []
    for count in (32, 512):
        settings = IgiSettings(sets=(1, 1), vpls=count, bounces=0)
        runs = [irradiance(scene, surfaces, settings.model_copy(update={"seed": s}))[0, 0] for s in range(24)]
        errors.append(float(np.std(runs) / np.mean(runs)))
    assert errors[1] < 0.1 * errors[0]
