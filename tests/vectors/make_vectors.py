"""Write the conformance vectors of the coefficient conventions: one JSON file a convention, beside this script.

    python tests/vectors/make_vectors.py            write the files
    python tests/vectors/make_vectors.py --check    exit with 1 where a file is not what would be written

Each file is a list of

    {"name", "convention", "bands",
     "engine_from_world": 3 × 3, takes world directions (right-handed, z up) to the engine's axes,
     "input":  [[r, g, b], …]   coefficients in Lightwell's convention,
     "output": [[r, g, b], …]   the same light in the engine's convention,
     "evaluations": [{"world": [x, y, z], "engine": [x, y, z],
                      "radiance": [r, g, b], "irradiance": [r, g, b]}, …]}

``radiance`` is the sum over all bands at the direction, ``irradiance`` the sum over at most three bands, on a surface
with that normal; an engine that evaluates ``output`` at ``engine`` by its own formulas must find them.

``gradients.json`` has vectors of all conventions for the change of the light with place,

    {"convention", "bands", "engine_from_world",
     "position": [x, y, z], "engine_position": [x, y, z]   of the probe, metres, in world and engine axes,
     "input":  [[[d/dx, d/dy, d/dz] for r, g, b], …]        per metre, Lightwell's convention and world axes,
     "output": the same in the engine's convention and along the engine's axes}

Nothing here uses Lightwell: the lights are projected in each engine's own axes with the engine's own basis, written out
as polynomials. Only the standard library, correctly rounded square roots and exact sums are used, so that the files are
the same on every machine.
"""

from __future__ import annotations

import json
import random
import sys
from collections.abc import Callable
from math import fsum, pi, sqrt
from pathlib import Path
from typing import Any

Vector = tuple[float, float, float]
Light = tuple[Vector, Vector]
"""Direction towards a directional light, world axes, and its RGB irradiance."""

DEGREES = [degree for degree in range(5) for _ in range(2 * degree + 1)]
ORDERS = [order for degree in range(5) for order in range(-degree, degree + 1)]


def basis(x: float, y: float, z: float) -> list[float]:
    """Return the 25 real orthonormal harmonics of degrees 0 … 4 without Condon–Shortley phase."""
    return [
        sqrt(1 / pi) / 2,
        sqrt(3 / pi) / 2 * y,
        sqrt(3 / pi) / 2 * z,
        sqrt(3 / pi) / 2 * x,
        sqrt(15 / pi) / 2 * x * y,
        sqrt(15 / pi) / 2 * y * z,
        sqrt(5 / pi) / 4 * (3 * z * z - 1),
        sqrt(15 / pi) / 2 * x * z,
        sqrt(15 / pi) / 4 * (x * x - y * y),
        sqrt(35 / (2 * pi)) / 4 * y * (3 * x * x - y * y),
        sqrt(105 / pi) / 2 * x * y * z,
        sqrt(21 / (2 * pi)) / 4 * y * (5 * z * z - 1),
        sqrt(7 / pi) / 4 * z * (5 * z * z - 3),
        sqrt(21 / (2 * pi)) / 4 * x * (5 * z * z - 1),
        sqrt(105 / pi) / 4 * z * (x * x - y * y),
        sqrt(35 / (2 * pi)) / 4 * x * (x * x - 3 * y * y),
        sqrt(35 / pi) * 3 / 4 * x * y * (x * x - y * y),
        sqrt(35 / (2 * pi)) * 3 / 4 * y * z * (3 * x * x - y * y),
        sqrt(5 / pi) * 3 / 4 * x * y * (7 * z * z - 1),
        sqrt(5 / (2 * pi)) * 3 / 4 * y * z * (7 * z * z - 3),
        sqrt(1 / pi) * 3 / 16 * (35 * z**4 - 30 * z * z + 3),
        sqrt(5 / (2 * pi)) * 3 / 4 * x * z * (7 * z * z - 3),
        sqrt(5 / pi) * 3 / 8 * (x * x - y * y) * (7 * z * z - 1),
        sqrt(35 / (2 * pi)) * 3 / 4 * x * z * (x * x - 3 * y * y),
        sqrt(35 / pi) * 3 / 16 * (x * x * (x * x - 3 * y * y) - y * y * (3 * x * x - y * y)),
    ]


