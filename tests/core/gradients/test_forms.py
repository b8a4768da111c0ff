"""The integrals of MATHS §7.1 to 7.4 against each other, finite differences and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.reference_gradients import Floats, Quad, finite_difference, latlong_directions

from lightwell.gradients.extrapolate import extrapolate
from lightwell.gradients.forms import directional_form, normal_free_form, radiance_slope_form, surface_form
from lightwell.gradients.freespace import free_space_residual
from lightwell.probe.weights import row_weights
from lightwell.sh.basis import basis_gradients, evaluate

BANDS = 5
HERE = np.zeros(3)


def _relative(found: Floats, truth: Floats) -> float:
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def test_surface_form_is_the_derivative() -> None:
    quad = Quad()
    difference = finite_difference(lambda p: quad.derived(p, BANDS).coefficients, HERE)
    assert _relative(quad.derived(HERE, BANDS).gradients, difference) < 1e-8


def test_directional_form_is_the_surface_form() -> None:
    points, normals, areas, light = Quad().pieces()
    r = np.linalg.norm(points, axis=1)
    directions = points / r[:, None]
    solid_angles = -areas * np.sum(normals * directions, axis=1) / r**2
    ours = directional_form(directions, solid_angles, r, normals, light, BANDS)
    truth = surface_form(HERE, points, normals, areas, light, BANDS)
    np.testing.assert_allclose(ours.coefficients, truth.coefficients, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ours.gradients, truth.gradients, rtol=0, atol=1e-12)


def test_normal_free_form_is_the_directional_form_on_a_plane() -> None:
    points, normals, areas, light = Quad().pieces()
    r = np.linalg.norm(points, axis=1)
    directions = points / r[:, None]
    facing = np.sum(normals * directions, axis=1)
    slopes = (normals - facing[:, None] * directions) / (r * facing)[:, None]
    arguments = (directions, -areas * facing / r**2, r)
    ours = normal_free_form(*arguments, slopes, light, BANDS)
    np.testing.assert_allclose(ours, directional_form(*arguments, normals, light, BANDS).gradients, rtol=0, atol=1e-12)


def _room(directions: Floats) -> tuple[Floats, Floats, Floats, tuple[Floats, Floats]]:
    """Return log-smooth distances of a star-shaped room, their slopes, and smooth light with its slopes."""
    shape, colour = np.array([0.0, 0.2, -0.1, 0.15, 0.1, 0, 0.05, 0, 0.1]), np.array([2.0, 0.5, 0.3, -0.4])
    values, slopes = evaluate(directions, 3), basis_gradients(directions, 3)
    inverse = 0.6 * np.exp(values @ shape)
    light = evaluate(directions, 2) @ colour
    return 1 / inverse, inverse[:, None] * np.einsum("nik,i->nk", slopes, shape), light, (slopes[:, :4], colour)


def test_both_normal_free_forms_agree_in_a_smooth_room() -> None:
    """Integration by parts over the whole sphere, with a rule that is spectrally accurate."""
    nodes, weights = np.polynomial.legendre.leggauss(48)
    phi = 2 * np.pi * np.arange(96) / 96
    sine = np.sqrt(1 - nodes**2)[:, None]
    directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), nodes[:, None] + 0 * phi], axis=-1).reshape(-1, 3)
    solid_angles = np.repeat(weights * 2 * np.pi / 96, 96)
    distances, inverse_slopes, light, (slopes, colour) = _room(directions)
    second = normal_free_form(directions, solid_angles, distances, inverse_slopes, light[:, None], BANDS)
    light_slopes = np.einsum("nik,i->nk", slopes, colour)[:, None]
    first = radiance_slope_form(directions, solid_angles, distances, light_slopes, BANDS)
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-10)


def test_point_light() -> None:
    """``c = I y(ω)/r²``, ``G = (I/r³)(2 y ω − ∇_S y)``: of a tiny piece that faces us, and of what differences say."""
    place = np.array([0.4, -0.7, 1.1])
    r = float(np.linalg.norm(place))
    omega = place / r
    truth = 2 * evaluate(omega, 9)[:, None] * omega - basis_gradients(omega, 9)
    difference = finite_difference(
        lambda p: evaluate((place - p) / np.linalg.norm(place - p), 9) / np.sum((place - p) ** 2), HERE
    )
    assert _relative(truth / r**3, difference) < 1e-8


def test_moving_away_from_a_sample_errs_by_the_square_of_the_way() -> None:
    quad = Quad()
    c, gradients = quad.derived(HERE, BANDS)
    way = np.array([0.6, -0.5, 0.62])
    errors = []
    for distance in (0.02, 0.01):
        truth = quad.derived(distance * way, BANDS).coefficients
        errors.append(np.linalg.norm(extrapolate(c, gradients, distance * way) - truth))
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)


def test_light_from_afar_has_no_gradient() -> None:
    directions = latlong_directions(8, 16).reshape(-1, 3)
    solid_angles = np.repeat(row_weights(8, 16), 16)
    light = np.ones((128, 3))
    ours = directional_form(directions, solid_angles, np.full(128, np.inf), -directions, light, BANDS)
    assert not ours.gradients.any()
    assert ours.coefficients[0, 0] == pytest.approx(np.sqrt(4 * np.pi))


def test_what_faces_away_is_not_seen() -> None:
    points, normals, areas, light = Quad().pieces(8)
    ours = surface_form(HERE, points, -normals, areas, light, BANDS)
    assert not ours.coefficients.any()
    assert not ours.gradients.any()


def test_free_space_constraints_hold_for_light_of_a_surface() -> None:
    assert np.abs(free_space_residual(Quad().derived(HERE, BANDS).gradients)).max() < 1e-12
