"""The stages that need no order: a frame goes in, its coefficients come out (merge … gradients)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import coefficient_count
from lightwell.probe.samples import SampleCounts
from lightwell.settings import StreamSettings
from lightwell_workers.ingest.frame import Frame, Pixels
from lightwell_workers.ingest.stages.gradients import PassingProxyError, Slope, measure_slope
from lightwell_workers.ingest.stages.map import Geometry, make_geometry
from lightwell_workers.ingest.stages.merge import merge
from lightwell_workers.ingest.stages.timing import StageTimes


@dataclass(frozen=True, slots=True, kw_only=True)
class Reduced:
    """One frame after projection; no longer holds on to the source's picture except through ``pixels``."""

    frame: Frame
    settings: StreamSettings
    """Those under which it was projected."""
    pixels: Pixels
    """The picture after merging."""
    geometry: Geometry
    coefficients: NDArray[np.float64]
    """In the mapping's axes, ``(bands², 3)``, not windowed or filtered."""
    slope: Slope | None
    """How they change with the probe's place, in the mapping's axes; None where that is not measured."""
    no_slope: str
    """Why this frame has no gradients though the stream has; empty otherwise."""
    counts: SampleCounts
    times: StageTimes


def reduce_frame(frame: Frame, settings: StreamSettings, uploads: Path | None = None) -> Reduced:
    """Run the order-free stages on one frame; safe on several threads at once.

    ``uploads`` is where the server keeps what it was sent.

    Raises
    ------
    MappingError, ProxyError
        Where the picture's size cannot belong to the mapping, or the stream's proxy cannot be used.
    """
    times = StageTimes()
    times.stage_ms["source"] = frame.source_ms
    with times.measure("merge"):
        pixels, counts = merge(frame.pixels, settings.negatives, frame.clip_level)
    with times.measure("map"):
        geometry = make_geometry(settings, pixels.shape[0], pixels.shape[1])
    with times.measure("downsample"):
        reduced = pixels if geometry.downsampler is None else geometry.downsampler(pixels)
    with times.measure("project"):
        projected = geometry.projector.project(reduced) * settings.gain
    slope, no_slope = None, ""
    if settings.gradients.proxy != "none":
        with times.measure("gradients"):
            try:
                slope = measure_slope(frame, settings, geometry, reduced, projected, uploads)
            except PassingProxyError as error:
                no_slope = str(error)
    return Reduced(
        frame=frame,
        settings=settings,
        pixels=pixels,
        geometry=geometry,
        coefficients=projected[: coefficient_count(settings.bands)],
        slope=slope,
        no_slope=no_slope,
        counts=counts,
        times=times,
    )
