"""What a scene file says: camera, picture, light, surroundings and objects; typed, bounded, described.

`lightwell.io.scenes` reads it. Paths are relative to the scene file. World axes are right-handed, +Z up, in metres.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator
from pydantic_core import PydanticCustomError

from lightwell.conventions import MAX_BANDS
from lightwell.igi_settings import IgiSettings
from lightwell.settings import MappingSettings, Settings, WindowSettings
from lightwell.video_settings import VideoSettings

MAX_SIDE, MAX_SAMPLES = 16384, 16
MAX_PIXELS = 1 << 26
"""Of a picture: 8192 × 8192; a rendering has 11 floats a pixel, by virtual lights 20."""
LARGEST_M = 1e6
"""Rays are traced in single precision."""
MAX_EV = 64.0
Fraction = Annotated[float, Field(ge=0, le=1)]
Metres = Annotated[float, Field(ge=-LARGEST_M, le=LARGEST_M)]
Place = tuple[Metres, Metres, Metres]
Power = Annotated[float, Field(ge=0, le=1e12)]
Name = Annotated[str, Field(min_length=1)]
Method = Literal["harmonics", "igi"]
LINE_SUFFIXES = (".jsonl", ".ndjson", ".json")
"""Of files that hold coefficients."""
MOST_GROUPS = 4
"""Grids that are light groups together: what the web page draws."""


def linear_from_hex(colour: str) -> tuple[float, float, float]:
    """Return the linear colour of an sRGB one, ``#rrggbb`` (IEC 61966-2-1).

    Raises
    ------
    ValueError
        Where it is none.
    """
    if re.fullmatch(r"#[0-9a-fA-F]{6}", colour) is None:
        raise ValueError(f"{colour!r} is no colour; write #rrggbb")
    values = [int(colour[place : place + 2], 16) / 255 for place in (1, 3, 5)]
    red, green, blue = (v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in values)
    return red, green, blue


def _colour(value: Any) -> Any:  # noqa: ANN401
    """Take ``#rrggbb`` (sRGB), one number for grey, or three linear numbers."""
    if isinstance(value, str):
        try:
            return linear_from_hex(value)
        except ValueError:
            raise PydanticCustomError("colour", "must be #rrggbb, or linear numbers 0 … 1") from None
    return (value,) * 3 if isinstance(value, int | float) and not isinstance(value, bool) else value


def require_view(position: Place, target: Place, up: Place) -> None:
    """Raise `PydanticCustomError` where a camera looks nowhere."""
    if max(abs(a - b) for a, b in zip(position, target, strict=True)) < 1e-6:
        raise PydanticCustomError("camera", "position and target must differ")
    if max(map(abs, up)) < 1e-6:
        raise PydanticCustomError("camera", "up must have a length")


class CameraSettings(Settings):
    """A pinhole camera: its place, or (igi) one of the scene's glTF file; by default the first."""

    name: str | None = Field(None, min_length=1, description="igi: a camera of the scene's glTF file")
    position: Place | None = Field(None, description="where the camera stands, metres")
    target: Place = Field((0.0, 0.0, 0.0), description="what is in the middle of the picture, metres")
    up: Place = Field((0.0, 0.0, 1.0), description="world direction of the picture's top")
    fov_degrees: float = Field(36.0, gt=0, lt=180, description="angle from the lower to the upper edge, degrees")

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.position is None:
            given = self.model_fields_set - {"name"}
            if given:
                raise PydanticCustomError("scene", "has {given} but no position", {"given": ", ".join(sorted(given))})
            return self
        if self.name is not None:
            raise PydanticCustomError("scene", "has a name and a position: give one of them")
        require_view(self.position, self.target, self.up)
        return self


