"""The discontinuity filter against its slow reference."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_igi
from tests.support.igi_scenes import pixels

from lightwell.igi.filter import PLANE_TOLERANCE, SAME_NORMAL, STRICT_NORMAL, filtered, margins, windows
from lightwell.igi.gbuffer import GBuffer
from lightwell.igi_settings import IgiSettings


def ground(shape: tuple[int, int]) -> GBuffer:
    """One plane, a metre away."""
    up = np.tile([0.0, 0, 1], (*shape, 1))
    return pixels(np.ones(shape, bool), np.zeros((*shape, 3)), up, up, np.ones(shape))


@given(
    seed=st.integers(0, 2**32 - 1),
    pattern=st.tuples(st.integers(1, 5), st.integers(1, 5)),
    widths=st.integers(1, 2),
    strict=st.booleans(),
)
@settings(max_examples=25, deadline=None)
def test_means_are_those_of_the_reference(seed: int, pattern: tuple[int, int], widths: int, strict: bool) -> None:
    random = np.random.default_rng(seed)
    (reach,) = windows(IgiSettings(sets=pattern, window=widths, passes=1))
    left, right, up, down = reach
    assert (left + right + 1, up + down + 1) == (widths * pattern[0], widths * pattern[1])
    shape = (up + down + 4, left + right + 5)
    # Normals about as far apart, and places about as far off the plane, as the tests ask for.
    normals, shading = (random.normal([0, 0, 1], spread, (*shape, 3)) for spread in (0.25, 0.12))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    shading /= np.linalg.norm(shading, axis=-1, keepdims=True)
    place = random.normal(0, 0.02, (*shape, 3))
    depth, seen = random.uniform(0.5, 3, shape), random.random(shape) > 0.2
    values = random.normal(size=(*shape, 4))
    got = filtered(values, pixels(seen, place, normals, shading, depth), reach, strict)
    cosines = (SAME_NORMAL, STRICT_NORMAL if strict else None)
    expected = reference_igi.filtered(values, seen, place, normals, shading, depth, reach, cosines, PLANE_TOLERANCE)
    np.testing.assert_allclose(got, expected, atol=1e-13)


@pytest.mark.parametrize("passes", [1, 2, 3])
@pytest.mark.parametrize("pattern", [(4, 4), (3, 5)])
def test_every_window_holds_each_set_as_often(pattern: tuple[int, int], passes: int) -> None:
    n, m = pattern
    settings = IgiSettings(sets=pattern, passes=passes)
    left, right, up, down = margins(settings)
    column, row = np.arange(-left, 9 + right), np.arange(-up, 7 + down)
    turn = column % n + n * (row % m)[:, None]
    values = np.eye(n * m)[turn]
    for reach in windows(settings):
        values = filtered(values, ground(values.shape[:2]), reach)
    assert values.shape == (7, 9, n * m)
    np.testing.assert_allclose(values, 1 / (n * m), rtol=1e-14)


def test_two_passes_are_a_tent() -> None:
    settings = IgiSettings(sets=(4, 4))
    left, right, _, _ = margins(settings)
    assert left == right == 3
    values = np.zeros((7, 7, 1))
    values[3, 3] = 1
    seen = []
    for column in range(-3, 4):
        moved = np.roll(values, (column, 0), (1, 0))
        for reach in windows(settings):
            moved = filtered(moved, ground(moved.shape[:2]), reach)
        seen.append(float(moved[0, 0, 0]))
    np.testing.assert_allclose(np.array(seen) * 64, [1, 2, 3, 4, 3, 2, 1], rtol=1e-13)
