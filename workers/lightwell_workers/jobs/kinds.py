"""The kinds of jobs by name."""

from __future__ import annotations

from lightwell.job_settings import JobKind
from lightwell_workers.jobs.capture_reduce import CaptureReduce
from lightwell_workers.jobs.igi_render import IgiRender
from lightwell_workers.jobs.ilf_grid import IlfGrid
from lightwell_workers.jobs.kind import Kind
from lightwell_workers.jobs.prt_transfer import PrtTransfer

KINDS: dict[JobKind, Kind] = {
    "ilf-grid": IlfGrid(),
    "prt-transfer": PrtTransfer(),
    "capture-reduce": CaptureReduce(),
    "igi-render": IgiRender(),
}
