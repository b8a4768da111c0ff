"""A pinhole camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import world_from_camera
from lightwell.scene_settings import MAX_PIXELS, MAX_SIDE

Floats = NDArray[np.float64]

OVERVIEW_FROM = (-0.4, -1.0, 0.4)
OVERVIEW_FOV_DEGREES = 36.0


@dataclass(frozen=True)
class Camera:
    """Stands at ``position``, looks at ``target``; what lies along ``up`` is at the picture's top.

    Pixels are square. Pixel ``(row i, column j)`` has its centre at ``x = j + ½``, ``y = i + ½`` from the top left, and
    ``fov_degrees`` spans the picture's height: the camera of three.js.
    """

    position: tuple[float, float, float]
    """World metres."""
    target: tuple[float, float, float]
    """World metres; in the middle of the picture."""
    up: tuple[float, float, float] = (0.0, 0.0, 1.0)
    fov_degrees: float = 36.0
    """Angle from the picture's lower to its upper edge, 0 < angle < 180."""

    def __post_init__(self) -> None:
        numbers = np.array([*self.position, *self.target, *self.up, self.fov_degrees])
        if not np.isfinite(numbers).all():
            raise ValueError("the camera's position, target, up and fov_degrees must be finite")
        if not 0 < self.fov_degrees < 180:
            raise ValueError(f"the camera's fov_degrees, {self.fov_degrees}, must lie between 0 and 180")
        if np.abs(np.subtract(self.target, self.position)).max() < 1e-9:
            raise ValueError(f"the camera's target {self.target} is where the camera stands: move one of them")
        if not np.any(self.up):
            raise ValueError("the camera's up must have a length")

    @property
    def world_from_camera(self) -> Floats:
        """Rotation from camera axes (x right, y up, z backwards) to world axes, ``(3, 3)``.

        Where the camera looks along ``up``, the picture's top is +Y (+X where that will not do either).
        """
        forward = np.subtract(self.target, self.position).astype(np.float64)
        forward /= np.linalg.norm(forward)
        for up in (self.up, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)):
            if np.linalg.norm(np.cross(forward, up)) > 1e-6 * np.linalg.norm(up):
                return world_from_camera(tuple(forward), up)
        raise AssertionError("no direction is parallel to two axes")

    def directions(self, size: tuple[int, int], samples: int = 1, rows: slice | None = None) -> Floats:
        """Return where the rays of a picture look.

        Parameters
        ----------
        size
            Width and height in pixels.
        samples
            N: a pixel has N² rays, at the centres of N × N equal parts of it; 1 is the pixel's centre.
        rows
            Which rows of pixels; all of them by default.

        Returns
        -------
        ``(rows, width, N², 3)`` unit vectors, world axes.
        """
        width, height = size
        first, last, _ = (rows or slice(None)).indices(height)
        inside = (np.arange(samples) + 0.5) / samples
        x = np.arange(width)[:, None] + inside
        y = np.arange(first, last)[:, None] + inside
        rays = self.looking(x[None, :, None, :], y[:, None, :, None], size)
        return rays.reshape(last - first, width, samples * samples, 3)

    def looking(self, x: ArrayLike, y: ArrayLike, size: tuple[int, int]) -> Floats:
        """Return where the camera looks at points ``(…)`` of a picture, which may lie beyond its edges.

        ``x`` and ``y`` in pixels from the top left, ``size`` the picture's width and height. Returns ``(…, 3)`` unit
        vectors, world axes; each depends on its own point alone, to the last bit.
        """
        width, height = size
        pixel = 2 * np.tan(np.radians(self.fov_degrees) / 2) / height
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        right, up = (x - width / 2) * pixel, (height / 2 - y) * pixel
        length = np.sqrt(right * right + up * up + 1)
        axes = self.world_from_camera
        return np.stack([(axes[k, 0] * right + axes[k, 1] * up - axes[k, 2]) / length for k in range(3)], axis=-1)


def overview(bounds: Sequence[tuple[NDArray[np.floating], NDArray[np.floating]]], size: tuple[int, int]) -> Camera:
    """Return a camera that shows boxes, each of two corners ``(3,)``: from in front (−Y), the left and above.

    ``size``: width and height of the picture in pixels. Without boxes it looks at the unit ball.
    """
    corners = np.array(bounds if len(bounds) else [((-1, -1, -1), (1, 1, 1))], np.float64)
    lower, upper = corners[:, 0].min(axis=0), corners[:, 1].max(axis=0)
    middle, radius = (lower + upper) / 2, max(float(np.linalg.norm(upper - lower)) / 2, 1e-3)
    half = np.radians(OVERVIEW_FOV_DEGREES) / 2
    narrower = min(half, np.arctan(np.tan(half) * size[0] / size[1]))
    place = middle + radius / np.sin(narrower) * np.array(OVERVIEW_FROM) / np.linalg.norm(OVERVIEW_FROM)
    return Camera(tuple(place.tolist()), tuple(middle.tolist()), fov_degrees=OVERVIEW_FOV_DEGREES)


def require_size(size: tuple[int, int]) -> None:
    """Raise `ValueError` where no picture has that width and height in pixels."""
    width, height = size
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise ValueError(f"the size {width}×{height} must lie between 1×1 and {MAX_SIDE}×{MAX_SIDE}")
    if width * height > MAX_PIXELS:
        raise ValueError(f"the size {width}×{height} must have at most {MAX_PIXELS} pixels")
