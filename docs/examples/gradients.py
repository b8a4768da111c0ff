"""Paper 001's two experiments with this system: python docs/examples/gradients.py [FOLDER].

Writes gradients-moved.jpg and gradients-samples.jpg and prints the errors of irradiance that docs/gradients.md quotes.
Samples are what a probe sees: a lat-long picture of the emitters, and their distances by ray casting.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.geometry.shapes import sphere
from lightwell.gradients.image import GradientPlan
from lightwell.gradients.interpolate import SampleSet
from lightwell.gradients.panorama import GradientPanorama
from lightwell.gradients.proxy import MeshProxy
from lightwell.io.meshes import load_meshes
from lightwell.probe.latlong import LatLong
from lightwell.probe.projection import projector
from lightwell.probe.unwrap import resample
from lightwell.render import Camera, Light, Scene, SceneObject, render
from lightwell.render.tonemap import expose_and_encode
from lightwell.sh.basis import evaluate
from lightwell.transfer.compute import compute_transfer
from lightwell.transfer.directions import make_directions

Floats = NDArray[np.float64]
BANDS, ROWS, PIECES = 5, 128, 24
BUNNY = Path(__file__).parents[2] / "samples" / "meshes" / "bunny.glb"


@dataclass(frozen=True)
class Quad:
    """A horizontal rectangle that shines downwards."""

    centre: tuple[float, float, float]
    half: tuple[float, float]
    radiance: tuple[float, float, float]

    def hit(self, origins: Floats, directions: Floats) -> Floats:
        """Return the distances (…) of rays that go upwards and meet it; infinite for others."""
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (self.centre[2] - origins[..., 2]) / directions[..., 2]
            x = origins[..., 0] + distance * directions[..., 0] - self.centre[0]
            y = origins[..., 1] + distance * directions[..., 1] - self.centre[1]
            return np.where((distance > 0) & (abs(x) <= self.half[0]) & (abs(y) <= self.half[1]), distance, np.inf)

    def pieces(self) -> tuple[Floats, Floats]:
        """Return midpoints (n, 3) and areas (n,) of a Gauss–Legendre rule."""
        x, w = np.polynomial.legendre.leggauss(PIECES)
        u, v = (grid.reshape(-1) for grid in np.meshgrid(x, x))
        points = np.array(self.centre) + np.stack([self.half[0] * u, self.half[1] * v, 0 * u], axis=1)
        return points, np.outer(w, w).reshape(-1) * self.half[0] * self.half[1]

    def mesh(self) -> Mesh:
        """Return it as two triangles."""
        (x, y, z), (a, b) = self.centre, self.half
        corners = [[x - a, y - b, z], [x + a, y - b, z], [x + a, y + b, z], [x - a, y + b, z]]
        return make_mesh("quad", np.array(corners), np.array([[0, 2, 1], [0, 3, 2]]))


class Exact:
    """The reference: emitters that hide each other, integrated anew at every point."""

    bands = BANDS

    def __init__(self, quads: list[Quad]) -> None:
        self.quads = quads

    def at(self, points: Floats) -> Floats:
        """Return the coefficients (n, bands², 3)."""
        total = np.zeros((len(points), BANDS * BANDS, 3))
        for quad in self.quads:
            places, areas = quad.pieces()
            others = [other for other in self.quads if other is not quad and other.centre[2] < quad.centre[2]]
            for start in range(0, len(points), 256):
                here = points[start : start + 256, None]
                way = places - here
                distance = np.linalg.norm(way, axis=2)
                directions = way / distance[..., None]
                weight = np.maximum(directions[..., 2], 0) / distance**2 * areas
                for other in others:
                    weight[np.isfinite(other.hit(here, directions))] = 0
                light = np.einsum("pn,pni->pi", weight, evaluate(directions, BANDS), optimize=True)
                total[start : start + 256] += light[..., None] * np.array(quad.radiance)
        return total


class Sampled:
    """Light from samples: a sample set, or a grid of them."""

    bands = BANDS

    def __init__(self, light: SampleSet | Grid) -> None:
        self.light = light

    def at(self, points: Floats) -> Floats:
        """Return the coefficients (n, bands², 3)."""
        if isinstance(self.light, Grid):
            return self.light.sample(points).coefficients
        return self.light.at(points)


def probe(quads: list[Quad], position: Floats) -> tuple[Floats, Floats]:
    """Return coefficients and gradients of what a probe sees at a position."""
    fine, mapping = LatLong(8 * ROWS, 16 * ROWS), LatLong(ROWS, 2 * ROWS)
    directions = fine.directions(*fine.pixel_centres())[0]
    nearest, picture = np.full(directions.shape[:2], np.inf), np.zeros(directions.shape, np.float32)
    for quad in quads:
        distance = quad.hit(position, directions)
        picture[distance < nearest] = quad.radiance
        nearest = np.minimum(nearest, distance)
    image = resample(picture, fine, mapping, 8)
    panorama, proxy = GradientPanorama(mapping), MeshProxy(RayScene([quad.mesh() for quad in quads]))
    plan = GradientPlan(ROWS, 2 * ROWS, BANDS, panorama.inverse_distances(proxy, position))
    return projector(mapping, BANDS).project(image), plan.apply(image)


def bunny(height: float) -> tuple[Mesh, NDArray[np.float32]]:
    """Return the bunny round the origin, and its transfer with shadows."""
    mesh = load_meshes(BUNNY)[0]
    middle = (mesh.positions.max(axis=0) + mesh.positions.min(axis=0)) / 2
    mesh = make_mesh("bunny", (mesh.positions - middle) * height, mesh.triangles, mesh.normals, (0.7, 0.7, 0.7))
    return mesh, compute_transfer([mesh], make_directions("hemisphere", 512), BANDS).coefficients


def moved(mesh: Mesh, offset: Floats) -> Mesh:
    """Return a mesh at another place."""
    return make_mesh(mesh.name, mesh.positions + offset, mesh.triangles, mesh.normals, mesh.albedo)


def relative_error(mesh: Mesh, transfer: NDArray[np.float32], light: Light, truth: Floats) -> float:
    """Return the rms error of irradiance over the vertices, relative to its rms."""
    irradiance = np.einsum("vk,vkc->vc", transfer[..., 0], light.at(mesh.positions.astype(np.float64)))
    reference = np.einsum("vk,vkc->vc", transfer[..., 0], truth)
    return float(np.linalg.norm(irradiance - reference) / np.linalg.norm(reference))


def picture(objects: tuple[SceneObject, ...], light: Light, camera: Camera, ev: float) -> NDArray[np.uint8]:
    """Return a picture of 8 bits on dark grey."""
    seen = render(Scene(objects, light, sampling="vertex"), camera, (280, 250), 3)
    return expose_and_encode(seen.colour + 0.04 * 2.0**-ev * (1 - seen.coverage[..., None]), ev)


def board(path: Path, rows: list[list[tuple[str, NDArray[np.uint8]]]]) -> None:
    """Write pictures with their titles as a JPEG."""
    figure = Figure(figsize=(2.8 * len(rows[0]), 2.8 * len(rows)), layout="constrained")
    axes = figure.subplots(len(rows), len(rows[0]), squeeze=False)
    for line, shown in zip(axes, rows, strict=True):
        for place, (title, pixels) in zip(line, shown, strict=True):
            place.imshow(pixels)
            place.set_title(title, fontsize=9)
            place.axis("off")
    figure.savefig(path, format="jpg", dpi=100, pil_kwargs={"quality": 88})


def moved_under_an_emitter(folder: Path) -> None:
    """Move the bunny under a small emitter; its light was sampled once, in the middle."""
    quads = [Quad((0.0, 0.0, 0.8), (0.12, 0.12), (30.0, 27.0, 22.0))]
    mesh, transfer = bunny(0.25)
    c, gradients = probe(quads, np.zeros(3))
    at = [[0.0, 0.0, 0.0]]
    ways: dict[str, Light] = {
        "one sample": Sampled(SampleSet(at, [c])),
        "with its gradient": Sampled(SampleSet(at, [c], [gradients])),
        "reference": Exact(quads),
    }
    rows = []
    for name, light in ways.items():
        shown = []
        for side, x in (("left", -0.15), ("middle", 0.0), ("right", 0.15)):
            here = moved(mesh, np.array([x, 0, 0]))
            truth = ways["reference"].at(here.positions.astype(np.float64))
            error = relative_error(here, transfer, light, truth)
            print(f"moved, {side:6} {name:20} error of irradiance {error:.3f}")
            camera = Camera((x, -1.0, 0.55), (x, 0.0, -0.01), fov_degrees=17)
            title = f"{side}: {name}" + ("" if name == "reference" else f", {100 * error:.0f} %")
            shown.append((title, picture((SceneObject(here, transfer=transfer),), light, camera, -0.2)))
        rows.append(shown)
    board(folder / "gradients-moved.jpg", rows)


def under_two_emitters(folder: Path) -> None:
    """Light the bunny from two emitters, one of which partly hides the other, by one and by eight samples."""
    quads = [
        Quad((0.1, 0.0, 1.1), (0.3, 0.25), (14.0, 2.0, 1.5)),
        Quad((-0.16, 0.0, 0.62), (0.16, 0.2), (1.2, 3.0, 14.0)),
    ]
    mesh, transfer = bunny(0.3)
    lower, upper = mesh.positions.min(axis=0).astype(np.float64), mesh.positions.max(axis=0).astype(np.float64)
    c, gradients = probe(quads, np.zeros(3))
    # Eight samples at the corners of the bounding box: the centres of a grid of 2 × 2 × 2 cells.
    half = (upper - lower) / 2
    spec = GridSpec(tuple(lower - half), tuple(upper + half), (2, 2, 2))
    corners = spec.centres().reshape(-1, 3)
    samples = [probe(quads, corner) for corner in corners]
    shape = (2, 2, 2, BANDS * BANDS, 3)
    table = np.array([one[0] for one in samples], np.float32).reshape(shape)
    slopes = np.array([one[1] for one in samples], np.float32).reshape(*shape, 3)
    coverage = np.ones((2, 2, 2), np.float32)
    exact = Exact(quads)
    truth = exact.at(mesh.positions.astype(np.float64))
    at = [[0.0, 0.0, 0.0]]
    ways: list[tuple[str, Light]] = [
        ("(a) one sample", Sampled(SampleSet(at, [c]))),
        ("(b) one sample, gradient", Sampled(SampleSet(at, [c], [gradients]))),
        ("(c) reference", exact),
        ("(d) places of eight samples", exact),
        ("(e) eight samples", Sampled(Grid(spec, table, coverage))),
        ("(f) eight samples, gradients", Sampled(Grid(spec, table, coverage, None, slopes))),
    ]
    camera = Camera((0.35, -1.05, 0.6), (0.0, 0.0, -0.01), fov_degrees=21)
    bead = sphere(24, 48, (0.7, 0.7, 0.7))
    beads = tuple(
        SceneObject(make_mesh("bead", 0.012 * bead.positions + corner, bead.triangles, bead.normals, bead.albedo))
        for corner in corners
    )
    shown = []
    for name, light in ways:
        objects: tuple[SceneObject, ...] = (SceneObject(mesh, transfer=transfer),)
        title = name
        if name.startswith("(d)"):
            objects += beads
        elif not name.startswith("(c)"):
            error = relative_error(mesh, transfer, light, truth)
            print(f"two emitters, {name:30} error of irradiance {error:.3f}")
            title += f", {100 * error:.1f} %"
        shown.append((title, picture(objects, light, camera, -0.1)))
    board(folder / "gradients-samples.jpg", [shown[:3], shown[3:]])


if __name__ == "__main__":
    target = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parents[1]
    moved_under_an_emitter(target)
    under_two_emitters(target)
