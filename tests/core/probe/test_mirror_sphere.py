"""The mirror sphere before a perspective camera: every figure of MATHS §3."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad
from tests.support.reference_probe import random_directions

from lightwell.errors import MappingError
from lightwell.probe.factory import make_mapping
from lightwell.probe.mirror_ball import MirrorBall
from lightwell.probe.mirror_sphere import MirrorSphere, SphereView, outline, solve_view
from lightwell.settings import MappingSettings

RATIOS = [0.02, 0.0366, 0.04, 0.0732, 0.4]


def jacobian(mapping: Any, psi: Any) -> Any:
    """Return dΩ_reflected/dΩ_pixel at the angle ψ from the axis of a centred sphere, from the mapping's density."""
    c = mapping.view.principal_distance
    density = mapping.density(mapping.width / 2 + c * np.tan(psi), np.full(np.shape(psi), mapping.height / 2))
    return density * c * c / np.cos(psi) ** 3


def centred(ratio: float, size: int = 500) -> Any:
    view = solve_view(size, size, None, ratio, 1.0, (size / 2, size / 2, size / 2))
    return MirrorSphere(size, size, view)


@pytest.mark.parametrize("k", RATIOS)
def test_jacobian(k: float) -> None:
    mapping = centred(k)
    incidence = np.radians(np.linspace(0.5, 88.9, 60))
    psi = np.arcsin(k * np.sin(incidence))
    beta = 2 * incidence - psi
    value = jacobian(mapping, psi)
    # The caustic form t²/(s_T s_S).
    t = np.cos(psi) - np.sqrt(k * k - np.sin(psi) ** 2)
    caustic = t * t * (2 / (k * np.cos(incidence)) + 1 / t) * (2 * np.cos(incidence) / k + 1 / t)
    assert value == pytest.approx(caustic, rel=1e-10)
    # Finite differences of the traced rays: dΩ_r/dΩ_pix = sinβ dβ / (sinψ dψ).
    step = 1e-7 * psi
    reflected = [
        np.arccos(-mapping.directions(*pixel_at(mapping, psi + sign * step))[0] @ mapping.blind_axis)
        for sign in (1, -1)
    ]
    slope = (reflected[0] - reflected[1]) / (2 * step)
    assert value[:-8] == pytest.approx((np.sin(beta) * slope / np.sin(psi))[:-8], rel=1e-5)
    assert jacobian(mapping, np.array([1e-9])) == pytest.approx((2 / k - 1) ** 2, rel=1e-9)


def pixel_at(mapping: Any, psi: Any) -> tuple[Any, Any]:
    return mapping.width / 2 + mapping.view.principal_distance * np.tan(psi), np.full(np.shape(psi), mapping.height / 2)


@pytest.mark.parametrize("k", RATIOS)
def test_jacobian_integrates_to_what_the_sphere_shows(k: float) -> None:
    mapping = centred(k)
    rim = math.asin(k)

    def integrand(incidence: float) -> float:
        psi = math.asin(k * math.sin(incidence))
        dpsi = k * math.cos(incidence) / math.cos(psi)
        return float(jacobian(mapping, np.array([psi]))[0]) * 2 * math.pi * math.sin(psi) * dpsi

    total, _ = quad(integrand, 1e-9, math.pi / 2 - 1e-9, epsabs=1e-12, epsrel=1e-12)
    assert total == pytest.approx(2 * math.pi * (1 + math.cos(rim)), rel=1e-7)
    assert mapping.blind_half_angle == rim
    assert mapping.seen_solid_angle == pytest.approx(2 * math.pi * (1 + math.cos(rim)))


@pytest.mark.parametrize("k", RATIOS)
def test_newton_inverts_the_reflection(k: float) -> None:
    mapping = centred(k)
    incidence = np.radians(np.linspace(0, 89.99, 500))
    psi = np.arcsin(k * np.sin(incidence))
    x, y = pixel_at(mapping, psi)
    directions, seen = mapping.directions(x, y)
    assert seen.all()
    beta = np.arccos(np.clip(-directions @ mapping.blind_axis, -1, 1))
    assert beta == pytest.approx(2 * incidence - psi, abs=1e-6)
    back_x, back_y, visible = mapping.pixels(directions)
    assert visible.all()
    assert np.hypot(back_x - x, back_y - y).max() < 1e-7


