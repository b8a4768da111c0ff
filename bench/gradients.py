"""Gradients: their cost beside the projection's, sphericart's derivatives, and the errors that MATHS §7 promises.

Everything runs on one thread; ratios are of medians of interleaved repeats in this process.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import sphericart
from tests.support.reference_gradients import Quad, between_samples, edge_sum, moving_away

from bench.report import Row, interleaved_medians, row
from lightwell.gradients.image import GradientPlan
from lightwell.gradients.panorama import GradientPanorama
from lightwell.gradients.proxy import BoxProxy
from lightwell.gradients.sphere import sphere_gradients
from lightwell.probe.downsample import Downsampler
from lightwell.probe.latlong import LatLong
from lightwell.probe.mapping import Mapping
from lightwell.probe.mirror_sphere import MirrorSphere, SphereView
from lightwell.probe.octahedral import Octahedral
from lightwell.probe.projection import Projector
from lightwell.sh.basis import evaluate_with_gradient

BANDS = 5
HEIGHT, WIDTH = 1700, 2400
DIRECTIONS = 100_000


def run() -> list[Row]:
    """Measure."""
    return [*_live(), *_stream(), *_basis(), *_errors()]


def _live() -> list[Row]:
    """Measure at the default resolution, for mappings of each kind."""
    return [
        *_mapping("lat-long 256×128", LatLong(128, 256)),
        *_mapping("octahedral 256×256", Octahedral(256, 256)),
        *_mapping("mirror sphere 256×256", MirrorSphere(256, 256, SphereView(0.05, 2400.0))),
    ]


def _mapping(name: str, mapping: Mapping) -> list[Row]:
    image = np.random.default_rng(0).lognormal(size=(mapping.height, mapping.width, 3)).astype(np.float32)
    project, more, panorama = Projector(mapping, BANDS), Projector(mapping, BANDS + 1), GradientPanorama(mapping)
    inverse = panorama.inverse_distances(BoxProxy([-3, -2, -1], [2, 3, 1.5]), np.zeros(3))
    plan = GradientPlan(panorama.height, panorama.width, BANDS, inverse, panorama.seen)

    def gradients() -> None:
        light = panorama(image)
        plan.apply(light)
        plan.mean_distance(light)

    functions: dict[str, Callable[[], object]] = {
        "project": lambda: project.project(image),
        "gradients": gradients,
        "plan": lambda: GradientPlan(panorama.height, panorama.width, BANDS, inverse, panorama.seen),
        "closed": lambda: sphere_gradients(more.project(image), 2.0),
    }
    if isinstance(mapping, LatLong):
        functions["numpy"] = lambda: edge_sum(image.astype(np.float64), inverse, BANDS)
    took = interleaved_medians(functions, 41)
    rows = [
        row(f"{name}: gradients and mean distance against projection", took["gradients"], "ms", took["project"]),
        row(f"{name}: a plan for another place against projection", took["plan"], "ms", took["project"]),
        row(f"{name}: closed sphere with its 6 bands against projection", took["closed"], "ms", took["project"]),
    ]
    if "numpy" in took:
        rows.append(row(f"{name}: NumPy's sum over edges against ours", took["numpy"], "ms", took["gradients"]))
    return rows


def _stream() -> list[Row]:
    """Downsample and project a 2400×1700 half-float frame, with gradients and without."""
    frame = np.random.default_rng(0).lognormal(size=(HEIGHT, WIDTH, 3)).astype(np.float16)
    reduce = Downsampler(LatLong(HEIGHT, WIDTH), 256)
    small = reduce.mapping
    project = Projector(small, BANDS)
    plan = GradientPlan(small.height, small.width, BANDS, np.ones((small.height, small.width)))

    def without() -> None:
        project.project(reduce(frame))

    def with_gradients() -> None:
        image = reduce(frame)
        project.project(image)
        plan.apply(image)
        plan.mean_distance(image)

    took = interleaved_medians({"without": without, "with": with_gradients})
    return [row("2400×1700 frame reduced, with gradients against without", took["with"], "ms", took["without"])]


def _basis() -> list[Row]:
    """Compare derivatives of the basis to degree 8 with sphericart's."""
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    theirs = sphericart.SphericalHarmonics(8)
    ours, other = (
        evaluate_with_gradient(directions, 9)[1],
        np.swapaxes(theirs.compute_with_gradients(directions)[1], 1, 2),
    )
    took = interleaved_medians(
        {
            "ours": lambda: evaluate_with_gradient(directions, 9),
            "sphericart": lambda: theirs.compute_with_gradients(directions),
        }
    )
    return [
        row("basis gradients to degree 8, largest difference to sphericart's", float(np.abs(ours - other).max()), ""),
        row(
            f"basis gradients of {DIRECTIONS} directions against sphericart's time",
            took["ours"],
            "ms",
            took["sphericart"],
        ),
    ]


def _errors() -> list[Row]:
    """Print the tables of MATHS §7.4 and §7.8; the baseline is the figure given there."""
    rows = []
    for share, without, with_gradient, given in moving_away(Quad()):
        rows.append(row(f"error at {share:g} of the mean distance, one sample", without, "", given[0]))
        rows.append(row(f"error at {share:g} of the mean distance, its gradient", with_gradient, "", given[1]))
    for size, way, error, given_error in between_samples(Quad()):
        rows.append(row(f"error in a cell of {size:g} m, {way}", error, "", given_error))
    return rows
