"""Scenes for `lightwell.igi`."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.shapes import box, plane, sphere
from lightwell.igi import IgiMaterial, IgiObject, IgiScene
from lightwell.igi.gbuffer import GBuffer
from lightwell.render import Camera

ROOM_CAMERA = Camera((1.5, -1.7, 1.7), (-0.3, 0.4, 0.9), fov_degrees=60)


def placed(mesh: Mesh, scale: ArrayLike, at: ArrayLike, name: str | None = None, inwards: bool = False) -> Mesh:
    """A mesh scaled and moved; ``inwards``: turned inside out."""
    sizes = np.broadcast_to(np.asarray(scale, float), (3,))
    triangles = mesh.triangles[:, ::-1] if inwards else mesh.triangles
    normals = mesh.normals / sizes * (-1 if inwards else 1)
    return make_mesh(name or mesh.name, mesh.positions * sizes + np.asarray(at), triangles, normals)


def panel(size: tuple[float, float], at: ArrayLike, name: str = "panel") -> Mesh:
    """A rectangle that looks down."""
    flat = plane(1)
    return placed(
        make_mesh(name, flat.positions, flat.triangles[:, ::-1], -flat.normals), [size[0] / 2, size[1] / 2, 1], at
    )


def matte(*base: float) -> IgiMaterial:
    return IgiMaterial(base=(base[0], base[1], base[2]), specular=0)


def lamp(*emission: float) -> IgiMaterial:
    return IgiMaterial(base=(0, 0, 0), specular=0, emission=(emission[0], emission[1], emission[2]))


def walls() -> list[IgiObject]:
    """A closed room of 4 × 4 × 3 m, coloured as that of ``room_path_traced.py`` of the shared examples."""
    colours = {
        "x+": (0.7, 0.2, 0.2),
        "x-": (0.2, 0.6, 0.25),
        "y+": (0.7, 0.7, 0.7),
        "y-": (0.6, 0.6, 0.75),
        "z+": (0.8, 0.8, 0.8),
        "z-": (0.5, 0.45, 0.4),
    }
    room = placed(box(), [2, 2, 1.5], [0, 0, 1.5], inwards=True)
    found = []
    for name, colour in colours.items():
        normal = np.zeros(3)
        normal["xyz".index(name[0])] = -1 if name[1] == "+" else 1
        corners = np.flatnonzero(room.normals @ normal > 0.5)
        triangles = [[int(np.flatnonzero(corners == v)[0]) for v in t] for t in room.triangles if t[0] in corners]
        found.append(
            IgiObject(make_mesh(name, room.positions[corners], triangles, room.normals[corners]), matte(*colour))
        )
    return found


def panel_room() -> IgiScene:
    """The room with two emissive panels below its ceiling, a ball and a block: all matte."""
    return IgiScene(
        (
            *walls(),
            IgiObject(placed(sphere(64, 128), 0.5, [-0.6, 0.5, 0.5], "ball"), matte(0.7, 0.6, 0.2)),
            IgiObject(placed(box(), [0.35, 0.35, 0.5], [0.7, 0.2, 0.5], "block"), matte(0.3, 0.5, 0.7)),
            IgiObject(panel((1.0, 0.6), [-0.8, 0.6, 2.97]), lamp(16.0, 15.0, 13.0)),
            IgiObject(panel((0.6, 1.0), [1.0, -0.6, 2.97]), lamp(10.0, 11.0, 14.0)),
        )
    )


def pixels(
    seen: np.ndarray, place: np.ndarray, geometric: np.ndarray, shading: np.ndarray, depth: np.ndarray
) -> GBuffer:
    """What the filter asks of pixels."""
    nothing = np.zeros_like(place)
    return GBuffer(seen, nothing, place, geometric, shading, nothing, nothing, nothing[..., 0], nothing, depth)
