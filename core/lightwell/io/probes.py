"""The coefficients of a capture's probes, one by one: what is known at their places before any resampling."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import coefficient_count
from lightwell.io.captures import Capture
from lightwell.io.poses import CaptureError
from lightwell.probe.downsample import Downsampler
from lightwell.probe.projection import projector
from lightwell.sh.rotation import rotate
from lightwell.synthetic.rig import rotation_of

WIDTH = 64
"""Pixels across which frames are reduced to: plenty for five bands."""


def probe_coefficients(
    capture: Capture,
    probes: Sequence[int],
    bands: int,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> NDArray[np.float64]:
    """Return the coefficients ``(n, bands², 3)`` of some of a capture's probes, in world axes, gain included.

    Raises
    ------
    CaptureError
        Where the capture is in angular order and has no frames, or one of them cannot be read.
    """
    if capture.sorted_samples is not None:
        raise CaptureError(
            f"{capture.directory}: is in angular order and has no frames; make a grid of it (lightwell submit ilf-grid)"
        )
    reduce = Downsampler(capture.mapping(), WIDTH)
    project = projector(reduce.mapping, bands, blind=capture.info.mapping.blind)
    out = np.empty((len(probes), coefficient_count(bands), 3))
    for row, index in enumerate(probes):
        report(row, len(probes))
        frame = np.nan_to_num(capture.read_frame(index).astype(np.float32), nan=0.0, posinf=65504.0, neginf=0.0)
        turn = rotation_of(capture.poses.orientations[index])
        out[row] = capture.info.gain * rotate(project.project(reduce(frame)), turn)
    return out
