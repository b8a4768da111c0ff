"""From settings to a mapping."""

from __future__ import annotations

from lightwell.errors import MappingError
from lightwell.probe.angular import Angular, make_fisheye
from lightwell.probe.cube import Cube
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Mapping
from lightwell.probe.mirror_ball import MirrorBall
from lightwell.probe.mirror_sphere import MirrorSphere, solve_view
from lightwell.probe.octahedral import Octahedral
from lightwell.settings import MappingSettings


def make_mapping(settings: MappingSettings, height: int, width: int) -> Mapping:
    """Return the mapping of a picture of ``height`` by ``width`` pixels.

    Raises
    ------
    MappingError
        Where an input is missing or the picture's size cannot belong to the mapping; it names the option.
    """
    match settings.kind:
        case "latlong":
            return LatLong(height, width)
        case "octahedral":
            return Octahedral(height, width)
        case "cube":
            return Cube(height, width)
        case "mirror-sphere":
            view = solve_view(
                height,
                width,
                settings.fov_degrees,
                settings.sphere_radius_m,
                settings.sphere_distance_m,
                settings.disc,
            )
            return MirrorSphere(height, width, view, settings.forward, settings.up)
        case "mirror-ball":
            return MirrorBall(height, width, settings.disc, settings.forward, settings.up)
        case "angular":
            return Angular(height, width, settings.disc, settings.forward, settings.up)
        case "fisheye":
            if settings.fov_degrees is None:
                raise MappingError("a fisheye picture needs --fov-degrees, the field of view across its width")
            return make_fisheye(
                settings.fisheye,
                height,
                width,
                settings.fov_degrees,
                settings.disc,
                settings.forward,
                settings.up,
            )
