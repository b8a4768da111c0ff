"""Slow, plain versions of the kernels of `lightwell.igi`, straight from MATHS §10."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.rays import RayScene
from lightwell.igi.filter import PLANE_TOLERANCE, SAME_NORMAL, Reach
from lightwell.igi.gbuffer import GBuffer
from lightwell.igi.lights import CAPTURED, DIRECTIONAL, POINT, SURFACE, LightSets, VirtualLights
from lightwell.igi.surfaces import Surfaces
from lightwell.render.light import StaticField
from lightwell.sh.basis import evaluate
from lightwell.sh.shading import irradiance, phong

Floats = NDArray[np.float64]


def light_at(
    lights: VirtualLights, j: int, place: Floats, normal: Floats, field: StaticField | None = None
) -> tuple[Floats, Floats, float] | None:
    """Direction ω, Φ ``(3,)`` without the clamp and its factor, or None below the horizon."""
    axis, flux = lights.normal[j], lights.flux[j]
    if lights.kind[j] == DIRECTIONAL:
        return (axis, flux, 1.0) if normal @ axis > 0 else None
    if lights.kind[j] == CAPTURED:
        assert field is not None
        radiance = evaluate(axis, field.bands) @ field.at(place[None])[0]
        return (axis, flux * radiance, 1.0) if normal @ axis > 0 else None
    away = lights.position[j] - place
    square = float(away @ away)
    omega = away / np.sqrt(square)
    above, cosine = float(normal @ omega), float(-axis @ omega)
    if above <= 0:
        return None
    if lights.kind[j] == POINT:
        a, b = lights.falloff[j]
        return omega, flux * np.clip(a * cosine + b, 0, 1) ** 2 / square, 1.0
    if cosine <= 0:
        return None
    # Bounded: both cosines over the squared distance.
    kept = min(1.0, square / (lights.least[j] * cosine * above)) if lights.least[j] > 0 else 1.0
    assert lights.kind[j] == SURFACE
    return omega, flux * cosine / (np.pi * square), kept


def gathered(
    rays: RayScene,
    sets: LightSets,
    bands: int,
    place: Floats,
    normal: Floats,
    which: int,
    field: StaticField | None = None,
) -> tuple[Floats, float]:
    """Coefficients ``(2, bands², 3)`` of one pixel, and what the clamp took."""
    total, lost = np.zeros((2, bands * bands, 3)), 0.0
    for j in range(sets.starts[which], sets.starts[which + 1]):
        seen = light_at(sets.lights, j, place, normal, field)
        if seen is None:
            continue
        omega, phi, kept = seen
        far = sets.lights.kind[j] in (DIRECTIONAL, CAPTURED)
        ray = omega if far else sets.lights.position[j] - place
        end = np.array([1e30 if far else 1.0], np.float32)
        if rays.occluded(place[None].astype(np.float32), ray[None].astype(np.float32), end)[0]:
            continue
        total[int(j >= sets.bounced[which])] += kept * evaluate(omega, bands)[:, None] * phi
        lost += (1 - kept) * float(phi.sum())
    return total, lost


def filtered(
    values: NDArray[Any],
    seen: NDArray[np.bool_],
    place: Floats,
    geometric: Floats,
    shading: Floats,
    depth: Floats,
    reach: tuple[int, int, int, int],
    cosines: tuple[float, float | None],
    tolerance: float,
) -> NDArray[Any]:
    """The mean over accepted neighbours, pixel by pixel."""
    left, right, up, down = reach
    height, width = seen.shape
    out = np.zeros((height - up - down, width - left - right, values.shape[2]), values.dtype)
    for i in range(up, height - down):
        for j in range(left, width - right):
            if not seen[i, j]:
                continue
            window = slice(i - up, i + down + 1), slice(j - left, j + right + 1)
            accepted = seen[window] & (geometric[window] @ geometric[i, j] > cosines[0])
            accepted &= np.abs((place[window] - place[i, j]) @ geometric[i, j]) < tolerance * depth[i, j]
            if cosines[1] is not None:
                accepted &= shading[window] @ shading[i, j] >= cosines[1]
            out[i - up, j - left] = values[window][accepted].mean(axis=0)
    return out


def shaded(
    coefficients: Floats, normal: Floats, view: Floats, exponent: float, window: Floats
) -> tuple[Floats, Floats]:
    """Irradiance over π under a window of the degrees, and the lobe's radiance, of ``(bands², 3)``; not clipped."""
    degrees = np.repeat(np.arange(len(window)), 2 * np.arange(len(window)) + 1)
    mirrored = view - 2 * (view @ normal) * normal
    return (
        irradiance(coefficients * window[degrees][:, None], normal) / np.pi,
        phong(coefficients, mirrored, exponent),
    )


def first_solid(surfaces: Surfaces, origin: Floats, direction: Floats) -> tuple[int, float]:
    """The first triangle that a ray meets where there is a surface (−1: none), and how far, in its own lengths."""
    a, b, c = (surfaces.mesh.positions[surfaces.mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    places = np.linalg.solve(
        np.stack([b - a, c - a, np.broadcast_to(-direction.astype(np.float64), a.shape)], axis=2),
        (origin.astype(np.float64) - a)[..., None],
    )[..., 0]
    u, v, t = places.T
    for triangle in np.argsort(t):
        if t[triangle] <= 0 or min(u[triangle], v[triangle], 1 - u[triangle] - v[triangle]) < 0:
            continue
        item = surfaces.objects[surfaces.owner[triangle]]
        material = item.material
        corners = surfaces.mesh.triangles[triangle]
        weights = np.array([1 - u[triangle] - v[triangle], u[triangle], v[triangle]])
        alpha = material.alpha
        if material.alpha_texture is not None:
            alpha *= float(material.alpha_texture.at((weights @ surfaces.uv_of(0)[corners])[None])[0, 0])
        if item.alpha is not None:
            own = surfaces.mesh.triangles[surfaces.owner == surfaces.owner[triangle]]
            alpha *= float(weights @ item.alpha[corners - own.min()])
        if alpha * (1 - material.transmission) >= material.hole_below:
            return int(triangle), float(t[triangle])
    return -1, np.inf


def incident_of_rays(
    fine: GBuffer, centre: GBuffer, before: NDArray[Any], after: NDArray[Any], samples: int, reach: Reach
) -> list[Floats | None]:
    """What each ray takes: its pixel's after the filter, the mean over its surface in the window, or None."""
    found: list[Floats | None] = []
    for i, j in np.ndindex(fine.seen.shape):
        if not fine.seen[i, j]:
            found.append(np.zeros(before.shape[2]))
            continue
        row, column = i // samples, j // samples
        window = (
            slice(row, row + reach.up + reach.down + 1),
            slice(column, column + reach.left + reach.right + 1),
        )
        same = centre.seen & (centre.geometric @ fine.geometric[i, j] > SAME_NORMAL)
        same &= np.abs((centre.place - fine.place[i, j]) @ fine.geometric[i, j]) < PLANE_TOLERANCE * fine.depth[i, j]
        if same[row + reach.up, column + reach.left]:
            found.append(after[row, column])
        else:
            found.append(before[window][same[window]].mean(axis=0) if same[window].any() else None)
    return found
