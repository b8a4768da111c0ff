"""From light, normal, transfer and view to radiance.

The browser's fragment shader (``client/src/materials.ts``) in NumPy, in the same order and with the same clamps.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count
from lightwell.render.light import Light, with_bands
from lightwell.render.material import Material, horizon_factor
from lightwell.render.negatives import without_negatives
from lightwell.render.scene import Negatives, Scene
from lightwell.sh.basis import Y00
from lightwell.sh.lobes import lambert_zonal, phong_zonal, zonal_to_coefficients

Floats = NDArray[np.float64]


class Surface(NamedTuple):
    """Points on one object, and how they are seen."""

    points: Floats
    """``(n, 3)`` world metres."""
    normals: Floats
    """``(n, 3)`` unit vectors, interpolated."""
    view: Floats
    """``(n, 3)`` unit vectors from the camera to the point."""
    albedo: Floats
    """``(n, 3)``."""
    transfer: Floats | None
    """``(n, bands², C)``."""


class Received(NamedTuple):
    """What a surface gets, before its material mixes it; linear in the light."""

    irradiance: Floats
    """``(n, 3)``."""
    lobe: Floats
    """``(n, 3)`` radiance blurred by the Phong lobe about the mirror direction; zeros where it is not used."""
    open: Floats
    """``(n,)`` share of the cosine-weighted hemisphere that is visible."""


def receive(light: Light, surface: Surface, material: Material) -> Received:
    """Sum the light over each point's transfer (or cosine) and lobe."""
    count = len(surface.points)
    coefficients = light.at(surface.points)
    if surface.transfer is None:
        cosine = zonal_to_coefficients(lambert_zonal(light.bands), surface.normals)
        irradiance, visible = _sum(cosine, coefficients), np.ones(count)
    else:
        bands = min(light.bands, bands_of_count(surface.transfer.shape[1]))
        irradiance = _transferred(surface.transfer[:, : bands * bands], with_bands(coefficients, bands))
        # t_00 of an unshadowed surface is π Y_00.
        visible = surface.transfer[:, 0].mean(axis=-1) / (np.pi * Y00)
    lobe = np.zeros((count, 3))
    if material.gloss > 0:
        factors = phong_zonal(material.exponent, light.bands, material.normalised)
        lobe = _sum(zonal_to_coefficients(factors, reflect(surface.view, surface.normals)), coefficients)
    return Received(irradiance, lobe, visible)


def shade(scene: Scene, surface: Surface, material: Material, received: Received) -> Floats:
    """Return the radiance ``(n, 3)`` that leaves the points towards the camera."""
    colour = surface.albedo * _handled(received.irradiance, scene.negatives) / np.pi
    reflected = reflect(surface.view, surface.normals)
    if material.gloss > 0:
        polished = _handled(received.lobe, scene.negatives) * np.clip(received.open, 0, 1)[:, None]
        if material.horizon:
            cosine = np.einsum("nk,nk->n", reflected, surface.normals)
            polished *= horizon_factor(cosine, material.exponent)[:, None]
        colour = (1 - material.gloss) * colour + material.gloss * polished
    if material.mirror > 0 and scene.backdrop is not None:
        colour = colour + material.mirror * scene.backdrop.radiance(reflected)
    return colour


def reflect(view: Floats, normals: Floats) -> Floats:
    """Return the mirror directions ``v − 2 (v·n) n``, ``(n, 3)``; ``view`` runs from the camera to the point."""
    mirrored: Floats = view - 2 * np.einsum("nk,nk->n", view, normals)[:, None] * normals
    return mirrored


def _sum(weights: Floats, coefficients: Floats) -> Floats:
    """Return ``Σ_k w_k c_k``: ``(n, K)`` times ``(K, 3)`` or ``(n, K, 3)``."""
    if coefficients.ndim == 2:
        return np.asarray(weights @ coefficients)
    return np.asarray(np.einsum("nk,nkc->nc", weights, coefficients))


def _transferred(transfer: Floats, coefficients: Floats) -> Floats:
    """Return ``Σ_k t_k c_k``: ``(n, K, 1 or 3)`` times ``(K, 3)`` or ``(n, K, 3)``."""
    if transfer.shape[2] == 1:
        return _sum(transfer[:, :, 0], coefficients)
    per_point = "kc" if coefficients.ndim == 2 else "nkc"
    return np.asarray(np.einsum(f"nkc,{per_point}->nc", transfer, coefficients))


def _handled(rgb: Floats, negatives: Negatives) -> Floats:
    if negatives == "keep":
        return rgb
    return without_negatives(rgb) if negatives == "desaturate" else np.maximum(rgb, 0)