def basis_condon_shortley(x: float, y: float, z: float) -> list[float]:
    """Return the basis of Sloan, Filament's ``radiance`` and Unreal: odd orders have the other sign."""
    return [-value if order % 2 else value for value, order in zip(basis(x, y, z), ORDERS, strict=True)]


def basis_unity(x: float, y: float, z: float) -> list[float]:
    """Return what a directional light of irradiance 1 adds to ``SphericalHarmonicsL2``, and beyond degree 2 the basis.

    The light reads, at a normal n, ``Σ A_l K² p(d) p(n) / π`` with the polynomials p = 1, y, z, x, xy, yz, 3z²−1, xz,
    x²−y²; what is stored is the factor of p(n).
    """
    stored = [
        1 / (4 * pi),
        y / (2 * pi),
        z / (2 * pi),
        x / (2 * pi),
        15 / (16 * pi) * x * y,
        15 / (16 * pi) * y * z,
        5 / (64 * pi) * (3 * z * z - 1),
        15 / (16 * pi) * x * z,
        15 / (64 * pi) * (x * x - y * y),
    ]
    return stored + basis(x, y, z)[9:]


ENGINES: dict[str, tuple[tuple[Vector, Vector, Vector], Callable[[float, float, float], list[float]]]] = {
    # three.js: right-handed, y up; its basis has no Condon–Shortley phase.
    "three": (((1, 0, 0), (0, 0, 1), (0, -1, 0)), basis),
    # Filament: right-handed, y up.
    "filament": (((1, 0, 0), (0, 0, 1), (0, -1, 0)), basis_condon_shortley),
    # Unity: left-handed, y up.
    "unity": (((1, 0, 0), (0, 0, 1), (0, 1, 0)), basis_unity),
    # Unreal: left-handed, z up.
    "unreal": (((1, 0, 0), (0, -1, 0), (0, 0, 1)), basis_condon_shortley),
    # Sloan: Lightwell's axes.
    "sloan": (((1, 0, 0), (0, 1, 0), (0, 0, 1)), basis_condon_shortley),
}

EVALUATED_AT: list[Vector] = [
    (1, 0, 0),
    (0, -1, 0),
    (0, 0, 1),
    (0.6, 0.0, 0.8),
    (2 / 3, -2 / 3, 1 / 3),
    (-3 / 13, 4 / 13, -12 / 13),
]


def lights() -> dict[str, list[Light]]:
    """Return the named lights. A constant light is a sum of lights that no polynomial of degree ≤ 4 tells from it."""
    white = (1.0, 1.0, 1.0)
    axes = {"+x": (1, 0, 0), "-x": (-1, 0, 0), "+y": (0, 1, 0), "-y": (0, -1, 0), "+z": (0, 0, 1), "-z": (0, 0, -1)}
    named: dict[str, list[Light]] = {f"light from {name}": [(axis, white)] for name, axis in axes.items()}
    named["coloured light from an oblique direction"] = [((2 / 7, -3 / 7, 6 / 7), (3.0, 1.5, 0.25))]
    named["constant"] = [(direction, (w, 2 * w, 3 * w)) for direction, w in icosahedron()]
    generator = random.Random(2)
    named["random"] = [
        (unit(generator), (generator.uniform(-1, 1), generator.uniform(-1, 1), generator.uniform(-1, 1)))
        for _ in range(40)
    ]
    return named


def icosahedron() -> list[tuple[Vector, float]]:
    """Return the 12 vertices, each with the weight 4π/12: a spherical 5-design."""
    golden = (1 + sqrt(5)) / 2
    short, long = 1 / sqrt(1 + golden * golden), golden / sqrt(1 + golden * golden)
    vertices: list[Vector] = []
    for a in (-short, short):
        for b in (-long, long):
            vertices += [(0, a, b), (a, b, 0), (b, 0, a)]
    return [(vertex, 4 * pi / 12) for vertex in vertices]


def unit(generator: random.Random) -> Vector:
    """Return a random direction."""
    while True:
        x, y, z = (generator.uniform(-1, 1) for _ in range(3))
        length = sqrt(fsum([x * x, y * y, z * z]))
        if 0.1 < length < 1:
            return x / length, y / length, z / length


