"""Settings of one stream: typed, bounded and described in one place.

The command line, ``lightwell.toml``, the REST API and the ingest worker all use these models; each description ends up
in ``--help``, in OpenAPI and in ``lightwell.toml``.
"""

from __future__ import annotations

import math
import re
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationInfo, field_validator, model_validator
from pydantic_core import ErrorDetails, PydanticCustomError

from lightwell.conventions import DEFAULT_BANDS, DEFAULT_FORWARD, DEFAULT_UP, MAX_STREAM_BANDS, Units

MappingName = Literal["latlong", "mirror-sphere", "mirror-ball", "angular", "fisheye", "octahedral", "cube"]
ProxyKind = Literal["none", "sphere", "box", "mesh", "depth"]
WindowKind = Literal["none", "hann", "lanczos", "nonneg", "auto"]
FilterKind = Literal["none", "alpha", "tau", "one-euro", "kalman"]
ProjectionWeights = Literal["solid-angle", "paper", "fejer"]
Vector3 = tuple[float, float, float]
FARTHEST_M = 1e7
"""World coordinates of probes are within so many metres: what is farther is a mistake, of the unit for instance."""
Coordinate = Annotated[float, Field(ge=-FARTHEST_M, le=FARTHEST_M)]

STREAM_NAME_PATTERN = r"^[a-z0-9][a-z0-9_-]{0,62}$"
MAX_FIELD_STREAMS = 32
StreamName = Annotated[str, Field(pattern=STREAM_NAME_PATTERN)]


