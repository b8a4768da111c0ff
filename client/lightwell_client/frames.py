"""Frames as a program wants them: NumPy arrays, times, what was missed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import Convention, Units
from lightwell.gradients.extrapolate import extrapolate
from lightwell.wire import DominantLight, Frame, Quality, WindowUsed, unpack_coefficients, unpack_gradients


@dataclass(frozen=True, eq=False)
class LightFrame:
    """SH coefficients of one captured frame, in the convention and with the bands that were asked for."""

    stream: str
    session: str
    """Names one run of the worker; ``seq`` starts anew with each."""
    seq: int
    coefficients: NDArray[np.float32]
    """``(bands², 3)`` float32 of radiance, linear Rec. 709 RGB, coefficient (l, m) at l² + l + m; read-only."""
    bands: int
    convention: Convention
    units: Units
    mapping: str
    """How the probe's picture covers the sphere."""
    window: WindowUsed
    dominant: DominantLight | None
    quality: Quality
    gradients: NDArray[np.float32] | None
    """``(bands², 3, 3)``: coefficient, channel, ∂/∂(x, y, z) per metre, in the convention's axes; None where the stream
    measures none or they were not asked for (``gradients=True``)."""
    position: NDArray[np.float64] | None
    """``(3,)`` metres in the convention's axes: where the probe stood; None where that is not known."""
    trust_radius_m: float | None
    """How far from there `at` is right to about ten per cent, metres; None: not known, or the light is far."""
    truth: NDArray[np.float32] | None
    """Exact coefficients, where the source knows them (synthetic rooms)."""
    source_frame: str
    capture_time_ns: int
    ingest_time_ns: int
    publish_time_ns: int
    received_time_ns: int
    """When this client had it, by its own clock."""
    missed: int
    """Frames that were overtaken between the frame before and this one, at the server or here."""
    from_hello: bool = False
    """True for the newest frame that the server had when the connection was made: it may be of any age."""

    @property
    def latency_seconds(self) -> float:
        """Time from capture to this client; clocks of two machines may disagree.

        Says nothing of the way the light takes where the frame is ``from_hello``.
        """
        return (self.received_time_ns - self.capture_time_ns) / 1e9

    def at(self, offset: ArrayLike) -> NDArray[np.float32]:
        """Return the coefficients ``(…, bands², 3)`` at ``offset`` ``(…, 3)`` metres from the probe.

        ``c + G·offset``, the step cut short for each colour so that its mean radiance keeps at least 30 %
        (MATHS §7.4). Axes are the convention's.

        Raises
        ------
        ValueError
            Where the frame has no gradients.
        """
        if self.gradients is None:
            raise ValueError(
                f"this frame of {self.stream!r} has no gradients: follow the stream with gradients=True, and give it a "
                "proxy ([streams.NAME.gradients])"
            )
        return extrapolate(self.coefficients, self.gradients, offset).astype(np.float32)

    @classmethod
    def from_wire(
        cls, frame: Frame, *, mapping: str, received_time_ns: int, missed: int, from_hello: bool = False
    ) -> LightFrame:
        """Return the frame of a message; raises ``ValueError`` where its arrays do not fit its bands."""
        coefficients = unpack_coefficients(frame.coefficients)
        if len(coefficients) != frame.bands**2:
            raise ValueError(f"{len(coefficients)} coefficients do not fit {frame.bands} bands")
        gradients = None if frame.gradients is None else unpack_gradients(frame.gradients)
        if gradients is not None and len(gradients) != frame.bands**2:
            raise ValueError(f"gradients of {len(gradients)} coefficients do not fit {frame.bands} bands")
        return cls(
            stream=frame.stream,
            session=frame.session,
            seq=frame.seq,
            coefficients=coefficients,
            bands=frame.bands,
            convention=frame.convention,
            units=frame.units,
            mapping=mapping,
            window=frame.window,
            dominant=frame.dominant,
            quality=frame.quality,
            gradients=gradients,
            position=None if frame.position is None else np.array(frame.position),
            trust_radius_m=frame.trust_radius_m,
            truth=None if frame.truth is None else unpack_coefficients(frame.truth),
            source_frame=frame.source_frame,
            capture_time_ns=frame.capture_time_ns,
            ingest_time_ns=frame.ingest_time_ns,
            publish_time_ns=frame.publish_time_ns,
            received_time_ns=received_time_ns,
            missed=missed,
            from_hello=from_hello,
        )

    def as_json(self) -> dict[str, Any]:
        """Return what ``lightwell watch --json`` prints, ready for ``json.dumps``."""
        return {
            "stream": self.stream,
            "session": self.session,
            "seq": self.seq,
            "capture_time_ns": self.capture_time_ns,
            "ingest_time_ns": self.ingest_time_ns,
            "publish_time_ns": self.publish_time_ns,
            "received_time_ns": self.received_time_ns,
            "missed": self.missed,
            "from_hello": self.from_hello,
            "bands": self.bands,
            "convention": self.convention,
            "units": self.units,
            "window": self.window.kind,
            "window_weights": self.window.weights,
            "mapping": self.mapping,
            "coefficients": self.coefficients.tolist(),
            "position": None if self.position is None else self.position.tolist(),
            "gradients": None if self.gradients is None else self.gradients.tolist(),
            "trust_radius_m": self.trust_radius_m,
            "dominant": None if self.dominant is None else msgspec.to_builtins(self.dominant),
            "quality": msgspec.to_builtins(self.quality),
            "source_frame": self.source_frame,
        }
