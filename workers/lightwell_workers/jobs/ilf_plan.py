"""What an ``ilf-grid`` job does in which order: fixed before it starts, whatever computes it."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from lightwell.conventions import coefficient_count
from lightwell.field.buckets import Buckets, make_buckets
from lightwell.field.gather import gathered_buckets, turn_buckets
from lightwell.field.spec import GridSpec
from lightwell.io.captures import Capture, open_capture
from lightwell.job_settings import IlfGridSettings, RepairKind
from lightwell.probe.downsample import Downsampler
from lightwell.probe.mapping import Mapping
from lightwell.synthetic.rig import rotation_of
from lightwell_workers.jobs.kind import Estimate, JobError

MEGABYTE = 1 << 20
SAMPLE_SECONDS = 0.25e-6
"""Core time to splat one sample onto a plane."""
CELL_SECONDS = 6e-9
"""Core time to read one cell of one direction and to add it to 25 coefficients."""
ADAPT_SECONDS = 1e-5
"""Core time to fit a cell with 25 coefficients into an adaptive grid."""
DIRECTION_SECONDS = 1e-4
"""Core time of one direction whatever there is to read."""
REPAIR_SECONDS: dict[RepairKind, tuple[float, float]] = {
    "pull-push": (0.0, 0.25e-6),
    "bilateral": (1e-6, 3e-6),
    "mipmap": (0.1e-6, 0.4e-6),
    "none": (0.08e-6, 0.0),
}
"""Core time of the repair of one direction, for each node and in addition for each hole. Nodes are the cells of a face
of the grid where the plane across the direction is repaired, else those of the whole grid."""
PROCESS_BYTES = 250 * MEGABYTE
"""What a compute process takes before it does anything."""
FRAME_SECONDS = 2e-3
SORT_BYTES = 3 * 3 * 4
"""Memory to sort one sample: three copies in floats."""
MOST_BATCH = 512
MOST_PART, LEAST_PART = 16384, 64
LEAST_PROBE_SPREAD_M = 0.01


class Part(msgspec.Struct, array_like=True):
    """A range of probes or of directions."""

    first: int
    last: int


class Plan(msgspec.Struct):
    """Written once, when the job is prepared; what is in it decides the bytes of the result."""

    batches: list[Part]
    """Probes that are sorted together; none where the capture is in angular order."""
    parts: list[Part]
    """Directions whose partial sums are made by one task."""
    together: int
    """Tasks in one checkpoint."""
    digest: str
    """Of the capture."""


class Field:
    """The capture of a job as its tasks see it."""

    def __init__(self, settings: IlfGridSettings) -> None:
        self.settings = settings
        self.capture: Capture = open_capture(Path(settings.capture))
        self.mapping: Mapping = self.capture.mapping()
        self.downsampler: Downsampler | None = None
        if settings.frame_width:
            self.downsampler = Downsampler(self.mapping, settings.frame_width)
            self.mapping = self.downsampler.mapping
        self.rotating = self.capture.rotating
        self.sphere_radius_m = self.capture.info.mapping.sphere_radius_m if settings.viewpoint == "correct" else None
        self.buckets: Buckets = (
            gathered_buckets(settings.directions, settings.bands) if self.rotating else self._fixed_buckets()
        )
        self.specs = grid_specs(settings, self.capture)

    def _fixed_buckets(self) -> Buckets:
        settings = self.settings
        buckets = make_buckets(self.mapping, settings.bands, settings.weights, settings.blind, self.sphere_radius_m)
        turn = rotation_of(self.capture.poses.orientations[0])
        # Exactly as they were where the rig was never turned: results of such captures keep their bytes.
        return buckets if np.allclose(turn, np.eye(3), rtol=0, atol=1e-12) else turn_buckets(buckets, turn)

    @property
    def directions(self) -> int:
        """Number of buckets."""
        return len(self.buckets.directions)


def grid_specs(settings: IlfGridSettings, capture: Capture) -> list[GridSpec]:
    """Return the grids of a job; without bounds, the box round the probes."""
    if settings.bounds is not None:
        lower, upper = (np.array(corner) for corner in settings.bounds)
        if not (upper > lower).all():
            raise JobError(f"bounds: {settings.bounds}: the upper corner must lie above the lower one on every axis")
    else:
        lower, upper = capture.bounds
        middle, size = (lower + upper) / 2, upper - lower
        size = np.maximum(size, max(LEAST_PROBE_SPREAD_M, 0.05 * size.max()))
        lower, upper = middle - size / 2, middle + size / 2
    corners = [tuple(float(value) for value in corner) for corner in (lower, upper)]
    return [GridSpec(corners[0], corners[1], resolution) for resolution in settings.resolutions]  # type: ignore[arg-type]


def count_directions(settings: IlfGridSettings, capture: Capture) -> int:
    """Return the number of buckets without making them."""
    if capture.rotating:
        return settings.directions
    width = settings.frame_width or capture.info.width
    height = math.ceil(capture.info.height * width / capture.info.width)
    share = 1.0 if capture.info.mapping.kind in ("latlong", "octahedral", "cube") else math.pi / 4
    return max(1, round(share * width * height))


def direction_seconds(settings: IlfGridSettings, probes: int, specs: list[GridSpec]) -> float:
    """Return the core time of one direction in all grids."""
    return sum(_grid_seconds(settings, probes, spec.cells) for spec in specs)


def _grid_seconds(settings: IlfGridSettings, probes: int, cells: int) -> float:
    share = (8 + coefficient_count(settings.bands)) / 33
    face = cells ** (2 / 3)
    # A kernel gathers 7.07 P / N² samples on the average; places without any are as rare as with random positions.
    holes = math.exp(-7.07 * probes / face)
    nodes = face if settings.repair in ("pull-push", "bilateral") else cells
    each, hole = REPAIR_SECONDS[settings.repair]
    repair = DIRECTION_SECONDS + nodes * (each + holes * hole)
    products, moments = (5, 6) if settings.gradients == "regression" else (1, 1)
    return repair + probes * SAMPLE_SECONDS * moments + cells * CELL_SECONDS * share * products


def estimate(settings: IlfGridSettings) -> Estimate:
    """Return what a job needs. Raises `LightwellError` where the capture cannot be used."""
    capture = open_capture(Path(settings.capture))
    specs = grid_specs(settings, capture)
    cells = sum(spec.cells for spec in specs)
    directions = count_directions(settings, capture)
    seconds = directions * direction_seconds(settings, capture.count, specs)
    seconds += 0 if capture.sorted_samples else capture.count * FRAME_SECONDS * directions / 49_000
    grid_bytes = cells * coefficient_count(settings.bands) * 3 * 4
    many = 1 if settings.gradients == "none" else 4
    sorted_bytes = directions * capture.count * (6 if settings.sample_format == "half" else 12)
    adaptive = settings.adaptive_tolerance is not None
    if adaptive:
        seconds += cells * ADAPT_SECONDS * coefficient_count(settings.bands) / 25
    return Estimate(
        seconds=seconds,
        # Bricks with nodes of their own take up to twice the grid; sums and the atlas as much again.
        memory_bytes=PROCESS_BYTES
        + (3 * many + 5 * adaptive) * grid_bytes
        + min(settings.memory_mb * MEGABYTE, SORT_BYTES * directions * capture.count),
        disk_bytes=(0 if capture.sorted_samples else sorted_bytes) + (8 * many + 3 * adaptive) * grid_bytes,
    )


def make_plan(field: Field, processes: int) -> Plan:
    """Return the plan of a job."""
    settings, probes, directions = field.settings, field.capture.count, field.directions
    batches: list[Part] = []
    if field.capture.sorted_samples is None:
        fitting = settings.memory_mb * MEGABYTE // (directions * SORT_BYTES)
        batches = _ranges(probes, max(1, min(MOST_BATCH, fitting)))
    cost = direction_seconds(settings, probes, field.specs)
    # Parts of one size, as many in each checkpoint as there are processes: none waits for a larger one, or for none.
    checkpoints = math.ceil(directions / max(1, processes * min(MOST_PART, settings.checkpoint_seconds / cost)))
    size = max(LEAST_PART, math.ceil(directions / (checkpoints * processes)))
    return Plan(batches, _ranges(directions, size), processes, field.capture.digest)


def _ranges(count: int, size: int) -> list[Part]:
    return [Part(first, min(first + size, count)) for first in range(0, count, size)]


def read_plan(path: Path) -> Plan:
    """Read what `make_plan` made."""
    return msgspec.json.decode(path.read_bytes(), type=Plan)


def capture_attributes(field: Field) -> dict[str, Any]:
    """Return what a grid says of the capture that it comes from."""
    info = field.capture.info
    return {
        "capture": {"name": info.name, "digest": field.capture.digest, "probes": field.capture.count},
        "units": info.units,
    }
