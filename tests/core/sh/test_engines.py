"""Coefficient conventions against the published vectors and against each engine's own formulas."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from tests.support import reference_sh as reference
from tests.vectors import make_vectors

from lightwell.conventions import CONVENTIONS, Convention
from lightwell.sh.basis import evaluate
from lightwell.sh.engines import convert, convert_directions, engine_from_world
from lightwell.sh.rotation import rotate

FOLDER = Path(make_vectors.__file__).parent
ENGINES: list[Convention] = [convention for convention in CONVENTIONS if convention != "lightwell"]


def vectors(convention: str) -> list[dict[str, Any]]:
    loaded: list[dict[str, Any]] = json.loads((FOLDER / f"{convention}.json").read_text(encoding="utf-8"))
    return loaded


def three_radiance(sh: np.ndarray, n: Any) -> Any:
    """SphericalHarmonics3.getAt."""
    x, y, z = n
    return (
        sh[0] * 0.282095
        + sh[1] * 0.488603 * y
        + sh[2] * 0.488603 * z
        + sh[3] * 0.488603 * x
        + sh[4] * 1.092548 * (x * y)
        + sh[5] * 1.092548 * (y * z)
        + sh[6] * 0.315392 * (3 * z * z - 1)
        + sh[7] * 1.092548 * (x * z)
        + sh[8] * 0.546274 * (x * x - y * y)
    )


def three_irradiance(sh: np.ndarray, n: Any) -> Any:
    """SphericalHarmonics3.getIrradianceAt."""
    x, y, z = n
    return (
        sh[0] * 0.886227
        + sh[1] * 2 * 0.511664 * y
        + sh[2] * 2 * 0.511664 * z
        + sh[3] * 2 * 0.511664 * x
        + sh[4] * 2 * 0.429043 * x * y
        + sh[5] * 2 * 0.429043 * y * z
        + sh[6] * (0.743125 * z * z - 0.247708)
        + sh[7] * 2 * 0.429043 * x * z
        + sh[8] * 0.429043 * (x * x - y * y)
    )


def filament_irradiance(sh: np.ndarray, n: Any) -> Any:
    """Builder::radiance scales by the table of IndirectLight.h; the shader then sums plain polynomials."""
    x, y, z = n
    table = [0.282095, -0.325735, 0.325735, -0.325735, 0.273137, -0.273137, 0.078848, -0.273137, 0.136569]
    polynomials = [1, y, z, x, y * x, y * z, 3 * z * z - 1, z * x, x * x - y * y]
    return np.pi * sum(s * t * p for s, t, p in zip(sh, table, polynomials, strict=False))


def unity_irradiance(sh: np.ndarray, n: Any) -> Any:
    """UnityCG.cginc: ShadeSH9 of unity_SHAr … unity_SHC as packed from SphericalHarmonicsL2; it reads E/π."""
    x, y, z = n
    linear = sh[3] * x + sh[1] * y + sh[2] * z + (sh[0] - sh[6])
    quadratic = sh[4] * (x * y) + sh[5] * (y * z) + 3 * sh[6] * (z * z) + sh[7] * (z * x)
    return np.pi * (linear + quadratic + sh[8] * (x * x - y * y))


def unreal_basis(n: Any) -> np.ndarray:
    """TSHVector<3>::SHBasisFunction."""
    x, y, z = n
    return np.array(
        [
            0.282095,
            -0.488603 * y,
            0.488603 * z,
            -0.488603 * x,
            1.092548 * x * y,
            -1.092548 * y * z,
            0.315392 * (3 * z * z - 1),
            -1.092548 * x * z,
            0.546274 * (x * x - y * y),
        ]
    )


def unreal_irradiance(sh: np.ndarray, n: Any) -> Any:
    """Dot with CalcDiffuseTransfer."""
    transfer = unreal_basis(n) * np.repeat([np.pi, 2 * np.pi / 3, np.pi / 4], [1, 3, 5])
    return transfer @ sh


def unreal_radiance(sh: np.ndarray, n: Any) -> Any:
    """Dot with the basis."""
    return unreal_basis(n) @ sh


# DirectXMath has the basis of Unreal in Lightwell's axes; Filament and Unity keep no radiance.
IRRADIANCE: dict[Convention, Callable[[np.ndarray, Any], Any]] = {
    "three": three_irradiance,
    "filament": filament_irradiance,
    "unity": unity_irradiance,
    "unreal": unreal_irradiance,
    "sloan": unreal_irradiance,
}
RADIANCE: dict[Convention, Callable[[np.ndarray, Any], Any]] = {
    "three": three_radiance,
    "unreal": unreal_radiance,
    "sloan": unreal_radiance,
}
SIX_DIGITS = 2e-5
"""What the engines' constants of six digits leave."""


@pytest.mark.parametrize("convention", ENGINES)
def test_vectors_are_fresh(convention: Convention) -> None:
    assert (FOLDER / f"{convention}.json").read_text(encoding="utf-8") == make_vectors.text(convention)


@pytest.mark.parametrize("convention", ENGINES)
def test_agrees_with_the_vectors(convention: Convention) -> None:
    for vector in vectors(convention):
        output = convert(vector["input"], convention)
        np.testing.assert_allclose(output, vector["output"], rtol=0, atol=2e-14, err_msg=vector["name"])
        back = convert(vector["output"], "lightwell", convention)
        np.testing.assert_allclose(back, vector["input"], rtol=0, atol=5e-14, err_msg=vector["name"])
        np.testing.assert_array_equal(engine_from_world(convention), vector["engine_from_world"])
        for evaluation in vector["evaluations"]:
            np.testing.assert_array_equal(convert_directions(evaluation["world"], convention), evaluation["engine"])


