"""Meshes of transfer jobs in the page, against `lightwell.render`: attributes of the GLB, halves, three colours."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.browser.conftest import OpenPage
from tests.browser.pictures import Picture
from tests.browser.publisher import Publisher, distant_light
from tests.browser.results import lit_and_dark, put_grid, put_results
from tests.browser.server import ServerProcess
from tests.browser.test_render import BARE, CAMERA, SIZE, compare
from tests.support.reference_pictures import encode_as_page, still_life

from lightwell.io.glb import encode_glb
from lightwell.render import DistantLight, FieldLight, Material, Scene, SceneObject
from lightwell.render.light import Light

pytestmark = [pytest.mark.browser, pytest.mark.timeout(120)]

TINTS = np.array([1.0, 0.8, 0.55])


def parts() -> list[SceneObject]:
    """The still life with colours of its own, as a transfer job would have made it."""
    colours = {"bunny": (0.8, 0.75, 0.6), "ball": (0.3, 0.5, 0.8), "table": (0.5, 0.4, 0.35)}
    items = []
    for name, item in still_life().items():
        albedo = np.broadcast_to(np.array(colours[name], np.float32), item.mesh.positions.shape)
        items.append(replace(item, mesh=replace(item.mesh, albedo=np.ascontiguousarray(albedo))))
    return items


def put_transfer(server: ServerProcess, job: str, channels: int, bake: bool) -> list[SceneObject]:
    """Give the server a finished transfer job; return the objects as Python draws them."""
    objects = []
    files: dict[str, bytes] = {}
    entries = []
    lanes: list[NDArray[np.float32]] = []
    for index, item in enumerate(parts()):
        assert item.transfer is not None
        transfer = item.transfer.astype(np.float32) * (TINTS if channels == 3 else 1.0)
        values = np.ascontiguousarray(transfer.reshape(len(transfer), -1), np.float32)
        files[f"mesh-{index}.f16.bin"] = values.astype("<f2").tobytes()
        count, triangles = len(item.mesh.positions), len(item.mesh.triangles)
        entries.append(
            {
                "name": item.mesh.name,
                "vertices": count,
                "triangles": triangles,
                "float16": f"mesh-{index}.f16.bin",
                "stride": values.shape[1],
            }
        )
        lanes.append(values)
        objects.append(SceneObject(item.mesh, Material(gloss=0.15, exponent=12.0), transfer))
    files["scene.glb"] = encode_glb([item.mesh for item in objects], lanes if bake else None)
    description = {"version": 1, "bands": 5, "channels": channels, "meshes": entries, "glb": "scene.glb"}
    files["transfer.json"] = json.dumps(description).encode()
    put_results(server, job, files)
    return objects


def expected_picture(objects: list[SceneObject], light: Light) -> Picture:
    return encode_as_page(Scene(tuple(objects), light), CAMERA, SIZE, ev=-1.0)


@pytest.mark.parametrize(
    ("job", "channels", "bake"),
    [("transfer-baked", 1, True), ("transfer-halves", 1, False), ("transfer-colours", 3, False)],
)
def test_a_transfer_is_drawn_as_python_draws_it(
    open_page: OpenPage, room: Publisher, server: ServerProcess, job: str, channels: int, bake: bool
) -> None:
    objects = put_transfer(server, job, channels, bake)
    room.coefficients = distant_light((-1.0, -0.6, 0.8)) * [1.0, 0.8, 0.5] + 0.3 * distant_light((1.0, 0.2, 0.1))
    page = open_page(f"#{BARE}&ev=-1&object={job}", size={"width": SIZE[0], "height": SIZE[1]})
    assert compare(page, expected_picture(objects, DistantLight(room.coefficients)), f"render-{job}") < 0.01


def test_three_colours_of_transfer_in_a_grid(open_page: OpenPage, room: Publisher, server: ServerProcess) -> None:
    objects = put_transfer(server, "transfer-in-grid", 3, False)
    # A grid as large as the objects, so that they are drawn at a size of their own: its shortest edge is 7 m.
    grid = lit_and_dark()
    spec = replace(grid.spec, lower=(-3.88, -4.08, -3.0), upper=(4.12, 3.92, 4.0))
    name, field = put_grid(server, "grid-of-objects", replace(grid, spec=spec))
    page = open_page(
        f"#{BARE}&ev=-1&object=transfer-in-grid&light=grid&grid={name}&at=0.12,-0.08,0.5&probes=0&sampling=fragment",
        size={"width": SIZE[0], "height": SIZE[1]},
    )
    # As in `viewport.ts` and `subject.ts`: about the middle of the box around the meshes.
    corners = np.concatenate([item.mesh.positions for item in objects])
    lower, upper = corners.min(axis=0), corners.max(axis=0)
    scale = 0.26 * 7.0 / (0.5 * np.linalg.norm(upper - lower))
    moved = []
    for item in objects:
        positions = (item.mesh.positions - 0.5 * (lower + upper)) * scale + [0.12, -0.08, 0.5]
        moved.append(replace(item, mesh=replace(item.mesh, positions=positions.astype(np.float32))))
    scene = Scene(tuple(moved), FieldLight(field), sampling="vertex")
    expected = encode_as_page(scene, CAMERA, SIZE, ev=-1.0)
    assert compare(page, expected, "render-grid-transfer-colours") < 0.01
