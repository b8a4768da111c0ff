"""Temporal filters of coefficients (equation 13 of paper 003 and its relatives; MATHS §5).

Every filter here is ``y += K (x − y)`` with *one* gain 0 ≤ K ≤ 1 for all coefficients and channels, so the output is a
mean of inputs: it shows no light that no input showed, and stays non-negative where they are. The filters differ only
in how they choose K, and in whether x is the newest frame or a mean of the last two.

Differences between coefficient vectors are measured by ``‖A c‖``, every coefficient weighted by the A_l of Lambert: by
what a diffuse surface would show of them.

A filter starts anew, and says so in ``cut``, at its first frame, when time runs backwards, after a gap longer than
``max_gap_seconds``, when the number of bands changes, and, if ``cut_threshold`` is set, when a frame differs from the
output by more than that share of the output.

A moving probe: where the gradients of the frames are known, what is held of older frames is first moved to where the
newest frame was taken, ``y ← y + G Δp`` with the mean of the gradients at both ends, and only then blended. So the
light does not lag behind the probe (MATHS §5), and a probe that moves through standing light is no change of the
light: neither a cut nor a reason to raise the gain. The gradients themselves are blended with the same gain, so that
they remain the derivatives of what is put out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import bands_of_count, degree_of_index
from lightwell.settings import FilterSettings
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.rotation import rotate, rotate_gradients

_ONE_EURO_SPEED_CUTOFF_HZ = 1.0
_KALMAN_GATE = 9.0
"""Innovations beyond three standard deviations (nine variances) are taken for changes of the light."""


@dataclass(frozen=True)
class Place:
    """What one frame says of the light round the probe."""

    gradients: NDArray[np.float64] | None = None
    """``(bands², 3, 3)``: coefficient, channel, ∂/∂(x, y, z) per metre, in the axes of the coefficients."""
    position_m: NDArray[np.float64] | None = None
    """``(3,)`` world metres."""
    reach_m: float = math.inf
    """How far the gradients hold: a probe that moved further since the frame before starts the filter anew."""


class TemporalFilter(Protocol):
    """What `make_filter` returns."""

    cut: bool
    """True where the last update started anew."""
    gradients: NDArray[np.float64] | None
    """Filtered like the coefficients, in world axes, ``(bands², 3, 3)``; None where the last frame brought none."""

    def update(
        self,
        coefficients: ArrayLike,
        time_ns: int,
        world_from_local: ArrayLike | None = None,
        place: Place | None = None,
    ) -> NDArray[np.float64]:
        """Take one frame and return the filtered coefficients in world axes.

        Parameters
        ----------
        coefficients
            ``(bands², 3)``, in local axes where ``world_from_local`` is given.
        time_ns
            Capture time, nanoseconds since the Unix epoch.
        world_from_local
            ``(3, 3)`` rotation of a moving camera; the frame is rotated into world axes before it is filtered.
        place
            Where the frame was taken and how its light changes there, as far as that is known.

        Returns
        -------
        ``(bands², 3)`` float64, the caller's to keep.

        Raises
        ------
        ValueError
            Where coefficients or gradients hold NaN or Inf, which no later frame would mend, or the rotation is none.
        """
        ...

    def reset(self) -> None:
        """Forget everything: the next update starts anew."""
        ...


class _Gain(Protocol):
    """Chooses the gain of one update. Norms are A-weighted."""

    def start(self, level: float) -> None:
        """Begin at a first frame of norm ``level``."""
        ...

    def gain(self, seconds: float, level: float, innovation: float, change: float) -> float:
        """Return K, 0 … 1.

        ``seconds`` since the last frame; ``level = ‖A y‖``, ``innovation = ‖A(x − y)‖`` with the previous output y;
        ``change = ‖A(x − x_previous)‖``.
        """
        ...


def _linear_hold_share(seconds: float, tau_seconds: float) -> float:
    """Return the share of the frame before in what a low-pass of time constant τ sees of a linear change.

    With ``a = Δt/τ``, ``p = e^−a`` and ``q = (1 − p)/a`` the exact response to an input that is linear between frames
    is ``y = p y + (q − p) x_previous + (1 − q) x`` (MATHS §5), which is ``y += (1 − p)(target − y)`` with this share
    of ``x_previous`` in the target. Holding the newest frame instead runs half a frame ahead of the light.
    """
    a = seconds / tau_seconds if tau_seconds > 0 else math.inf
    if a < 1e-4:
        return 0.5 - a / 12  # the series: q − p and 1 − p cancel
    if a > 700:
        return 1 / a
    decay = math.exp(-a)
    return ((1 - decay) / a - decay) / (1 - decay)


class _ConstantGain:
    """Kinds none (K = 1) and alpha: ``y = (x + α y)/(1 + α)``, mean delay α frames, whatever the frame rate."""

    def __init__(self, alpha: float) -> None:
        self._gain = 1 / (1 + alpha)

    def start(self, level: float) -> None:
        """Nothing to begin."""

    def gain(self, seconds: float, level: float, innovation: float, change: float) -> float:
        """Return ``1/(1 + α)``."""
        return self._gain


class _TimeConstantGain:
    """Kind tau: ``K = 1 − e^(−Δt/τ)``, the same response in seconds at any frame rate (input held between frames)."""

    def __init__(self, tau_seconds: float) -> None:
        self._tau_seconds = tau_seconds

    def start(self, level: float) -> None:
        """Nothing to begin."""

    def gain(self, seconds: float, level: float, innovation: float, change: float) -> float:
        """Return ``1 − e^(−Δt/τ)``; 1 for τ = 0."""
        return -math.expm1(-seconds / self._tau_seconds) if self._tau_seconds > 0 else 1.0


class _OneEuroGain:
    """Kind one-euro (Casiez, Roussel and Vogel 2012) with the scalar relative speed of the light.

    The cut-off is ``f_min + β v``; the speed ``v = ‖A(x_t − x_{t−1})‖ / (Δt ‖A y‖)`` is itself smoothed at 1 Hz.
    """

    def __init__(self, min_cutoff_hz: float, beta: float) -> None:
        self._min_cutoff_hz = min_cutoff_hz
        self._beta = beta
        self._speed = 0.0

    def start(self, level: float) -> None:
        """Begin at rest."""
        self._speed = 0.0

    def gain(self, seconds: float, level: float, innovation: float, change: float) -> float:
        """Return ``1 − e^(−2π f Δt)``; 1 where the output is black, for then the relative speed has no meaning."""
        if level == 0:
            return 1.0
        if seconds == 0:
            return 0.0
        smoothing = -math.expm1(-2 * math.pi * _ONE_EURO_SPEED_CUTOFF_HZ * seconds)
        self._speed += smoothing * (change / (seconds * level) - self._speed)
        cutoff_hz = self._min_cutoff_hz + self._beta * self._speed
        return -math.expm1(-2 * math.pi * cutoff_hz * seconds)


class _KalmanGain:
    """Kind kalman: the light does a random walk; one scalar variance P for the whole vector (MATHS §5).

    Noise is relative to the light: ``r = measurement_noise ‖A y‖²`` is the variance of a frame (``E‖A noise‖²``, summed
    over coefficients and channels), ``q = process_noise ‖A y‖²`` the variance that the light gains a second. An
    innovation beyond three standard deviations is taken for a change of the light and raises P, so that a switched lamp
    is followed within a frame.
    """

    def __init__(self, process_noise: float, measurement_noise: float) -> None:
        self._process_noise = process_noise
        self._measurement_noise = measurement_noise
        self._variance = 0.0

    def start(self, level: float) -> None:
        """Begin as sure as one frame can make us."""
        self._variance = self._measurement_noise * level**2

    def gain(self, seconds: float, level: float, innovation: float, change: float) -> float:
        """Return ``P/(P + r)``; 1 where nothing is known and nothing is seen."""
        noise = self._measurement_noise * level**2
        self._variance += self._process_noise * level**2 * seconds
        total = self._variance + noise
        if innovation**2 > _KALMAN_GATE * total:
            self._variance += innovation**2 - total
            total = self._variance + noise
        gain = self._variance / total if total > 0 else 1.0
        self._variance *= 1 - gain
        return gain


class _CommonGainFilter:
    """Holds the state and decides when to start anew; the gain is chosen by a `_Gain`."""

    def __init__(
        self, gain: _Gain, cut_threshold: float, max_gap_seconds: float, linear_hold_tau: float | None = None
    ) -> None:
        self.cut = False
        self.gradients: NDArray[np.float64] | None = None
        self._linear_hold_tau = linear_hold_tau
        self._gain = gain
        self._cut_threshold = cut_threshold
        self._max_gap_seconds = max_gap_seconds
        self._output: NDArray[np.float64] | None = None
        self._input = np.empty((0, 3))
        self._place = Place()
        """Of the frame before; gradients in world axes."""
        self._time_ns = 0
        self._weights = np.empty((0, 1))

    def reset(self) -> None:
        self._output = None

    def update(
        self,
        coefficients: ArrayLike,
        time_ns: int,
        world_from_local: ArrayLike | None = None,
        place: Place | None = None,
    ) -> NDArray[np.float64]:
        frame = np.array(coefficients, dtype=np.float64)
        here = place or Place()
        if not np.isfinite(frame).all() or not (here.gradients is None or np.isfinite(here.gradients).all()):
            raise ValueError("the coefficients hold NaN or Inf; repair the samples before projection")
        if world_from_local is not None:
            frame = rotate(frame, world_from_local)
            if here.gradients is not None:
                here = replace(here, gradients=rotate_gradients(here.gradients, world_from_local))
        jumped = self._follow(here)
        self._output = self._next_output(frame, here.gradients, (time_ns - self._time_ns) * 1e-9, jumped)
        self._input, self._place = frame, here
        self._time_ns = time_ns
        return self._output.copy()

    def _follow(self, here: Place) -> bool:
        """Move what is held to where the probe is now; return whether that is further than the gradients reach."""
        before = self._place
        if here.position_m is None or before.position_m is None or self._output is None:
            return False
        moved = here.position_m - before.position_m
        known = [one.gradients for one in (before, here) if one.gradients is not None]
        if not known or not moved.any():
            return False
        # A frame without gradients says nothing of how far those of the other hold.
        reach = max(one.reach_m for one in (before, here) if one.gradients is not None)
        if float(np.linalg.norm(moved)) > reach:
            return True
        if all(gradients.shape[:1] == self._output.shape[:1] for gradients in known):
            change = (sum(known) / len(known)) @ moved
            self._output = self._output + change
            self._input = self._input + change
        return False

    def _next_output(
        self, frame: NDArray[np.float64], gradients: NDArray[np.float64] | None, seconds: float, jumped: bool
    ) -> NDArray[np.float64]:
        output = self._output
        if output is None or output.shape != frame.shape:
            return self._start(frame, gradients)
        level, innovation = self._norm(output), self._norm(frame - output)
        gap = jumped or not 0 <= seconds <= self._max_gap_seconds
        if gap or (self._cut_threshold > 0 and innovation > self._cut_threshold * level):
            return self._start(frame, gradients)
        self.cut = False
        gain = self._gain.gain(seconds, level, innovation, self._norm(frame - self._input))
        share = 0.0
        if self._linear_hold_tau is not None:
            share = _linear_hold_share(seconds, self._linear_hold_tau)
        self.gradients = self._next_gradients(gradients, gain, share)
        return output + gain * (frame + share * (self._input - frame) - output)

    def _next_gradients(self, new: NDArray[np.float64] | None, gain: float, share: float) -> NDArray[np.float64] | None:
        old, before = self.gradients, self._place.gradients
        if new is None or old is None or before is None or not new.shape == old.shape == before.shape:
            return new
        return np.asarray(old + gain * (new + share * (before - new) - old))

    def _start(self, frame: NDArray[np.float64], gradients: NDArray[np.float64] | None) -> NDArray[np.float64]:
        self.gradients = gradients
        bands = bands_of_count(frame.shape[0])
        self._weights = lambert_zonal(bands)[degree_of_index(bands), np.newaxis]
        self._gain.start(self._norm(frame))
        self.cut = True
        return frame

    def _norm(self, coefficients: NDArray[np.float64]) -> float:
        return float(np.linalg.norm(self._weights * coefficients))


def make_filter(settings: FilterSettings) -> TemporalFilter:
    """Return the filter that the settings describe."""
    gain: _Gain
    linear_hold_tau = None
    match settings.kind:
        case "none":
            gain = _ConstantGain(0.0)
        case "alpha":
            gain = _ConstantGain(settings.alpha)
        case "tau":
            gain = _TimeConstantGain(settings.tau_seconds)
            linear_hold_tau = settings.tau_seconds if settings.hold == "first" else None
        case "one-euro":
            gain = _OneEuroGain(settings.min_cutoff_hz, settings.beta)
        case "kalman":
            gain = _KalmanGain(settings.process_noise, settings.measurement_noise)
    return _CommonGainFilter(gain, settings.cut_threshold, settings.max_gap_seconds, linear_hold_tau)
