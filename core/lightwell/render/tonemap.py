"""From radiance to the eight bits of a screen, exactly as the browser's page does it.

`neutral_tone_mapping` and `encode_srgb` repeat ``NeutralToneMapping`` and ``sRGBTransferOETF`` of three.js 0.187, their
rounded constants included. The former is Khronos' PBR Neutral: colours are kept, highlights are compressed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]

START_COMPRESSION = 0.8 - 0.04
DESATURATION = 0.15


def neutral_tone_mapping(colour: ArrayLike) -> Floats:
    """Return exposed radiance ``(…, 3)`` compressed to what a screen can show; may leave 0 … 1 a little."""
    rgb = np.asarray(colour, dtype=np.float64)
    smallest = rgb.min(axis=-1, keepdims=True)
    mapped = rgb - np.where(smallest < 0.08, smallest - 6.25 * smallest * smallest, 0.04)
    peak = mapped.max(axis=-1, keepdims=True)
    rest = 1 - START_COMPRESSION
    bright = peak >= START_COMPRESSION
    safe = np.where(bright, peak, 1.0)
    new_peak = 1 - rest * rest / (safe + rest - START_COMPRESSION)
    grey = 1 - 1 / (DESATURATION * (safe - new_peak) + 1)
    compressed = mapped * (new_peak / safe)
    return np.asarray(np.where(bright, compressed + grey * (new_peak - compressed), mapped))


def encode_srgb(linear: ArrayLike) -> Floats:
    """Return linear values ``(…)`` as sRGB, 0 … 1; what is outside is clipped."""
    value = np.clip(np.asarray(linear, dtype=np.float64), 0, 1)
    return np.asarray(np.where(value <= 0.0031308, value * 12.92, np.power(value, 0.41666) * 1.055 - 0.055))


def expose_and_encode(colour: ArrayLike, ev: float = 0.0, *, tone_mapping: bool = True) -> NDArray[np.uint8]:
    """Return radiance ``(…, 3)`` times 2^``ev``, tone-mapped, as sRGB of eight bits."""
    exposed = np.asarray(colour, dtype=np.float64) * 2.0**ev
    shown = neutral_tone_mapping(exposed) if tone_mapping else exposed
    return np.rint(encode_srgb(shown) * 255).astype(np.uint8)
