"""``lightwell submit``, ``jobs``, ``job``, ``cancel`` and ``retry``: the queue, through the API."""

from __future__ import annotations

import json as json_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from lightwell_server.cli.connection import JSON, SERVER, TOKEN, as_document, connect, describe_progress, follow
from lightwell_server.cli.connection import print_job as show

if TYPE_CHECKING:
    from lightwell_client import Job


def submit(
    kind: str = typer.Argument(help="ilf-grid, prt-transfer, capture-reduce or igi-render."),
    param: list[str] = typer.Option(
        [], "--param", "-p", metavar="K=V", help="A setting; V is JSON or text, K may be dotted (window.kind=nonneg)."
    ),
    priority: int = typer.Option(100, min=1, help="Smaller is sooner."),
    key: str | None = typer.Option(None, help="Idempotency key: the same key and settings give the same job."),
    dry_run: bool = typer.Option(False, "--dry-run", help="Only say what the job would need."),
    wait: bool = typer.Option(False, "--wait", help="Wait for the end; exit status 1 where it fails."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Submit a job of KIND."""
    settings = _settings(param)
    with connect(server, token) as client:
        if dry_run:
            estimate = client.estimate(kind, settings)
            if json:
                import msgspec

                print(msgspec.json.encode(estimate).decode())
            else:
                print(
                    f"{estimate.seconds:.0f} s of core time, {estimate.memory_bytes >> 20} MB of memory a process, "
                    f"{estimate.disk_bytes >> 20} MB of disk; {estimate.reason or 'it fits'}"
                )
            raise typer.Exit(0 if estimate.fits else 1)
        job = client.submit(kind, settings, priority=priority, key=key)
        if not wait:
            show(job, as_json=json)
            return
        ended = follow(client, job.id, quiet=json)
        show(ended.job, as_json=json)
        raise typer.Exit(0 if ended.ok else 1)


def jobs(
    state: str | None = typer.Option(None, help="Only jobs in this state."),
    kind: str | None = typer.Option(None, help="Only jobs of this kind."),
    limit: int = typer.Option(20, min=1, max=100_000, help="At most this many."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = typer.Option(False, "--json", help="Print one job a line as JSON."),
) -> None:
    """List the jobs, newest first."""
    found: list[Job] = []
    with connect(server, token) as client:
        cursor = None
        while len(found) < limit:
            page = client.jobs(cursor=cursor, limit=min(200, limit - len(found)), state=state, kind=kind)
            found += page.jobs
            cursor = page.next
            if cursor is None:
                break
    if json:
        for job in found:
            print(json_module.dumps(as_document(job)))
        return
    from rich.console import Console
    from rich.table import Table

    table = Table()
    for heading in ("id", "kind", "state", "progress", "attempts", "error"):
        table.add_column(heading, overflow="fold")
    for job in found:
        progress = describe_progress(job) if job.state == "running" else ""
        table.add_row(job.id, job.kind, job.state, progress, str(job.attempts), job.error or "")
    Console().print(table)


def job(
    job: str = typer.Argument(help="Id of the job."),
    log: bool = typer.Option(False, "--log", help="Print its log."),
    wait: bool = typer.Option(False, "--follow", help="Wait for its end."),
    download: Path | None = typer.Option(None, help="Write its results into this folder."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Show one job."""
    with connect(server, token) as client:
        if log:
            for line in client.job_log(job):
                print(json_module.dumps(line))
            return
        found = follow(client, job, quiet=json).job if wait else client.job(job)
        if download is not None:
            download.mkdir(parents=True, exist_ok=True)
            for artifact in found.artifacts:
                client.download(artifact.id, download / artifact.path)
        show(found, as_json=json)


def cancel(
    job: str = typer.Argument(help="Id of the job."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Cancel a job that is queued or runs."""
    with connect(server, token) as client:
        show(client.cancel(job), as_json=json)


def retry(
    job: str = typer.Argument(help="Id of the job."),
    wait: bool = typer.Option(False, "--wait", help="Wait for the end; exit status 1 where it fails."),
    server: str = SERVER,
    token: str | None = TOKEN,
    json: bool = JSON,
) -> None:
    """Queue a failed or cancelled job again; it goes on from its last checkpoint."""
    with connect(server, token) as client:
        found = client.retry(job)
        if wait:
            ended = follow(client, job, quiet=json)
            show(ended.job, as_json=json)
            raise typer.Exit(0 if ended.ok else 1)
        show(found, as_json=json)


def _settings(params: list[str]) -> dict[str, Any]:
    """Return settings from ``K=V`` options."""
    settings: dict[str, Any] = {}
    for text in params:
        name, separator, value = text.partition("=")
        if not separator or not name:
            raise typer.BadParameter(f"{text!r}: write K=V", param_hint="--param")
        place = settings
        *path, last = name.split(".")
        for part in path:
            place = place.setdefault(part, {})
            if not isinstance(place, dict):
                raise typer.BadParameter(f"{text!r}: {part} has a value already", param_hint="--param")
        try:
            place[last] = json_module.loads(value)
        except ValueError:
            place[last] = value
    return settings
