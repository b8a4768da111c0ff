"""Pictures against Mitsuba 3: a room with emissive panels, matte, all bounces (issue 6, Done-when 2)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.igi_scenes import ROOM_CAMERA, panel_room
from tests.support.mitsuba_room import room_path_traced

from lightwell.igi import render_igi
from lightwell.igi_settings import IgiSettings

SIZE, FINER = (48, 36), 4
"""A pixel of Mitsuba's picture is the mean over its area; here that is the mean of finer pixels."""


def picture(settings: IgiSettings) -> NDArray[np.float64]:
    fine = render_igi(panel_room(), ROOM_CAMERA, (SIZE[0] * FINER, SIZE[1] * FINER), settings).colour
    blocks = fine.astype(np.float64).reshape(SIZE[1], FINER, SIZE[0], FINER, 3)
    return np.asarray(blocks.mean(axis=(1, 3)))


@pytest.mark.slow
def test_a_room_with_panels(tmp_path: Path) -> None:
    theirs = room_path_traced(panel_room(), ROOM_CAMERA, SIZE, 529, tmp_path)
    errors = {}
    for count in (64, 256, 1024):
        mine = picture(IgiSettings(sets=(4, 4), vpls=count, bounces=10))
        errors[count] = float(np.sqrt(((mine - theirs) ** 2).mean()) / theirs.mean())
    print("\nrelative rms by virtual lights: " + ", ".join(f"{n}: {error:.2%}" for n, error in errors.items()))
    assert errors[1024] < 0.06
    assert list(errors.values()) == sorted(errors.values(), reverse=True)
