"""Light of a grid of exact coefficients against the light that is there, at points and as a picture of Mitsuba 3."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.igi_scenes import lamp, matte, placed
from tests.support.mitsuba_room import room_path_traced

from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.mesh import make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import plane, sphere
from lightwell.igi import IgiObject, IgiScene, render_igi
from lightwell.igi.captured import CapturedField
from lightwell.igi.gather import Gatherer
from lightwell.igi.lights import NONE, arrange
from lightwell.igi.sequence import halton
from lightwell.igi.shade import responses
from lightwell.igi.surfaces import Surfaces
from lightwell.igi_settings import IgiSettings
from lightwell.render import Camera
from lightwell.render.light import FieldLight
from lightwell.sh.shading import irradiance
from lightwell.synthetic.scene import Emitter, Scene

PANELS = (
    Emitter("area", (0.0, 0.2, 1.3), (0.5, 0, 0), (0, -0.4, 0), (8.0, 7.0, 6.0)),
    Emitter("area", (-1.3, 0.0, 0.2), (0, 0.4, 0), (0, 0, 0.5), (2.0, 3.0, 4.0)),
)
NEAR = Scene("near panels", PANELS)
FAR = Scene("far", (), far=(0.3, 0.3, 0.35), far_lobe=(3.0, 3.0, 3.0))
CAMERA = Camera((0.3, -1.6, 0.7), (0, 0, -0.2), fov_degrees=28)
SIZE, FINER = (32, 24), 4


def field_of(scene: Scene, bands: int) -> FieldLight:
    spec = GridSpec((-0.5,) * 3, (0.5,) * 3, (8, 8, 8))
    coefficients = scene.coefficients(spec.centres(), bands).astype(np.float32)
    return FieldLight(Grid(spec, coefficients, np.ones(spec.shape, np.float32)))


def still_life() -> tuple[IgiObject, ...]:
    return (
        IgiObject(placed(plane(1), 0.4, [0, 0, -0.3], "ground"), matte(0.6, 0.6, 0.6)),
        IgiObject(placed(sphere(48, 96), 0.12, [0.05, 0, -0.12], "ball"), matte(0.7, 0.5, 0.3)),
    )


@pytest.mark.parametrize(("scene", "most"), [(NEAR, (0.11, 0.035)), (FAR, (0.003, 0.001))])
def test_what_surfaces_of_any_direction_get(scene: Scene, most: tuple[float, float]) -> None:
    random = np.random.default_rng(0)
    places, normals = random.uniform(-0.3, 0.3, (60, 3)), random.normal(size=(60, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    truth = np.array([irradiance(scene.coefficients(x, 10), n) for x, n in zip(places, normals, strict=True)])
    for bands, limit in zip((3, 5), most, strict=True):
        field = field_of(scene, bands)
        source = CapturedField(field, Surfaces(IgiScene(still_life())))
        sets = arrange([source.lights(halton(4096, 3, 0), 4096, 0)], NONE, (1, 1), 0)
        gatherer = Gatherer(RayScene([]), sets, 3, np.float64, field)
        got = gatherer.gather(places[None], normals[None], np.ones((1, 60), bool), groups=1).coefficients[0]
        shape = np.ones(60), np.zeros(60, bool)
        mine = np.pi * responses(got, normals, normals, normals, *shape, "nonneg", 3).matte[:, 0]
        error = float(np.sqrt(((mine - truth) ** 2).mean()) / truth.mean())
        print(f"\n{scene.name}, {bands} bands: {error:.1%}, on average {mine.mean() / truth.mean() - 1:+.1%}")
        assert error < limit


def test_a_picture_in_the_light_of_near_panels(tmp_path: Path) -> None:
    """The grid against the panels themselves, shadows and all bounces."""
    panels = []
    for number, emitter in enumerate(PANELS):
        centre, u, v = (np.array(part) for part in (emitter.centre, emitter.half_u, emitter.half_v))
        corners = [centre - u - v, centre + u - v, centre + u + v, centre - u + v]
        normal = np.cross(u, v) / np.linalg.norm(np.cross(u, v))
        mesh = make_mesh(f"panel {number}", corners, [[0, 1, 2], [0, 2, 3]], np.tile(normal, (4, 1)))
        panels.append(IgiObject(mesh, lamp(*emitter.radiance)))
    theirs = room_path_traced(IgiScene((*still_life(), *panels)), CAMERA, SIZE, 256, tmp_path)
    size = (SIZE[0] * FINER, SIZE[1] * FINER)
    for bands, limit in ((3, 0.13), (5, 0.09)):
        scene = IgiScene(still_life(), field=field_of(NEAR, bands))
        fine = render_igi(scene, CAMERA, size, IgiSettings())
        mine = fine.colour.astype(float).reshape(SIZE[1], FINER, SIZE[0], FINER, 3).mean(axis=(1, 3))
        full = fine.coverage.reshape(SIZE[1], FINER, SIZE[0], FINER).min(axis=(1, 3)) == 1
        difference = (mine - theirs)[full]
        error = float(np.sqrt((difference**2).mean()) / theirs[full].mean())
        print(f"\ngrid of {bands} bands: {error:.1%}, on average {difference.mean() / theirs[full].mean():+.1%}")
        assert error < limit
