"""Windows against ringing: ``c'_lm = h_l c_lm`` (MATHS §4).

Cutting a bright, small light off at a degree makes the sum of its harmonics negative elsewhere. A window takes weight
off the higher degrees. Fixed windows do that for every frame alike; the automatic one does no more than a frame needs.

Fixed kernels that are never negative
    A zonal kernel that is nowhere negative makes the result non-negative for *every* non-negative light.

    ``irradiance``: the non-negative quadratic that is nearest, in least squares, to the cosine kernel of equal mean
    (MATHS §4.1b): ``h = (1, 0.858, 0.909)``, and ``(1, ½)`` for two bands. Above three bands the higher degrees are
    *removed*: a diffuse surface hardly sees them (A_3 = 0, A_4 = −π/24), and with them gone the irradiance is the same,
    and non-negative, whether a renderer sums three bands, as most do, or all of them. For glossy surfaces use
    ``radiance``.

    ``radiance``: of all non-negative polynomials of the degree, the one with the largest h_1 (MATHS §4.1c): the squared
    Christoffel–Darboux kernel at the last node of the Gauss quadrature (of weight 1 + u for odd degrees, as Lukács'
    theorem asks).

Automatic window
    The weakest Laplacian window ``h_l = 1/(1 + λ l²(l+1)²)`` (Sloan 2017) under which the target is nowhere negative,
    in all channels at once so that hues stay. For ``irradiance`` that is asked of the sum over all bands and of the sum
    over the first three, because renderers use either.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Literal

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import MAX_BANDS, bands_of_count, degree_of_index
from lightwell.settings import WindowKind, WindowSettings
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.minimum import is_at_least
from lightwell.sh.shading import convolve

Target = Literal["radiance", "irradiance"]

MAX_STRENGTH = 1e9
"""Largest λ that the search considers: nothing but the mean is left."""

_NONNEG_SHIFT = 0.5031278668604173
"""a of the least-squares kernel (u + a)²; a root of the derivative, which the tests verify."""

_ROUNDING = 1e-12
"""How far below zero, relative to the mean coefficient, still counts as zero."""

_BISECTIONS = 20


def fixed_window(
    kind: WindowKind, bands: int, width: float | None = None, target: Target = "irradiance"
) -> NDArray[np.float64]:
    """Return the weights h_l of a fixed window, ``(bands,)`` float64, h_0 = 1.

    Parameters
    ----------
    kind
        ``none``; ``hann``: ``½(1 + cos(πl/w))``; ``lanczos``: ``sinc(l/w)``; ``nonneg``: the kernels above.
    bands
        1 … 11.
    width
        w of hann and lanczos: the degree at which they reach zero and stay there. Default ``bands``, so that the first
        missing degree is the first zero; inf switches the window off.
    target
        For ``nonneg``: what must not become negative.

    Raises
    ------
    ValueError
        Where the kind is no fixed window (``auto``), the width is not positive or the bands are out of range.
    """
    if not 1 <= bands <= MAX_BANDS:
        raise ValueError(f"{bands} bands are outside 1 … {MAX_BANDS}")
    width = float(bands) if width is None else width
    if not width > 0:
        raise ValueError(f"the window's width {width} must be positive")
    degree = np.arange(bands)
    inside = degree < width
    match kind:
        case "none":
            return np.ones(bands)
        case "hann":
            return np.where(inside, 0.5 * (1 + np.cos(np.pi * degree / width)), 0.0)
        case "lanczos":
            return np.where(inside, np.sinc(degree / width), 0.0)
        case "nonneg":
            return _nonneg_irradiance(bands) if target == "irradiance" else _nonneg_radiance(bands)
        case _:
            raise ValueError(f"{kind!r} is no fixed window; there are none, hann, lanczos and nonneg")


def apply_window(coefficients: ArrayLike, weights: ArrayLike) -> NDArray[np.float64]:
    """Return ``h_l c_lm``, the shape of ``coefficients``, ``(bands², ...)``, float64; ``weights`` is ``(bands,)``.

    Raises
    ------
    ValueError
        Where the two have not the same bands.
    """
    return convolve(coefficients, weights)


def laplacian_window(strength: float, bands: int) -> NDArray[np.float64]:
    """Return ``h_l = 1/(1 + λ l²(l+1)²)``, ``(bands,)``, of strength λ ≥ 0."""
    degree = np.arange(bands)
    return 1 / (1 + strength * (degree * (degree + 1.0)) ** 2)


def weakest_strength(coefficients: ArrayLike, target: Target = "irradiance", at_least: float = 0.0) -> float:
    """Return the least λ, not below ``at_least``, whose Laplacian window leaves the target nowhere negative.

    Found by bisection that keeps a feasible end, so the returned λ itself is feasible. Channels whose mean is not
    positive have nothing to protect and are left out. λ ends at `MAX_STRENGTH`.

    Parameters
    ----------
    coefficients
        ``(bands², C)``, for instance RGB.
    target
        What must not become negative.
    at_least
        Where to begin.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    feasible = _feasibility(array, target)
    if feasible(at_least):
        return at_least
    # λ/(1 + λ) covers all strengths in a bounded interval.
    low, high = _bounded(at_least), _bounded(MAX_STRENGTH)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        if feasible(_unbounded(middle)):
            high = middle
        else:
            low = middle
    return _unbounded(high)


