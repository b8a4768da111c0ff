"""One frame in the form that a subscriber asked for: another convention, fewer bands. Arrays in, bytes out."""

from __future__ import annotations

from typing import NamedTuple

import msgspec

from lightwell.conventions import Convention, coefficient_count
from lightwell.sh.engines import convert, convert_directions, convert_gradients
from lightwell.wire import Frame, Vector3, pack_coefficients, unpack_coefficients, unpack_gradients


class Variant(NamedTuple):
    """What subscribers share: each variant of a frame is converted and encoded once."""

    convention: Convention = "lightwell"
    bands: int | None = None
    """At most this many bands; None: all that there are."""
    gradients: bool = False
    """Whether gradients are sent: they are three times as long as the coefficients."""


AS_PUBLISHED = Variant(gradients=True)
"""The variant that changes nothing."""
STRIPPED = Variant()
"""What who asks for nothing gets."""


def make_variant(frame: Frame, variant: Variant) -> Frame:
    """Return ``frame`` in the convention and with at most the bands of ``variant``; the same object if nothing changes.

    Bands are cut, not windowed again: the window that was used stays with the frame, shortened with it.
    """
    bands = min(variant.bands or frame.bands, frame.bands)
    if frame.gradients is not None and not variant.gradients:
        frame = msgspec.structs.replace(frame, gradients=None)
    if bands == frame.bands and variant.convention == frame.convention:
        return frame
    dominant = frame.dominant
    if dominant is not None:
        direction = _vector(dominant.direction, frame.convention, variant.convention)
        dominant = msgspec.structs.replace(dominant, direction=direction)
    return msgspec.structs.replace(
        frame,
        bands=bands,
        convention=variant.convention,
        coefficients=_coefficients(frame.coefficients, frame.convention, variant.convention, bands),
        truth=frame.truth and _coefficients(frame.truth, frame.convention, variant.convention, bands),
        gradients=frame.gradients and _gradients(frame.gradients, frame.convention, variant.convention, bands),
        position=frame.position and _vector(frame.position, frame.convention, variant.convention),
        window=msgspec.structs.replace(frame.window, weights=frame.window.weights[:bands]),
        dominant=dominant,
    )


def _vector(vector: Vector3, source: Convention, to: Convention) -> Vector3:
    x, y, z = convert_directions(vector, to, source).tolist()
    return x, y, z


def _coefficients(packed: bytes, source: Convention, to: Convention, bands: int) -> bytes:
    return pack_coefficients(convert(unpack_coefficients(packed)[: coefficient_count(bands)], to, source))


def _gradients(packed: bytes, source: Convention, to: Convention, bands: int) -> bytes:
    """Convert ``(bands², 3, 3)`` derivatives: each one's coefficients, and the axes along which they are taken."""
    gradients = unpack_gradients(packed)[: coefficient_count(bands)]
    return pack_coefficients(convert_gradients(gradients, to, source))
