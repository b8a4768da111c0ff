"""What a worker's message must be beyond its types: the numbers in it, and whose it is. No sockets."""

from __future__ import annotations

import math

import numpy as np

from lightwell.conventions import coefficient_count
from lightwell.settings import FARTHEST_M
from lightwell.wire import Backdrop, DominantLight, Frame, StreamStatus

FLOAT_BYTES = 4
LATE_NS = 50_000_000
"""A frame that took so much longer than the quickest one is late: the server is behind, or the network is."""


class Punctuality:
    """Tells frames that were held up on their way, whatever the difference between the two machines' clocks."""

    def __init__(self) -> None:
        self._quickest_ns: int | None = None

    def is_late(self, publish_time_ns: int, received_ns: int) -> bool:
        """Return whether a frame took much longer than the quickest one so far."""
        took_ns = received_ns - publish_time_ns
        if self._quickest_ns is None or took_ns < self._quickest_ns:
            self._quickest_ns = took_ns
        return took_ns - self._quickest_ns > LATE_NS


def check_message(message: Frame | Backdrop | StreamStatus, stream: str, session: str) -> None:
    """Let a message of this stream and session pass.

    Raises
    ------
    ValueError
        Says what is wrong and what was expected.
    """
    if message.stream != stream:
        raise ValueError(f"the message is of stream {message.stream[:63]!r}, the socket is of {stream!r}")
    if message.session != session:
        raise ValueError(f"the message is of session {message.session[:32]!r}, announced was {session[:32]!r}")
    match message:
        case Frame():
            _check_frame(message)
        case Backdrop():
            if not message.jpeg.startswith(b"\xff\xd8"):
                raise ValueError("the backdrop is no JPEG")
        case StreamStatus():
            pass


def _check_frame(frame: Frame) -> None:
    if frame.convention != "lightwell":
        raise ValueError(f"convention {frame.convention!r}: workers publish 'lightwell', the server converts")
    _check_floats("coefficients", frame.coefficients, coefficient_count(frame.bands) * 3)
    if frame.truth is not None:
        _check_floats("truth", frame.truth, coefficient_count(frame.bands) * 3)
    if frame.gradients is not None:
        _check_floats("gradients", frame.gradients, coefficient_count(frame.bands) * 9)
    if frame.position is not None and not all(abs(value) <= FARTHEST_M for value in frame.position):
        raise ValueError(f"position must be finite and within {FARTHEST_M:g} m of the world's origin")
    if frame.trust_radius_m is not None and not 0 <= frame.trust_radius_m < math.inf:
        raise ValueError(f"trust_radius_m = {frame.trust_radius_m} must be at least 0 and finite; leave it out instead")
    if len(frame.window.weights) != frame.bands or not all(map(math.isfinite, frame.window.weights)):
        raise ValueError(f"window.weights must be {frame.bands} finite numbers, one a band")
    if frame.dominant is not None:
        _check_dominant(frame.dominant)


def _check_floats(name: str, packed: bytes, count: int) -> None:
    if len(packed) != count * FLOAT_BYTES:
        raise ValueError(f"{name} must be {count * FLOAT_BYTES} bytes ({count} float32), not {len(packed)}")
    if not np.isfinite(np.frombuffer(packed, dtype="<f4")).all():
        raise ValueError(f"{name} must be finite, not NaN or infinite")


def _check_dominant(light: DominantLight) -> None:
    if not all(map(math.isfinite, (*light.direction, *light.irradiance, *light.ambient))):
        raise ValueError("dominant must be finite, not NaN or infinite")
