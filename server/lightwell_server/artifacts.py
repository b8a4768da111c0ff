"""Where the results of jobs lie."""

from __future__ import annotations

from pathlib import Path

from lightwell.errors import LightwellError
from lightwell_workers.jobs.directory import JOB_ID, Artifact, JobDirectory


class ArtifactNotFoundError(LightwellError):
    """There is no such result."""


def find_artifact(root: Path, artifact_id: str) -> tuple[Artifact, Path]:
    """Return an artefact and its place; raises `ArtifactNotFoundError`."""
    job, _, _ = artifact_id.partition(".")
    if JOB_ID.match(job):
        directory = JobDirectory(root, job)
        for artifact in directory.read_manifest():
            if artifact.id == artifact_id:
                return artifact, directory.artifacts / artifact.path
    raise ArtifactNotFoundError(f"there is no artefact {artifact_id!r}; GET /api/v1/jobs/{{id}} lists those of a job")


def find_file(root: Path, artifact_id: str, path: str) -> tuple[Path, str, str]:
    """Return place, SHA-256 and media type of a file below a folder; raises `ArtifactNotFoundError`.

    Only files that the manifest names are served, so that no path leads out of the folder.
    """
    artifact, place = find_artifact(root, artifact_id)
    for file in artifact.files or ():
        if file.path == path:
            kind = "application/json" if path.endswith(".json") else "application/octet-stream"
            return place / path, file.sha256, kind
    raise ArtifactNotFoundError(f"the artefact {artifact_id!r} holds no file {path!r}")
