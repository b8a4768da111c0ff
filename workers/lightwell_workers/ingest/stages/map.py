"""map: where each pixel of the current frame looks, and the tables that follow from it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

from lightwell.errors import FrameError
from lightwell.probe.downsample import Downsampler
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.probe.projection import Projector, projector
from lightwell.settings import StreamSettings
from lightwell_workers.ingest.frame import Frame

PERSISTENT_FRAMES = 10
"""Frames in a row of one new size after which the stream changes to it."""

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
        projector=projector(reduced, settings.bands, settings.weights, settings.mapping.blind),
        blind_fraction=(1.0 - math.cos(mapping.blind_half_angle)) / 2.0,
    )


class SizeGate:
    """Refuses single frames of another size; lets the stream change to a size that persists."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None
        """Height and width of the stream's pictures; None before the first."""
        self._other: tuple[int, int] | None = None
        self._others_in_a_row = 0

    def refusal(self, frame: Frame) -> FrameError | None:
        """Return why a frame is to be skipped; None where it has the stream's size.

        The first frame sets the size; another one becomes it after ``PERSISTENT_FRAMES`` in a row.
        """
        height, width, _ = frame.pixels.shape
        if self.size is None or (height, width) == self.size:
            self.size = height, width
            self._other, self._others_in_a_row = None, 0
            return None
        self._others_in_a_row = self._others_in_a_row + 1 if (height, width) == self._other else 1
        self._other = height, width
        if self._others_in_a_row >= PERSISTENT_FRAMES:
            self.size = height, width
            return None
        return FrameError(frame.name, f"is {width}×{height}, the stream's frames are {self.size[1]}×{self.size[0]}")
