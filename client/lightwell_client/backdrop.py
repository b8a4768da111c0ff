"""Pictures of the surroundings, decoded only where somebody asks for it."""

from __future__ import annotations

import importlib
import io
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import LightwellError
from lightwell.wire import Backdrop


@dataclass(frozen=True)
class BackdropPicture:
    """A lat-long picture, log-encoded in a JPEG (`lightwell.wire.Backdrop` has the curve)."""

    stream: str
    seq: int
    capture_time_ns: int
    width: int
    height: int
    k: float
    cap: float
    jpeg: bytes

    @classmethod
    def from_wire(cls, message: Backdrop) -> BackdropPicture:
        """Return the picture of a message."""
        return cls(
            stream=message.stream,
            seq=message.seq,
            capture_time_ns=message.capture_time_ns,
            width=message.width,
            height=message.height,
            k=message.k,
            cap=message.cap,
            jpeg=message.jpeg,
        )

    def decode(self) -> NDArray[np.float32]:
        """Return linear RGB radiance, ``(height, width, 3)`` float32, row 0 at +Z.

        Uses OpenCV or Pillow, whichever is installed. Raises ``LightwellError`` where neither is.
        """
        return self.radiance(_decode_jpeg(self.jpeg))

    def radiance(self, samples: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return linear radiance of decoded 8-bit samples: ``x = ((1 + k cap)^y − 1) / k``."""
        curve = (np.power(1.0 + self.k * self.cap, np.arange(256) / 255.0) - 1.0) / self.k
        return curve.astype(np.float32)[samples]


def _decode_jpeg(jpeg: bytes) -> NDArray[np.uint8]:
    """Return RGB samples, ``(height, width, 3)``; neither decoder is a dependency of this package."""
    try:
        cv2 = importlib.import_module("cv2")
    except ImportError:
        pass
    else:
        decoded = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
        if decoded is None:
            raise LightwellError("the backdrop is no JPEG that can be decoded")
        return np.ascontiguousarray(decoded[:, :, ::-1], dtype=np.uint8)
    try:
        pillow = importlib.import_module("PIL.Image")
    except ImportError:
        raise LightwellError("decoding a backdrop needs OpenCV or Pillow: pip install pillow") from None
    return np.asarray(pillow.open(io.BytesIO(jpeg)).convert("RGB"), dtype=np.uint8)
