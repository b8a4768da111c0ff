"""A job's folder: ``<data>/jobs/<id>/``.

``events.jsonl``
    what happened, appended line by line (`lightwell_workers.jobs.events`)
``lock``
    held by the process that works on the job
``cancel``
    there while the job is to stop: tasks look for it between blocks
``work/``
    checkpoints; gone when the job has succeeded
``artifacts/``, ``manifest.json``
    results, there when the job has succeeded
"""

from __future__ import annotations

import hashlib
import mimetypes
import re
import shutil
from pathlib import Path

import msgspec

from lightwell.io.files import write_atomically

JOB_ID = re.compile(r"^[a-z0-9][a-z0-9-]{7,63}$")


class ArtifactFile(msgspec.Struct):
    """One file of a folder that is an artefact."""

    path: str
    """Relative to the artefact."""
    bytes: int
    sha256: str


class Artifact(msgspec.Struct):
    """One result: a file or a folder."""

    id: str
    """``<job>.<name without its last suffix>``."""
    path: str
    """Relative to the job's ``artifacts``."""
    bytes: int
    sha256: str
    """Of the file; of a folder: of the lines ``sha256  path`` of its files, by path."""
    media_type: str
    files: list[ArtifactFile] | None = None
    """Of a folder."""


class JobDirectory:
    """The paths of one job."""

    def __init__(self, root: Path, job: str) -> None:
        if not JOB_ID.match(job):
            raise ValueError(f"{job!r} is no job id")
        self.id = job
        self.path = root / job
        self.events = self.path / "events.jsonl"
        self.lock = self.path / "lock"
        self.cancel = self.path / "cancel"
        self.work = self.path / "work"
        self.preview = self.work / "preview.png"
        """A picture of what there is so far; not every kind makes one."""
        self.artifacts = self.path / "artifacts"
        self.manifest = self.path / "manifest.json"

    def read_manifest(self) -> list[Artifact]:
        """Return the job's artefacts; none where it has not succeeded."""
        try:
            return msgspec.json.decode(self.manifest.read_bytes(), type=list[Artifact])
        except (OSError, msgspec.MsgspecError):
            return []

    def publish(self, results: Path) -> None:
        """Make the folder ``results`` the job's artefacts, and forget the checkpoints; may be done again."""
        if results.is_dir():
            for unfinished in results.glob(".*.partial"):  # of a step that was killed while it wrote
                if unfinished.is_dir():
                    shutil.rmtree(unfinished)
                else:
                    unfinished.unlink()
            shutil.rmtree(self.artifacts, ignore_errors=True)
            results.rename(self.artifacts)
        artifacts = [_describe(self.id, path) for path in sorted(self.artifacts.iterdir())]
        write_atomically(self.manifest, msgspec.json.format(msgspec.json.encode(artifacts), indent=1))
        shutil.rmtree(self.work, ignore_errors=True)


def _describe(job: str, path: Path) -> Artifact:
    name = f"{job}.{path.name.rpartition('.')[0] or path.name}"
    if path.is_file():
        kind = mimetypes.guess_type(path.name)[0] or "application/octet-stream"
        return Artifact(name, path.name, path.stat().st_size, _sha256(path), kind)
    files = [
        ArtifactFile(file.relative_to(path).as_posix(), file.stat().st_size, _sha256(file))
        for file in sorted(path.rglob("*"))
        if file.is_file()
    ]
    listing = "".join(f"{file.sha256}  {file.path}\n" for file in files)
    digest = hashlib.sha256(listing.encode()).hexdigest()
    return Artifact(name, path.name, sum(file.bytes for file in files), digest, "inode/directory", files)


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
