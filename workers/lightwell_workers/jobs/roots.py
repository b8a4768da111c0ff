"""Where what jobs read may lie."""

from __future__ import annotations

from pathlib import Path

from lightwell.job_settings import JobsSettings

FOLDERS = ("captures", "jobs", "meshes", "scenes", "uploads")
"""Of the data directory."""


def data_roots(settings: JobsSettings, data_dir: Path) -> tuple[Path, ...]:
    """Return the folders below which inputs of jobs may lie, all links followed."""
    return tuple(root.resolve() for root in (*(data_dir / name for name in FOLDERS), *settings.data_roots))
