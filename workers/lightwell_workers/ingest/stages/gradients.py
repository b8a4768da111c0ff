"""gradients: how the coefficients change with the probe's place (MATHS §7), from what stands for its surroundings.

What stands still is made once: the panorama of the mapping, the proxy, and for a probe at rest the plan, which holds
the distance of every pixel. A probe that moves or turns in a room gets a plan for each frame.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import FrameError, ProxyError
from lightwell.geometry.rays import RayScene
from lightwell.gradients.image import GradientPlan
from lightwell.gradients.panorama import GradientPanorama
from lightwell.gradients.proxy import BoxProxy, DepthProxy, MeshProxy, Proxy, SphereProxy
from lightwell.gradients.sphere import sphere_gradients
from lightwell.gradients.trust import trust_radius
from lightwell.io.exr import read_depth
from lightwell.io.meshes import load_meshes
from lightwell.io.uploads import UPLOAD_ID, read_record
from lightwell.probe.downsample import Downsampler
from lightwell.probe.half import Picture
from lightwell.probe.mapping import Mapping
from lightwell.settings import GradientsSettings, StreamSettings
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.stages.map import Geometry, in_closed_form

WIDEST = 512
"""Wider pictures, of streams that project whole frames, are made smaller for their gradients."""
PANORAMA_WIDTH = 256
MOST_BLIND = 0.02
"""Share of the sphere that a probe may not see before how far its gradients hold is not known: they are those of the
light that it sees."""

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Slope:
    """The change of one frame's coefficients with the probe's place."""

    gradients: Floats
    """``(bands², 3, 3)`` per metre, in the mapping's axes, not windowed or filtered."""
    trust_radius_m: float
    """How far they hold (MATHS §7.4); infinite where the light is far."""


class PassingProxyError(ProxyError):
    """Of one frame alone: a probe that moves has left its proxy, or the frame's depth file is bad."""


class _View(NamedTuple):
    """From where and which way a probe looks, hashable."""

    position_m: tuple[float, ...]
    world_from_camera: tuple[float, ...]
    depth: str


def measure_slope(
    frame: Frame,
    settings: StreamSettings,
    geometry: Geometry,
    reduced: Picture,
    projected: Floats,
    uploads: Path | None = None,
) -> Slope:
    """Return the gradients of a frame.

    Parameters
    ----------
    frame, settings, geometry
        As for the other stages; ``settings.gradients.proxy`` is not ``none``.
    reduced
        The picture that was projected.
    projected
        Its coefficients times the gain, with one band more where `in_closed_form`.
    uploads
        Where the server keeps what it was sent.

    Raises
    ------
    PassingProxyError
        Where there are none for this frame.
    ProxyError, MeshError
        Where the proxy cannot be used: an option, a file or the probe's place is wrong or missing.
    """
    wanted = settings.gradients
    if in_closed_form(wanted) and wanted.radius_m is not None:
        return Slope(sphere_gradients(projected, wanted.radius_m), trust_radius(wanted.radius_m))
    mapping, picture = _picture(frame, geometry, reduced)
    panorama = _panorama(mapping)
    view = _view(frame, settings)
    if wanted.proxy != "depth":
        _proxy(wanted, uploads)  # what is wrong with it is wrong for every frame
    try:
        plan = _plan(mapping, geometry.mapping, settings.bands, wanted, view, uploads)
    except ProxyError as error:
        lasts = "{stem}" not in (wanted.depth or "") if wanted.proxy == "depth" else frame.position_m is None
        if lasts:
            raise
        raise PassingProxyError(str(error)) from None
    samples = panorama(picture)
    return Slope(plan.apply(samples) * settings.gain, trust_radius(plan.mean_distance(samples)))


def _picture(frame: Frame, geometry: Geometry, reduced: Picture) -> tuple[Mapping, Picture]:
    """Return the picture that is summed and its mapping: the one that was projected, unless that is large."""
    mapping = geometry.mapping if geometry.downsampler is None else geometry.downsampler.mapping
    if mapping.width <= WIDEST:
        return mapping, reduced
    smaller = _downsampler(mapping)
    return smaller.mapping, smaller(reduced)


@lru_cache(maxsize=2)
def _downsampler(mapping: Mapping) -> Downsampler:
    return Downsampler(mapping, PANORAMA_WIDTH)


@lru_cache(maxsize=4)
def _panorama(mapping: Mapping) -> GradientPanorama:
    return GradientPanorama(mapping, PANORAMA_WIDTH)


def _view(frame: Frame, settings: StreamSettings) -> _View:
    """Return the view; raises `ProxyError` where the proxy stands in the world and the probe's place is not known."""
    wanted = settings.gradients
    if wanted.proxy == "depth":
        assert wanted.depth is not None
        return _View((0.0, 0.0, 0.0), (), wanted.depth.replace("{stem}", Path(frame.name).stem))
    place = settings.position_m if frame.position_m is None else frame.position_m.tolist()
    if place is None:
        raise ProxyError(
            f"gradients.proxy = '{wanted.proxy}' needs the probe's place: set position_m, or a source that knows it"
        )
    turned = () if frame.world_from_camera is None else tuple(frame.world_from_camera.ravel().tolist())
    return _View(tuple(place), turned, "")


@lru_cache(maxsize=4)
def _plan(
    mapping: Mapping,
    frames: Mapping,
    bands: int,
    wanted: GradientsSettings,
    view: _View,
    uploads: Path | None,
) -> GradientPlan:
    panorama = _panorama(mapping)
    proxy = _depth_proxy(frames, view.depth) if wanted.proxy == "depth" else _proxy(wanted, uploads)
    turn = np.reshape(view.world_from_camera, (3, 3)) if view.world_from_camera else None
    inverse = panorama.inverse_distances(proxy, view.position_m, turn)
    return GradientPlan(panorama.height, panorama.width, bands, inverse, panorama.seen)


@lru_cache(maxsize=2)
def _proxy(wanted: GradientsSettings, uploads: Path | None) -> Proxy:
    match wanted.proxy:
        case "sphere" if wanted.radius_m is not None and wanted.centre_m is not None:
            return SphereProxy(wanted.radius_m, wanted.centre_m)
        case "box" if wanted.box_lower_m is not None and wanted.box_upper_m is not None:
            return BoxProxy(wanted.box_lower_m, wanted.box_upper_m)
        case "mesh" if wanted.mesh is not None:
            return MeshProxy(RayScene(load_meshes(_mesh_path(wanted.mesh, uploads), wanted.mesh_up)))
    raise ProxyError(f"gradients.proxy = '{wanted.proxy}' lacks its measures")  # settings are checked: not reached


def _mesh_path(mesh: str, uploads: Path | None) -> Path:
    if not UPLOAD_ID.match(mesh) or Path(mesh).exists():
        return Path(mesh)
    record = None if uploads is None else read_record(uploads / mesh)
    if uploads is None or record is None or record.kind != "mesh":
        raise ProxyError(f"gradients.mesh = '{mesh}': there is no such upload of a mesh; send it, or name a file")
    return record.path_below(uploads / mesh)


def _depth_proxy(mapping: Mapping, file: str) -> Proxy:
    try:
        metres = read_depth(file)
    except FrameError as error:
        raise ProxyError(f"gradients.depth: {error}") from None
    if metres.shape != (mapping.height, mapping.width):
        raise ProxyError(
            f"gradients.depth: {file} is {metres.shape[1]}×{metres.shape[0]}, but the frames are "
            f"{mapping.width}×{mapping.height}: both must look alike, pixel by pixel"
        )
    return DepthProxy(mapping, metres)
