"""Pictures under real maps against Mitsuba 3, all bounces; and what becomes of the lights in the open."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.igi_scenes import matte, placed
from tests.support.mitsuba_room import room_path_traced

import lightwell_workers
from lightwell.geometry.shapes import box, plane, sphere
from lightwell.igi import IgiObject, IgiScene, Sky, render_igi
from lightwell.igi.surfaces import Surfaces
from lightwell.igi.virtual import make_virtual_lights
from lightwell.igi_settings import IgiSettings
from lightwell.io.pictures import read_picture
from lightwell.probe.samples import repair
from lightwell.render import Camera

MAPS = Path(lightwell_workers.__path__[0], "samples", "hdri")
CAMERA = Camera((1.6, -4.6, 2.4), (0, 0, 0.4), fov_degrees=40)
SIZE, FINER = (36, 27), 4


def in_the_open(name: str) -> IgiScene:
    """A ground with a ball and a block, under a sample map."""
    pixels = repair(read_picture(MAPS / f"{name}.exr").pixels, "clamp").astype(np.float32)
    return IgiScene(
        (
            IgiObject(placed(plane(1), 2.5, [0, 0, 0], "ground"), matte(0.6, 0.55, 0.5)),
            IgiObject(placed(sphere(64, 128), 0.5, [-0.6, 0.1, 0.5], "ball"), matte(0.7, 0.6, 0.2)),
            IgiObject(placed(box(), [0.35, 0.35, 0.5], [0.6, 0.2, 0.5], "block"), matte(0.3, 0.5, 0.7)),
        ),
        sky=Sky(pixels),
    )


def picture(scene: IgiScene, settings: IgiSettings) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Means over Mitsuba's pixels, and which of them are full."""
    fine = render_igi(scene, CAMERA, (SIZE[0] * FINER, SIZE[1] * FINER), settings)
    blocks = fine.colour.astype(np.float64).reshape(SIZE[1], FINER, SIZE[0], FINER, 3)
    covered = fine.coverage.reshape(SIZE[1], FINER, SIZE[0], FINER)
    return blocks.mean(axis=(1, 3)), np.asarray(covered.min(axis=(1, 3)) == 1)


@pytest.mark.parametrize(("name", "most"), [("venice", 0.045), ("esplanade", 0.05)])
def test_under_a_real_map(name: str, most: float, tmp_path: Path) -> None:
    """A soft sky, and one with a sun."""
    scene = in_the_open(name)
    theirs = room_path_traced(scene, CAMERA, SIZE, 256, tmp_path)
    errors = {}
    for count in (256, 1024):
        mine, full = picture(scene, IgiSettings(vpls=count))
        difference = (mine - theirs)[full]
        errors[count] = float(np.sqrt((difference**2).mean()) / theirs[full].mean())
    print(f"\n{name}: relative rms by virtual lights: " + ", ".join(f"{n}: {error:.2%}" for n, error in errors.items()))
    assert errors[1024] < most
    assert errors[1024] < 0.8 * errors[256]


def test_lights_that_miss_are_made_up_for() -> None:
    """In the open most paths meet nothing; as many more are sent, and the rest of the lights is the sky's."""
    scene = in_the_open("venice")
    for count, sets in ((1000, (1, 1)), (1024, (4, 4)), (16, (2, 2)), (1, (4, 4))):
        made = make_virtual_lights(scene, Surfaces(scene), IgiSettings(vpls=count, sets=sets)).lights
        number = sets[0] * sets[1]
        assert abs(made.count - count) < max(number, 0.05 * count) + 1
        assert made.direct.sum() >= count // 10
        assert made.flux.max(axis=1).min() > 0
