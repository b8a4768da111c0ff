"""A map, rendered through the mirror sphere and projected, gives the map's own coefficients again."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.reference_probe import MAP_NAMES, basis, project_latlong, real_map, relative_error

from lightwell.probe.downsample import Downsampler
from lightwell.probe.factory import make_mapping
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Mapping
from lightwell.probe.projection import Projector
from lightwell.probe.unwrap import resample
from lightwell.settings import MappingSettings


def report(line: str) -> None:
    """Print a figure; pytest shows it with ``-s`` or ``-rP``."""
    print(line)  # noqa: T201


def mirror_sphere(k: float, size: int) -> Mapping:
    settings = MappingSettings(
        kind="mirror-sphere", sphere_radius_m=k, sphere_distance_m=1, disc=(size / 2, size / 2, size / 2)
    )
    return make_mapping(settings, size, size)


def constant_weight(mapping: Mapping, image: NDArray[Any]) -> NDArray[Any]:
    """Return the coefficients with the weight 4π/N for every pixel whose centre shows the sphere (paper 000)."""
    directions, seen = mapping.directions(*mapping.pixel_centres())
    weights = 4 * math.pi / seen.sum() * seen
    return np.asarray(np.einsum("ij,ijk,ijc->kc", weights, basis(directions, 5), image.astype(np.float64)))


@pytest.mark.parametrize("k", [0.0366, 0.0732])
def test_mirror_sphere_recovers_the_light(k: float) -> None:
    mapping = mirror_sphere(k, 250)
    project = Projector(mapping, 5)
    for name in MAP_NAMES:
        # One pixel of the esplanade is the sun: it takes more rays to catch it evenly.
        rays = 8 if name == "esplanade" else 4
        image = resample(real_map(name), LatLong(256, 512), mapping, supersample=rays)
        truth = project_latlong(real_map(name), 5)
        ours, constant = (
            relative_error(value, truth) for value in (project.project(image), constant_weight(mapping, image))
        )
        report(f"R/D {k}, {name:10} mirror sphere {ours:7.3%}   constant weight 4π/N {constant:7.2%}")
        assert ours < 0.005
        assert constant > 4 * ours


def operator_error(k: float, size: int) -> float:
    """Return ``max |G − G_ref|`` of constant weights: the error of the Gram matrix of five bands (MATHS §3)."""
    mapping = mirror_sphere(k, size)
    directions, seen = mapping.directions(*mapping.pixel_centres())
    values = basis(directions[seen], 5)
    constant = values.T @ values * (4 * math.pi / seen.sum())
    return float(np.abs(constant - np.eye(25)).max())


@pytest.mark.parametrize(("k", "expected"), [(0.0366, 4.8e-2), (0.0732, 8.4e-2)])
def test_constant_weight_is_4_to_8_percent_off(k: float, expected: float) -> None:
    error = operator_error(k, 250)
    report(f"R/D {k}: constant weights are off by {error:.1%} in the operator")
    assert error == pytest.approx(expected, rel=0.15)


def test_downsampled_sphere_still_recovers_the_light() -> None:
    mapping = mirror_sphere(0.0366, 600)
    reduce = Downsampler(mapping, 150)
    project = Projector(reduce.mapping, 5)
    for name in ("forest", "hall", "venice"):
        image = resample(real_map(name), LatLong(256, 512), mapping, supersample=2)
        error = relative_error(project.project(reduce(image)), project_latlong(real_map(name), 5))
        assert error < 0.005
