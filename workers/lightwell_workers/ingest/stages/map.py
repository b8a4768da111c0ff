"""map: where each pixel of the current frame looks, and the tables that follow from it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache

from lightwell.errors import FrameError
from lightwell.probe.downsample import Downsampler
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.probe.projection import Projector, projector
from lightwell.settings import GradientsSettings, StreamSettings
from lightwell_workers.ingest.frame import Frame

RECENT_FRAMES = 10
"""Frames whose majority decides on the size of the stream's pictures."""

KEPT = 4
"""Mappings and downsamplers that are kept: those before and after a change of settings or size."""

_mapping = lru_cache(maxsize=KEPT)(make_mapping)
_downsampler = lru_cache(maxsize=KEPT)(Downsampler)


@dataclass(frozen=True, slots=True)
class Geometry:
    """The tables for pictures of one size."""

    mapping: Mapping
    downsampler: Downsampler | None
    """None where whole frames are projected."""
    projector: Projector
    """Has one band more than the stream where its gradients are those of a sphere that goes with the probe."""
    blind_fraction: float
    """Share of the sphere that the probe does not see."""


def make_geometry(settings: StreamSettings, height: int, width: int) -> Geometry:
    """Return the tables for ``settings`` and pictures of ``height × width``.

    A picture that is no wider than the resolution is projected as it is. Tables are made once and then kept, each kind
    by what it depends on: calling this for every frame costs microseconds.

    Raises
    ------
    MappingError
        Where a picture of this size cannot belong to the mapping.
    """
    mapping = _mapping(settings.mapping, height, width)
    downsampler = None
    if 0 < settings.resolution < width:
        downsampler = _downsampler(mapping, settings.resolution, settings.downsample)
    reduced = mapping if downsampler is None else downsampler.mapping
    return Geometry(
        mapping=mapping,
        downsampler=downsampler,
        projector=projector(
            reduced, settings.bands + in_closed_form(settings.gradients), settings.weights, settings.mapping.blind
        ),
        blind_fraction=(1.0 - math.cos(mapping.blind_half_angle)) / 2.0,
    )


def in_closed_form(gradients: GradientsSettings) -> bool:
    """Return whether the gradients follow from the coefficients alone (MATHS §7.7)."""
    return gradients.proxy == "sphere" and gradients.centre_m is None


class SizeGate:
    """Refuses single frames of another size; the size of the stream's pictures is that of most recent frames."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None
        """Height and width of the stream's pictures; None before the first."""
        self._recent: deque[tuple[int, int]] = deque(maxlen=RECENT_FRAMES)

    def refusal(self, frame: Frame) -> FrameError | None:
        """Return why a frame is to be skipped; None where it has the stream's size.

        The first frame sets the size. Another one becomes it once more than half of the last ``RECENT_FRAMES`` frames
        have it: after six of them in a stream that runs, but after two where only the first frame was of another size.
        """
        height, width, _ = frame.pixels.shape
        self._recent.append((height, width))
        if self.size is None or 2 * self._recent.count((height, width)) > len(self._recent):
            self.size = height, width
        if (height, width) == self.size:
            return None
        return FrameError(frame.name, f"is {width}×{height}, the stream's frames are {self.size[1]}×{self.size[0]}")
