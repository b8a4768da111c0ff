"""Instant global illumination with filtered incident radiance (paper 004; MATHS §8, §10). Arrays in, arrays out.

All light, direct and after bounces, becomes virtual point lights in n × m sets. Pixels take turns with the sets; what a
pixel gets of its set is kept as SH coefficients of *incident radiance*, and those are averaged over neighbours on the
same surface, so that each pixel can then be shaded with its own normal and material.

::

    from lightwell.igi import IgiMaterial, IgiObject, IgiScene, render_igi
    from lightwell.igi_settings import IgiSettings
    from lightwell.render import Camera

    scene = IgiScene((IgiObject(room, IgiMaterial()), IgiObject(panel, IgiMaterial(emission=(9.0, 9.0, 8.0)))))
    picture = render_igi(scene, Camera((0.0, -4.0, 1.5), (0.0, 0.0, 1.0)), (640, 480), IgiSettings(sets="4x4"))
    picture.colour  # (480, 640, 3) float32, linear radiance
"""

from lightwell.igi.materials import IgiMaterial
from lightwell.igi.render import IgiRenderer, render_igi
from lightwell.igi.rendering import IgiRendering
from lightwell.igi.scene import DirectionalLight, IgiObject, IgiScene, PointLight
from lightwell.igi.sky import Sky, sky_of_harmonics
from lightwell.igi.textures import Texture, linear_from_srgb

__all__ = [
    "DirectionalLight",
    "IgiMaterial",
    "IgiObject",
    "IgiRenderer",
    "IgiRendering",
    "IgiScene",
    "PointLight",
    "Sky",
    "Texture",
    "linear_from_srgb",
    "render_igi",
    "sky_of_harmonics",
]