@pytest.mark.parametrize(
    ("convention", "quantity", "formula"),
    [(convention, "irradiance", formula) for convention, formula in IRRADIANCE.items()]
    + [(convention, "radiance", formula) for convention, formula in RADIANCE.items()],
)
def test_the_engines_own_formulas_find_the_light(
    convention: Convention, quantity: str, formula: Callable[[np.ndarray, Any], Any]
) -> None:
    nine = [vector for vector in vectors(convention) if vector["bands"] == 3]
    assert len(nine) == 9
    for vector in nine:
        for evaluation in vector["evaluations"]:
            value = formula(np.array(vector["output"]), evaluation["engine"])
            np.testing.assert_allclose(value, evaluation[quantity], rtol=0, atol=SIX_DIGITS, err_msg=vector["name"])


@pytest.mark.parametrize("convention", CONVENTIONS)
def test_the_sun_overhead_is_up_in_every_engine(convention: Convention) -> None:
    up = {"three": 1, "filament": 1, "unity": 1, "unreal": 2, "sloan": 2, "lightwell": 2}
    np.testing.assert_array_equal(convert_directions([0, 0, 1], convention), np.eye(3)[up[convention]])


def test_sloan_has_the_constants_of_directxmath() -> None:
    # Degrees 3 to 5 of SHMath/DirectXSH.cpp, sh_eval_basis_5.
    x, y, z = reference.directions(1)[0]
    s2, c2 = 2 * x * y, x * x - y * y
    s3, c3 = x * s2 + y * c2, x * c2 - y * s2
    s4, c4 = x * s3 + y * c3, x * c3 - y * s3
    s5, c5 = x * s4 + y * c4, x * c4 - y * s4
    p52, p53 = (
        z * (7.190305177459987500 * z * z - 2.396768392486662100),
        -4.403144694917253700 * z * z + 0.489238299435250430,
    )
    theirs = {
        9: -0.590043589926643520 * s3,
        15: -0.590043589926643520 * c3,
        17: -1.770130769779930200 * z * s3,
        23: -1.770130769779930200 * z * c3,
        16: 0.625835735449176030 * s4,
        24: 0.625835735449176030 * c4,
        28: p52 * s2,
        32: p52 * c2,
        27: p53 * s3,
        33: p53 * c3,
        26: 2.075662314881041100 * z * s4,
        34: 2.075662314881041100 * z * c4,
        25: -0.656382056840170150 * s5,
        35: -0.656382056840170150 * c5,
    }
    ours = convert(evaluate([x, y, z], 6), "sloan")
    np.testing.assert_allclose(ours[list(theirs)], list(theirs.values()), rtol=0, atol=1e-14)


def test_handedness() -> None:
    handedness = {name: round(np.linalg.det(engine_from_world(name))) for name in CONVENTIONS}
    assert handedness == {"lightwell": 1, "three": 1, "filament": 1, "unity": -1, "unreal": -1, "sloan": 1}


def test_constant_light_of_one_reads_one_in_unity() -> None:
    coefficients = np.zeros((9, 3))
    coefficients[0] = np.sqrt(4 * np.pi)
    np.testing.assert_allclose(convert(coefficients, "unity")[0], 1, rtol=1e-15)


@given(
    seed=st.integers(0, 2**32 - 1),
    bands=st.integers(1, 8),
    first=st.sampled_from(CONVENTIONS),
    second=st.sampled_from(CONVENTIONS),
)
@settings(max_examples=60, deadline=None)
def test_any_path_is_reversible(seed: int, bands: int, first: Convention, second: Convention) -> None:
    coefficients = np.random.default_rng(seed).normal(size=(bands**2, 3))
    there = convert(coefficients, second, first)
    np.testing.assert_allclose(convert(there, first, second), coefficients, rtol=0, atol=1e-13)
    through = convert(convert(coefficients, "lightwell", first), second, "lightwell")
    np.testing.assert_allclose(there, through, rtol=0, atol=1e-13)


@given(seed=st.integers(0, 2**32 - 1), convention=st.sampled_from(["three", "filament", "unreal", "sloan"]))
@settings(max_examples=20, deadline=None)
def test_turning_the_light_commutes_with_conversion(seed: int, convention: Convention) -> None:
    coefficients = np.random.default_rng(seed).normal(size=(25, 3))
    turn = reference.rotation(seed)
    # In the engine's axes the same turn is axes · R · axesᵀ, proper even where the axes are not.
    axes = engine_from_world(convention)
    sign: Convention = "lightwell" if convention == "three" else "sloan"
    in_engine = convert(convert(coefficients, convention), "lightwell", sign)
    expected = convert(rotate(in_engine, axes @ turn @ axes.T), sign)
    np.testing.assert_allclose(convert(rotate(coefficients, turn), convention), expected, rtol=0, atol=1e-13)


def test_all_bands_are_kept() -> None:
    coefficients = np.random.default_rng(0).normal(size=(64, 3))
    for convention in CONVENTIONS:
        assert convert(coefficients, convention).shape == (64, 3)
        np.testing.assert_allclose(
            convert(coefficients, convention)[:9], convert(coefficients[:9], convention), rtol=0, atol=1e-15
        )


def test_single_channel_and_result_is_the_callers() -> None:
    coefficients = np.arange(9.0)
    converted = convert(coefficients, "three")
    assert converted.shape == (9,)
    converted[:] = 0
    assert convert(coefficients, "three").any()


@pytest.mark.parametrize(("to", "source"), [("godot", "lightwell"), ("three", "maya")])
def test_unknown_conventions_are_named(to: Convention, source: Convention) -> None:
    with pytest.raises(ValueError, match=r"(godot|maya).*there are lightwell, three"):
        convert(np.zeros((9, 3)), to, source)
