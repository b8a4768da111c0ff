"""merge: one radiance picture without bad samples.

A source of single exposures needs no merging of exposures: what is left is to count the samples that say something
about the picture's quality, and to replace those that no sum may contain. The gain is applied to the coefficients and
to the backdrop (all that follows is linear), which leaves the picture untouched.
"""

from __future__ import annotations

from typing import Literal

from lightwell.probe.samples import SampleCounts, count_samples, repair
from lightwell_workers.ingest.frame import Pixels


def merge(pixels: Pixels, negatives: Literal["keep", "clamp"], clip_level: float) -> tuple[Pixels, SampleCounts]:
    """Return the repaired picture and the counts of the samples as they came.

    Samples from ``clip_level`` on count as saturated. The picture itself is returned where nothing is to be repaired.
    """
    counts = count_samples(pixels, clip_level)
    if counts.nan or counts.infinite or (counts.negative and negatives == "clamp"):
        return repair(pixels, negatives), counts
    return pixels, counts