def test_reflected_ray_passes_through_a_known_point() -> None:
    """A light at a known place appears where the law of reflection says, to machine precision."""
    radius, distance = 0.05, 1.25
    mapping = centred(radius / distance)
    rng = np.random.default_rng(3)
    x, y = rng.uniform(100, 400, 200), rng.uniform(100, 400, 200)
    directions, seen = mapping.directions(x, y)
    c = mapping.view.principal_distance
    ray = np.stack([(x - 250) / c, (250 - y) / c, -np.ones(200)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    centre = np.array([0, 0, -distance])
    along = ray @ centre
    t = along - np.sqrt(along**2 - (distance**2 - radius**2))
    point = t[:, None] * ray
    normal = (point - centre) / radius
    assert seen.all()
    # Angles of incidence and reflection are equal and in one plane.
    assert np.sum(-ray * normal, axis=1) == pytest.approx(np.sum(directions * normal, axis=1), abs=1e-12)
    assert np.abs(np.sum(np.cross(-ray, normal) * directions, axis=1)).max() < 1e-12
    # The reflected line misses the sphere's centre by R sin i.
    miss = np.linalg.norm(np.cross(point - centre, directions), axis=1)
    sin_incidence = np.linalg.norm(np.cross(ray, normal), axis=1)
    assert miss == pytest.approx(radius * sin_incidence, abs=1e-12)


def test_far_sphere_becomes_the_orthographic_ball() -> None:
    ball = MirrorBall(200, 200)
    rng = np.random.default_rng(5)
    x, y = rng.uniform(40, 160, 300), rng.uniform(40, 160, 300)
    expected = ball.directions(x, y)[0]
    errors = [np.abs(centred(k, 200).directions(x, y)[0] - expected).max() for k in (1e-2, 1e-3, 1e-4)]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert errors[2] < 2e-4


def test_numbers_of_the_papers() -> None:
    assert math.degrees(math.asin(91.5 / 1250)) == pytest.approx(4.2, abs=0.01)
    assert math.degrees(math.asin(45.8 / 1250)) == pytest.approx(2.1, abs=0.01)
    c = 100 * 1250 / (1250 - 100)
    assert c == pytest.approx(108.7, abs=0.05)
    assert outline(c, math.asin(45.8 / 1250), 0).radius == pytest.approx(3.99, abs=0.01)
    assert outline(c, math.asin(91.5 / 1250), 0).radius == pytest.approx(7.98, abs=0.02)


@pytest.mark.parametrize(
    ("k", "rho", "expected"),
    [
        (0.0366, 0.0, 0.965), (0.0366, 0.5, 0.975), (0.0366, 0.9, 1.017), (0.0366, 0.95, 1.040), (0.0366, 0.99, 1.12),
        (0.0732, 0.0, 0.934), (0.0732, 0.99, 1.24),
    ],
)  # fmt: skip
def test_weight_is_not_constant(k: float, rho: float, expected: float) -> None:
    """Weight over mean weight on the disc: 4π/N is only the limit of a camera infinitely far away."""
    mapping = centred(k)
    density = float(mapping.density(250 + 250 * rho + 1e-6, 250.0))
    mean = mapping.seen_solid_angle / (math.pi * 250**2)
    assert density / mean == pytest.approx(expected, abs=0.006)


@pytest.mark.parametrize("forward", [(0, 0, -1), (1, 2, 0.5)])
def test_blind_cone_lies_behind_the_sphere(forward: tuple[float, float, float]) -> None:
    settings = MappingSettings(
        kind="mirror-sphere", sphere_radius_m=0.1, sphere_distance_m=1, fov_degrees=20, forward=forward, up=(0, 1, 0.3)
    )
    mapping = make_mapping(settings, 300, 400)
    unit = np.array(forward) / np.linalg.norm(forward)
    assert mapping.blind_axis == pytest.approx(unit)
    assert mapping.blind_half_angle == pytest.approx(math.asin(0.1))
    directions = random_directions(3000)
    seen = mapping.pixels(directions)[2]
    assert np.array_equal(seen, np.arccos(directions @ unit) >= mapping.blind_half_angle)


@pytest.mark.parametrize("offset", [(0, 0), (400, -300)])
@pytest.mark.parametrize("k", [0.0366, 0.3])
def test_two_inputs_give_the_third(k: float, offset: tuple[int, int]) -> None:
    width, height, fov = 2400, 1700, 50.0
    # Put the disc where the outline of such a sphere really is, from all three inputs.
    start = solve_view(height, width, fov, k, 1.0, None)
    psi = math.asin(k)
    centred_radius = outline(start.principal_distance, psi, 0).radius
    centre = (width / 2 + offset[0], height / 2 + offset[1])
    if offset != (0, 0):
        alpha = (
            math.atan2(math.hypot(*offset), start.principal_distance)
            + math.asin(
                math.hypot(*offset) * math.cos(2 * psi) / math.hypot(start.principal_distance, math.hypot(*offset))
            )
        ) / 2
        shape = outline(start.principal_distance, psi, alpha)
        assert shape.offset == pytest.approx(math.hypot(*offset), rel=1e-12)
        centred_radius = shape.radius
    disc = (*centre, centred_radius)
    whole = solve_view(height, width, fov, k, 1.0, disc)
    for given in ((None, k, 1.0, disc), (fov, None, None, disc), (fov, 2 * k, 2.0, disc), (fov, None, 1.0, disc)):
        view = solve_view(height, width, *given)
        assert view.ratio == pytest.approx(whole.ratio, rel=1e-9)
        assert view.principal_distance == pytest.approx(whole.principal_distance, rel=1e-9)
        assert view.axis == pytest.approx(whole.axis, abs=1e-9)


def test_outline_of_an_off_axis_sphere() -> None:
    """The traced silhouette has the centre and the area that `outline` says."""
    view = solve_view(1000, 1000, 60.0, 0.3, 1.0, (700.0, 400.0, 290.0))
    mapping = MirrorSphere(1000, 1000, view)
    y, x = np.mgrid[0:1000, 0:1000] + 0.5
    seen = mapping.sees(x, y)
    assert x[seen].mean() == pytest.approx(700, abs=0.3)
    assert y[seen].mean() == pytest.approx(400, abs=0.3)
    tilt = math.acos(-view.axis[2])
    shape = outline(view.principal_distance, math.asin(0.3), tilt)
    assert math.sqrt(seen.sum() / math.pi) == pytest.approx(shape.radius, rel=1e-3)


def test_contradiction_is_named() -> None:
    with pytest.raises(MappingError, match=r"radius of 74\.\d pixels.*--disc says 50\.0"):
        solve_view(1000, 1000, 37.0, 0.05, 1.0, (500.0, 500.0, 50.0))
    solve_view(1000, 1000, 37.0, 0.05, 1.0, (500.0, 500.0, 73.0))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ((None, None, None, None), "Missing: --fov-degrees, --sphere-radius-m, --sphere-distance-m, --disc"),
        ((40.0, None, 1.0, None), "Missing: --sphere-radius-m, --disc"),
        ((None, 0.05, 1.0, None), "Missing: --fov-degrees, --disc"),
        ((None, 1.0, 1.0, None), "smaller than --sphere-distance-m"),
        ((180.0, 0.1, 1.0, None), "not 180"),
        ((1e-300, 0.1, 1.0, None), "not 1e-300"),
        ((40.0, None, None, (50.0, 50.0, -4.0)), "radius must be positive"),
    ],
)
def test_missing_and_impossible_inputs(given: tuple[Any, ...], message: str) -> None:
    with pytest.raises(MappingError, match=message):
        solve_view(100, 100, *given)


def test_impossible_ratio_is_refused() -> None:
    with pytest.raises(MappingError, match="smaller than"):
        MirrorSphere(100, 100, SphereView(1.5, 100.0))


def test_rim_pixels_span_large_angles() -> None:
    """At 250 pixels the last ring spans about 14°: the cone without covered pixels is larger than asin k (MATHS §3)."""
    mapping = centred(0.0366, 250)
    y, x = np.nonzero(mapping.coverage())
    centres, _ = mapping.directions(x + 0.5, y + 0.5)
    widest = np.degrees(np.arccos(np.clip(centres @ mapping.blind_axis, -1, 1)).min())
    assert 6 < widest < 15
    assert widest > 3 * math.degrees(mapping.blind_half_angle)
