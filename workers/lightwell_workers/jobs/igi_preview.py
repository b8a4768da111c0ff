"""The picture that a running ``igi-render`` job shows: coarse first, then tile by tile as it will be."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from lightwell.igi.rendering import Tile
from lightwell.io.files import write_atomically
from lightwell.io.igi_scenes import meter
from lightwell.io.preview import encode_png
from lightwell.render.tonemap import expose_and_encode
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.igi_plan import Plan, known_exposure

SIDE = 640
"""Longer side at most, pixels."""
PAUSE_SECONDS = 0.7


class Preview:
    """Draws ``preview.png`` in the job's work folder, now and then; it is not among the results."""

    def __init__(self, plan: Plan, context: JobContext) -> None:
        """Go on with what an earlier step has drawn."""
        self._plan = plan
        self._png = context.directory.preview
        self._state = context.work / "preview.npy"
        self._stride = -(-max(plan.size) // SIDE)
        shape = (-(-plan.height // self._stride), -(-plan.width // self._stride), 3)
        self._colour: NDArray[np.float32] = np.zeros(shape, np.float32)
        self._drawn = time.monotonic()
        with contextlib.suppress(OSError, ValueError):
            found = np.load(self._state)
            if found.shape == shape:
                self._colour = found

    def lay(self, coarse: NDArray[np.float32]) -> None:
        """Begin with a coarse picture ``(h, w, 3)``, drawn at once."""
        height, width = self._colour.shape[:2]
        larger = cv2.resize(coarse, (width, height), interpolation=cv2.INTER_LINEAR)
        self._colour = np.asarray(larger, np.float32)
        self.draw()

    def put(self, tile: Tile, path: Path) -> None:
        """Put a tile that has been written to its place; draw where the last time is long enough ago."""
        step = self._stride
        top, left = -(-tile.top // step), -(-tile.left // step)
        with np.load(path) as file:
            shown = file["lit"] + file["behind"] if self._plan.backdrop else file["lit"]
            part = shown[top * step - tile.top :: step, left * step - tile.left :: step]
        self._colour[top : top + part.shape[0], left : left + part.shape[1]] = part
        if time.monotonic() - self._drawn > PAUSE_SECONDS:
            self.draw()

    def draw(self) -> None:
        """Write the picture. A disk that is full loses it: the job's own writes say so."""
        ev = known_exposure(self._plan, self._state.parent)
        ev = meter(self._colour) if ev is None else ev
        pixels = expose_and_encode(self._colour, ev, tone_mapping=self._plan.tone_mapping)
        with contextlib.suppress(OSError):
            with self._state.with_name(".preview.partial").open("wb") as file:
                np.save(file, self._colour)
            self._state.with_name(".preview.partial").replace(self._state)
            write_atomically(self._png, encode_png(pixels))
        self._drawn = time.monotonic()