class Settings(BaseModel):
    """Base: immutable; an unknown key is an error that names it, and so is a number that is not finite."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class MappingSettings(Settings):
    """Where each pixel looks."""

    kind: MappingName = Field("latlong", description="how the picture covers the sphere")
    forward: Vector3 = Field(DEFAULT_FORWARD, description="world direction in which the camera looks")
    up: Vector3 = Field(DEFAULT_UP, description="world direction in which the image's top points")
    fov_degrees: float | None = Field(None, gt=0, le=360, description="field of view across the image width, degrees")
    fisheye: Literal["equidistant", "equisolid"] = Field("equidistant", description="projection of the fisheye lens")
    sphere_radius_m: float | None = Field(None, gt=0, description="radius of the mirror sphere, metres")
    sphere_distance_m: float | None = Field(None, gt=0, description="camera to sphere centre, metres")
    disc: tuple[float, float, float] | None = Field(
        None, description="centre x, centre y and radius of the probe's disc in pixels, where it is not centred"
    )
    blind: Literal["fill", "zero"] = Field(
        "fill", description="cone that the probe cannot see: filled from its rim, or left dark"
    )


class WindowSettings(Settings):
    """Window against ringing (MATHS §4)."""

    kind: WindowKind = Field(
        "none", description="none, hann, lanczos, nonneg (fixed, never negative) or auto (weakest)"
    )
    target: Literal["radiance", "irradiance"] = Field(
        "irradiance", description="what must not become negative: for diffuse surfaces the irradiance is enough"
    )
    width: float | None = Field(
        None, gt=0, description="hann and lanczos: degree at which the window reaches zero; default: bands"
    )
    smoothing_seconds: float = Field(
        0.25, ge=0, le=60, description="auto: time constant with which the window relaxes, seconds"
    )


class FilterSettings(Settings):
    """Temporal filter (MATHS §5, equation 13 of paper 003)."""

    kind: FilterKind = Field(
        "tau", description="none, alpha (paper 003), tau (independent of frame rate), one-euro or kalman"
    )
    tau_seconds: float = Field(0.1, ge=0, le=60, description="tau: time constant, seconds")
    hold: Literal["zero", "first"] = Field(
        "zero", description="tau: light between frames is taken as constant, or (first) as changing linearly"
    )
    alpha: float = Field(1.0, ge=0, le=1000, description="alpha: weight of the previous output (mean delay in frames)")
    min_cutoff_hz: float = Field(0.5, gt=0, le=1000, description="one-euro: cut-off at rest, hertz")
    beta: float = Field(0.4, ge=0, le=1000, description="one-euro: how much relative speed raises the cut-off")
    process_noise: float = Field(0.01, gt=0, description="kalman: relative variance gained per second")
    measurement_noise: float = Field(0.001, gt=0, description="kalman: relative variance of one frame")
    cut_threshold: float = Field(
        0.0, ge=0, description="start anew where a frame differs by more than this share of the light; 0: never"
    )
    max_gap_seconds: float = Field(1.0, gt=0, description="start anew after a gap longer than this, seconds")


class GradientsSettings(Settings):
    """How far the light's surroundings are, for the change of the light with the probe's place (MATHS §7)."""

    proxy: ProxyKind = Field(
        "none", description="what stands for the surroundings: sphere, box, mesh or depth; none: no gradients"
    )
    radius_m: float | None = Field(None, gt=0, description="sphere: its radius, metres")
    centre_m: Vector3 | None = Field(
        None, description="sphere: its centre, world metres; default: it goes with the probe"
    )
    box_lower_m: Vector3 | None = Field(None, description="box: its corner with the smallest x, y, z, world metres")
    box_upper_m: Vector3 | None = Field(None, description="box: its corner with the largest x, y, z, world metres")
    mesh: str | None = Field(
        None, description="mesh: file of the room in world metres (.glb, .gltf, .ply, .obj), or the id of an upload"
    )
    mesh_up: Literal["y", "z"] = Field("y", description="mesh: which of the file's axes points up")
    depth: str | None = Field(
        None,
        description="depth: EXR file of the size of the frames, metres along each pixel's ray; {stem} stands for the "
        "frame's name without suffix",
    )

    @model_validator(mode="after")
    def _is_complete(self) -> Self:
        needed = {
            "sphere": ("radius_m",),
            "box": ("box_lower_m", "box_upper_m"),
            "mesh": ("mesh",),
            "depth": ("depth",),
        }.get(self.proxy, ())
        missing = [name for name in needed if getattr(self, name) in (None, "")]
        if missing:
            raise _gradients_error(f"proxy = '{self.proxy}' needs {' and '.join(missing)}")
        if self.proxy == "box" and self.box_lower_m is not None and self.box_upper_m is not None:
            for axis, low, high in zip("xyz", self.box_lower_m, self.box_upper_m, strict=True):
                if low >= high:
                    raise _gradients_error(
                        f"box_lower_m has {axis} = {low:g}, which must be below box_upper_m's {high:g}"
                    )
        return self


def _gradients_error(message: str) -> PydanticCustomError:
    return PydanticCustomError("gradients", "{message}", {"message": message})


class BackdropSettings(Settings):
    """Picture of the surroundings that goes beside the coefficients (WEB.md §5)."""

    enabled: bool = Field(True, description="send a backdrop")
    fps: float = Field(10.0, gt=0, le=120, description="pictures per second")
    width: int = Field(512, ge=16, le=4096, description="width in pixels; the height is half of it")
    quality: int = Field(90, ge=10, le=100, description="JPEG quality")


class StreamSettings(Settings):
    """Everything that one stream does with its source."""

    source: str = Field(description="source URL: exr:…, video:…, synthetic:…")
    mapping: MappingSettings = MappingSettings()
    bands: int = Field(
        DEFAULT_BANDS, ge=1, le=MAX_STREAM_BANDS, description="SH bands to project onto; bands² coefficients"
    )
    resolution: int = Field(
        256, ge=0, le=8192, description="width in pixels to downsample to before projection; 0: project the whole frame"
    )
    downsample: Literal["area", "gaussian"] = Field(
        "area", description="solid-angle-weighted area means, or the iterated Gaussian of paper 003"
    )
    weights: ProjectionWeights = Field(
        "solid-angle", description="quadrature: solid-angle, paper (equation 12) or fejer"
    )
    gain: float = Field(1.0, gt=0, description="factor from sample to radiance")
    units: Units = Field("relative", description="unit of radiance after the gain")
    position_m: tuple[Coordinate, Coordinate, Coordinate] | None = Field(
        None, description="where the probe stands, world metres; sources that know each frame's position say it instead"
    )
    negatives: Literal["keep", "clamp"] = Field(
        "keep", description="samples below zero: kept (unbiased noise) or clamped to zero"
    )
    window: WindowSettings = WindowSettings()
    filter: FilterSettings = FilterSettings()
    gradients: GradientsSettings = GradientsSettings()
    backdrop: BackdropSettings = BackdropSettings()
    enabled: bool = Field(True, description="run this stream's ingest worker beside the server")

    @field_validator("gradients")
    @classmethod
    def _surrounds_the_probe(cls, gradients: GradientsSettings, info: ValidationInfo) -> GradientsSettings:
        place: Vector3 | None = info.data.get("position_m")
        if place is not None and (reason := outside_proxy(gradients, place)):
            raise _gradients_error(reason)
        return gradients


def _each_once(streams: tuple[str, ...]) -> tuple[str, ...]:
    twice = next((name for name in streams if streams.count(name) > 1), None)
    if twice is not None:
        raise PydanticCustomError("twice", "names {name} twice: name each stream once", {"name": repr(twice)})
    return streams


FieldStreams = Annotated[
    tuple[StreamName, ...], Field(min_length=1, max_length=MAX_FIELD_STREAMS), AfterValidator(_each_once)
]


class FieldSettings(Settings):
    """Several streams whose probes stand at known places: the light between them."""

    streams: FieldStreams = Field(description="names of the streams that it is made of")


def outside_proxy(gradients: GradientsSettings, place: Vector3) -> str:
    """Return why a probe at ``place`` (world metres) is not inside the sphere or the box; empty where it is."""
    if gradients.proxy == "box" and gradients.box_lower_m is not None and gradients.box_upper_m is not None:
        for axis, low, at, high in zip("xyz", gradients.box_lower_m, place, gradients.box_upper_m, strict=True):
            if not low < at < high:
                return f"the box spans {axis} = {low:g} … {high:g}, but the probe stands at {axis} = {at:g}"
    if gradients.proxy == "sphere" and gradients.centre_m is not None and gradients.radius_m is not None:
        distance = math.dist(gradients.centre_m, place)
        if distance >= gradients.radius_m:
            return f"the sphere's radius is {gradients.radius_m:g} m; the probe is {distance:.3g} m from its centre"
    return ""


def complaint(item: ErrorDetails) -> str:
    """Return what is wrong with one value, and the remedy, as ``= VALUE: what it should be``.

    Values under a key that holds secrets are left out.
    """
    message = re.sub(r"^\w+ should", "must", item["msg"]).partition(", unable to ")[0]
    match item["type"]:
        case "extra_forbidden":
            return "is no option: check its spelling"
        case "missing" if item["loc"] and isinstance(item["loc"][-1], int):
            return "is missing: the list has too few values"
        case "missing":
            return "is missing: it has no default"
        case "string_pattern_mismatch" if item["ctx"]["pattern"] == STREAM_NAME_PATTERN:
            remedy = "use lower-case letters, digits, - and _, at most 63, a letter or digit first"
            return f"= {item['input']!r} is no stream name: {remedy}"
        case "dict_type" | "model_type" | "model_attributes_type":
            message = "must be an object, a table of keys and values"
        case "tuple_type" | "list_type":
            message = "must be a list"
        case "gradients" | "twice" | "scene":
            return message
        case "too_short":
            message = message.partition(" after validation")[0]
        case "too_long":
            message = f"must have at most {item['ctx']['max_length']} values"
    if any("token" in str(part) for part in item["loc"]):
        return message
    return f"= {item['input']!r}: {message[0].lower()}{message[1:]}"
