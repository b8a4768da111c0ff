"""What a worker's message must be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from tests.support.publisher import make_backdrop, make_frame, make_status

from lightwell.wire import DominantLight, WindowUsed, pack_coefficients
from lightwell_server.intake import LATE_NS, Punctuality, check_message


def test_valid_messages_pass() -> None:
    gradients = np.zeros((9, 9), np.float32)
    frame = make_frame(gradients=gradients.tobytes(), truth=pack_coefficients(np.ones((9, 3))))
    for message in (frame, make_backdrop(), make_status()):
        check_message(message, "probe", "s1")


def nan_at(index: int) -> bytes:
    array = np.zeros((9, 3), np.float32)
    array.flat[index] = np.nan
    return pack_coefficients(array)


MISTAKES: list[tuple[dict[str, Any], str]] = [
    ({"stream": "other"}, "the message is of stream 'other', the socket is of 'probe'"),
    ({"session": "s2"}, "the message is of session 's2', announced was 's1'"),
    ({"convention": "three"}, "convention 'three': workers publish 'lightwell', the server converts"),
    ({"coefficients": b"\0" * 12}, r"coefficients must be 108 bytes \(27 float32\), not 12"),
    ({"coefficients": nan_at(5)}, "coefficients must be finite, not NaN or infinite"),
    ({"coefficients": pack_coefficients(np.full((9, 3), np.inf))}, "coefficients must be finite"),
    ({"truth": b""}, "truth must be 108 bytes"),
    ({"gradients": b"\0" * 8}, "gradients must be 324 bytes"),
    ({"gradients": pack_coefficients(np.full((9, 9), np.nan))}, "gradients must be finite"),
    ({"position": (0.0, float("inf"), 0.0)}, "position must be finite"),
    ({"position": (0.0, 1e160, 0.0)}, "within 1e\\+07 m"),
    ({"trust_radius_m": float("inf")}, "trust_radius_m = inf must be at least 0 and finite; leave it out instead"),
    ({"trust_radius_m": -1.0}, "trust_radius_m = -1.0 must be at least 0"),
    ({"window": WindowUsed(kind="hann", weights=[1.0])}, "window.weights must be 3 finite numbers"),
    ({"window": WindowUsed(kind="hann", weights=[1.0, 1.0, np.nan])}, "window.weights must be 3 finite numbers"),
    (
        {"dominant": DominantLight(direction=(0, 0, float("nan")), irradiance=(0, 0, 0), ambient=(0, 0, 0))},
        "dominant must be finite",
    ),
]


@pytest.mark.parametrize(("changes", "message"), MISTAKES)
def test_a_mistake_is_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        check_message(make_frame(**changes), "probe", "s1")


def test_a_backdrop_must_be_a_jpeg() -> None:
    with pytest.raises(ValueError, match="no JPEG"):
        check_message(make_backdrop(jpeg=b"GIF89a"), "probe", "s1")


def test_lateness_does_not_depend_on_the_clocks() -> None:
    for offset_ns in (0, -(10**12), 10**12):
        punctuality = Punctuality()
        assert not punctuality.is_late(1000 + offset_ns, 2000)
        assert not punctuality.is_late(2000 + offset_ns, 3000 + LATE_NS)
        assert punctuality.is_late(3000 + offset_ns, 4001 + LATE_NS)
        assert not punctuality.is_late(5000 + offset_ns, 5500)
        assert punctuality.is_late(6000 + offset_ns, 6501 + LATE_NS)
