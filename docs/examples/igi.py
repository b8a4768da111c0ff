"""Paper 004's comparison of filters on a bump-mapped surface: python docs/examples/igi.py [FOLDER].

Writes igi-filters.jpg and prints the errors that docs/igi.md quotes: the rms difference to brute force (every pixel
looks at all 1,024 lights) over the bump-mapped pixels, relative to their mean. Two scenes: a ground and a ball lit by a
real map, and the same under two panels. Filters go over the picture once, as in the paper, and that of incident
radiance also twice, as is the default.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.shapes import plane, sphere
from lightwell.igi import IgiMaterial, IgiObject, IgiRendering, IgiScene, Sky, Texture, render_igi
from lightwell.igi_settings import IgiFilter, IgiSettings
from lightwell.io.meshes import load_meshes
from lightwell.io.pictures import read_picture
from lightwell.probe.samples import repair
from lightwell.render import Camera, expose_and_encode

SAMPLES = Path(__file__).parents[2] / "samples"
SIZE = (960, 720)
CAMERA = Camera((1.6, -4.6, 2.0), (0.1, 0.0, 0.5), fov_degrees=34)
PATTERNS = ((4, 4), (8, 8))
Variant = tuple[IgiFilter, int]
"""A filter, and how often it goes over the picture."""
SHOWN: dict[Variant, str] = {
    ("sh", 1): "incident radiance (SH)",
    ("irradiance", 1): "irradiance, loose",
    ("irradiance-strict", 1): "irradiance, strict",
    ("none", 1): "no filter",
}
VARIANTS = SHOWN | {("sh", 2): "SH, two passes"}
LIGHTS = 1024
CROP = slice(250, 442), slice(190, 446)


@dataclass(frozen=True)
class Compared:
    """Brute force and what the filters make of fewer lights a pixel."""

    truth: IgiRendering
    bumpy: NDArray[np.bool_]
    """(H, W): the pixels that are compared."""
    filtered: dict[tuple[tuple[int, int], Variant], IgiRendering]

    def error(self, pattern: tuple[int, int], variant: Variant) -> float:
        """Return the relative rms over the bumpy pixels."""
        difference = (self.filtered[pattern, variant].colour - self.truth.colour)[self.bumpy]
        return float(np.sqrt((difference.astype(np.float64) ** 2).mean()) / self.truth.colour[self.bumpy].mean())


def bumps() -> Texture:
    """Return heights of round bumps of several sizes, which repeat: a sum of waves."""
    v, u = np.meshgrid(*[2 * np.pi * np.arange(512) / 512] * 2, indexing="ij")
    random = np.random.default_rng(4)
    heights = np.zeros((512, 512))
    for _ in range(40):
        a, b = random.integers(-9, 10, 2)
        heights += np.sin(a * u + b * v + 2 * np.pi * random.random()) / (4 + np.hypot(a, b))
    return Texture((heights / np.abs(heights).max())[..., None].astype(np.float32))


def moved(mesh: Mesh, scale: float, at: tuple[float, float, float]) -> Mesh:
    """Return a mesh scaled and moved."""
    return make_mesh(mesh.name, scale * mesh.positions + np.array(at), mesh.triangles, mesh.normals)


def objects() -> tuple[IgiObject, ...]:
    """Return a bump-mapped ground and ball, and a bunny between them and the light."""
    texture = bumps()
    flat, ball = plane(1), sphere(96, 192)
    ground_uv = 3 * (flat.positions[:, :2] + 1)
    spot = ball.positions
    azimuth = np.arctan2(spot[:, 1], spot[:, 0])
    ball_uv = np.stack([azimuth / np.pi, np.arccos(np.clip(spot[:, 2], -1, 1)) / np.pi], axis=1)
    (bunny,) = load_meshes(SAMPLES / "meshes" / "bunny.glb")
    lower, upper = bunny.bounds
    size = 1.1 / float(upper[2] - lower[2])
    middle = (lower + upper) / 2
    place = (0.75 - size * float(middle[0]), 0.2 - size * float(middle[1]), -size * float(lower[2]))
    return (
        IgiObject(
            moved(flat, 3.0, (0, 0, 0)),
            IgiMaterial(base=(0.6, 0.55, 0.5), roughness=0.6, bump_texture=texture, bump_metres=0.09),
            (ground_uv.astype(np.float32),),
        ),
        IgiObject(
            moved(ball, 0.55, (-0.7, 0.1, 0.55)),
            IgiMaterial(base=(0.6, 0.35, 0.2), roughness=0.6, bump_texture=texture, bump_metres=0.05),
            (ball_uv.astype(np.float32),),
        ),
        IgiObject(moved(bunny, size, place), IgiMaterial(base=(0.5, 0.5, 0.5), specular=0)),
    )


def scenes() -> dict[str, IgiScene]:
    """Return the two scenes."""
    panorama = repair(read_picture(SAMPLES / "hdri" / "venice.exr").pixels, "clamp").astype(np.float32)
    corners = np.array([[-0.5, -0.4, 0], [0.5, -0.4, 0], [0.5, 0.4, 0], [-0.5, 0.4, 0]])
    panels = [
        IgiObject(
            make_mesh("panel", corners + at, [[0, 2, 1], [0, 3, 2]], [[0, 0, -1]] * 4),
            IgiMaterial(base=(0, 0, 0), specular=0, emission=colour),
        )
        for at, colour in (([-1.6, -0.6, 2.2], (14.0, 11.0, 7.0)), ([1.4, 0.9, 2.6], (5.0, 9.0, 14.0)))
    ]
    return {
        "a real map": IgiScene(objects(), sky=Sky(panorama)),
        "two panels": IgiScene((*objects(), *panels)),
    }


def compare(scene: IgiScene) -> Compared:
    """Render brute force and every filter; without bounces, so that all have the very same lights."""
    plain = IgiSettings(sets=(1, 1), filter="none", vpls=LIGHTS, bounces=0, layers=("albedo",))
    truth = render_igi(scene, CAMERA, SIZE, plain)
    assert truth.albedo is not None
    grey = np.ptp(truth.albedo, axis=-1) < 1e-3
    bumpy = (truth.coverage > 0) & ~grey & (truth.colour.max(axis=-1) < 5)
    filtered = {
        (pattern, (name, passes)): render_igi(
            scene, CAMERA, SIZE, plain.model_copy(update={"sets": pattern, "filter": name, "passes": passes})
        )
        for pattern in PATTERNS
        for name, passes in VARIANTS
    }
    return Compared(truth, bumpy, filtered)


def picture(found: Compared, file: Path) -> None:
    """Write what the filters make of a part of the picture."""
    figure = Figure(figsize=(15, 5.2), dpi=80)
    axes = figure.subplots(len(PATTERNS), 1 + len(SHOWN))
    for row, pattern in zip(axes, PATTERNS, strict=True):
        shown = [("brute force", found.truth)]
        shown += [
            (f"{label}: {found.error(pattern, variant):.1%}", found.filtered[pattern, variant])
            for variant, label in SHOWN.items()
        ]
        for axis, (title, rendering) in zip(row, shown, strict=True):
            axis.imshow(expose_and_encode(rendering.colour[CROP], 0.3), interpolation="nearest")
            axis.set_title(title, fontsize=9)
            axis.set_xticks([])
            axis.set_yticks([])
        row[0].set_ylabel(f"{pattern[0]} × {pattern[1]}")
    figure.tight_layout()
    figure.savefig(file, pil_kwargs={"quality": 90})


def main() -> None:
    """Print the errors and write the picture."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    for name, scene in scenes().items():
        found = compare(scene)
        print(f"{name}, relative rms over {found.bumpy.sum()} bump-mapped pixels")
        for pattern in PATTERNS:
            errors = {variant: found.error(pattern, variant) for variant in VARIANTS}
            figures = " · ".join(f"{VARIANTS[variant]} {error:.2%}" for variant, error in errors.items())
            ratios = [errors["sh", 1] / errors[other, 1] for other in ("irradiance", "irradiance-strict")]
            print(f"  {pattern[0]} × {pattern[1]}: {figures} · SH over loose {ratios[0]:.2f}, strict {ratios[1]:.2f}")
        if name == "a real map":
            picture(found, folder / "igi-filters.jpg")


if __name__ == "__main__":
    main()
