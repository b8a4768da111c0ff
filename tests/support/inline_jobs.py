"""Jobs without a queue: the steps of a kind, one after the other, in this process."""

from __future__ import annotations

import json
import threading
from pathlib import Path
from typing import Any, cast

from lightwell.job_settings import JobKind
from lightwell_workers.jobs.compute import InlineCompute
from lightwell_workers.jobs.context import JobContext
from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.events import EventLog
from lightwell_workers.jobs.kinds import KINDS, load_kind


def run_inline(kind: str, folder: Path, report: str = "report.json", **settings: Any) -> tuple[Path, dict[str, Any]]:
    """Run a job in ``folder``; return the folder of its results and its report."""
    directory = JobDirectory(folder, "inline-job")
    directory.path.mkdir(parents=True, exist_ok=True)
    context = JobContext(directory, EventLog(directory.events), InlineCompute(), threading.Event())
    context.results.mkdir(parents=True, exist_ok=True)
    name = cast(JobKind, kind)
    one = load_kind(name)
    parsed = KINDS[name].settings_type.model_validate(settings)
    one.estimate(parsed)
    one.prepare(parsed, context)
    for step in one.steps(parsed, context):
        step.run(context)
    return context.results, json.loads((context.results / report).read_text())
