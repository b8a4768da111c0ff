"""Settings of jobs and of their queue: typed, bounded and described in one place.

The command line, ``lightwell.toml``, the REST API and the executor all use these models, like those of streams in
`lightwell.settings`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, field_validator, model_validator
from pydantic_core import PydanticCustomError

from lightwell.conventions import DEFAULT_BANDS
from lightwell.igi_settings import IgiSettings
from lightwell.scene_settings import (
    LINE_SUFFIXES,
    MAX_EV,
    MAX_PIXELS,
    MAX_SAMPLES,
    MAX_SIDE,
    MOST_GROUPS,
    Name,
    Place,
    one_or_more,
    require_view,
)
from lightwell.settings import MappingSettings, Settings, Vector3, WindowSettings
from lightwell.video_settings import VideoSettings

JobKind = Literal["ilf-grid", "prt-transfer", "capture-reduce", "igi-render"]
JobState = Literal["queued", "running", "cancelling", "cancelled", "failed", "succeeded"]
RepairKind = Literal["pull-push", "mipmap", "bilateral", "none"]
GradientKind = Literal["none", "central", "regression"]
Cells = Annotated[int, Field(strict=True, ge=1, le=4096)]
Resolution = Annotated[tuple[Cells, Cells, Cells], Field(description="cells along x, y and z")]

MAX_GRID_BANDS = 6
MAX_TRANSFER_BANDS = 6
MAX_FRAMES = 10_000
"""Pictures of one igi-render job."""
MAX_CELLS = 1 << 25
"""Of all grids of a job: 320 along each axis of one. Larger ones fit neither memory nor a browser."""
DEFAULT_PRIORITY = 100


def _resolutions(value: Any) -> Any:  # noqa: ANN401
    """Take ``64``, ``[64, 64, 32]`` and lists of either."""
    if isinstance(value, int) and not isinstance(value, bool):
        return ((value, value, value),)
    if isinstance(value, list | tuple):
        if len(value) == 3 and all(isinstance(item, int) for item in value):
            return (tuple(value),)
        return tuple((item, item, item) if isinstance(item, int) else item for item in value)
    return value


class IlfGridSettings(Settings):
    """Resampling of a capture to a regular grid of SH coefficients (paper 000; MATHS §6)."""

    capture: str = Field(min_length=1, description="id of a registered capture, or its folder below a data root")
    resolutions: Annotated[tuple[Resolution, ...], BeforeValidator(_resolutions)] = Field(
        ((32, 32, 32),),
        max_length=8,
        description="cells along x, y and z; several grids in one pass",
        json_schema_extra={"minItems": 1},
    )
    bounds: tuple[Vector3, Vector3] | None = Field(
        None, description="lower and upper corner of the grid, metres; default: the box round the probes"
    )
    bands: int = Field(DEFAULT_BANDS, ge=1, le=MAX_GRID_BANDS, description="SH bands; bands² coefficients a cell")
    support_cells: float = Field(3.0, gt=0.5, le=16, description="diameter of the Gaussian kernel's support, cells")
    sigma_cells: float = Field(0.5, gt=0.05, le=8, description="standard deviation of the Gaussian kernel, cells")
    viewpoint: Literal["correct", "ignore"] = Field(
        "correct", description="shift each direction's rays to where a mirror sphere reflected them, or do not"
    )
    weights: Literal["solid-angle", "paper"] = Field(
        "solid-angle", description="each pixel's solid angle, or the paper's constant 4π/N"
    )
    blind: Literal["fill", "zero"] = Field("fill", description="what the probe cannot see: from its rim, or dark")
    repair: RepairKind = Field(
        "pull-push",
        description="cells without a sample: pull-push across the direction, the paper's 3D mip-map,"
        " joint bilateral, or left dark (none)",
    )
    window: WindowSettings = WindowSettings()
    gradients: GradientKind = Field(
        "none",
        description="gradient of the coefficients in space: none, central differences of the grid, or local-linear"
        " kernel regression of the samples (half the error, three times the work)",
    )
    gradient_projection: bool = Field(
        False,
        description="take off what no light in empty space does from the gradients: less noise where they have some",
    )
    precision: Literal["float32", "float16"] = Field("float32", description="type of the stored coefficients")
    adaptive_tolerance: float | None = Field(
        None,
        gt=0,
        lt=1,
        description="also write an adaptive grid, within this of the regular one in every cell, relative to the rms"
        " coefficient vector; default: none",
    )
    directions: int = Field(
        16384, ge=64, le=262144, description="rotating rigs: directions to which each probe is gathered"
    )
    frame_width: int = Field(0, ge=0, le=8192, description="width in pixels to downsample frames to; 0: as they are")
    sample_format: Literal["half", "float"] = Field("half", description="type of the sorted samples")
    memory_mb: int = Field(1024, ge=64, description="memory that sorting and resampling may each use, megabytes")
    checkpoint_seconds: float = Field(
        12.0, ge=0.05, le=3600, description="core time between checkpoints: what a kill can cost, seconds"
    )
    compare: bool = Field(True, description="simulated captures: report the error against the exact field")

    @field_validator("resolutions")
    @classmethod
    def _check_resolutions(cls, value: tuple[tuple[int, int, int], ...]) -> tuple[tuple[int, int, int], ...]:
        cells = sum(x * y * z for x, y, z in value)
        if not value:
            raise PydanticCustomError("resolutions", "must hold at least one")
        if len(set(value)) < len(value):
            raise PydanticCustomError("resolutions", "must differ from each other: grids are named by them")
        if cells > MAX_CELLS:
            words = f"must have at most {MAX_CELLS} cells together, not {cells}"
            raise PydanticCustomError("resolutions", words)
        return value

    @model_validator(mode="after")
    def _check_gradients(self) -> Self:
        if self.gradients == "regression" and self.repair in ("mipmap", "none"):
            words = f"regression needs the repair pull-push or bilateral, not {self.repair}"
            raise PydanticCustomError("gradients", words)
        if self.gradient_projection and self.gradients == "none":
            raise PydanticCustomError("gradient_projection", "needs gradients: central or regression")
        return self

    @field_validator("bounds")
    @classmethod
    def _check_bounds(cls, value: tuple[Vector3, Vector3] | None) -> tuple[Vector3, Vector3] | None:
        if value is not None and not all(low < high for low, high in zip(*value, strict=True)):
            raise PydanticCustomError("bounds", "the upper corner must lie above the lower one on every axis")
        return value


class CaptureReduceSettings(Settings):
    """Adaptive subsampling of a capture (paper 000 §5.1; MATHS §6)."""

    capture: str = Field(min_length=1, description="id of a registered capture, or its folder below a data root")
    tolerance: float = Field(
        0.02, gt=0, lt=2, description="a probe is dropped where it differs by less from the last one kept and the next"
    )
    max_distance_m: float | None = Field(
        None, gt=0, description="largest distance between probes that are kept, metres; default: from the density"
    )


Share = Annotated[float, Field(ge=0, le=1)]
Colour = tuple[Share, Share, Share]


class PrtTransferSettings(Settings):
    """Precomputed radiance transfer of meshes: how each vertex answers to light (paper 003 §3.7; MATHS §9)."""

    mesh: str = Field(min_length=1, description="id of an uploaded mesh, or a file below a data root: GLB, PLY or OBJ")
    up: Literal["y", "z"] = Field("y", description="which axis of the file points up; glTF says y")
    normals: Literal["file", "triangles"] = Field(
        "file", description="vertex normals: the file's where it has them, or always made from the triangles"
    )
    bands: int = Field(5, ge=1, le=MAX_TRANSFER_BANDS, description="SH bands; bands² coefficients a vertex")
    mode: Literal["unshadowed", "shadowed", "interreflected"] = Field(
        "shadowed", description="exact without shadows; with shadows; with light from other surfaces too"
    )
    bounces: int = Field(2, ge=1, le=8, description="interreflected: how many surfaces light may come by way of")
    directions: int = Field(1024, ge=16, le=65536, description="directions a vertex; visibility is asked for in each")
    sampling: Literal["hemisphere", "fibonacci", "stratified"] = Field(
        "hemisphere",
        description="cosine-weighted spiral about the normal (least error), spiral over the sphere, or the paper's"
        " jittered sphere",
    )
    turn: Literal["shared", "vertex"] = Field(
        "shared", description="hemisphere: the same directions at all vertices, or turned from one to the next (noise)"
    )
    albedo: Share | None = Field(None, description="of all objects, instead of the file's colours")
    object_albedo: dict[str, Colour] = Field(
        {}, description="linear red, green and blue of objects by name, instead of the file's colours", max_length=256
    )
    ground: bool = Field(False, description="add a round ground plane under the objects")
    ground_radius: float = Field(3.0, ge=1, le=100, description="its radius, in radii of the objects from above")
    ground_rings: int = Field(64, ge=4, le=1024, description="its rings of vertices")
    ground_segments: int = Field(96, ge=8, le=2048, description="its vertices a ring")
    ground_albedo: Share = Field(0.5, description="its albedo")
    bake: bool = Field(True, description="write the transfer into scene.glb too, as attributes _PRT0 …")
    seed: int = Field(0, ge=0, lt=1 << 32, description="of the directions' jitter")
    reuse: bool = Field(True, description="take the result of an earlier job with the same mesh and settings")
    checkpoint_seconds: float = Field(
        6.0, ge=0.05, le=3600, description="time between checkpoints: what a kill can cost, seconds"
    )


Coefficient = Annotated[float, Field(ge=-1e20, le=1e20)]


class IgiLightSettings(Settings):
    """What shines on the scene from outside it, in place of what its file says; lamps in the scene add to it."""

    map: str | None = Field(
        None, min_length=1, description="id of an uploaded map, or a picture below a data root: .exr or .hdr, lat-long"
    )
    frames: str | None = Field(
        None,
        min_length=1,
        description="recorded light over time, below a data root: a folder, dir/*.exr, frame.%04d.exr, a video, or"
        " lines of `lightwell watch STREAM --json` (.jsonl)",
    )
    frame: int | None = Field(
        None,
        description="of frames: all pictures in the light of this one, from 0, or from the end where negative",
    )
    video: VideoSettings = Field(VideoSettings(), description="frames: how a video's signal stands for light")
    mapping: MappingSettings = Field(
        MappingSettings(), description="of the map or the frames, where a probe recorded them and they are not lat-long"
    )
    stream: str | None = Field(
        None,
        min_length=1,
        description="name of a stream: its newest frame when the job is submitted; in lines of several: which of them",
    )
    field: str | None = Field(
        None,
        min_length=1,
        description="name of a field of streams: what arrives now in the middle of the scene, taken for distant",
    )
    grid: Annotated[tuple[Name, ...] | None, BeforeValidator(one_or_more)] = Field(
        None,
        min_length=1,
        max_length=MOST_GROUPS,
        description="id of a grid, or its folder below a data root; or a list of those: light groups that add up; with"
        " map or stream they follow",
    )
    gain: float = Field(1.0, ge=0, le=1e12, description="factor")
    probe_at: Place | None = Field(
        None, description="grid with map or stream: where that probe stands, metres; default: where the stream says"
    )
    coefficients: tuple[tuple[Coefficient, Coefficient, Coefficient], ...] | None = Field(
        None,
        max_length=121,
        description="bands² rows of red, green, blue: what the stream showed; the server fills that in",
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        named = [name for name in ("map", "frames", "stream", "field") if getattr(self, name) is not None]
        if named == ["frames", "stream"] and Path(str(self.frames)).suffix.lower() in LINE_SUFFIXES:
            named.remove("stream")  # which of those that were recorded
        if len(named) > 1:
            raise PydanticCustomError(
                "light", "give map, frames, stream or field, not {named}", {"named": " and ".join(named)}
            )
        rows = 0 if self.coefficients is None else len(self.coefficients)
        if self.coefficients is not None and (rows == 0 or math.isqrt(rows) ** 2 != rows):
            words = "coefficients must be bands² rows (1, 4, 9, 16, 25, …), not {found}"
            raise PydanticCustomError("light", words, {"found": rows})
        if self.frame is not None and self.frames is None:
            raise PydanticCustomError("light", "frame is one of those that frames names: give frames")
        if self.grid is not None and (self.frames is not None or self.field is not None):
            words = "a grid follows a map or a stream, not frames or a field: leave one out"
            raise PydanticCustomError("light", words)
        return self


Degrees = Annotated[float, Field(gt=0, lt=180)]


class KeyCameraSettings(Settings):
    """Where the camera is at one point of its path."""

    position: Place = Field(description="where the camera stands, metres")
    target: Place = Field((0.0, 0.0, 0.0), description="what is in the middle of the picture, metres")
    up: Place = Field((0.0, 0.0, 1.0), description="world direction of the picture's top")
    fov_degrees: Degrees = Field(36.0, description="angle from the lower to the upper edge, degrees")

    @model_validator(mode="after")
    def _check(self) -> Self:
        require_view(self.position, self.target, self.up)
        return self


class IgiCameraSettings(Settings):
    """From where the scene is seen; by default as its file says."""

    name: str | None = Field(None, min_length=1, description="a camera of the scene's glTF file; default: the first")
    position: Place | None = Field(None, description="or: where the camera stands, metres")
    target: Place = Field((0.0, 0.0, 0.0), description="with position: what is in the middle of the picture, metres")
    up: Place = Field((0.0, 0.0, 1.0), description="with position: world direction of the picture's top")
    fov_degrees: Degrees = Field(36.0, description="with position: angle from the lower to the upper edge, degrees")
    path: tuple[KeyCameraSettings, ...] = Field(
        (),
        max_length=256,
        description="or: cameras that it moves through, smoothly, the first picture at the first, the last at the last:"
        ' [{"position": [1, 2, 1], "target": [0, 0, 1]}, …]',
    )
    orbit_degrees: float = Field(
        0.0, ge=-36000, le=36000, description="it turns so far about the vertical through its target, over all pictures"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.name is not None and self.position is not None:
            raise PydanticCustomError("camera", "has a name and a position: give one of them")
        if self.path and (self.name is not None or self.position is not None or self.orbit_degrees):
            raise PydanticCustomError("camera", "has a path: leave name, position and orbit_degrees out")
        if len(self.path) == 1:
            raise PydanticCustomError("camera", "path needs two cameras or more; one is position, target …")
        if self.position is not None:
            require_view(self.position, self.target, self.up)
            return self
        # What has its default may have been written down by the queue.
        fields = IgiCameraSettings.model_fields
        said = [name for name in ("target", "up", "fov_degrees") if getattr(self, name) != fields[name].default]
        if said:
            raise PydanticCustomError("camera", "has {said} but no position", {"said": ", ".join(said)})
        return self


class IgiRenderSettings(Settings):
    """Pictures by virtual point lights (paper 004; MATHS §8, §10)."""

    scene: str = Field(
        min_length=1, description="scene below a data root (.toml, .glb, .gltf), or the id of an uploaded mesh (GLB)"
    )
    width: int | None = Field(
        None, ge=1, le=MAX_SIDE, description="pixels; default: as the scene's file says, else 640"
    )
    height: int | None = Field(None, ge=1, le=MAX_SIDE, description="pixels; default: as the file says, else 480")
    samples: int | None = Field(
        None, ge=1, le=MAX_SAMPLES, description="N: a pixel is the mean of N² rays; default: as the file says, else 3"
    )
    light: IgiLightSettings = IgiLightSettings()
    camera: IgiCameraSettings = IgiCameraSettings()
    frames: int | None = Field(
        None,
        ge=1,
        le=MAX_FRAMES,
        description="pictures; default: as many as show light.frames, at its own pace where that is known, 48 where the"
        " camera moves, else one",
    )
    fps: float = Field(24.0, ge=0.01, le=240, description="of the film, pictures a second")
    igi: IgiSettings = IgiSettings()
    ev: float | None = Field(
        None, ge=-MAX_EV, le=MAX_EV, description="exposure of PNG and film, EV; default: metered from the first picture"
    )
    tone_mapping: Literal["neutral", "none"] | None = Field(
        None, description="of PNG and film: as the web page, or clipped at white; default: as the file says"
    )
    checkpoint_seconds: float = Field(
        10.0, ge=0.05, le=3600, description="time between checkpoints; tiles that are done before are kept too"
    )

    @model_validator(mode="after")
    def _check(self) -> Self:
        if self.width is not None and self.height is not None and self.width * self.height > MAX_PIXELS:
            raise PydanticCustomError("picture", "must have at most {most} pixels", {"most": MAX_PIXELS})
        return self


class JobsSettings(Settings):
    """The queue of long jobs and the executor that works on it."""

    embedded: bool = Field(True, description="run one executor process beside the server")
    database_url: str = Field(
        "", description="postgresql://… for the queue's state; empty: SQLite in the data directory"
    )
    scheduler: str = Field(
        "", description="address of a Dask scheduler, tcp:// or tls://; empty: processes on this machine"
    )
    processes: int = Field(0, ge=0, le=1024, description="compute processes on this machine; 0: one a core")
    concurrency: int = Field(2, ge=1, le=64, description="jobs at once")
    data_roots: tuple[Path, ...] = Field(
        (), description="folders below which captures, meshes and scenes may lie, beside those of the data directory"
    )
    quota_mb: int = Field(100_000, ge=1, description="disk that all jobs may use together, megabytes")
    min_free_mb: int = Field(500, ge=0, description="free disk that a job must leave, megabytes")
    retention_days: float = Field(30.0, gt=0, description="finished jobs and their results are deleted after, days")
    executor: str = Field(
        "executor-0", pattern=r"^[A-Za-z0-9_.-]{1,64}$", description="name of this executor; one live process has it"
    )
