"""Conventions and bands of a frame."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.publisher import make_frame

from lightwell.conventions import CONVENTIONS, Convention
from lightwell.sh.engines import convert, convert_directions
from lightwell.wire import DominantLight, pack_coefficients, unpack_coefficients
from lightwell_server.variants import AS_PUBLISHED, Variant, make_variant


def test_what_changes_nothing_returns_the_same_object() -> None:
    frame = make_frame(bands=3)
    assert make_variant(frame, AS_PUBLISHED) is frame
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


def test_gradients_turn_their_coefficients_and_their_axes() -> None:
    rng = np.random.default_rng(2)
    gradients = rng.standard_normal((9, 3, 3)).astype(np.float32)
    frame = make_frame(bands=3, gradients=pack_coefficients(gradients))
    variant = make_variant(frame, Variant("three", 2))
    assert variant.gradients is not None
    got = np.frombuffer(variant.gradients, "<f4").reshape(4, 3, 3)
    converted = np.stack([convert(gradients[:4, :, axis], "three") for axis in range(3)], axis=-1)
    x, y, z = np.moveaxis(converted, -1, 0)  # engine axes of three: (x, z, −y)
    np.testing.assert_allclose(got, np.stack([x, z, -y], axis=-1), rtol=1e-6, atol=1e-6)
