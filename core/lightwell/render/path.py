"""Cameras that move: through key cameras, or round what they look at."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lightwell.render.camera import Camera

Floats = NDArray[np.float64]


def camera_path(keys: Sequence[Camera], count: int) -> list[Camera]:
    """Return ``count`` cameras through two or more ``keys``, the first at the first, the last at the last.

    Position, target, up and the angle of view follow Catmull-Rom splines (1974): smooth, and straight between two keys.
    Each pair of keys gets the same time. One camera is the first key.

    Raises
    ------
    ValueError
        Where a camera between keys would stand on its target.
    """
    if len(keys) < 2:
        raise ValueError("a path needs two cameras or more")
    times = np.linspace(0, len(keys) - 1, count) if count > 1 else np.zeros(1)
    rows = np.array([[*key.position, *key.target, *key.up, key.fov_degrees] for key in keys])
    return [_camera(row) for row in _spline(rows, times)]


def orbit(camera: Camera, degrees: float, count: int) -> list[Camera]:
    """Return ``count`` cameras that turn about the vertical through the target, counter-clockwise from above.

    Picture k has turned by ``degrees · k / count``: a full turn ends one step before it begins, so that a film loops.
    """
    return [_turned(camera, np.radians(degrees * k / count)) for k in range(count)]


def _spline(rows: Floats, times: Floats) -> Floats:
    """Return the spline through ``(n, k)`` rows, a unit of time apart, at ``times``."""
    # Beyond the ends the first and the last step go on as they are: two keys make a straight line.
    padded = np.concatenate([2 * rows[:1] - rows[1:2], rows, 2 * rows[-1:] - rows[-2:-1]])
    part = np.clip(np.floor(times).astype(int), 0, len(rows) - 2)
    t = (times - part)[:, None]
    before, here, there, after = (padded[part + k] for k in range(4))
    slope, next_slope = (there - before) / 2, (after - here) / 2
    value: Floats = (
        (2 * t**3 - 3 * t**2 + 1) * here
        + (t**3 - 2 * t**2 + t) * slope
        + (3 * t**2 - 2 * t**3) * there
        + (t**3 - t**2) * next_slope
    )
    return value


def _camera(row: Floats) -> Camera:
    position, target, up = (tuple(map(float, row[k : k + 3])) for k in (0, 3, 6))
    # A spline may overshoot what an angle can be.
    return Camera(position, target, up, float(np.clip(row[9], 1e-3, 179.0)))  # type: ignore[arg-type]


def _turned(camera: Camera, angle: float) -> Camera:
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    away = turn @ np.subtract(camera.position, camera.target)
    position = tuple(map(float, np.add(camera.target, away)))
    up = tuple(map(float, turn @ np.array(camera.up)))
    return Camera(position, camera.target, up, camera.fov_degrees)  # type: ignore[arg-type]
