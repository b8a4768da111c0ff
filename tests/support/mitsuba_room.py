"""A scene of `lightwell.igi` by Mitsuba 3: matte surfaces, emissive ones and a sky, all bounces."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from tests.support.mitsuba_pictures import ENLARGE, WORLD_FROM_ENVMAP, import_mitsuba, sensor

from lightwell.igi import IgiScene
from lightwell.render import Camera


def room_path_traced(
    scene: IgiScene, camera: Camera, size: tuple[int, int], samples: int, folder: Path, depth: int = -1
) -> NDArray[np.float64]:
    """``(H, W, 3)`` radiance, under a sky black where nothing is. Winding must be that of the normals."""
    mi = import_mitsuba()
    made: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "path", "max_depth": depth, "rr_depth": 8, "hide_emitters": scene.sky is not None},
        "camera": sensor(mi, camera, size, samples),
    }
    if scene.sky is not None:
        pixels = scene.sky.pixels.repeat(ENLARGE, 0).repeat(ENLARGE, 1)
        made["sky"] = {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(pixels[:, ::-1])),
            "to_world": mi.ScalarTransform4f(WORLD_FROM_ENVMAP),
        }
    for number, item in enumerate(scene.objects):
        mesh, material = item.mesh, item.material
        assert material.base is not None
        assert material.specular == 0
        file = folder / f"object-{number}.ply"
        trimesh.Trimesh(mesh.positions, mesh.triangles, vertex_normals=mesh.normals, process=False).export(
            file, vertex_normal=True
        )
        shape = {
            "type": "ply",
            "filename": str(file),
            "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(material.base)}},
        }
        if material.emits:
            shape["emitter"] = {"type": "area", "radiance": {"type": "rgb", "value": list(material.emission)}}
        made[f"object-{number}"] = shape
    return np.asarray(mi.render(mi.load_dict(made)), dtype=np.float64)
