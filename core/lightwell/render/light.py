"""Where light comes from: the same everywhere, or a grid that says what arrives at each point."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count, coefficient_count, degree_of_index
from lightwell.field.adaptive import AnyGrid
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.window import apply_window

Floats = NDArray[np.float64]


class Light(Protocol):
    """Radiance coefficients at points."""

    @property
    def bands(self) -> int:
        """SH bands."""
        ...

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands²,  3)`` for ``points`` ``(n, 3)``, or ``(bands², 3)`` where all points get the same."""
        ...


@dataclass(frozen=True, eq=False)
class DistantLight:
    """Light from so far away that it is the same at every point: a probe, or one frame of a stream."""

    coefficients: Floats
    """``(bands², 3)`` of radiance."""

    def __post_init__(self) -> None:
        array = np.asarray(self.coefficients, dtype=np.float64)
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"light has the shape {array.shape}; (bands², 3) coefficients are needed")
        bands_of_count(array.shape[0])
        if not np.isfinite(array).all():
            raise ValueError("light must be finite")
        object.__setattr__(self, "coefficients", array)

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(self.coefficients.shape[0])

    def at(self, points: Floats) -> Floats:
        """Return ``(bands², 3)``."""
        del points
        return self.coefficients


@dataclass(frozen=True, eq=False)
class FieldLight:
    """An incident light field: trilinear coefficients of a grid, regular or adaptive, at each point.

    Beyond the outermost cell centres the field is that of the nearest one.
    """

    grid: AnyGrid
    most_bands: int | None = None
    """Use no more bands than these."""
    window: Floats | None = None
    """``(bands,)`` weights against ringing, `lightwell.sh.window.fixed_window`."""
    gain: float | Floats = 1.0
    """Factor, one or ``(3,)`` for each channel."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return min(self.grid.bands, self.most_bands or self.grid.bands)

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        found = self.grid.sample(points, bands=self.bands).coefficients
        if self.window is not None:
            found = np.moveaxis(apply_window(np.moveaxis(found, 1, 0), self.window), 0, 1)
        return found * self.gain


@dataclass(frozen=True, eq=False)
class ModulatedLight:
    """A static field that follows a live probe: ``g c(x)`` and, as distant light, what no gain explains (MATHS §11d).

    `modulate` makes it.
    """

    field: FieldLight
    """With the gain g of each channel."""
    rest: Floats
    """``(bands², 3)``: ``ℓ − g b``, zeros where it is negligible."""
    residual: float
    """Share of the live light, by irradiance, that the gain does not explain."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(len(self.rest))

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        found = self.field.at(points)
        total: Floats = np.broadcast_to(self.rest, (len(points), *self.rest.shape)).copy()
        total[:, : found.shape[1]] += found
        return total


NEGLIGIBLE_REST = 0.01
"""Below this residual the rest is noise and calibration, and is left out: the web page's."""


def modulate(field: FieldLight, live: Floats, place: tuple[float, float, float] | None = None) -> ModulatedLight:
    """Return the field multiplied with a gain, and a rest, so that it is the live light where the probe stands.

    Method 2 of MATHS §11d: ``g = ⟨ℓ, b⟩ / ⟨b, b⟩`` for each channel, weighted by A_l², not below 0; b is the field at
    the probe's place.

    Parameters
    ----------
    field
        The static field; its gain is multiplied with the new one.
    live
        ``(bands², 3)`` of the probe, ℓ.
    place
        Where the probe stands, metres; None: the middle of the grid.
    """
    spec = field.grid.spec
    where = np.add(spec.lower, spec.upper) / 2 if place is None else np.array(place, dtype=np.float64)
    base = field.at(where[None])[0]
    bands = max(field.bands, bands_of_count(len(live)))
    total, known = (np.zeros((bands * bands, 3)) for _ in range(2))
    total[: len(live)], known[: len(base)] = live, base
    weights = lambert_zonal(bands)[degree_of_index(bands), None] ** 2
    square = (weights * known**2).sum(axis=0)
    gain = np.maximum(np.divide((weights * total * known).sum(axis=0), square, out=np.zeros(3), where=square > 0), 0)
    rest = total - gain * known
    power = float((weights * total**2).sum())
    residual = float(np.sqrt((weights * rest**2).sum() / power)) if power > 0 else 0.0
    if residual < NEGLIGIBLE_REST:
        rest = np.zeros_like(rest)
    return ModulatedLight(replace(field, gain=field.gain * gain), rest, residual)


def with_bands(coefficients: Floats, bands: int) -> Floats:
    """Return the first ``bands`` bands of ``(…, K, 3)``; there are never more than there were."""
    return coefficients[..., : coefficient_count(bands), :]
