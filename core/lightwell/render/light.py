"""Where light comes from: the same everywhere, or a grid that says what arrives at each point."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import bands_of_count, coefficient_count, degree_of_index
from lightwell.field.adaptive import AnyGrid
from lightwell.gradients.interpolate import SampleSet
from lightwell.render.nonnegative import nonnegative_gains
from lightwell.scene_settings import MOST_GROUPS
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
class SampledLight:
    """Light beside and between probes with known places (MATHS §7.4, §7.8): one probe is extrapolated by its gradient.

    `lightwell.gradients.interpolate.SampleSet` says how several are combined, and how far steps go.
    """

    samples: SampleSet

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(self.samples.coefficients.shape[1])

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        return self.samples.at(points)


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

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of the grid's volume, ``(3,)`` metres each."""
        return np.array(self.grid.spec.lower, np.float64), np.array(self.grid.spec.upper, np.float64)

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        found = self.grid.sample(points, bands=self.bands).coefficients
        if self.window is not None:
            found = np.moveaxis(apply_window(np.moveaxis(found, 1, 0), self.window), 0, 1)
        return found * self.gain


@dataclass(frozen=True, eq=False)
class SummedLight:
    """A static field in several parts that add up: one grid for each group of lamps, over the same space."""

    fields: tuple[FieldLight, ...]

    @property
    def bands(self) -> int:
        """SH bands."""
        return max(field.bands for field in self.fields)

    @property
    def box(self) -> tuple[Floats, Floats]:
        """Lower and upper corner of what holds all their volumes."""
        lower, upper = zip(*(field.box for field in self.fields), strict=True)
        return np.min(lower, axis=0), np.max(upper, axis=0)

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        total = np.zeros((len(points), coefficient_count(self.bands), 3))
        for field in self.fields:
            total[:, : coefficient_count(field.bands)] += field.at(points)
        return total


StaticField = FieldLight | SummedLight


@dataclass(frozen=True, eq=False)
class ModulatedLight:
    """A static field that follows a live probe: ``Σ g_k c_k(x)`` and, as distant light, the rest (MATHS §11d).

    `modulate` makes it.
    """

    fields: tuple[FieldLight, ...]
    """Each with its gain g, one for each channel."""
    rest: Floats
    """``(bands², 3)``: ``ℓ − Σ g_k c_k(x_0)``, zeros where it is negligible."""
    method: Method
    """Whether each field has a gain of its own."""
    residual: float
    """Share of the live light, by irradiance, that the gains do not explain."""

    @property
    def bands(self) -> int:
        """SH bands."""
        return bands_of_count(len(self.rest))

    def at(self, points: Floats) -> Floats:
        """Return ``(n, bands², 3)``."""
        found = SummedLight(self.fields).at(points)
        total: Floats = np.broadcast_to(self.rest, (len(points), *self.rest.shape)).copy()
        total[:, : found.shape[1]] += found
        return total


Method = Literal["gain", "groups"]
"""``gain``: method 2 of MATHS §11d, one gain for the whole field; ``groups``: method 4, one for each light group."""
GROUPS_EXPLAIN = 0.05
"""Light groups have gains of their own where these leave less than this of the live light; else something is new."""
NEGLIGIBLE_REST = 0.01
"""Below this residual the rest is noise and calibration, and is left out: the web page's."""


def modulate(
    fields: FieldLight | Sequence[FieldLight], live: Floats, place: tuple[float, float, float] | None = None
) -> ModulatedLight:
    """Return the field multiplied with gains, and a rest, so that it is the live light where the probe stands.

    Several fields are light groups (MATHS §11d, method 4): for each channel the gains g ≥ 0 are those with which
    ``Σ g_k c_k(x_0)`` comes nearest to the live light ℓ, weighted by A_l². They tell lamps apart, but take new light
    for a change of known lamps: where they leave a residual of `GROUPS_EXPLAIN`, and where there is a single field,
    the sum b of the fields has one gain ``g = ⟨ℓ, b⟩ / ⟨b, b⟩``, not below 0 (method 2).

    Parameters
    ----------
    fields
        The static field, or the parts that add up to it; gains are multiplied with those that they have.
    live
        ``(bands², 3)`` of the probe, ℓ.
    place
        Where the probe stands, metres; None: the middle of the first grid.

    Raises
    ------
    ValueError
        Where there is no field, or more than `MOST_GROUPS`.
    """
    parts = (fields,) if isinstance(fields, FieldLight) else tuple(fields)
    if not 1 <= len(parts) <= MOST_GROUPS:
        raise ValueError(f"{len(parts)} light groups: between 1 and {MOST_GROUPS} are needed")
    spec = parts[0].grid.spec
    where = np.add(spec.lower, spec.upper) / 2 if place is None else np.array(place, dtype=np.float64)
    bands = max(bands_of_count(len(live)), SummedLight(parts).bands)
    total, known = np.zeros((bands * bands, 3)), np.zeros((len(parts), bands * bands, 3))
    total[: len(live)] = live
    for part, values in zip(parts, known, strict=True):
        base = part.at(where[None])[0]
        values[: len(base)] = base
    metric = lambert_zonal(bands)[degree_of_index(bands), None]
    weighted, seen = metric * known, metric * total
    power = float(np.linalg.norm(seen))

    def unexplained(gains: Floats) -> tuple[Floats, float]:
        rest = total - np.einsum("gc,gkc->kc", gains, known)
        return rest, float(np.linalg.norm(metric * rest)) / power if power > 0 else 0.0

    method: Method = "groups"
    gains = np.stack([nonnegative_gains(weighted[..., c].T, seen[:, c]) for c in range(3)], axis=1)
    rest, residual = unexplained(gains)
    if len(parts) == 1 or residual >= GROUPS_EXPLAIN:
        method = "gain"
        gains = np.broadcast_to(_common_gain(seen, weighted.sum(axis=0)), (len(parts), 3))
        rest, residual = unexplained(gains)
    if residual < NEGLIGIBLE_REST:
        rest = np.zeros_like(rest)
    scaled = tuple(replace(part, gain=part.gain * gain) for part, gain in zip(parts, gains, strict=True))
    return ModulatedLight(scaled, rest, method, residual)


def _common_gain(live: Floats, field: Floats) -> Floats:
    """Return ``⟨ℓ, b⟩ / ⟨b, b⟩`` of each channel, at least 0: ``(3,)``; 0 where the field is black."""
    square = (field**2).sum(axis=0)
    return np.asarray(np.maximum(np.divide((live * field).sum(axis=0), square, out=np.zeros(3), where=square > 0), 0))


def with_bands(coefficients: Floats, bands: int) -> Floats:
    """Return the first ``bands`` bands of ``(…, K, 3)``; there are never more than there were."""
    return coefficients[..., : coefficient_count(bands), :]
