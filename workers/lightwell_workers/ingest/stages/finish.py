"""The stages that run in the order of the frames: window, filter, and the message that publish sends."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from lightwell import wire
from lightwell.errors import FrameError
from lightwell.settings import FilterSettings, WindowSettings
from lightwell.sh.dominant import split_dominant
from lightwell.sh.temporal import TemporalFilter, make_filter
from lightwell.sh.window import WindowStage
from lightwell_workers.ingest.stages.reduce import Reduced

LARGEST_COEFFICIENT = 1e30
"""Coefficients travel as float32, whose largest is 3.4e38: no gain of filter, rotation or convention gets there."""


class Finisher:
    """Windows and filters coefficients, keeping the state that both carry from frame to frame.

    Settings may change between frames: a new window or filter starts anew with the first frame that brings it.
    """

    def __init__(self, stream: str, session: str) -> None:
        self._stream = stream
        self._session = session
        self._window: WindowStage | None = None
        self._window_key: tuple[int, WindowSettings] | None = None
        self._filter: TemporalFilter | None = None
        self._filter_key: tuple[int, FilterSettings] | None = None

    def finish(self, reduced: Reduced) -> wire.Frame:
        """Return the message for the next frame; ``seq`` and ``publish_time_ns`` are the publisher's to set.

        Raises
        ------
        FrameError
            Where the samples are so large that no message can hold their light; window and filter never saw them.
        """
        frame, settings, times = reduced.frame, reduced.settings, reduced.times
        _require_sendable(reduced)
        window, temporal = self._stages(reduced)
        with times.measure("window"):
            windowed, weights, strength = window.update(reduced.coefficients, frame.capture_time_ns)
        with times.measure("filter"):
            filtered = temporal.update(windowed, frame.capture_time_ns, frame.world_from_camera)
        return wire.Frame(
            stream=self._stream,
            session=self._session,
            seq=0,
            capture_time_ns=frame.published_capture_time_ns,
            ingest_time_ns=frame.ingest_time_ns,
            publish_time_ns=0,
            bands=settings.bands,
            coefficients=wire.pack_coefficients(filtered),
            units=settings.units,
            window=wire.WindowUsed(
                kind=settings.window.kind, weights=[float(weight) for weight in weights], strength=float(strength)
            ),
            dominant=_dominant(filtered),
            quality=wire.Quality(
                nan=reduced.counts.nan,
                infinite=reduced.counts.infinite,
                negative=reduced.counts.negative,
                saturated=reduced.counts.saturated,
                blind_fraction=reduced.geometry.blind_fraction,
                cut=temporal.cut,
                stage_ms=times.stage_ms,
            ),
            source_frame=frame.name,
            truth=_truth(frame.truth, settings.bands),
        )

    def _stages(self, reduced: Reduced) -> tuple[WindowStage, TemporalFilter]:
        settings = reduced.settings
        if self._window is None or self._window_key != (settings.bands, settings.window):
            self._window = WindowStage(settings.window, settings.bands)
            self._window_key = (settings.bands, settings.window)
        if self._filter is None or self._filter_key != (settings.bands, settings.filter):
            self._filter = make_filter(settings.filter)
            self._filter_key = (settings.bands, settings.filter)
        return self._window, self._filter


def _require_sendable(reduced: Reduced) -> None:
    largest = float(np.abs(reduced.coefficients).max())
    if not largest <= LARGEST_COEFFICIENT:  # NaN is not either
        reason = f"gives a coefficient of {largest:.3g}, above {LARGEST_COEFFICIENT:g}: are its samples damaged?"
        raise FrameError(reduced.frame.name, reason)


def _dominant(coefficients: NDArray[np.float64]) -> wire.DominantLight | None:
    if len(coefficients) < 4:
        return None
    split = split_dominant(coefficients)
    return wire.DominantLight(
        direction=_vector(split.direction), irradiance=_vector(split.irradiance), ambient=_vector(split.ambient)
    )


def _vector(values: NDArray[np.float64]) -> wire.Vector3:
    return float(values[0]), float(values[1]), float(values[2])


def _truth(truth: NDArray[np.float64] | None, bands: int) -> bytes | None:
    return None if truth is None else wire.pack_coefficients(truth[: bands * bands])
