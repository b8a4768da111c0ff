"""Small valid messages."""

from __future__ import annotations

import numpy as np

from lightwell.wire import Announce, Backdrop, Frame, Quality, StreamStatus, WindowUsed, pack_coefficients


def frame(name: str = "0", bands: int = 2) -> Frame:
    return Frame(
        stream="test",
        session="s",
        seq=0,
        capture_time_ns=1,
        ingest_time_ns=2,
        publish_time_ns=0,
        bands=bands,
        coefficients=pack_coefficients(np.zeros((bands * bands, 3))),
        window=WindowUsed(kind="none", weights=[1.0] * bands),
        quality=Quality(),
        source_frame=name,
    )


def status(state: str = "running") -> StreamStatus:
    return StreamStatus(stream="test", session="s", state=state)  # type: ignore[arg-type]


def backdrop(seq: int = 0, size: int = 10) -> Backdrop:
    return Backdrop(
        stream="test", session="s", seq=seq, capture_time_ns=1, width=2, height=1, k=200, cap=512, jpeg=bytes(size)
    )


def announce() -> Announce:
    return Announce(stream="test", session="s", worker_version="0", settings={"source": "synthetic:room"})
