"""Figures of MATHS §2 and §3 that are about quadrature and geometry themselves, not about one module."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from tests.support.reference_probe import basis

from lightwell.probe.factory import make_mapping
from lightwell.probe.fourier import FourierProjection
from lightwell.probe.half import sample_rows
from lightwell.probe.latlong import LatLong
from lightwell.probe.weights import row_weights
from lightwell.settings import MappingSettings, ProjectionWeights

BANDS = 5


def pixel_means(height: int, width: int, points: int = 12) -> NDArray[np.float64]:
    """Return the mean of the basis over the solid angle of each lat-long pixel, ``(H, W, 25)``."""
    fine = LatLong(height * points, width * points)
    values = basis(fine.directions(*fine.pixel_centres())[0].reshape(-1, 3), BANDS)
    weighted = values.reshape(fine.height, fine.width, -1) * fine.row_solid_angles()[:, None, None]
    cells = weighted.reshape(height, points, width, points, -1).sum(axis=(1, 3))
    return np.asarray(cells / LatLong(height, width).row_solid_angles()[:, None, None])


def centres(height: int, width: int) -> NDArray[np.float64]:
    mapping = LatLong(height, width)
    return basis(mapping.directions(*mapping.pixel_centres())[0].reshape(-1, 3), BANDS).reshape(height, width, -1)


@pytest.mark.parametrize(("weights", "error"), [("paper", 1.2e-2), ("solid-angle", 1.2e-2), ("fejer", 1.6e-2)])
def test_pixels_that_are_means_smooth_the_light(weights: ProjectionWeights, error: float) -> None:
    rows = row_weights(25, 50, weights)
    operator = np.einsum("i,ijk,ijl->kl", rows, centres(25, 50), pixel_means(25, 50))
    assert np.abs(operator - np.eye(25)).max() == pytest.approx(error, rel=0.1)


def test_solving_for_pixel_means_undoes_it() -> None:
    means = pixel_means(25, 50)
    gram = np.einsum("i,ijk,ijl->kl", row_weights(25, 50), means, means)
    assert np.linalg.cond(gram) == pytest.approx(1.03, abs=0.01)
    light = np.random.default_rng(0).normal(size=25)
    seen = np.einsum("i,ijk,ij->k", row_weights(25, 50), means, means @ light)
    np.testing.assert_allclose(np.linalg.solve(gram, seen), light, rtol=1e-12)


def test_gauss_legendre_rows_are_exact_to_twice_the_degree() -> None:
    height, width = BANDS, 2 * BANDS
    cosines, weights = np.polynomial.legendre.leggauss(height)
    phi = 2 * math.pi * (np.arange(width) + 0.5) / width
    sines = np.sqrt(1 - cosines**2)[:, None]
    directions = np.stack(
        [sines * np.cos(phi), sines * np.sin(phi), np.broadcast_to(cosines[:, None], (height, width))], axis=-1
    )
    values = basis(directions.reshape(-1, 3), BANDS).reshape(height, width, -1)
    gram = np.einsum("i,ijk,ijl->kl", weights * 2 * math.pi / width, values, values)
    np.testing.assert_allclose(gram, np.eye(25), atol=1e-13)


def test_one_running_float32_sum_would_lose_light_and_ours_does_not() -> None:
    height, width = 814, 1628
    image = np.full((height, width, 3), 0.1, np.float32)
    image[200:204, 300:304] = 5e5
    weighted = image[..., 0].astype(np.float64) * row_weights(height, width)[:, None] / math.sqrt(4 * math.pi)
    exact = weighted.sum()
    running = np.cumsum(weighted.astype(np.float32).reshape(-1), dtype=np.float32)[-1]
    assert abs(running / exact - 1) > 1e-4
    ours = FourierProjection(LatLong(height, width), 1, "solid-angle")(sample_rows(image, height, width))[0, 0]
    assert abs(ours / exact - 1) < 1e-6


def test_octahedral_density_spans_the_cube_of_root_three() -> None:
    mapping = make_mapping(MappingSettings(kind="octahedral"), 600, 600)
    density = mapping.density(*mapping.pixel_centres()) / (2 / 600) ** 2
    assert density.min() == pytest.approx(1, abs=0.02)
    assert density.max() == pytest.approx(3**1.5, rel=0.02)


def sphere_view(ratio: float, pixels: int) -> Any:
    disc = (pixels / 2, pixels / 2, pixels / 2)
    return make_mapping(
        MappingSettings(kind="mirror-sphere", sphere_radius_m=ratio, sphere_distance_m=1.0, disc=disc), pixels, pixels
    )


def seen_gram(axis: NDArray[np.float64], half_angle: float) -> NDArray[np.float64]:
    """Return ``∫ Y Yᵀ`` over the sphere without a cone: Gauss–Legendre rows about the axis."""
    cosines, weights = np.polynomial.legendre.leggauss(40)
    low, high = -1.0, math.cos(half_angle)
    cosines, weights = low + (cosines + 1) * (high - low) / 2, weights * (high - low) / 2
    phi = 2 * math.pi * np.arange(40) / 40
    other = np.cross(axis, (0.3, 0.5, 0.8))
    other /= np.linalg.norm(other)
    third = np.cross(axis, other)
    sines = np.sqrt(1 - cosines**2)[:, None, None]
    turned = np.cos(phi)[:, None] * other + np.sin(phi)[:, None] * third
    directions = cosines[:, None, None] * axis + sines * turned
    values = basis(directions.reshape(-1, 3), BANDS).reshape(40, 40, -1)
    return np.asarray(np.einsum("i,ijk,ijl->kl", weights * 2 * math.pi / 40, values, values))


@pytest.mark.parametrize(
    ("ratio", "pixels", "error"),
    [(0.0366, 250, 3.2e-3), (0.0732, 250, 4.5e-3), (0.0366, 800, 1.7e-3), (0.0732, 800, 3.1e-3)],
)
def test_operator_error_of_the_finite_camera_weight(ratio: float, pixels: int, error: float) -> None:
    # w = J cos³ψ at the pixels' centres, scaled to what the sphere shows.
    mapping = sphere_view(ratio, pixels)
    directions, seen = mapping.directions(*mapping.pixel_centres())
    weights = np.where(seen, mapping.density(*mapping.pixel_centres()), 0.0)
    weights *= mapping.seen_solid_angle / weights.sum()
    values = basis(directions.reshape(-1, 3), BANDS)
    gram = values.T @ (values * weights.reshape(-1, 1))
    reference = seen_gram(mapping.blind_axis, mapping.blind_half_angle)
    assert np.abs(gram - reference).max() < 2.2 * error


def test_a_mirror_sphere_has_no_single_viewpoint() -> None:
    # The ray of angle β misses the centre by R sin i, i = (β + ψ)/2; far away, i = β/2.
    cosines, weights = np.polynomial.legendre.leggauss(200)
    miss = 0.05 * np.sin(np.arccos(cosines) / 2)
    assert math.sqrt(np.sum(weights * miss**2) / 2) == pytest.approx(0.05 / math.sqrt(2), rel=1e-4)
    angle = np.degrees(np.arcsin(miss / 1.0))
    assert angle.max() == pytest.approx(2.9, abs=0.05)
    assert math.sqrt(np.sum(weights * angle**2) / 2) == pytest.approx(2.0, abs=0.05)
