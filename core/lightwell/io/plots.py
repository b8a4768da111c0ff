"""Plots for people: a grid in slices, and where the probes of a capture stand."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from lightwell.field.adaptive import AnyGrid
from lightwell.io.preview import irradiance_slice

NAMES = "xyz"


def _png(figure: Figure) -> bytes:
    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def plot_grid(opened: AnyGrid, normal: tuple[float, float, float] = (0.0, 0.0, 1.0)) -> bytes:
    """Return a PNG: irradiance on surfaces with ``normal`` and coverage, in the middle slices across z, y and x."""
    grid = opened.to_regular()
    figure = Figure(figsize=(11, 7), layout="constrained")
    axes = figure.subplots(2, 3)
    slices = [irradiance_slice(grid, axis, grid.spec.resolution[axis] // 2, normal) for axis in (2, 1, 0)]
    white = max(float(np.quantile(np.concatenate([part.reshape(-1) for part in slices]), 0.98)), 1e-12)
    for column, (axis, part) in enumerate(zip((2, 1, 0), slices, strict=True)):
        right, upwards = [other for other in range(3) if other != axis]
        lower, upper = grid.spec.lower, grid.spec.upper
        extent = (lower[right], upper[right], lower[upwards], upper[upwards])
        middle = lower[axis] + (grid.spec.resolution[axis] // 2 + 0.5) * grid.spec.voxel[axis]
        top, bottom = axes[0, column], axes[1, column]
        top.imshow(np.clip(part / white, 0, 1) ** (1 / 2.2), origin="lower", extent=extent, interpolation="nearest")
        top.set_title(f"irradiance, {NAMES[axis]} = {middle:.3g} m")
        coverage = np.take(grid.coverage, grid.spec.resolution[axis] // 2, axis=2 - axis)
        shown = bottom.imshow(coverage, origin="lower", extent=extent, vmin=0, vmax=1, interpolation="nearest")
        bottom.set_title("share measured, not repaired")
        for place in (top, bottom):
            place.set_xlabel(f"{NAMES[right]}, m")
            place.set_ylabel(f"{NAMES[upwards]}, m")
    figure.colorbar(shown, ax=axes[1, :], shrink=0.8)
    direction = ", ".join(f"{value:g}" for value in normal)
    figure.suptitle(f"normal ({direction}); white = {white:.4g}")
    return _png(figure)


def plot_positions(positions: NDArray[np.float64]) -> bytes:
    """Return a PNG of probe positions ``(P, 3)`` from above and from two sides."""
    figure = Figure(figsize=(11, 4), layout="constrained")
    for place, (right, upwards) in zip(figure.subplots(1, 3), ((0, 1), (0, 2), (1, 2)), strict=True):
        place.scatter(positions[:, right], positions[:, upwards], s=4, alpha=0.6, linewidths=0)
        place.set_xlabel(f"{NAMES[right]}, m")
        place.set_ylabel(f"{NAMES[upwards]}, m")
        place.set_aspect("equal")
    figure.suptitle(f"{len(positions)} probes")
    return _png(figure)


def plot_placement(
    positions: NDArray[np.float64],
    candidates: NDArray[np.float64],
    bounds: tuple[Sequence[float], Sequence[float]] | None,
    histories: Mapping[str, Sequence[float]],
    tolerance: float,
) -> bytes:
    """Return a PNG of sample positions ``(n, 3)``, and of the error with 1, 2, … samples.

    They are drawn in the box of ``bounds``, or where there is none among the ``candidates`` ``(m, 3)``.
    """
    figure = Figure(figsize=(14, 4), layout="constrained")
    *views, curve = figure.subplots(1, 4)
    for place, (right, upwards, deep) in zip(views, ((0, 1, 2), (0, 2, 1), (1, 2, 0)), strict=True):
        if bounds is None:
            place.scatter(candidates[:, right], candidates[:, upwards], s=2, c="0.8", linewidths=0)
        else:
            low, high = ((corner[right], corner[upwards]) for corner in bounds)
            place.add_patch(Rectangle(low, high[0] - low[0], high[1] - low[1], fill=False, edgecolor="0.6"))
        place.scatter(positions[:, right], positions[:, upwards], s=24, c=positions[:, deep], cmap="viridis")
        place.set_xlabel(f"{NAMES[right]}, m")
        place.set_ylabel(f"{NAMES[upwards]}, m (colour: {NAMES[deep]})")
        place.set_aspect("equal")
        place.autoscale_view()
    for way, errors in histories.items():
        curve.plot(np.arange(1, len(errors) + 1), errors, label=way)
    curve.axhline(tolerance, color="0.6", linewidth=1)
    curve.set_xscale("log")
    curve.set_yscale("log")
    curve.set_xlabel("samples")
    curve.set_ylabel("largest error")
    curve.legend()
    figure.suptitle(f"{len(positions)} samples with gradients for a tolerance of {tolerance:g}")
    return _png(figure)
