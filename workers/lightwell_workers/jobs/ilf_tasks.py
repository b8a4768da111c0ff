"""The tasks of an ``ilf-grid`` job: what runs on the compute processes. They exchange data through files."""

from __future__ import annotations

import os
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from lightwell.field.gather import gather, turned_offsets
from lightwell.field.resample import Kernel, Resampler
from lightwell.field.sums import FieldSums
from lightwell.io.angular import AngularStore
from lightwell.job_settings import IlfGridSettings
from lightwell.synthetic.rig import rotation_of
from lightwell_workers.jobs.context import stop_if_cancelled
from lightwell_workers.jobs.ilf_plan import MEGABYTE, Field

MOST_BLOCK = 1024


@lru_cache(maxsize=2)
def open_field(document: str, digest: str) -> Field:
    """Return the field of a job; ``digest`` of the capture keeps a changed one from being mistaken for it."""
    del digest
    return Field(IlfGridSettings.model_validate_json(document))


def sort_batch(cancel: Path, document: str, digest: str, store: str, first: int, last: int) -> None:
    """Write the samples of the probes ``first`` … ``last − 1`` in angular order."""
    field = open_field(document, digest)
    capture, buckets = field.capture, field.buckets
    gain = np.float32(capture.info.gain)
    rows = []
    turns = rotation_of(capture.poses.orientations[first:last])
    for index in range(first, last):
        stop_if_cancelled(cancel)
        frame = capture.read_frame(index)
        plain = not field.rotating and field.downsampler is None and gain == 1
        pixels: Any = frame
        if not plain:
            pixels = frame.astype(np.float32) * gain
            if field.downsampler is not None:
                pixels = field.downsampler(pixels)
        if field.rotating:
            rows.append(gather(pixels, field.mapping, buckets.directions, turns[index - first]))
        else:
            turned = pixels.reshape(-1, 3)[buckets.pixels]
            # Inf and NaN are no samples; where there is neither, halves stay what they are.
            rows.append(np.where(np.isfinite(turned), turned, np.nan).astype(turned.dtype))
    AngularStore.open(Path(store)).write_probes(first, np.stack(rows))


def resample_part(cancel: Path, document: str, digest: str, store: str, out: str, first: int, last: int) -> None:
    """Write the partial sums of the directions at the places ``first`` … ``last − 1`` of the store to ``out``."""
    field = open_field(document, digest)
    settings, capture, buckets = field.settings, field.capture, field.buckets
    samples = AngularStore.open(Path(store))
    kernel = Kernel(settings.support_cells, settings.sigma_cells)
    regression = settings.gradients == "regression"
    sums = [FieldSums(spec, settings.bands, gradients=regression) for spec in field.specs]
    turns = rotation_of(capture.poses.orientations) if field.rotating else None
    resamplers = [Resampler(one, capture.poses.positions, kernel, settings.repair) for one in sums]
    bytes_each = capture.count * 3 * 4 * (6 if field.rotating else 2)
    block = max(1, min(MOST_BLOCK, settings.memory_mb * MEGABYTE // bytes_each))
    with threadpool_limits(1):
        for start in range(first, last, block):
            places = slice(start, min(start + block, last))
            chosen = samples.order[places]
            directions, offsets = buckets.directions[chosen], buckets.offsets[chosen]
            if turns is not None and field.sphere_radius_m is not None:
                offsets = turned_offsets(field.mapping, directions, turns, field.sphere_radius_m)
            radiance = samples.read(places.start, places.stop)
            for resampler in resamplers:
                resampler.add(
                    directions,
                    offsets,
                    radiance,
                    buckets.rows[chosen],
                    buckets.weights[chosen],
                    partial(stop_if_cancelled, cancel),
                )
        for resampler in resamplers:
            resampler.finish()
    save_sums(Path(out), sums)


def save_sums(path: Path, sums: list[FieldSums]) -> None:
    """Write sums of several grids; the file appears whole or not at all."""
    arrays = {f"{index}.{name}": array for index, one in enumerate(sums) for name, array in one.arrays().items()}
    unfinished = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with unfinished.open("wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        unfinished.replace(path)
    finally:
        unfinished.unlink(missing_ok=True)


def load_sums(path: Path, field: Field) -> list[FieldSums]:
    """Read what `save_sums` wrote."""
    with np.load(path) as file:
        sums = []
        for index, spec in enumerate(field.specs):
            prefix = f"{index}."
            arrays = {name.removeprefix(prefix): file[name] for name in file.files if name.startswith(prefix)}
            sums.append(FieldSums.restore(spec, field.settings.bands, arrays))
    return sums
