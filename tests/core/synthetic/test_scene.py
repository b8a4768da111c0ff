"""The analytic scenes against brute force."""

from __future__ import annotations

import json

import numpy as np
import pytest

from lightwell.sh.basis import evaluate
from lightwell.synthetic import scene as scenes
from lightwell.synthetic.scene import PRESETS, scene_from_json


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_coefficients_are_the_projection_of_radiance(name: str) -> None:
    scene, point = PRESETS[name], np.array([0.2, -0.3, 0.1])
    height = 900
    theta, phi = np.pi * (np.arange(height) + 0.5) / height, np.pi * (np.arange(2 * height) + 0.5) / height
    total = np.zeros((16, 3))
    for angle in theta:
        directions = np.stack(
            [np.sin(angle) * np.cos(phi), np.sin(angle) * np.sin(phi), np.full(phi.shape, np.cos(angle))], axis=1
        )
        light = scene.radiance(point, directions)
        total += np.sin(angle) * (np.pi / height) ** 2 * evaluate(directions, 4).T @ light
    exact = scene.coefficients(point, 4)
    assert np.abs(total - exact).max() < 2e-3 * np.sqrt((exact**2).sum())


@pytest.mark.parametrize("name", ["cube", "scene1", "scene2"])
def test_quadrature_has_converged(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = PRESETS[name]
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (12, 3))
    found = scene.coefficients(points, 5)
    for constant in ("AREA_NODES", "LENS_NODES", "WALL_NODES"):
        monkeypatch.setattr(scenes, constant, 2 * getattr(scenes, constant))
    assert np.abs(found - scene.coefficients(points, 5)).max() < 2e-6 * np.sqrt((found**2).sum(axis=(1, 2)).max())


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_radiance_is_constant_along_rays_within_the_volume(name: str) -> None:
    generator = np.random.default_rng(1)
    origins = generator.uniform(-0.4, 0.4, (3000, 3))
    directions = generator.normal(size=(3000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    here = PRESETS[name].radiance(origins, directions)
    there = PRESETS[name].radiance(origins + 0.1 * directions, directions)
    # The edges of emitters are sharp: a ray at one may fall to either side by rounding.
    assert (np.abs(here - there).max(axis=1) > 1e-9).mean() < 1e-3


def test_light_varies_as_the_scenes_say() -> None:
    points = np.random.default_rng(2).uniform(-0.5, 0.5, (200, 3))
    for name, varies in {"constant": False, "distant": False, "scene1": True, "scene2": True}.items():
        coefficients = PRESETS[name].coefficients(points, 3)
        spread = coefficients.std(axis=0).max() / np.abs(coefficients).max()
        assert (spread > 0.05) == varies


def test_scenes_survive_json() -> None:
    for scene in PRESETS.values():
        assert scene_from_json(json.loads(json.dumps(scene.to_json()))) == scene
