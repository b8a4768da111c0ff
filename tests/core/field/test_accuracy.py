"""Done when 2: the simulation of MATHS §6, against exact coefficients."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from lightwell.field.buckets import make_buckets
from lightwell.field.gradient import central_differences, project_in_place
from lightwell.field.grid import Grid
from lightwell.field.resample import Kernel, accumulate
from lightwell.field.spec import GridSpec
from lightwell.field.sums import FieldSums
from lightwell.io.simulate import RigSettings
from lightwell.probe.factory import make_mapping
from lightwell.synthetic.rig import VirtualProbe, place_probes
from lightwell.synthetic.scene import PRESETS, Scene

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

BOUNDS = ((-0.5, -0.5, -0.5), (0.5, 0.5, 0.5))


class Probes(NamedTuple):
    """A capture in memory."""

    scene: Scene
    rig: RigSettings
    positions: NDArray[np.float64]
    frames: NDArray[np.float32]


def _capture(scene: str, probes: int, size: int = 72, layout: str = "random", probe: str = "mirror-sphere") -> Probes:
    rig = RigSettings(probes=probes, size=size, sphere_radius_m=0.05, samples=2, layout=layout, probe=probe)  # type: ignore[arg-type]
    mapping = make_mapping(rig.mapping(), size, 2 * size if probe == "latlong" else size)
    virtual = VirtualProbe(mapping, rig.sphere_radius_m, rig.samples)
    positions = place_probes(rig.layout, probes, BOUNDS, seed=1)
    frames = np.stack([virtual.render(PRESETS[scene], position).reshape(-1, 3) for position in positions])
    return Probes(PRESETS[scene], rig, positions, frames)


def _resample(probes: Probes, cells: int, *, correct: bool = True, gradients: bool = False) -> FieldSums:
    size = probes.rig.size
    mapping = make_mapping(probes.rig.mapping(), size, 2 * size if probes.rig.probe == "latlong" else size)
    buckets = make_buckets(mapping, 5, sphere_radius_m=probes.rig.sphere_radius_m if correct else None)
    sums = FieldSums(GridSpec(*BOUNDS, (cells,) * 3), 5, gradients=gradients)
    radiance = np.ascontiguousarray(probes.frames[:, buckets.pixels].transpose(1, 0, 2))
    accumulate(
        sums,
        probes.positions,
        buckets.directions,
        buckets.offsets,
        radiance,
        buckets.rows,
        buckets.weights,
        Kernel(),
    )
    return sums


@pytest.fixture(scope="module")
def cube() -> Probes:
    """What the tests of accuracy share."""
    return _capture("cube", 1500)


@pytest.fixture(scope="module")
def fitted(cube: Probes) -> FieldSums:
    """The grid of `cube`, with gradients by regression."""
    return _resample(cube, 16, gradients=True)


def _error(found: NDArray[np.floating], exact: NDArray[np.float64]) -> float:
    return float(np.sqrt(((found - exact) ** 2).sum() / (exact**2).sum()))


def test_simulation_of_maths_6(cube: Probes, capsys: pytest.CaptureFixture[str]) -> None:
    probes = cube
    corrected, plain = _resample(probes, 16), _resample(probes, 16, correct=False)
    exact = probes.scene.coefficients(corrected.spec.centres(), 5)
    mapping = make_mapping(probes.rig.mapping(), probes.rig.size, probes.rig.size)
    buckets = make_buckets(mapping, 5)
    at_probes = np.einsum("qk,pqc->pkc", buckets.rows, probes.frames[:, buckets.pixels], optimize=True)
    squared = ((corrected.spec.centres().reshape(-1, 1, 3) - probes.positions[None]) ** 2).sum(axis=-1)
    nearest = at_probes[squared.argmin(axis=1)].reshape(exact.shape)
    weights = 1 / squared**2
    weights /= weights.sum(axis=1, keepdims=True)
    shepard = (weights @ at_probes.reshape(len(at_probes), -1)).reshape(exact.shape)
    figures = {
        "corrected": _error(corrected.coefficients, exact),
        "uncorrected": _error(plain.coefficients, exact),
        "nearest": _error(nearest, exact),
        "shepard": _error(shepard, exact),
    }
    with capsys.disabled():
        print("\n" + ", ".join(f"{name} {value:.4f}" for name, value in figures.items()))
    assert figures["corrected"] <= 0.075
    assert 0.08 < figures["uncorrected"] < 0.13
    assert figures["nearest"] > 2 * figures["corrected"]
    assert figures["shepard"] > 1.9 * figures["corrected"]


def test_planar_captures_work_too() -> None:
    probes = _capture("cube", 1500, layout="planes")
    sums = _resample(probes, 16)
    assert _error(sums.coefficients, probes.scene.coefficients(sums.spec.centres(), 5)) <= 0.075


@pytest.mark.parametrize("probe", ["mirror-sphere", "latlong"])
def test_constant_environment_is_exact(probe: str) -> None:
    probes = _capture("constant", 60, size=32, probe=probe)
    sums = _resample(probes, 6)
    exact = probes.scene.coefficients(sums.spec.centres(), 5)
    np.testing.assert_allclose(sums.coefficients, exact, atol=1e-5 * exact.max())


def test_distant_light_has_no_spatial_variation() -> None:
    probes = _capture("distant", 60, size=32)
    sums = _resample(probes, 6)
    spread = sums.coefficients.reshape(-1, 25, 3).std(axis=0).max()
    assert spread < 1e-5 * sums.coefficients.max()


def test_gradients_by_regression_are_better_than_central_differences(
    cube: Probes, fitted: FieldSums, capsys: pytest.CaptureFixture[str]
) -> None:
    """And with them the half-gradient rule (MATHS §7.8) is better than trilinear interpolation."""
    probes, sums = cube, fitted
    some = np.s_[::2, ::2, ::2]  # 512 of the 4,096 cells: exact gradients cost six exact fields
    centres, step = sums.spec.centres()[some], 1e-3
    exact = np.stack(
        [
            (probes.scene.coefficients(centres + shift, 5) - probes.scene.coefficients(centres - shift, 5)) / (2 * step)
            for shift in np.eye(3) * step
        ],
        axis=-1,
    )
    central = central_differences(sums.coefficients, sums.spec.voxel)
    assert sums.gradients is not None
    points = np.random.default_rng(2).uniform(-0.45, 0.45, (2000, 3))
    truth = probes.scene.coefficients(points, 5)
    plain, helped = (
        Grid(sums.spec, sums.coefficients, sums.coverage, gradients=gradients).sample(points).coefficients
        for gradients in (None, sums.gradients)
    )
    projected = central.copy()
    project_in_place(projected)
    figures = {
        "central, projected": _error(projected[some], exact),
        "regression": _error(sums.gradients[some], exact),
        "central": _error(central[some], exact),
        "trilinear": _error(plain, truth),
        "half-gradient": _error(helped, truth),
    }
    with capsys.disabled():
        print("\n" + ", ".join(f"{name} {value:.4f}" for name, value in figures.items()))
    assert figures["regression"] < 0.12
    assert figures["regression"] < 0.65 * figures["central"]
    assert figures["central, projected"] < figures["central"]
    assert figures["half-gradient"] < figures["trilinear"]


def test_free_space_identity_holds_to_the_discretisation_error(cube: Probes, fitted: FieldSums) -> None:
    """∂x c_11 + ∂y c_1−1 + ∂z c_10 = 0 (MATHS §7.6)."""
    probes, sums = cube, fitted
    spec = sums.spec

    def divergence(gradients: NDArray[np.float32]) -> float:
        gradient = gradients[2:-2, 2:-2, 2:-2]
        total = gradient[..., 3, :, 0] + gradient[..., 1, :, 1] + gradient[..., 2, :, 2]
        return float(np.sqrt((total**2).mean() / (gradient[..., 1:4, :, :] ** 2).mean()))

    exact = probes.scene.coefficients(spec.centres(), 5)
    assert divergence(central_differences(exact.astype(np.float32), spec.voxel)) < 0.1
    assert divergence(central_differences(sums.coefficients, spec.voxel)) < 0.35
    # Each direction's slopes obey it by construction, but for those of lattices that a cell reads between nodes.
    assert sums.gradients is not None
    assert divergence(sums.gradients) < 0.01
