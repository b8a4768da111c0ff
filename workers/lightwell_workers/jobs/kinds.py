"""The kinds of jobs by name; the code of one is imported when a job first needs it.

A server that lists jobs, and an executor that makes grids, need nothing of what renders pictures: all kinds together
import for half a second.
"""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

from lightwell.job_settings import (
    CaptureReduceSettings,
    IgiRenderSettings,
    IlfGridSettings,
    JobKind,
    PrtTransferSettings,
)
from lightwell.settings import Settings
from lightwell_workers.jobs.kind import Kind


class KindInfo(NamedTuple):
    """What is known of a kind without its code."""

    description: str
    """What it does, in one line."""
    settings_type: type[Settings]
    """Model of its settings."""


KINDS: dict[JobKind, KindInfo] = {
    "ilf-grid": KindInfo("Resample a capture of light probes to a regular grid of SH coefficients", IlfGridSettings),
    "prt-transfer": KindInfo(
        "Compute how each vertex of a mesh answers to light, with shadows and bounces", PrtTransferSettings
    ),
    "capture-reduce": KindInfo("Drop the probes of a capture that look like their neighbours", CaptureReduceSettings),
    "igi-render": KindInfo(
        "Render pictures or a film of a scene, with shadows and light that surfaces reflect", IgiRenderSettings
    ),
}


@cache
def load_kind(name: JobKind) -> Kind:
    """Return what does the jobs of a kind."""
    match name:
        case "ilf-grid":
            from lightwell_workers.jobs.ilf_grid import IlfGrid

            return IlfGrid()
        case "prt-transfer":
            from lightwell_workers.jobs.prt_transfer import PrtTransfer

            return PrtTransfer()
        case "capture-reduce":
            from lightwell_workers.jobs.capture_reduce import CaptureReduce

            return CaptureReduce()
        case "igi-render":
            from lightwell_workers.jobs.igi_render import IgiRender

            return IgiRender()
