"""Options of the commands that talk to a server, and what they print of jobs."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from lightwell_client import Lightwell
    from lightwell_client.jobs import Job

SERVER: str = typer.Option("http://127.0.0.1:8400", help="URL of the server.")
TOKEN: str | None = typer.Option(None, envvar="LIGHTWELL_TOKEN", help="The server's token.")
JSON: bool = typer.Option(False, "--json", help="Print one JSON document.")


@dataclass(frozen=True)
class Ended:
    """How a followed job ended."""

    job: Job
    ok: bool


def connect(server: str, token: str | None) -> Lightwell:
    """Return a client; raises `LightwellError` where the URL is none."""
    from lightwell.errors import LightwellError
    from lightwell_client import Lightwell

    try:
        return Lightwell(server, token=token)
    except ValueError as error:
        raise LightwellError(f"--server: {error}") from None


def as_document(job: Job) -> dict[str, Any]:
    """Return a job as JSON-ready values."""
    import msgspec

    document: dict[str, Any] = msgspec.to_builtins(job)
    return document


def print_job(job: Job, *, as_json: bool) -> None:
    """Print one job, as JSON or for people."""
    if as_json:
        print(json.dumps(as_document(job)))
        return
    print(f"{job.id}  {job.kind}  {job.state}")
    if job.progress is not None and job.state == "running":
        print(f"  {describe_progress(job)}")
    if job.error:
        print(f"  {job.error}")
    for artifact in job.artifacts:
        print(f"  {artifact.id}  {artifact.bytes} bytes  sha256 {artifact.sha256[:16]}…")


def describe_progress(job: Job) -> str:
    """Return how far a job is, in words."""
    progress = job.progress
    if progress is None:
        return ""
    eta = "" if progress.eta_seconds is None else f", {progress.eta_seconds:.0f} s left"
    return f"{progress.stage} {progress.done}/{progress.total}{eta}"


def follow(client: Lightwell, job: str, *, quiet: bool = False) -> Ended:
    """Wait for a job's end, with a progress bar on a terminal; Ctrl-C leaves the job running and says so."""
    import sys

    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=quiet or not sys.stderr.isatty(),
    )
    try:
        with bar:
            task = bar.add_task("queued", total=None)
            for event in client.events(job):
                if event["type"] == "progress":
                    bar.update(task, description=event["stage"], completed=event["done"], total=event["total"])
                elif event["type"] == "state":
                    bar.update(task, description=event["state"])
    except KeyboardInterrupt:
        print(f"job {job} goes on; `lightwell job {job}` shows it, `lightwell cancel {job}` ends it", file=sys.stderr)
        raise typer.Exit(130) from None
    result = client.job(job)
    return Ended(result, result.state == "succeeded")
