"""Projection of a full 2400×1700 half-float lat-long frame, against reading it, NumPy and ducc0.

Everything runs on one thread, but for the projection of the full frame, which takes two, and NumPy's matrix product,
which takes what its BLAS takes.
"""

from __future__ import annotations

import itertools

import ducc0
import numpy as np
from numba import njit

from bench.report import Row, interleaved_medians, row
from lightwell.probe.downsample import Downsampler
from lightwell.probe.factory import make_mapping
from lightwell.probe.latlong import LatLong
from lightwell.probe.projection import Projector
from lightwell.settings import MappingSettings
from lightwell.sh.basis import evaluate

HEIGHT, WIDTH, BANDS = 1700, 2400, 5
FRAMES = 5
"""Frames in turn: 24.5 MB each, so that none is still in the processor's cache when it comes again."""
NAIVE_ROWS = 50
"""Rows that the plain per-pixel NumPy loop gets; its time is scaled up."""


@njit(cache=True, nogil=True)
def _read(words):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    total = np.uint64(0)
    for index in range(words.size):
        total += words[index]
    return total


def _numpy_chunks(frame: np.ndarray, basis: np.ndarray, rows: int) -> np.ndarray:
    """Project with a precomputed float32 basis ``(H, W, bands²)`` of ``rows`` rows, which is used for all."""
    out = np.zeros((BANDS * BANDS, 3))
    flat = basis.reshape(-1, BANDS * BANDS)
    for start in range(0, HEIGHT, rows):
        out += flat.T @ frame[start : start + rows].reshape(-1, 3).astype(np.float32)
    return out


def _numpy_naive(frame: np.ndarray, rows: int) -> np.ndarray:
    """Project the way one writes it down: directions, basis and sum for every frame anew."""
    mapping = LatLong(HEIGHT, WIDTH)
    x, y = mapping.pixel_centres()
    basis = evaluate(mapping.directions(x, y[:rows])[0], BANDS)
    weights = mapping.row_solid_angles()[:rows, None, None]
    return np.asarray(np.einsum("ijk,ijc->kc", basis * weights, frame[:rows].astype(np.float64)))


def _ducc(frame: np.ndarray) -> np.ndarray:
    """Analyse three channels on the Fejér-1 grid, which is that of our pixel centres."""
    planes = np.ascontiguousarray(frame.transpose(2, 0, 1), dtype=np.float32)
    alm = [
        ducc0.sht.analysis_2d(
            map=planes[channel : channel + 1], spin=0, lmax=BANDS - 1, mmax=BANDS - 1, geometry="F1",
            phi0=np.pi / WIDTH, nthreads=1,
        )
        for channel in range(3)
    ]  # fmt: skip
    return np.concatenate(alm)


def run() -> list[Row]:
    """Measure; every figure is a median of interleaved repeats."""
    rng = np.random.default_rng(0)
    frame = rng.lognormal(size=(HEIGHT, WIDTH, 3)).astype(np.float16)
    frames = [frame, *(frame.copy() for _ in range(FRAMES - 1))]
    copied = np.empty_like(frame)
    mapping = LatLong(HEIGHT, WIDTH)
    full = Projector(mapping, BANDS)
    reduce = Downsampler(mapping, 256)
    small = Projector(reduce.mapping, BANDS)
    reduced = reduce(frame)
    disc = (WIDTH / 2, HEIGHT / 2, HEIGHT / 2)
    sphere = make_mapping(
        MappingSettings(kind="mirror-sphere", sphere_radius_m=0.0458, sphere_distance_m=1.25, disc=disc), HEIGHT, WIDTH
    )
    sphere_full, sphere_reduce = Projector(sphere, BANDS), Downsampler(sphere, 256)
    chunk = 100
    precomputed = evaluate(mapping.directions(*mapping.pixel_centres())[0][:chunk], BANDS).astype(np.float32)
    turn = itertools.cycle(frames)
    functions = {
        "read": lambda: _read(next(turn).reshape(-1).view(np.uint64)),
        "copy": lambda: np.copyto(copied, next(turn)),
        "full": lambda: full.project(next(turn)),
        "reduce": lambda: reduce(next(turn)),
        "small": lambda: small.project(reduced),
        "sphere full": lambda: sphere_full.project(next(turn)),
        "sphere reduce": lambda: sphere_reduce(next(turn)),
    }
    others = {
        "numpy matrix": lambda: _numpy_chunks(next(turn), precomputed, chunk),
        "numpy": lambda: _numpy_naive(next(turn), NAIVE_ROWS),
        "ducc": lambda: _ducc(next(turn)),
    }
    # Apart, because the threads of NumPy's BLAS keep a core busy for a while after each product.
    ms = interleaved_medians(functions, repeats=31) | interleaved_medians(others, repeats=5)
    ms["numpy"] *= HEIGHT / NAIVE_ROWS
    ours = ms["full"]
    return [
        row("read the frame once from memory", ms["read"], "ms"),
        row("copy the frame (against reading it)", ms["copy"], "ms", ms["read"]),
        row("project the full frame, 5 bands (against reading it)", ours, "ms", ms["read"]),
        row("project the full frame, 5 bands (against copying it)", ours, "ms", ms["copy"]),
        row("downsample to 256 pixels (against reading)", ms["reduce"], "ms", ms["read"]),
        row("matrix of the small frame", ms["small"], "ms"),
        row("downsample and matrix (against reading)", ms["reduce"] + ms["small"], "ms", ms["read"]),
        row("mirror sphere: project the full frame (against reading)", ms["sphere full"], "ms", ms["read"]),
        row("mirror sphere: downsample (against reading)", ms["sphere reduce"], "ms", ms["read"]),
        row("NumPy, basis precomputed (against our full frame)", ms["numpy matrix"], "ms", ours),
        row("NumPy, basis each time (against our full frame)", ms["numpy"], "ms", ours),
        row("ducc0 analysis_2d, lmax 4 (against our full frame)", ms["ducc"], "ms", ours),
    ]
