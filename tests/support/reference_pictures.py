"""The page's picture by `lightwell.render`: same objects, camera, coefficients, tone mapping.

For tests of the browser (issue 4, Done-when 3)::

    expected = page_picture(coefficients, camera=(0.9, -4.6, 1.6, 0.12, -0.08, 0.5), size=(512, 384), ev=0.0)
    difference = np.abs(see(page) - expected).mean() / 255

with ``#camera=0.9,-4.6,1.6,0.12,-0.08,0.5&ev=0&backdrop=off&hud=0&panel=0`` in the page's address. ``camera`` is what
stands there: position and target. Pixels are averaged after they have been encoded, as the browser's antialiasing does.

Diffuse, Phong and PRT are `page_picture` with ``gloss``, ``exponent`` and ``shadows``; a grid is
``light=FieldLight(…)``, which takes world metres (move an object with ``offset``); ``sampling`` is "point" for the
page's "fragment".
For other meshes build a `Scene` and call `encode_as_page`, which is what `page_picture` does in the end. What the
page draws and this does not: arrow, box, probes of a grid, panel.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import make_mesh
from lightwell.render import (
    Camera,
    DistantLight,
    FieldLight,
    Harmonics,
    Light,
    Material,
    Rendering,
    Scene,
    SceneObject,
    render,
)
from lightwell.render.light import with_bands
from lightwell.render.scene import Sampling
from lightwell.render.tonemap import encode_srgb, neutral_tone_mapping

Floats = NDArray[np.float64]

SCENE_FILE = Path(__file__).parents[2] / "client" / "public" / "scene.bin"
LANES = 36
PAGE_FOV_DEGREES = 36.0
BALL = Material(albedo=(1.0, 1.0, 1.0), gloss=0.92)
TABLE_COLOUR = "#77736d"


def linear_colour(colour: str) -> tuple[float, float, float]:
    """The linear colour of ``#rrggbb``, as three.js reads it."""
    values = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
    linear = np.where(values < 0.04045, values * 0.0773993808, (values * 0.9478672986 + 0.0521327014) ** 2.4)
    return float(linear[0]), float(linear[1]), float(linear[2])


@cache
def still_life() -> dict[str, SceneObject]:
    """Bunny, ball and table of ``scene.bin`` with their transfer, in the page's world axes; materials are defaults."""
    data = gzip.decompress(SCENE_FILE.read_bytes())
    length = int(np.frombuffer(data, "<u4", 1)[0])
    header: dict[str, Any] = json.loads(data[4 : 4 + length])
    lanes = np.frombuffer(data, "<i2", LANES * header["vertices"], 4 + length).reshape(-1, LANES) / 32767
    triangles = np.frombuffer(data, "<u2", offset=4 + length + 2 * LANES * header["vertices"]).reshape(-1, 3)
    scales = header["scales"]
    objects = {}
    for part in header["parts"]:
        own = triangles[part["start"] // 3 : (part["start"] + part["count"]) // 3]
        used, corners = np.unique(own, return_inverse=True)
        rows = lanes[used]
        mesh = make_mesh(part["name"], rows[:, :3] * scales["position"], corners.reshape(-1, 3), rows[:, 4:7])
        transfer = rows[:, 8 : 8 + header["bands"] ** 2, None] * scales["transfer"]
        objects[part["name"]] = SceneObject(mesh, transfer=transfer)
    return objects


def page_scene(
    light: Light | Floats,
    *,
    colour: str = "#d8d2c8",
    gloss: float = 0.15,
    exponent: float = 12.0,
    shadows: bool = True,
    bands: int = 5,
    mirror: float = 0.0,
    backdrop: bool = False,
    sampling: Sampling = "point",
    offset: Sequence[float] = (0.0, 0.0, 0.0),
) -> Scene:
    """The page's still life, by the names of its view state; ``backdrop``: the harmonics behind the objects."""
    if not isinstance(light, DistantLight | FieldLight):
        light = DistantLight(with_bands(np.asarray(light, np.float64), bands))
    materials = {
        "bunny": Material(linear_colour(colour), gloss, exponent, mirror=mirror),
        "ball": replace(BALL, exponent=exponent),
        "table": Material(linear_colour(TABLE_COLOUR), 0.0, exponent),
    }
    objects = []
    for name, item in still_life().items():
        moved = replace(item.mesh, positions=(item.mesh.positions + np.asarray(offset)).astype(np.float32))
        objects.append(SceneObject(moved, materials[name], item.transfer if shadows else None))
    behind = Harmonics(light.coefficients) if backdrop and isinstance(light, DistantLight) else None
    return Scene(tuple(objects), light, behind, sampling=sampling)


def encode_as_page(
    scene: Scene, camera: Sequence[float], size: tuple[int, int], *, ev: float, supersample: int = 2
) -> Floats:
    """What the page shows of a scene: ``(H, W, 3)``, 0 … 255 sRGB, over black where nothing is."""
    view = Camera((camera[0], camera[1], camera[2]), (camera[3], camera[4], camera[5]), fov_degrees=PAGE_FOV_DEGREES)
    width, height = size
    fine = render(scene, view, (width * supersample, height * supersample))
    encoded = 255 * encode_srgb(neutral_tone_mapping(fine.colour * 2.0**ev))
    return np.asarray(encoded.reshape(height, supersample, width, supersample, 3).mean(axis=(1, 3)))


def page_picture(
    light: Light | Floats,
    camera: Sequence[float],
    size: tuple[int, int],
    *,
    ev: float = 0.0,
    supersample: int = 2,
    **view: Any,
) -> Floats:
    """What the page shows of its still life: ``(H, W, 3)``, 0 … 255; ``view`` as in `page_scene`."""
    return encode_as_page(page_scene(light, **view), camera, size, ev=ev, supersample=supersample)


def page_mask(light: Light | Floats, camera: Sequence[float], size: tuple[int, int], **view: Any) -> Floats:
    """Share of each pixel that the still life covers, ``(H, W)``."""
    view_camera = Camera(
        (camera[0], camera[1], camera[2]), (camera[3], camera[4], camera[5]), fov_degrees=PAGE_FOV_DEGREES
    )
    found: Rendering = render(page_scene(light, **view), view_camera, size, samples=4)
    return found.coverage.astype(np.float64)
