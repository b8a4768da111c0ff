"""Coefficients in the conventions of other software.

`convert` goes from any convention to any other and back without loss, for any number of bands.

============  ===========================  ==========  =========================================  ==================
convention    engine axes from world axes  sign        what a coefficient is                      feed it to
============  ===========================  ==========  =========================================  ==================
lightwell     (x, y, z), right-handed,     none        radiance, orthonormal                      –
              z up
three         (x, z, −y), right-handed,    none        radiance, orthonormal                      ``LightProbe.sh``
              y up                                                                                [1]_
filament      (x, z, −y), right-handed,    (−1)^m      radiance, orthonormal                      ``IndirectLight::
              y up                                                                                Builder::radiance``
                                                                                                  [2]_
unity         (x, z, y), left-handed,      none        degrees 0–2: irradiance/π, times the       ``SphericalHarmonics
              y up                                     constant of the basis polynomial (below);  L2[channel, i]``
                                                       higher degrees: radiance, orthonormal      [3]_
unreal        (x, −y, z), left-handed,     (−1)^m      radiance, orthonormal                      ``FSHVectorRGB3``
              z up                                                                                [4]_
sloan         (x, y, z), right-handed,     (−1)^m      radiance, orthonormal                      ``XMSHEvalDirection``
              z up                                                                                and kin [5]_
============  ===========================  ==========  =========================================  ==================

In every convention coefficient (l, m) has the index l² + l + m; the polar axis of the basis is the *engine's* z axis
(also where the engine's up is y: no engine here swizzles its basis); and the value of the light at a world direction ω
is found by evaluating the engine's basis at ``engine_from_world @ ω``.

Axes
    y-up engines: world +Z is engine +y. For the right-handed ones that is a turn of −90° about x, as in a glTF export
    from a z-up program. Unity and Unreal are left-handed, so the change of axes is a reflection: a rotation times the
    parity ``(−1)^l``. Unity gets y and z swapped (world +Y is Unity's forward); its glTF importers negate x instead,
    and a scene that came that way is turned by half about up: turn the light with it, by 180° about world +Z, before
    converting. Unreal gets y negated; its centimetres do not matter for distant light.
Layout
    Coefficient-major, ``(bands², 3)``. Engines that keep one vector a channel (Unity, Unreal, DirectXMath) take a
    column each.
Sign
    ``(−1)^m`` is the Condon–Shortley phase: only odd m change sign, which looks like a half turn about the polar axis
    when it is forgotten.
Unity's scale
    ``SphericalHarmonicsL2`` stores irradiance over π (constant light of radiance 1 reads 1), times the constant of the
    polynomials 1, y, z, x, xy, yz, 3z²−1, xz, x²−y². So ``stored = A_l/π · K_lm · c_lm`` with K = 0.282095, 0.488603,
    1.092548, 0.315392, 0.546274. Unity has no degree above 2, where half of the A_l would be zero; those keep their
    radiance so that the conversion can be undone.
Filament's two forms
    ``Builder::radiance`` takes this convention and derives what its shader needs. ``Builder::irradiance`` takes the
    shader's own, pre-scaled form; do not feed it these.
Bands
    three, Filament, Unity and Unreal use the first nine coefficients (three bands) and ignore the rest.

.. [1] three.js, ``src/math/SphericalHarmonics3.js`` (basis table, radiance; ``getIrradianceAt`` applies A_l).
.. [2] Filament, ``filament/include/filament/IndirectLight.h`` and ``filament/src/details/IndirectLight.cpp`` (signs of
   the reconstruction factors), ``libs/ibl/src/CubemapSH.cpp`` (``computeShBasis`` includes the phase).
.. [3] Unity Manual, "Light Probes: technical information" (order, basis); ``unity_SHAr`` … ``unity_SHC`` in
   ``UnityCG.cginc`` (polynomials); the factor K/π as in pema99/SHTools, ``SHTools.cs``.
.. [4] Unreal Engine, ``Core/Public/Math/SHMath.h`` (``TSHVector<3>::SHBasisFunction``, ``CalcDiffuseTransfer``).
.. [5] Sloan 2008, "Stupid Spherical Harmonics (SH) Tricks"; Microsoft DirectXMath, ``SHMath/DirectXSH.cpp``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import CONVENTIONS, Convention, bands_of_count, degree_of_index, order_of_index
from lightwell.sh.lobes import lambert_zonal
from lightwell.sh.rotation import rotation_matrix


@dataclass(frozen=True)
class _Engine:
    """How one engine's coefficients differ from Lightwell's."""

    engine_from_world: tuple[tuple[int, int, int], tuple[int, int, int], tuple[int, int, int]]
    condon_shortley: bool = False
    premultiplied_irradiance: bool = False


_Z_UP = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
_Y_UP = ((1, 0, 0), (0, 0, 1), (0, -1, 0))

_ENGINES: dict[Convention, _Engine] = {
    "lightwell": _Engine(_Z_UP),
    "three": _Engine(_Y_UP),
    "filament": _Engine(_Y_UP, condon_shortley=True),
    "unity": _Engine(((1, 0, 0), (0, 0, 1), (0, 1, 0)), premultiplied_irradiance=True),
    "unreal": _Engine(((1, 0, 0), (0, -1, 0), (0, 0, 1)), condon_shortley=True),
    "sloan": _Engine(_Z_UP, condon_shortley=True),
}

# Constants of the basis polynomials 1, y, z, x, xy, yz, 3z²−1, xz, x²−y².
_POLYNOMIAL_CONSTANTS = np.sqrt(np.array([1, 3, 3, 3, 15, 15, 5 / 4, 15, 15 / 4]) / (4 * np.pi))


def engine_from_world(convention: Convention) -> NDArray[np.float64]:
    """Return the matrix that takes world directions to the convention's axes, ``(3, 3)``: a signed permutation.

    Its determinant is −1 for the left-handed engines. It also converts what else has a direction, such as a frame's
    dominant light (`convert_directions`).

    Raises
    ------
    ValueError
        Where the convention is unknown; the message lists those that exist.
    """
    return np.array(_engine(convention).engine_from_world, dtype=np.float64)


def convert_directions(directions: ArrayLike, to: Convention, source: Convention = "lightwell") -> NDArray[np.float64]:
    """Return directions ``(..., 3)`` in the axes of another convention."""
    to_from_source = engine_from_world(to) @ engine_from_world(source).T
    converted: NDArray[np.float64] = np.asarray(directions, dtype=np.float64) @ to_from_source.T
    return converted


def convert(coefficients: ArrayLike, to: Convention, source: Convention = "lightwell") -> NDArray[np.float64]:
    """Return coefficients in another convention.

    Parameters
    ----------
    coefficients
        ``(bands², ...)`` in the convention ``source``, for instance ``(bands², 3)`` for RGB.
    to, source
        Names of `lightwell.conventions.CONVENTIONS`.

    Returns
    -------
    The same shape, float64. Converting back returns the input to rounding.

    Raises
    ------
    ValueError
        Where a convention is unknown or the number of coefficients is no square.
    """
    array = np.asarray(coefficients, dtype=np.float64)
    matrix = _conversion(to, source, bands_of_count(array.shape[0]))
    converted: NDArray[np.float64] = np.tensordot(matrix, array, axes=1)
    return converted


def convert_gradients(gradients: ArrayLike, to: Convention, source: Convention = "lightwell") -> NDArray[np.float64]:
    """Return derivatives ``(bands², ..., 3)`` along the axes of ``source`` in another convention, along its axes.

    Lengths stay metres in all conventions. Raises as `convert`.
    """
    return convert_directions(convert(gradients, to, source), to, source)


def _engine(convention: Convention) -> _Engine:
    try:
        return _ENGINES[convention]
    except KeyError:
        raise ValueError(f"unknown convention {convention!r}; there are {', '.join(CONVENTIONS)}") from None


@cache
def _conversion(to: Convention, source: Convention, bands: int) -> NDArray[np.float64]:
    """Return the matrix from ``source`` to ``to``, ``(bands², bands²)``."""
    target, origin = _engine(to), _engine(source)
    axes = engine_from_world(to) @ engine_from_world(source).T
    scale = _scale(target, bands)[:, np.newaxis] / _scale(origin, bands)[np.newaxis, :]
    matrix = scale * _axis_change(axes, bands)
    matrix.setflags(write=False)
    return matrix


def _axis_change(axes: NDArray[np.float64], bands: int) -> NDArray[np.float64]:
    """Return the matrix of a proper or improper change of axes: a reflection is −1 times a rotation."""
    if np.linalg.det(axes) > 0:
        return rotation_matrix(axes, bands)
    parity = (-1.0) ** degree_of_index(bands)
    return parity[:, np.newaxis] * rotation_matrix(-axes, bands)


def _scale(engine: _Engine, bands: int) -> NDArray[np.float64]:
    """Return the factor of each coefficient, ``(bands²,)``: sign and scale, once the axes are the engine's."""
    scale = np.ones(bands * bands)
    if engine.condon_shortley:
        scale *= (-1.0) ** np.abs(order_of_index(bands))
    if engine.premultiplied_irradiance:
        count = min(len(scale), 9)
        stored = lambert_zonal(3)[degree_of_index(3)] / np.pi * _POLYNOMIAL_CONSTANTS
        scale[:count] *= stored[:count]
    return scale
