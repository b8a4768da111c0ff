"""The Phong lobe against its integral over the hemisphere, by quadrature: no light comes from below the surface."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from tests.support.igi_scenes import placed

import lightwell_workers
from lightwell.geometry.shapes import plane
from lightwell.igi import IgiMaterial, IgiObject, IgiScene, Sky, render_igi
from lightwell.igi.materials import phong_exponent
from lightwell.igi.shade import responses
from lightwell.igi_settings import IgiSettings
from lightwell.io.pictures import read_picture
from lightwell.probe.samples import repair
from lightwell.render import Camera
from lightwell.sh.basis import evaluate

UP = np.array([0.0, 0, 1])
MAPS = Path(lightwell_workers.__path__[0], "samples", "hdri")


class Rule(NamedTuple):
    directions: np.ndarray
    solid_angles: np.ndarray


@cache
def upper_side() -> Rule:
    """A product rule over the directions above the surface."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    z, phi = (nodes + 1) / 2, 2 * np.pi * (np.arange(160) + 0.5) / 160
    z, phi = (part.reshape(-1) for part in np.meshgrid(z, phi, indexing="ij"))
    ring = np.sqrt(1 - z * z)
    directions = np.stack([ring * np.cos(phi), ring * np.sin(phi), z], axis=1)
    return Rule(directions, np.repeat(weights / 2, 160) * 2 * np.pi / 160)


def lobe_of(light: np.ndarray, mirrored: np.ndarray, exponent: float) -> np.ndarray:
    """``(s + 1)/2π ∫ max(0, r·ω)^s L(ω) dω`` over the directions above, ``(3,)``; ``light`` (n, 3) along the rule."""
    directions, solid_angles = upper_side()
    cosine = directions @ mirrored
    weights = np.where(cosine > 0, np.maximum(cosine, 1e-300) ** exponent, 0) * solid_angles
    return np.asarray((exponent + 1) / (2 * np.pi) * (weights @ light))


def drawn(light: np.ndarray, mirrored: np.ndarray, exponent: float, bands: int) -> np.ndarray:
    directions, solid_angles = upper_side()
    coefficients = (evaluate(directions, bands) * solid_angles[:, None]).T @ light
    view = mirrored * [1, 1, -1]
    got = responses(
        coefficients[None, None],
        UP[None],
        view[None],
        UP[None],
        np.array([exponent]),
        np.ones(1, bool),
        "nonneg",
        bands,
    )
    return np.asarray(got.lobe[0, 0])


def mirrored_at(degrees: float, azimuth: float) -> np.ndarray:
    theta = np.radians(degrees)
    return np.array([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)])


ANGLES = (5.0, 30.0, 50.0, 65.0, 80.0)


@pytest.mark.parametrize("bands", [2, 3, 4, 5])
def test_in_a_furnace_a_lobe_gets_its_share_above_the_surface(bands: int) -> None:
    """Radiance 1 from above: never more than 1, and what the quadrature says."""
    even = np.ones((len(upper_side().directions), 3))
    for roughness in (1.0, 0.7, 0.5, 0.35):
        exponent = float(phong_exponent(roughness))
        for degrees in (0.0, *ANGLES):
            mirrored = mirrored_at(degrees, 1.0)
            got = drawn(even, mirrored, exponent, bands)
            np.testing.assert_allclose(got, lobe_of(even, mirrored, exponent), atol=5e-3)
            assert got.max() < 1.001


def relative_rms(light: np.ndarray, exponent: float, bands: int) -> float:
    truth, got = [], []
    for degrees in ANGLES:
        for azimuth in np.arange(6) * np.pi / 3 + 0.2:
            truth.append(lobe_of(light, mirrored_at(degrees, azimuth), exponent))
            got.append(drawn(light, mirrored_at(degrees, azimuth), exponent, bands))
    return float(np.sqrt(((np.array(got) - np.array(truth)) ** 2).mean()) / np.mean(truth))


def test_under_a_real_map() -> None:
    """What cutting off at 9 and at 25 coefficients costs, by roughness."""
    pixels = repair(read_picture(MAPS / "venice.exr").pixels, "clamp").astype(np.float32)
    light = Sky(pixels).radiance(upper_side().directions)
    for roughness, most in ((0.9, (0.03, 0.02)), (0.7, (0.03, 0.01)), (0.5, (0.13, 0.04)), (0.35, (0.26, 0.16))):
        exponent = float(phong_exponent(roughness))
        errors = [relative_rms(light, exponent, bands) for bands in (3, 5)]
        print(f"\nroughness {roughness}, exponent {exponent:.1f}: {errors[0]:.1%}, {errors[1]:.1%}")
        assert (np.array(errors) < most).all()


def test_materials_in_a_furnace_as_pictures() -> None:
    """Matte part and lobe together reflect no more than arrives, and all of it straight from above."""
    flat = placed(plane(4), 2, [0, 0, 0])
    sky = Sky(np.ones((32, 64, 3), np.float32))
    settings = IgiSettings(vpls=8192, sets=(1, 1), filter="none", bounces=0)
    for metallic, roughness in ((0.0, 0.3), (0.0, 0.6), (1.0, 0.3), (1.0, 0.7)):
        white = IgiMaterial(base=(1, 1, 1), metallic=metallic, roughness=roughness, specular=0.5)
        scene = IgiScene((IgiObject(flat, white),), sky=sky)
        above = render_igi(scene, Camera((0, 0, 3), (0, 0, 0), fov_degrees=10), (8, 8), settings).colour
        np.testing.assert_allclose(above, 1, atol=2e-3)
        aslant = render_igi(scene, Camera((0, -3, 0.6), (0, 0, 0), fov_degrees=10), (8, 8), settings).colour
        assert aslant.max() < 1.002
