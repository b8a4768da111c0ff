"""The tables of MATHS §7.4 and §7.8, within 20 %. `./script/bench gradients` prints them."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.reference_gradients import BETWEEN, Quad, between_samples, moving_away

from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.gradients.interpolate import SampleSet


def test_error_against_distance() -> None:
    for share, without, with_gradient, given in moving_away(Quad()):
        assert (without, with_gradient) == pytest.approx(given, rel=0.2), share


def test_error_between_samples() -> None:
    for size, way, error, given in between_samples(Quad()):
        assert error == pytest.approx(given, rel=0.2), (size, way)


@pytest.mark.parametrize("size", BETWEEN)
def test_grids_and_sample_sets_do_as_the_table_says(size: float) -> None:
    """The code that is used, not the formula: a grid's half gradients, barycentric halves, Shepard's full ones."""
    quad = Quad()
    spec = GridSpec((-size,) * 3, (size,) * 3, (2, 2, 2))
    corners = spec.centres().reshape(-1, 3)
    samples = [quad.derived(corner, 5) for corner in corners]
    c, slopes = np.array([one.coefficients for one in samples]), np.array([one.gradients for one in samples])
    shape = (2, 2, 2, 25, 3)
    coverage = np.ones((2, 2, 2), np.float32)
    table = c.reshape(shape).astype(np.float32)
    points = np.random.default_rng(0).uniform(-size / 2, size / 2, (100, 3))
    truth = np.array([quad.derived(point, 5).coefficients for point in points])

    def error(found: np.ndarray) -> float:
        relative = np.linalg.norm(found - truth, axis=(1, 2)) / np.linalg.norm(truth, axis=(1, 2))
        return float(np.sqrt(np.mean(relative**2)))

    given = BETWEEN[size]
    plain = Grid(spec, table, coverage)
    assert error(plain.sample(points).coefficients) == pytest.approx(given["trilinear"], rel=0.2)
    half = Grid(spec, table, coverage, None, slopes.reshape(*shape, 3).astype(np.float32))
    assert error(half.sample(points).coefficients) == pytest.approx(given["half"], rel=0.2)
    assert error(SampleSet(corners, c).at(points, "shepard")) == pytest.approx(given["Shepard"], rel=0.2)
    assert error(SampleSet(corners, c, slopes).at(points, "shepard")) == pytest.approx(given["Shepard, full"], rel=0.2)
    # Tetrahedra are coarser than cells, and halves are as good in them.
    assert error(SampleSet(corners, c, slopes).at(points)) < 2 * given["half"]
