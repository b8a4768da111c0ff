"""Results of ``prt-transfer`` jobs by what decides them, so that the same work is never done twice.

``<data>/jobs/.transfers/<digest>`` holds the id of the newest job with that result. The result itself is that job's
own: it is kept as long as the job is (``[jobs] retention_days``), and files that several jobs share are hard links.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
from pathlib import Path

import msgspec

from lightwell.io.files import write_atomically
from lightwell_workers.jobs.directory import JOB_ID, JobDirectory

FOLDER = ".transfers"
DIGEST = re.compile(r"^[0-9a-f]{64}$")
DOCUMENT = "transfer.json"


class _Document(msgspec.Struct):
    digest: str


def take(root: Path, digest: str, results: Path) -> str | None:
    """Make an earlier job's result of this digest that of ``results``; return that job's id, or None.

    ``results`` is an empty folder, and is one again where nothing was taken.
    """
    index = root / FOLDER / digest
    try:
        job = index.read_text("ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None
    if JOB_ID.match(job) and _link(JobDirectory(root, job), digest, results):
        return job
    for file in results.iterdir():
        file.unlink()
    with contextlib.suppress(OSError):
        index.unlink()
    return None


def _link(source: JobDirectory, digest: str, results: Path) -> bool:
    artifacts = source.read_manifest()
    if not artifacts or any(artifact.files is not None for artifact in artifacts):
        return False
    try:
        for artifact in artifacts:
            place = source.artifacts / artifact.path
            if place.stat().st_size != artifact.bytes:
                return False
            target = results / artifact.path
            target.unlink(missing_ok=True)
            try:
                os.link(place, target)
            except FileNotFoundError:
                return False
            except OSError:
                shutil.copyfile(place, target)
        document = msgspec.json.decode((results / DOCUMENT).read_bytes(), type=_Document)
    except (FileNotFoundError, msgspec.MsgspecError):
        return False
    return document.digest == digest


def remember(root: Path, digest: str, job: str) -> None:
    """Say that a job has the result of a digest; forget those whose jobs are gone. Raises ``OSError``."""
    folder = root / FOLDER
    folder.mkdir(exist_ok=True)
    write_atomically(folder / digest, job.encode("ascii"))
    for index in folder.iterdir():
        with contextlib.suppress(OSError, UnicodeDecodeError):
            if DIGEST.match(index.name) and not (root / index.read_text("ascii").strip()).is_dir():
                index.unlink()
