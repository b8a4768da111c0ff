"""Pictures of the surroundings."""

from __future__ import annotations

import importlib
from types import ModuleType

import cv2
import numpy as np
import pytest
from tests.support.publisher import make_backdrop

from lightwell.errors import LightwellError
from lightwell_client.backdrop import BackdropPicture


def picture(radiance: float) -> BackdropPicture:
    """Return a grey picture of a radiance, as a worker encodes it."""
    message = make_backdrop()
    sample = np.log2(1 + message.k * radiance) / np.log2(1 + message.k * message.cap)
    pixels = np.full((message.height, message.width, 3), round(sample * 255), np.uint8)
    encoded, jpeg = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 100])
    assert encoded
    message.jpeg = jpeg.tobytes()
    return BackdropPicture.from_wire(message)


@pytest.mark.parametrize("radiance", [0.0, 0.01, 1.0, 100.0, 512.0])
def test_decoding_undoes_the_curve(radiance: float) -> None:
    decoded = picture(radiance).decode()
    assert decoded.shape == (8, 16, 3)
    assert decoded.dtype == np.float32
    np.testing.assert_allclose(decoded, radiance, rtol=0.06, atol=1e-3)


def test_what_is_no_jpeg_is_an_error() -> None:
    with pytest.raises(LightwellError, match="no JPEG"):
        BackdropPicture.from_wire(make_backdrop(jpeg=b"\xff\xd8 nothing")).decode()


def test_without_a_decoder_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(name: str) -> ModuleType:
        raise ImportError(name)

    shown = picture(1.0)
    monkeypatch.setattr(importlib, "import_module", absent)
    with pytest.raises(LightwellError, match="pip install pillow"):
        shown.decode()
