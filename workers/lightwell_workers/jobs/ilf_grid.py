"""``ilf-grid``: a capture becomes a grid of SH coefficients (paper 000).

prepare → sort (probes into angular order, batch by batch) → resample (directions, part by part; partial sums are folded
in a fixed order) → finish (window, gradients, report, preview).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import msgspec

from lightwell.field.buckets import angular_order
from lightwell.field.grid import Grid
from lightwell.field.sums import FieldSums
from lightwell.io.angular import AngularStore
from lightwell.io.files import write_atomically
from lightwell.io.preview import preview_png
from lightwell.job_settings import IlfGridSettings
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.ilf_finish import finish
from lightwell_workers.jobs.ilf_plan import Field, Part, Plan, estimate, make_plan, read_plan
from lightwell_workers.jobs.ilf_tasks import load_sums, open_field, resample_part, save_sums, sort_batch
from lightwell_workers.jobs.kind import Estimate, JobError, Step


class IlfGrid:
    """The kind."""

    def estimate(self, settings: IlfGridSettings, roots: Sequence[Path] | None = None) -> Estimate:
        """Return what the job needs; raises `LightwellError` where the capture cannot be used."""
        del roots  # no file of its settings names others elsewhere
        return estimate(settings)

    def prepare(self, settings: IlfGridSettings, context: JobContext) -> None:
        """Open the capture, plan the work and make the store that the probes are sorted into."""
        context.progress("prepare", 0, 1)
        field = Field(settings)
        plan = make_plan(field, context.processes)
        if plan.batches:
            batch = plan.batches[0].last - plan.batches[0].first
            order = angular_order(field.buckets.directions)
            AngularStore.create(_store(context, field), order, field.capture.count, batch, settings.sample_format)
        else:
            stored = AngularStore.open(_store(context, field))
            if (stored.directions, stored.probes) != (field.directions, field.capture.count):
                raise JobError(
                    f"{stored.path}: holds {stored.directions} directions of {stored.probes} probes, but the capture's "
                    f"mapping and poses make {field.directions} of {field.capture.count}: sort the frames again"
                )
        write_atomically(_plan(context), msgspec.json.encode(plan))
        probes, directions = field.capture.count, field.directions
        context.log("prepared", probes=probes, directions=directions, parts=len(plan.parts))
        context.progress("prepare", 1, 1)

    def steps(self, settings: IlfGridSettings, context: JobContext) -> list[Step]:
        """Return sorting and resampling in groups of tasks, and the end."""
        plan = read_plan(_plan(context))
        document = settings.model_dump_json()
        sort = [
            Step(f"sort {group[0].first}", partial(_sort, document, plan, group))
            for group in _groups(plan.batches, plan.together)
        ]
        resample = [
            Step(f"resample {group[0].first}", partial(_resample, document, plan, group))
            for group in _groups(plan.parts, plan.together)
        ]
        return [*sort, *resample, Step("finish", partial(_finish, document, plan))]


def _groups(parts: list[Part], size: int) -> list[list[Part]]:
    return [parts[first : first + size] for first in range(0, len(parts), size)]


def _plan(context: JobContext) -> Path:
    return context.work / "plan.json"


def _store(context: JobContext, field: Field) -> Path:
    return field.capture.sorted_samples or context.work / "samples.zarr"


def _open(document: str, plan: Plan) -> Field:
    field = open_field(document, plan.digest)
    if field.capture.digest != plan.digest:
        raise JobError("the capture has changed since the job began; submit a new job")
    return field


def _sort(document: str, plan: Plan, group: list[Part], context: JobContext) -> None:
    field = _open(document, plan)
    total = field.capture.count
    context.progress("sort", group[0].first, total)
    items = [(document, plan.digest, str(_store(context, field)), part.first, part.last) for part in group]
    for part, _ in zip(group, context.map(sort_batch, items), strict=True):
        context.progress("sort", part.last, total)


def _sum_path(context: JobContext, directions: int) -> Path:
    return context.work / f"sum-{directions:07d}.npz"


def _resample(document: str, plan: Plan, group: list[Part], context: JobContext) -> None:
    """Make the partial sums of a group of parts and add them, in their order, to the running sum."""
    field = _open(document, plan)
    first, last, total = group[0].first, group[-1].last, field.directions
    if _sum_path(context, last).exists():
        return
    context.progress("resample", first, total)
    outs = [context.work / f"part-{part.first:07d}.npz" for part in group]
    items = [
        (document, plan.digest, str(_store(context, field)), str(out), part.first, part.last)
        for part, out in zip(group, outs, strict=True)
        if not out.exists()
    ]
    for done, _ in enumerate(context.map(resample_part, items), 1):
        context.progress("resample", first + round((last - first) * done / (len(items) + 1)), total)
    sums = load_sums(_sum_path(context, first), field) if first > 0 else load_sums(outs[0], field)
    for out in outs if first > 0 else outs[1:]:
        context.check()
        for whole, one in zip(sums, load_sums(out, field), strict=True):
            whole.add(one)
    save_sums(_sum_path(context, last), sums)
    if last < total:
        _show_so_far(sums[0], context)
    for out in outs:
        out.unlink()
    # The sum before this one stays: should this checkpoint be lost, the step begins from it again.
    for old in sorted(context.work.glob("sum-*.npz"))[:-2]:
        old.unlink()
    context.progress("resample", last, total)


def _show_so_far(sums: FieldSums, context: JobContext) -> None:
    """Draw the light of the directions so far: it fills up while the job runs."""
    write_atomically(context.directory.preview, preview_png(Grid(sums.spec, sums.coefficients, sums.coverage)))


def _finish(document: str, plan: Plan, context: JobContext) -> None:
    field = _open(document, plan)
    finish(field, load_sums(_sum_path(context, field.directions), field), context)
