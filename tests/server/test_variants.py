"""Conventions and bands of a frame."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.publisher import make_frame
from tests.vectors import make_vectors

from lightwell.conventions import CONVENTIONS, Convention
from lightwell.sh.engines import convert, convert_directions
from lightwell.wire import DominantLight, pack_coefficients, unpack_coefficients, unpack_gradients
from lightwell_server.variants import AS_PUBLISHED, Variant, make_variant


def test_what_changes_nothing_returns_the_same_object() -> None:
    frame = make_frame(bands=3)
    assert make_variant(frame, AS_PUBLISHED) is frame
    assert make_variant(frame, Variant()) is frame
    assert make_variant(frame, Variant("lightwell", 8)) is frame


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_coefficients_truth_and_dominant_light_are_converted_together(convention: Convention) -> None:
    rng = np.random.default_rng(1)
    array = rng.standard_normal((25, 3))
    light = DominantLight(direction=(0.6, 0.0, 0.8), irradiance=(1, 2, 3), ambient=(4, 5, 6))
    frame = make_frame(
        bands=5, coefficients=pack_coefficients(array), truth=pack_coefficients(2 * array), dominant=light
    )
    variant = make_variant(frame, Variant(convention, 3))
    expected = convert(array[:9].astype(np.float32), convention)
    np.testing.assert_allclose(unpack_coefficients(variant.coefficients), expected, rtol=1e-6, atol=1e-6)
    assert variant.truth is not None
    np.testing.assert_allclose(unpack_coefficients(variant.truth), 2 * expected, rtol=1e-6, atol=1e-6)
    assert variant.dominant is not None
    np.testing.assert_allclose(variant.dominant.direction, convert_directions(light.direction, convention))
    assert variant.dominant.irradiance == light.irradiance
    assert (variant.bands, variant.convention, len(variant.window.weights)) == (3, convention, 3)
    assert frame.bands == 5


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_gradients_and_position_follow_the_axes(convention: Convention) -> None:
    """Moving by d in the world and converting is converting and moving by the converted d."""
    rng = np.random.default_rng(2)
    array, gradients = rng.standard_normal((9, 3)), rng.standard_normal((9, 3, 3))
    frame = make_frame(
        bands=3,
        coefficients=pack_coefficients(array),
        gradients=pack_coefficients(gradients),
        position=(1.0, 2.0, -3.0),
        trust_radius_m=0.25,
    )
    variant = make_variant(frame, Variant(convention, 2, gradients=True))
    assert variant.gradients is not None
    got = unpack_gradients(variant.gradients)
    assert got.shape == (4, 3, 3)
    step = np.array([0.1, -0.2, 0.3])
    moved = convert((array + gradients @ step)[:4], convention)
    there = unpack_coefficients(variant.coefficients) + got @ convert_directions(step, convention)
    np.testing.assert_allclose(there, moved, rtol=1e-5, atol=1e-6)
    assert variant.position is not None
    np.testing.assert_array_equal(variant.position, convert_directions((1.0, 2.0, -3.0), convention))
    assert variant.trust_radius_m == 0.25
    stripped = make_variant(frame, Variant(convention, 2))
    assert stripped.gradients is None
    assert (stripped.position, stripped.trust_radius_m) == (variant.position, 0.25)
    assert frame.gradients is not None


PUBLISHED = (Path(make_vectors.__file__).parent / "gradients.json").read_text("utf-8")
VECTORS = json.loads(PUBLISHED)


def test_published_vectors_are_fresh() -> None:
    assert make_vectors.text("gradients") == PUBLISHED


@pytest.mark.parametrize("vector", VECTORS, ids=lambda vector: f"{vector['convention']}-{vector['bands']}")
def test_published_vectors_of_gradients(vector: dict[str, Any]) -> None:
    frame = make_frame(
        bands=vector["bands"],
        gradients=pack_coefficients(np.array(vector["input"])),
        position=tuple(vector["position"]),
    )
    variant = make_variant(frame, Variant(vector["convention"], gradients=True))
    assert variant.gradients is not None
    np.testing.assert_allclose(unpack_gradients(variant.gradients), vector["output"], rtol=2e-6, atol=2e-6)
    assert variant.position is not None
    np.testing.assert_allclose(variant.position, vector["engine_position"])
