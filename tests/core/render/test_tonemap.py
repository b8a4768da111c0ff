"""Tone mapping and sRGB as three.js 0.187 has them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from lightwell.render import encode_srgb, expose_and_encode, neutral_tone_mapping
from lightwell.render.tonemap import DESATURATION, START_COMPRESSION

CHUNKS = Path(__file__).parents[3] / "client/node_modules/three/src/renderers/shaders/ShaderChunk"


def three_neutral(colour: list[float]) -> list[float]:
    """The shader, line by line, for one colour."""
    x = min(colour)
    offset = x - 6.25 * x * x if x < 0.08 else 0.04
    colour = [value - offset for value in colour]
    peak = max(colour)
    if peak < START_COMPRESSION:
        return colour
    d = 1 - START_COMPRESSION
    new_peak = 1 - d * d / (peak + d - START_COMPRESSION)
    colour = [value * new_peak / peak for value in colour]
    g = 1 - 1 / (DESATURATION * (peak - new_peak) + 1)
    return [value * (1 - g) + new_peak * g for value in colour]


def test_neutral_is_the_shader_line_by_line() -> None:
    colours = np.random.default_rng(0).uniform(0, 1, (500, 3)) ** 3 * 20
    colours[:3] = np.array([[0, 0, 0], [0.08, 0.08, 0.08], [0.8, 0.8, 0.8]])
    expected = np.array([three_neutral([float(value) for value in colour]) for colour in colours])
    np.testing.assert_allclose(neutral_tone_mapping(colours), expected, atol=1e-14)


def test_the_installed_shader_has_these_constants() -> None:
    file = CHUNKS / "tonemapping_pars_fragment.glsl.js"
    if not file.is_file():
        pytest.skip("three.js is not installed in client/node_modules")
    text = file.read_text().partition("vec3 NeutralToneMapping")[2].partition("\n}")[0]
    assert re.findall(r"[0-9]*\.[0-9]+", text) == ["0.8", "0.04", "0.15", "0.08", "6.25", "0.04"]
    curve = (CHUNKS / "colorspace_pars_fragment.glsl.js").read_text().partition("sRGBTransferOETF")[2]
    assert re.findall(r"[0-9]*\.[0-9]+", curve)[:5] == ["0.41666", "1.055", "0.055", "12.92", "0.0031308"]


def test_srgb_is_within_a_hundredth_of_a_step_of_the_standard() -> None:
    linear = np.linspace(0, 1, 2001)
    standard = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(encode_srgb(linear), standard, atol=0.01 / 255)
    np.testing.assert_allclose(encode_srgb([-1.0, 2.0]), [0, 1], rtol=1e-15)


def test_exposure_doubles_and_eight_bits_round() -> None:
    grey = np.full((1, 3), 0.1)
    np.testing.assert_array_equal(expose_and_encode(grey, 1), expose_and_encode(2 * grey))
    assert expose_and_encode([[1.0, 1.0, 1.0]], tone_mapping=False).tolist() == [[255, 255, 255]]
    assert expose_and_encode([[1e9, 1e9, 1e9]]).tolist() == [[255, 255, 255]]
    assert expose_and_encode([[0.5, 0.5, 0.5]], tone_mapping=False).tolist() == [[188, 188, 188]]