class PictureSettings(Settings):
    """How many pixels, and how they become eight bits."""

    width: int = Field(640, ge=1, le=MAX_SIDE, description="pixels")
    height: int = Field(480, ge=1, le=MAX_SIDE, description="pixels")
    samples: int = Field(3, ge=1, le=MAX_SAMPLES, description="N: a pixel is the mean of N² rays")
    ev: float | None = Field(
        None, ge=-MAX_EV, le=MAX_EV, description="exposure of a PNG, EV; default: metered from the mean of the light"
    )
    tone_mapping: Literal["neutral", "none"] = Field(
        "neutral", description="of a PNG: as the web page, or clipped at white"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.width * self.height > MAX_PIXELS:
            raise PydanticCustomError("picture", "must have at most {most} pixels", {"most": MAX_PIXELS})
        return self


def one_or_more(value: Any) -> Any:  # noqa: ANN401
    """Take one name, or a list of them."""
    return (value,) if isinstance(value, str) else value


class SceneLightSettings(Settings):
    """Where the light comes from: file, stream or field of streams; grid; or grid that follows one of the first two."""

    file: Path | None = Field(
        None,
        description="picture (.exr, .hdr; lat-long), JSON of `lightwell project --json`, or a recording: JSON lines of"
        " `watch --json`, a video, a folder or a pattern of pictures",
    )
    frame: int | None = Field(
        None,
        description="file: which frame of a recording, counted from 0, or from the end where negative; default: the"
        " first, of JSON lines the last",
    )
    video: VideoSettings = Field(VideoSettings(), description="how a video's signal stands for light")
    mapping: MappingSettings = Field(
        MappingSettings(), description="of the picture, where it is a recorded frame of a probe and not lat-long"
    )
    stream: str | None = Field(
        None,
        min_length=1,
        description="name of a stream on the server: its newest frame; with JSON lines of several: which of them",
    )
    field: str | None = Field(
        None, min_length=1, description="name of a field on the server: the newest frames of its streams, by place"
    )
    gradients: bool | None = Field(
        None,
        description="how the light changes beside a probe. stream: true uses that, by default not; field: used where"
        " all its streams have some, false leaves it out",
    )
    grid: Annotated[tuple[Name, ...] | None, BeforeValidator(one_or_more)] = Field(
        None,
        min_length=1,
        max_length=MOST_GROUPS,
        description="folder of a grid (Zarr), or its id on the server; or a list of those: light groups that add up",
    )
    bands: int | None = Field(
        None, ge=1, le=MAX_BANDS, description="SH bands; default: 5 of a picture, else all that there are"
    )
    window: WindowSettings = WindowSettings()
    gain: float = Field(1.0, ge=0, le=1e12, description="factor")
    probe_at: Place | None = Field(
        None,
        description="grid with file or stream, or gradients of a stream: where that probe stands, metres; default:"
        " where the stream says, else the middle of the first grid, without one the origin",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        named = [name for name in ("file", "stream", "field", "grid") if getattr(self, name) is not None]
        if self.file is not None and self.file.suffix.lower() in LINE_SUFFIXES and "stream" in named:
            named.remove("stream")  # which of those that were recorded
        if not named or len([name for name in named if name != "grid"]) > 1 or {"field", "grid"} <= set(named):
            found = " and ".join(named) or "none of them"
            words = "give file, stream, field, grid, or grid and one of the first two, not {found}"
            raise PydanticCustomError("light", words, {"found": found})
        if self.frame is not None and self.file is None:
            raise PydanticCustomError("light", "frame is that of a recorded file: name the file")
        if self.gradients is not None and named not in (["stream"], ["field"]):
            raise PydanticCustomError("light", "gradients are those of a stream or a field, without a grid")
        if self.probe_at is not None and len(named) != 2 and not (named == ["stream"] and self.gradients):
            raise PydanticCustomError(
                "light", "probe_at needs a grid and a file or a stream, or a stream with gradients = true"
            )
        if (self.grid is not None or self.field is not None) and self.window.kind == "auto":
            raise PydanticCustomError("light", "grids and fields take a fixed window (hann, lanczos, nonneg), not auto")
        return self


class SceneBackdropSettings(Settings):
    """What is behind the objects, and what mirrors show."""

    kind: Literal["auto", "picture", "harmonics", "none"] = Field(
        "auto",
        description="the light's own picture; its harmonics (of a grid: where the camera stands); nothing."
        " auto: the picture where there is one, else the harmonics, but nothing for a grid",
    )
    file: Path | None = Field(None, description="another lat-long picture, .exr or .hdr")
    filter: Literal["linear", "nearest", "cubic"] = Field("linear", description="between the picture's pixels")


class SceneShadowSettings(Settings):
    """Transfer that is computed for this picture; objects with ``transfer`` keep theirs, and cast shadows too."""

    mode: Literal["none", "shadowed", "interreflected"] = Field(
        "none", description="none; what the objects hide of the light; and what they reflect onto each other"
    )
    directions: int = Field(1024, ge=64, le=65536, description="rays a vertex (Fibonacci; the paper: 2500)")
    bounces: int = Field(1, ge=1, le=8, description="interreflected: surfaces that light may come by way of")


class SceneObjectSettings(Settings):
    """One object, or all objects of a file: exactly one of mesh, shape and transfer."""

    mesh: Path | None = Field(None, description=".glb, .gltf, .ply or .obj")
    shape: Literal["sphere", "plane", "box"] | None = Field(
        None, description="radius or half-edge 1 m, round the origin; the plane faces +Z"
    )
    transfer: str | None = Field(
        None,
        min_length=1,
        description="folder with the results of a prt-transfer job, or the job's id: its meshes, with shadows",
    )
    up_axis: Literal["y", "z"] = Field("y", description="which axis of the mesh file points up")
    scale: float = Field(1.0, ge=1e-6, le=1e6, description="factor")
    turn_degrees: float = Field(
        0.0, ge=-360, le=360, description="turn about +Z, counter-clockwise from above, degrees"
    )
    position: Place = Field((0.0, 0.0, 0.0), description="where the file's origin goes, metres")
    albedo: Annotated[tuple[Fraction, Fraction, Fraction] | None, BeforeValidator(_colour)] = Field(
        None, description="#rrggbb (sRGB), or linear: one number or three; default: the file's own"
    )
    gloss: Fraction = Field(0.0, description="weight of the Phong lobe against the matte part")
    exponent: float = Field(12.0, ge=0, le=1e6, description="s of the Phong lobe max(0, cos)^s")
    normalised: bool = Field(True, description="the lobe integrates to 1; false: its peak is 1, as in paper 000")
    horizon: bool = Field(False, description="cut the lobe off where it reaches below the surface")
    mirror: Fraction = Field(0.0, description="weight of the mirrored backdrop (paper 003, equation 15)")
    two_sided: bool = Field(False, description="show and light the backs of triangles too")
    emission: Annotated[tuple[Power, Power, Power], BeforeValidator(_colour)] = Field(
        (0.0, 0.0, 0.0), description="igi: radiance, of the back too with two_sided; linear: one number or three"
    )

    bump: Path | None = Field(
        None, description="igi: picture of heights, 8 or 16 bits or .exr, by the first texture coordinates of the mesh"
    )
    bump_metres: float = Field(0.01, ge=-1e3, le=1e3, description="igi: height of white in it, or of 1, metres")

    @model_validator(mode="after")
    def _check(self) -> Self:
        named = [name for name in ("mesh", "shape", "transfer") if getattr(self, name) is not None]
        if len(named) != 1:
            found = " and ".join(named) or "none of them"
            raise PydanticCustomError("object", "give one of mesh, shape and transfer, not {found}", {"found": found})
        if self.transfer is not None and self.turn_degrees:
            raise PydanticCustomError("object", "turn_degrees cannot turn shadows: turn the mesh and transfer it anew")
        return self


class SceneLampSettings(Settings):
    """A lamp of no size."""

    kind: Literal["point", "spot", "directional"] = Field(description="directional: parallel light, from far away")
    intensity: Annotated[tuple[Power, Power, Power], BeforeValidator(_colour)] = Field(
        description="W/sr; of a spot along its axis; directional: W/m² on a surface that faces it. One number or three"
    )
    position: Place | None = Field(None, description="point, spot: where it is, metres")
    direction: Place | None = Field(None, description="spot, directional: the way in which it shines")
    inner_degrees: float = Field(
        0.0, ge=0, le=89, description="spot: angle from its axis up to which it has its full intensity"
    )
    outer_degrees: float = Field(45.0, gt=0, le=90, description="spot: angle beyond which there is no light")

    @model_validator(mode="after")
    def _check(self) -> Self:
        needed = {"point": ("position",), "spot": ("position", "direction"), "directional": ("direction",)}[self.kind]
        for name in ("position", "direction"):
            given = getattr(self, name) is not None
            if given != (name in needed):
                words = "a {kind} lamp has no {name}: leave it out" if given else "a {kind} lamp needs a {name}"
                raise PydanticCustomError("lamp", words, {"kind": self.kind, "name": name})
        if self.direction is not None and max(map(abs, self.direction)) < 1e-6:
            raise PydanticCustomError("lamp", "direction must have a length")
        if self.kind != "spot":
            if {"inner_degrees", "outer_degrees"} & self.model_fields_set:
                raise PydanticCustomError("lamp", "inner_degrees and outer_degrees are those of a spot: leave them out")
        elif self.inner_degrees >= self.outer_degrees:
            raise PydanticCustomError("lamp", "inner_degrees must be less than outer_degrees")
        return self


class SceneSettings(Settings):
    """A scene file. What has no meaning for its method is left out, but nothing that would change the picture."""

    method: Method = Field(
        "harmonics",
        description="harmonics: shading by spherical harmonics, as the web page; igi: virtual point lights, which also"
        " lamps in the scene cast and which surfaces reflect",
    )
    camera: CameraSettings = CameraSettings()
    light: SceneLightSettings | None = Field(None, description="igi: may be missing where lamps are in the scene")
    scene: Path | None = Field(
        None, description="igi: .glb or .gltf with objects, textures, lamps and cameras, besides objects"
    )
    igi: IgiSettings = IgiSettings()
    picture: PictureSettings = PictureSettings()
    backdrop: SceneBackdropSettings = SceneBackdropSettings()
    shadows: SceneShadowSettings = SceneShadowSettings()
    objects: tuple[SceneObjectSettings, ...] = Field((), max_length=1000, description="what is in the scene")
    lamps: tuple[SceneLampSettings, ...] = Field(
        (), max_length=1000, description="igi: points, spots and parallel light, besides those of the scene"
    )
    sampling: Literal["point", "vertex"] = Field(
        "point", description="light is summed at each visible point, or at vertices and interpolated"
    )
    negatives: Literal["desaturate", "clip", "keep"] = Field(
        "desaturate", description="where harmonics ring below zero: as the web page, cut off, or left"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.camera.position is None and self.scene is None:
            raise PydanticCustomError("scene", "camera.position is missing: it has no default")
        if self.method == "igi":
            if any(item.transfer is not None for item in self.objects):
                raise PydanticCustomError("scene", "objects with transfer need method = 'harmonics': name their mesh")
            return self
        if self.light is None:
            raise PydanticCustomError("scene", "light is missing: it has no default")
        for field, found in {
            "scene": self.scene is not None,
            "camera.name": self.camera.name is not None,
            "objects.emission": any(any(item.emission) for item in self.objects),
            "objects.bump": any(item.bump is not None for item in self.objects),
            "lamps": bool(self.lamps),
        }.items():
            if found:
                raise PydanticCustomError("scene", "{field} needs method = 'igi'", {"field": field})
        return self
