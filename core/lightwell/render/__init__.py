"""Pictures of lit objects: the reference that the browser's picture is compared with. Arrays in, arrays out.

::

    from lightwell.render import Camera, DistantLight, Material, Scene, SceneObject, render

    scene = Scene((SceneObject(mesh, Material(gloss=0.3)),), DistantLight(coefficients))
    picture = render(scene, Camera((0.0, -4.0, 1.5), (0.0, 0.0, 0.5)), (640, 480), samples=3)
    picture.colour  # (480, 640, 3) float32, linear radiance

`lightwell.io.scenes` makes scenes from files, `lightwell.io.renders` writes pictures.
"""

from lightwell.render.backdrop import Backdrop, Harmonics, Panorama
from lightwell.render.camera import Camera
from lightwell.render.light import DistantLight, FieldLight, Light, ModulatedLight, SampledLight, SummedLight, modulate
from lightwell.render.material import Material
from lightwell.render.picture import Rendering, render
from lightwell.render.scene import Scene, SceneObject
from lightwell.render.tonemap import encode_srgb, expose_and_encode, neutral_tone_mapping

__all__ = [
    "Backdrop",
    "Camera",
    "DistantLight",
    "FieldLight",
    "Harmonics",
    "Light",
    "Material",
    "ModulatedLight",
    "Panorama",
    "Rendering",
    "SampledLight",
    "Scene",
    "SceneObject",
    "SummedLight",
    "encode_srgb",
    "expose_and_encode",
    "modulate",
    "neutral_tone_mapping",
    "render",
]
