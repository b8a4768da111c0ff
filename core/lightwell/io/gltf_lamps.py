"""Lamps and cameras that nodes of a glTF file hold (KHR_lights_punctual; glTF 2.0 §3.10), in world axes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.scene import DirectionalLight, PointLight
from lightwell.io.gltf_check import GltfError
from lightwell.render.camera import Camera

Floats = NDArray[np.float64]

PUNCTUAL = "KHR_lights_punctual"


class GltfCamera(NamedTuple):
    """A camera of a file."""

    name: str
    camera: Camera | None
    """None: it has no perspective."""


def read_lamps(
    document: Mapping[str, Any], places: Mapping[int, Floats], turn: Floats
) -> list[PointLight | DirectionalLight]:
    """Return the punctual lights of the scene.

    Candela and lux are taken for W/sr and W/m², as nits of emissive surfaces are for radiance: all in the same ratio.

    Parameters
    ----------
    document
        A checked document.
    places
        Where nodes are, ``(4, 4)`` each.
    turn
        ``(3, 3)``: from the file's axes to the world's.

    Raises
    ------
    GltfError
        Where a lamp cannot be used; other errors where the document contradicts itself.
    """
    found: list[PointLight | DirectionalLight] = []
    lights = document.get("extensions", {}).get(PUNCTUAL, {}).get("lights", [])
    for index, place in places.items():
        use = document["nodes"][index].get("extensions", {}).get(PUNCTUAL)
        if use is None:
            continue
        light = lights[use["light"]]
        name = f"lamp {light.get('name') or document['nodes'][index].get('name') or use['light']!r}"
        intensity = float(light.get("intensity", 1))
        red, green, blue = (intensity * float(value) for value in light.get("color", (1, 1, 1)))
        power = (red, green, blue)
        x, y, z = (float(value) for value in turn @ place[:3, 3])
        try:
            if light["type"] == "directional":
                away = _direction(turn, place, (0, 0, -1), name)
                found.append(DirectionalLight((-away[0], -away[1], -away[2]), power))
            elif light["type"] == "point":
                found.append(PointLight((x, y, z), power))
            elif light["type"] == "spot":
                cone = light.get("spot", {})
                inner, outer = float(cone.get("innerConeAngle", 0)), float(cone.get("outerConeAngle", np.pi / 4))
                # Files round π/2 to either side.
                outer = min(outer, np.pi / 2) if outer < 1.0001 * np.pi / 2 else outer
                # A sharp edge should be written as a very narrow one; some programs write it as none.
                inner = min(inner, 0.999 * outer) if inner < 1.0001 * outer else inner
                away = _direction(turn, place, (0, 0, -1), name)
                found.append(PointLight((x, y, z), power, away, inner, outer))
            else:
                raise GltfError(
                    f"{name} has the type {light['type']!r}; point, spot and directional are read: export it again"
                )
        except GltfError:
            raise
        except ValueError as error:
            raise GltfError(f"{name}: {error}; export it again") from None
    return found


def read_cameras(document: Mapping[str, Any], places: Mapping[int, Floats], turn: Floats) -> list[GltfCamera]:
    """Return the cameras of the scene in the order of their nodes; arguments and errors as of `read_lamps`."""
    found: list[GltfCamera] = []
    for index, place in sorted(places.items()):
        node = document["nodes"][index]
        if "camera" not in node:
            continue
        camera = document["cameras"][node["camera"]]
        name = str(node.get("name") or camera.get("name") or f"camera {len(found)}")
        if camera["type"] != "perspective":
            found.append(GltfCamera(name, None))
            continue
        x, y, z = (float(value) for value in turn @ place[:3, 3])
        ahead = _direction(turn, place, (0, 0, -1), f"camera {name!r}")
        up = _direction(turn, place, (0, 1, 0), f"camera {name!r}")
        angle = float(np.degrees(camera["perspective"]["yfov"]))
        try:
            made = Camera((x, y, z), (x + ahead[0], y + ahead[1], z + ahead[2]), up, angle)
        except ValueError as error:
            raise GltfError(f"camera {name!r}: {error}; export it again") from None
        found.append(GltfCamera(name, made))
    return found


def _direction(turn: Floats, place: Floats, axis: tuple[float, float, float], name: str) -> tuple[float, float, float]:
    """Return where an axis of a node points, a unit vector in world axes."""
    vector = turn @ place[:3, :3] @ np.array(axis, np.float64)
    length = float(np.linalg.norm(vector))
    if not (np.isfinite(length) and length > 0):
        raise GltfError(f"{name} points nowhere: its node has no size; export it again")
    x, y, z = (float(value) for value in vector / length)
    return x, y, z
