"""The stages that run in the order of the frames: window, filter, and the message that publish sends."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from lightwell import wire
from lightwell.conventions import degree_of_index
from lightwell.errors import FrameError
from lightwell.settings import WindowSettings
from lightwell.sh.dominant import split_dominant
from lightwell.sh.temporal import Place, TemporalFilter, make_filter
from lightwell.sh.window import WindowStage
from lightwell_workers.ingest.stages.gradients import MOST_BLIND
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
        self._filter_key: tuple[object, ...] = ()

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
            place = _place(reduced, weights)
            filtered = temporal.update(windowed, frame.capture_time_ns, frame.world_from_camera, place)
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
            position=None if place.position_m is None else _vector(place.position_m),
            gradients=None if temporal.gradients is None else wire.pack_coefficients(temporal.gradients),
            trust_radius_m=_trust_radius(reduced) if temporal.gradients is not None else None,
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
        # A place that is corrected in the settings is no movement that the filter could follow.
        filter_key = (settings.bands, settings.filter, settings.position_m)
        if self._filter is None or self._filter_key != filter_key:
            self._filter = make_filter(settings.filter)
            self._filter_key = filter_key
        return self._window, self._filter


def _place(reduced: Reduced, weights: NDArray[np.float64]) -> Place:
    """Return where the frame was taken and how its windowed light changes there: windowed alike."""
    position = reduced.frame.position_m
    if position is None and reduced.settings.position_m is not None:
        position = np.array(reduced.settings.position_m)
    slope = reduced.slope
    if slope is None:
        return Place(position_m=position)
    windowed = slope.gradients * weights[degree_of_index(len(weights)), np.newaxis, np.newaxis]
    return Place(windowed, position, slope.trust_radius_m)


def _trust_radius(reduced: Reduced) -> float | None:
    """Return how far gradients hold; None where the light is far, or too much of it is not seen to say that."""
    if reduced.slope is None or reduced.geometry.blind_fraction > MOST_BLIND:
        return None
    return reduced.slope.trust_radius_m if math.isfinite(reduced.slope.trust_radius_m) else None


def _require_sendable(reduced: Reduced) -> None:
    largest = float(np.abs(reduced.coefficients).max())
    if reduced.slope is not None:  # np.maximum, unlike max, keeps NaN
        largest = float(np.maximum(largest, np.abs(reduced.slope.gradients).max()))
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
