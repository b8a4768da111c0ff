"""A worker whose light the test chooses."""

from __future__ import annotations

import contextlib
import threading
import time
from types import TracebackType

import cv2
import numpy as np
from numpy.typing import NDArray
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from lightwell import wire
from lightwell.sh.basis import evaluate

BANDS = 5
FRAMES_PER_SECOND = 25
K, CAP = 200.0, 512.0


def distant_light(direction: tuple[float, float, float], irradiance: float = 4.0) -> NDArray[np.float64]:
    """Return the coefficients of a white distant light and a dim surround, ``(25, 3)``.

    The light is windowed by ``1/(1 + l²/8)``, so that it is round and rings little.
    """
    basis = evaluate(np.array(direction) / np.linalg.norm(direction), BANDS)
    degree = np.repeat(np.arange(BANDS), 2 * np.arange(BANDS) + 1)
    coefficients = irradiance * basis / (1 + degree**2 / 8)
    coefficients[0] += 0.15 * np.sqrt(4 * np.pi)
    return np.repeat(coefficients[:, None], 3, axis=1)


def log_jpeg(picture: NDArray[np.float64]) -> bytes:
    """Encode linear RGB as `lightwell.wire.Backdrop` says."""
    curve = np.log2(1 + K * np.minimum(picture, CAP)) / np.log2(1 + K * CAP)
    done, data = cv2.imencode(".jpg", np.rint(255 * curve[..., ::-1]).astype(np.uint8))
    assert done
    return data.tobytes()


class Publisher:
    """Publishes frames, a backdrop and a status until it is closed; comes back when the server does."""

    def __init__(self, server_url: str, stream: str, **settings: object) -> None:
        self.url = f"{server_url.replace('http', 'ws', 1)}/api/v1/streams/{stream}/publish"
        self.stream = stream
        self.settings = {"source": "synthetic:test"} | settings
        self.coefficients = distant_light((0, 0, 1))
        self.backdrop = np.full((32, 64, 3), 0.2)
        self.gradients: NDArray[np.float64] | None = None
        self.position: tuple[float, float, float] | None = None
        self.trust_radius_m: float | None = None
        self.quality = wire.Quality(blind_fraction=0.021, nan=3)
        self.silent = threading.Event()
        """While set, the worker stays connected and sends no frame."""
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=f"publisher {stream}")
        self._seq = 0

    def __enter__(self) -> Publisher:
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()

    def _run(self) -> None:
        while not self._stop.is_set():
            with contextlib.suppress(OSError, WebSocketException):
                self._publish()
            self._stop.wait(0.1)

    def _publish(self) -> None:
        with connect(self.url, subprotocols=[Subprotocol(wire.SUBPROTOCOL)], proxy=None) as socket:
            announce = wire.Announce(stream=self.stream, session="test", worker_version="0", settings=self.settings)
            socket.send(wire.encode(announce))
            socket.recv()
            while not self._stop.wait(1 / FRAMES_PER_SECOND):
                if self.silent.is_set():
                    continue
                socket.send(wire.encode(self._frame()))
                if self._seq % 10 == 1:
                    socket.send(wire.encode(self._picture()))
                    socket.send(wire.encode(self._status()))

    def _frame(self) -> wire.Frame:
        now = time.time_ns()
        self._seq += 1
        linear = self.coefficients[[3, 1, 2], 0]
        direction = linear / np.linalg.norm(linear)
        return wire.Frame(
            stream=self.stream,
            session="test",
            seq=self._seq - 1,
            capture_time_ns=now,
            ingest_time_ns=now,
            publish_time_ns=now,
            bands=BANDS,
            coefficients=wire.pack_coefficients(self.coefficients),
            position=self.position,
            gradients=None if self.gradients is None else wire.pack_coefficients(self.gradients.reshape(-1, 3)),
            trust_radius_m=self.trust_radius_m,
            window=wire.WindowUsed(kind="auto", weights=[1.0] * BANDS, strength=0.012),
            dominant=wire.DominantLight(
                direction=(float(direction[0]), float(direction[1]), float(direction[2])),
                irradiance=(4.0, 4.0, 4.0),
                ambient=(0.1, 0.1, 0.1),
            ),
            quality=self.quality,
            source_frame=f"frame {self._seq - 1}",
        )

    def _picture(self) -> wire.Backdrop:
        height, width, _ = self.backdrop.shape
        return wire.Backdrop(
            stream=self.stream,
            session="test",
            seq=self._seq,
            capture_time_ns=time.time_ns(),
            width=width,
            height=height,
            k=K,
            cap=CAP,
            jpeg=log_jpeg(self.backdrop),
        )

    def _status(self) -> wire.StreamStatus:
        return wire.StreamStatus(
            stream=self.stream,
            session="test",
            state="running",
            fps=FRAMES_PER_SECOND,
            frames_published=self._seq,
            frames_skipped=2,
        )
