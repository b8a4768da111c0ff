"""The picture of the surroundings that goes beside the coefficients, at its own rate and on its own thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray

from lightwell import wire
from lightwell.probe.factory import make_mapping
from lightwell.probe.mapping import Mapping
from lightwell.probe.unwrap import Unwrapper
from lightwell.settings import MappingSettings
from lightwell_workers.ingest.log import stage_logger
from lightwell_workers.ingest.stages.reduce import Reduced

LOG_K = 200.0
LOG_CAP = 512.0
"""Curve of the log-encoded JPEG: ``y = log2(1 + k x) / log2(1 + k cap)`` (WEB.md §5)."""


def _log_table() -> NDArray[np.uint8]:
    """Return the code of every half-float bit pattern, ``(65536,)``; below zero and NaN are 0, +Inf is 255."""
    halves = np.arange(65536, dtype=np.uint16).view(np.float16).astype(np.float64)
    clipped = np.clip(np.nan_to_num(halves, nan=0.0, posinf=LOG_CAP, neginf=0.0), 0.0, LOG_CAP)
    levels = np.log2(1.0 + LOG_K * clipped) / np.log2(1.0 + LOG_K * LOG_CAP)
    return np.asarray(np.rint(255.0 * levels), dtype=np.uint8)


_LOG_TABLE = _log_table()


def encode_log_jpeg(picture: NDArray[np.float32], quality: int) -> bytes:
    """Return ``(height, width, 3)`` linear RGB as a log-encoded JPEG."""
    halves = np.clip(picture, 0.0, LOG_CAP).astype(np.float16)
    codes = _LOG_TABLE[halves.view(np.uint16)]
    _, jpeg = cv2.imencode(".jpg", cv2.cvtColor(codes, cv2.COLOR_RGB2BGR), [cv2.IMWRITE_JPEG_QUALITY, quality])
    return jpeg.tobytes()


class BackdropStage:
    """Makes a backdrop of the newest frame whenever one is due; never holds a frame's coefficients up."""

    def __init__(self, stream: str, session: str, show: Callable[[wire.Backdrop], None]) -> None:
        self._stream = stream
        self._session = session
        self._show = show
        self._changed = threading.Condition()
        self._waiting: Reduced | None = None
        self._next_due_seconds = 0.0
        self._closed = False
        self._count = 0
        self._unwrapper: Unwrapper | None = None
        self._unwrapper_key: tuple[object, ...] = ()
        self._thread = threading.Thread(target=self._run, name="backdrop", daemon=True)
        self._thread.start()

    def offer(self, reduced: Reduced) -> None:
        """Take the frame where a backdrop is due; returns at once."""
        settings = reduced.settings.backdrop
        now = time.monotonic()
        if not settings.enabled or now < self._next_due_seconds:
            return
        interval = 1.0 / settings.fps
        self._next_due_seconds = max(self._next_due_seconds + interval, now + 0.5 * interval)
        with self._changed:
            self._waiting = reduced
            self._changed.notify()

    def close(self) -> None:
        """Make the backdrop that is under way, then end."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._waiting is not None)
                reduced, self._waiting = self._waiting, None
            if reduced is None:
                return
            try:
                self._show(self._make(reduced))
            except Exception as error:  # a defect: the light goes on without its backdrop
                stage_logger("backdrop").error("no more backdrops", exc_info=error)
                return

    def _make(self, reduced: Reduced) -> wire.Backdrop:
        settings = reduced.settings.backdrop
        picture = self._unwrap(reduced.geometry.mapping, settings.width)(reduced.pixels)
        if reduced.frame.world_from_camera is not None:
            picture = turn(picture, reduced.frame.world_from_camera)
        self._count += 1
        return wire.Backdrop(
            stream=self._stream,
            session=self._session,
            seq=self._count - 1,
            capture_time_ns=reduced.frame.published_capture_time_ns,
            width=picture.shape[1],
            height=picture.shape[0],
            k=LOG_K,
            cap=LOG_CAP,
            jpeg=encode_log_jpeg(picture * np.float32(reduced.settings.gain), settings.quality),
        )

    def _unwrap(self, mapping: Mapping, width: int) -> Unwrapper:
        if self._unwrapper is None or self._unwrapper_key != (mapping.key, width):
            self._unwrapper = Unwrapper(mapping, width)
            self._unwrapper_key = (mapping.key, width)
        return self._unwrapper


def turn(picture: NDArray[np.float32], world_from_camera: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return a lat-long picture in camera axes as a lat-long picture in world axes (bilinear)."""
    height, width = picture.shape[:2]
    latlong = make_mapping(MappingSettings(kind="latlong"), height, width)
    columns, rows = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    directions, _ = latlong.directions(columns, rows)
    x, y, _ = latlong.pixels(directions @ world_from_camera)
    map_x = np.asarray(x - 0.5, dtype=np.float32)
    map_y = np.asarray(np.clip(y - 0.5, 0, height - 1), dtype=np.float32)
    return np.asarray(cv2.remap(picture, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP), np.float32)