class WindowStage:
    """Windows one frame after another; the automatic window is smoothed in time.

    A stronger window is applied at once, so that no frame shows negative light; a weaker one is approached with the
    time constant ``smoothing_seconds`` of the settings, so that the light does not pump. Because feasibility is not
    monotonic in λ, a strength on the way down is checked as well, and raised for the frame where it would not do.
    """

    def __init__(self, settings: WindowSettings, bands: int) -> None:
        self._settings = settings
        self._bands = bands
        self._fixed = (
            None if settings.kind == "auto" else fixed_window(settings.kind, bands, settings.width, settings.target)
        )
        self._relaxed: float | None = None
        self._time_ns = 0

    def update(self, coefficients: ArrayLike, time_ns: int) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the windowed coefficients, the weights and the strength.

        Parameters
        ----------
        coefficients
            ``(bands², 3)``.
        time_ns
            Capture time, nanoseconds since the Unix epoch; where it runs backwards the smoothing starts anew.

        Returns
        -------
        Coefficients ``(bands², 3)`` and weights ``(bands,)``, float64, and λ (0 for fixed windows).
        """
        if self._fixed is not None:
            return apply_window(coefficients, self._fixed), self._fixed.copy(), 0.0
        strength = self._smoothed_strength(np.asarray(coefficients, dtype=np.float64), time_ns)
        weights = laplacian_window(strength, self._bands)
        return apply_window(coefficients, weights), weights, strength

    def reset(self) -> None:
        """Forget the strength of earlier frames."""
        self._relaxed = None

    def _smoothed_strength(self, coefficients: NDArray[np.float64], time_ns: int) -> float:
        seconds = (time_ns - self._time_ns) * 1e-9
        previous, self._time_ns = self._relaxed, time_ns
        needed = weakest_strength(coefficients, self._settings.target)
        self._relaxed = needed
        if previous is None or previous <= needed or seconds < 0 or self._settings.smoothing_seconds == 0:
            return needed
        kept = np.exp(-seconds / self._settings.smoothing_seconds)
        relaxed = _bounded(needed) + kept * (_bounded(previous) - _bounded(needed))
        # Closer than this the window is as good as there, and "none needed" is worth reaching.
        if relaxed - _bounded(needed) < 2.0**-_BISECTIONS:
            return needed
        self._relaxed = _unbounded(relaxed)
        return weakest_strength(coefficients, self._settings.target, at_least=self._relaxed)


def _bounded(strength: float) -> float:
    return strength / (1 + strength)


def _unbounded(bounded: float) -> float:
    return bounded / (1 - bounded)


def _feasibility(coefficients: NDArray[np.float64], target: Target) -> Callable[[float], bool]:
    """Return a function that says whether a strength leaves every channel of the target nowhere negative."""
    bands = bands_of_count(coefficients.shape[0])
    scaled = coefficients
    counts = [bands * bands]
    if target == "irradiance":
        scaled = apply_window(coefficients, lambert_zonal(bands))
        # A_3 = 0: up to four bands, the first three are all there is.
        counts = [min(bands * bands, 9)] if bands <= 4 else [9, bands * bands]
    channels = np.ascontiguousarray(scaled[:, scaled[0] > 0].T)

    def feasible(strength: float) -> bool:
        weights = laplacian_window(strength, bands)[degree_of_index(bands)]
        return all(
            is_at_least(channel[:count] * weights[:count], -_ROUNDING * channel[0])
            for channel in channels
            for count in counts
        )

    return feasible


def _nonneg_irradiance(bands: int) -> NDArray[np.float64]:
    # The kernel of irradiance is ¼ + ½ h_1 u + (5/16) h_2 P_2(u) = s (u + a)², with s = ¼ / (a² + ⅓).
    mean = _NONNEG_SHIFT**2 + 1 / 3
    kernel = [1.0, 0.5] if bands <= 2 else [1.0, _NONNEG_SHIFT / mean, 8 / (15 * mean)]
    weights = np.zeros(bands)
    count = min(bands, len(kernel))
    weights[:count] = kernel[:count]
    return weights


@cache
def _nonneg_radiance(bands: int) -> NDArray[np.float64]:
    # 1. Nodes of the Gauss quadrature with weight 1 (even degree) or 1 + u (odd degree): eigenvalues of its Jacobi
    #    matrix. The kernel vanishes, twice, at all of them but the last.
    count = (bands - 1) // 2 + 1
    odd = bands % 2 == 0
    n = np.arange(count)
    diagonal = 1 / ((2 * n + 1) * (2 * n + 3)) if odd else np.zeros(count)
    n = n[1:]
    beside = np.sqrt(n * (n + 1)) / (2 * n + 1) if odd else n / np.sqrt(4 * n * n - 1)
    nodes = np.linalg.eigvalsh(np.diag(diagonal) + np.diag(beside, -1))

    # 2. Its moments with the Legendre polynomials, by a quadrature that is exact for them.
    u, quadrature = legendre.leggauss(bands + 1)
    kernel = np.prod(u[:, np.newaxis] - nodes[:-1], axis=1) ** 2 * (1 + u if odd else 1)
    moments = (quadrature * kernel) @ legendre.legvander(u, bands - 1)
    weights: NDArray[np.float64] = moments / moments[0]
    weights.setflags(write=False)
    return weights
