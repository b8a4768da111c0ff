"""One captured frame, on its way from a source to the first stage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.probe.samples import LARGEST_HALF

Pixels = NDArray[np.float16] | NDArray[np.float32]
"""A picture in linear Rec. 709 RGB, ``(height, width, 3)``, C-contiguous."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """A picture and what its source knows about it."""

    pixels: Pixels
    name: str
    """What the source calls it: a file name, a frame number."""
    capture_time_ns: int
    """When the light was captured, nanoseconds since the Unix epoch. Runs ahead of the clock where a recording is read
    faster than it was made: its intervals are those of the recording, which windows and filters follow."""
    ingest_time_ns: int
    """When the worker had the whole frame."""
    source_ms: float = 0.0
    """What the source spent on reading or rendering it, milliseconds."""
    clip_level: float = LARGEST_HALF
    """Samples from here on are the source's highest, whatever the light was; in the picture's own units."""
    truth: NDArray[np.float64] | None = None
    """Exact coefficients in world axes, ``(bands², 3)``, where the source knows them."""
    world_from_camera: NDArray[np.float64] | None = None
    """Rotation from the mapping's axes to world axes while the camera turns, ``(3, 3)``; None: it does not turn."""
    position_m: NDArray[np.float64] | None = None
    """Where the probe was, ``(3,)`` world metres, where the source knows it; it wins over the stream's settings."""

    @property
    def published_capture_time_ns(self) -> int:
        """Capture time in messages: never later than the frame came."""
        return min(self.capture_time_ns, self.ingest_time_ns)