def project(
    sources: list[Light], count: int, axes: tuple[Vector, Vector, Vector], functions: Callable[..., list[float]]
) -> list[list[float]]:
    """Return the coefficients of directional lights: ``Σ irradiance · Y(axes · direction)``."""
    values = [functions(*turn(axes, direction)) for direction, _ in sources]
    return [
        [fsum(colour[c] * value[i] for (_, colour), value in zip(sources, values, strict=True)) for c in range(3)]
        for i in range(count)
    ]


def turn(axes: tuple[Vector, Vector, Vector], v: Vector) -> list[float]:
    """Return the matrix times the vector."""
    return [fsum([row[0] * v[0], row[1] * v[1], row[2] * v[2]]) for row in axes]


def evaluate(coefficients: list[list[float]], direction: Vector) -> dict[str, list[float]]:
    """Return radiance and irradiance of Lightwell's coefficients at a world direction."""
    values = basis(*direction)
    cosine = [pi, 2 * pi / 3, pi / 4]
    first = min(len(coefficients), 9)
    return {
        "radiance": [fsum(row[c] * value for row, value in zip(coefficients, values, strict=False)) for c in range(3)],
        "irradiance": [
            fsum(cosine[DEGREES[i]] * coefficients[i][c] * values[i] for i in range(first)) for c in range(3)
        ],
    }


def vectors(convention: str) -> list[dict[str, Any]]:
    """Return the vectors of one convention."""
    engine_axes, engine_basis = ENGINES[convention]
    world_axes: tuple[Vector, Vector, Vector] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    result = []
    for bands in (1, 2, 3, 5):
        for name, sources in lights().items():
            given = project(sources, bands * bands, world_axes, basis)
            result.append(
                {
                    "name": name,
                    "convention": convention,
                    "bands": bands,
                    "engine_from_world": engine_axes,
                    "input": given,
                    "output": project(sources, bands * bands, engine_axes, engine_basis),
                    "evaluations": [
                        {"world": world, "engine": turn(engine_axes, world), **evaluate(given, world)}
                        for world in EVALUATED_AT
                    ],
                }
            )
    return result


def gradient_vectors() -> list[dict[str, Any]]:
    """Return the vectors of a light that changes linearly along each world axis by the light of some lamps a metre."""
    generator = random.Random(7)
    changes = [
        [(unit(generator), (generator.uniform(-1, 1), generator.uniform(-1, 1), generator.uniform(-1, 1)))] * 2
        for _ in range(3)
    ]
    position: Vector = (1.25, -0.5, 2.0)
    world_axes: tuple[Vector, Vector, Vector] = ((1, 0, 0), (0, 1, 0), (0, 0, 1))
    result = []
    for convention, (engine_axes, engine_basis) in ENGINES.items():
        for bands in (2, 3, 5):
            count = bands * bands
            along_world = [project(lamps, count, world_axes, basis) for lamps in changes]
            in_engine = [project(lamps, count, engine_axes, engine_basis) for lamps in changes]
            # The light at world p is Σ_k p_k change_k, and p = Aᵀ p': so ∂/∂p'_j = Σ_k A_jk change_k.
            result.append(
                {
                    "convention": convention,
                    "bands": bands,
                    "engine_from_world": engine_axes,
                    "position": position,
                    "engine_position": turn(engine_axes, position),
                    "input": [[[along_world[k][i][c] for k in range(3)] for c in range(3)] for i in range(count)],
                    "output": [
                        [[fsum(row[k] * in_engine[k][i][c] for k in range(3)) for row in engine_axes] for c in range(3)]
                        for i in range(count)
                    ],
                }
            )
    return result


def text(name: str) -> str:
    """Return the file of one convention, or that of the gradients: one vector a line."""
    made = gradient_vectors() if name == "gradients" else vectors(name)
    return "[\n" + ",\n".join(json.dumps(vector) for vector in made) + "\n]\n"


def main() -> int:
    """Write or check the files."""
    folder = Path(__file__).parent
    stale = [name for name in (*ENGINES, "gradients") if not _is_fresh(folder / f"{name}.json", text(name))]
    if "--check" in sys.argv[1:]:
        for name in stale:
            sys.stderr.write(f"{name}.json is stale; run {Path(__file__).name}\n")
        return int(bool(stale))
    for name in stale:
        (folder / f"{name}.json").write_text(text(name), encoding="utf-8")
    return 0


def _is_fresh(path: Path, content: str) -> bool:
    return path.is_file() and path.read_text(encoding="utf-8") == content


if __name__ == "__main__":
    sys.exit(main())
