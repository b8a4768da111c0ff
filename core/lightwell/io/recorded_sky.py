"""Recorded pictures as distant surroundings."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.sky import Sky
from lightwell.io.scenes import UNWRAPPED_WIDTH
from lightwell.probe.factory import make_mapping
from lightwell.probe.samples import repair
from lightwell.probe.unwrap import Unwrapper
from lightwell.settings import MappingSettings


def sky_of_picture(pixels: NDArray[np.floating], mapping: MappingSettings, gain: float = 1.0) -> Sky:
    """Return a picture ``(H, W, 3)`` as a sky; samples that are no light are repaired, negative ones are black.

    Raises
    ------
    MappingError
        Where a probe of this mapping has no pictures of this size.
    """
    whole = np.ascontiguousarray(repair(pixels), np.float32)
    height, width = whole.shape[:2]
    if mapping.kind == "latlong":
        make_mapping(mapping, height, width)
    else:
        whole = np.asarray(_unwrapper(mapping, height, width)(whole), np.float32)
    return Sky(np.maximum(np.float32(gain) * whole, 0))


@lru_cache(maxsize=2)
def _unwrapper(mapping: MappingSettings, height: int, width: int) -> Unwrapper:
    return Unwrapper(make_mapping(mapping, height, width), UNWRAPPED_WIDTH)
