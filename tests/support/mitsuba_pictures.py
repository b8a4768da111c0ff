"""The same scene by Mitsuba 3, a path tracer that nobody here wrote.

Mitsuba's variant is ``scalar_rgb``: compiled in its wheel, whereas the ``llvm`` ones need an LLVM library of the
machine.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from lightwell.render import Camera, SceneObject

WORLD_FROM_ENVMAP = np.array([[0.0, 0, -1, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
"""Mitsuba's lat-long map has +Y up and runs the other way round; with its columns reversed this puts it right."""
ENLARGE = 4
"""Mitsuba interpolates between texels and places their rows a little off; smaller texels make that harmless."""


def import_mitsuba() -> Any:
    """Mitsuba with its variant set; skips the test where it is not installed."""
    mitsuba = pytest.importorskip("mitsuba", reason="Mitsuba 3 is not installed: pip install mitsuba")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def sensor(mi: Any, camera: Camera, size: tuple[int, int], samples: int) -> dict[str, Any]:
    """Mitsuba's form of a camera whose pixels are means over their area, of ``size`` (width, height)."""
    return {
        "type": "perspective",
        "fov": camera.fov_degrees,
        "fov_axis": "y",
        "to_world": mi.ScalarTransform4f().look_at(
            origin=list(camera.position), target=list(camera.target), up=list(camera.up)
        ),
        "film": {
            "type": "hdrfilm",
            "width": size[0],
            "height": size[1],
            "rfilter": {"type": "box"},
            "pixel_format": "rgb",
            "component_format": "float32",
        },
        "sampler": {"type": "multijitter", "sample_count": samples},
    }


def path_traced(
    objects: Sequence[SceneObject],
    panorama: NDArray[np.floating],
    camera: Camera,
    size: tuple[int, int],
    samples: int,
    folder: Path,
    *,
    show_panorama: bool = False,
) -> NDArray[np.float64]:
    """Direct light of a panorama on Lambertian objects of one albedo each, or on mirrors: ``(H, W, 3)`` radiance."""
    mi = import_mitsuba()
    transform = mi.ScalarTransform4f
    pixels = np.asarray(panorama, np.float32)
    if not show_panorama:
        pixels = pixels.repeat(ENLARGE, 0).repeat(ENLARGE, 1)
    scene: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "direct", "hide_emitters": not show_panorama},
        "light": {
            "type": "envmap",
            "bitmap": mi.Bitmap(np.ascontiguousarray(pixels[:, ::-1])),
            "to_world": transform(WORLD_FROM_ENVMAP),
        },
        "camera": sensor(mi, camera, size, samples),
    }
    for number, item in enumerate(objects):
        mesh = item.mesh
        file = folder / f"object-{number}.ply"
        trimesh.Trimesh(mesh.positions, mesh.triangles, vertex_normals=mesh.normals, process=False).export(
            file, vertex_normal=True
        )
        assert item.material.albedo is not None
        colour = {"type": "rgb", "value": list(item.material.albedo)}
        matte = {"type": "diffuse", "reflectance": colour}
        scene[f"object-{number}"] = {
            "type": "ply",
            "filename": str(file),
            "bsdf": {"type": "conductor", "material": "none"} if item.material.mirror == 1 else matte,
        }
    return np.asarray(mi.render(mi.load_dict(scene)), dtype=np.float64)
