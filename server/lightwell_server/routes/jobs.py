"""``/api/v1/jobs``: the queue of long work."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
from fastapi import APIRouter, Header, Query, Request, Response
from fastapi.responses import JSONResponse, StreamingResponse
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lightwell.job_settings import DEFAULT_PRIORITY, IgiRenderSettings, JobKind, JobState, PrtTransferSettings
from lightwell.settings import Settings
from lightwell_server.igi_inputs import file_of, igi_input
from lightwell_server.problems import Problem, invalid_input
from lightwell_server.routes.access import ADMIN, READ, problems
from lightwell_server.services import Services, services
from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.job import FINISHED, Job
from lightwell_workers.jobs.kinds import KINDS, load_kind
from lightwell_workers.jobs.workflow import memory_problem, space_problem

if TYPE_CHECKING:
    from lightwell_workers.jobs.queue import Queue

router = APIRouter(tags=["jobs"])

POLL_SECONDS = 0.25
KEEP_ALIVE_POLLS = 60
LARGEST_PAGE = 200


class JobSubmission(BaseModel):
    """A new job."""

    model_config = ConfigDict(extra="forbid")

    kind: JobKind
    settings: dict[str, Any] = Field(description="settings of the kind; GET /job-kinds gives their schema")
    priority: int = Field(DEFAULT_PRIORITY, ge=1, le=1_000_000, description="smaller is sooner")
    dry_run: bool = Field(False, description="only say what the job would need")


class EstimateDocument(BaseModel):
    """What a job would need."""

    seconds: float = Field(description="core time")
    memory_bytes: int = Field(description="in each compute process")
    disk_bytes: int = Field(description="results, and files while it runs")
    fits: bool = Field(description="whether quota, free disk and memory allow it now")
    reason: str | None = Field(None, description="why it does not fit")


class ProgressDocument(BaseModel):
    """How far a job is."""

    stage: str
    done: int
    total: int
    rate: float
    eta_seconds: float | None = None


class ArtifactSummary(BaseModel):
    """One result."""

    id: str
    path: str
    bytes: int
    sha256: str
    media_type: str


class JobDocument(BaseModel):
    """One job; times are nanoseconds since the Unix epoch."""

    id: str
    kind: JobKind
    state: JobState
    priority: int
    settings: dict[str, Any]
    progress: ProgressDocument | None
    attempts: int
    created: int
    started: int | None
    finished: int | None
    artifacts: list[ArtifactSummary]
    error: str | None = None
    preview_ns: int | None = Field(None, description="when GET /jobs/{id}/preview was drawn; null: there is none")


class JobPage(BaseModel):
    """Jobs, newest first."""

    jobs: list[JobDocument]
    next: str | None = Field(description="cursor of the following page; null on the last")


class KindDocument(BaseModel):
    """One kind of job."""

    name: JobKind
    description: str
    settings_schema: dict[str, Any] = Field(description="JSON schema of its settings")


def _document(parts: Services, job: Job) -> JobDocument:
    """Return what is shown of a job: a file that was sent is named by its upload, not by its place on the server."""
    document = msgspec.to_builtins(job)
    light = document["settings"].get("light")
    for settings, name in ((document["settings"], "mesh"), (document["settings"], "scene"), (light or {}, "map")):
        place = settings.get(name)
        if isinstance(place, str) and Path(place).is_relative_to(parts.uploads.root):
            settings[name] = Path(place).relative_to(parts.uploads.root).parts[0]
    if job.state == "running":
        document["preview_ns"] = _drawn_ns(JobDirectory(parts.jobs.root, job.id).preview)
    for artifact in document["artifacts"]:
        artifact.pop("files", None)
    return JobDocument.model_validate(document)


def _drawn_ns(picture: Path) -> int | None:
    with contextlib.suppress(OSError):
        return picture.stat().st_mtime_ns
    return None


@router.get("/job-kinds", dependencies=READ, responses=problems())
async def job_kinds() -> list[KindDocument]:
    """List the kinds of jobs with the schemas of their settings."""
    return [
        KindDocument(name=name, description=kind.description, settings_schema=kind.settings_type.model_json_schema())
        for name, kind in KINDS.items()
    ]


@router.post(
    "/jobs",
    status_code=202,
    dependencies=ADMIN,
    response_model=JobDocument | EstimateDocument,
    responses={
        200: {"description": "a dry run's estimate, or the job of a repeated key"},
        **problems(404, 409, 422, 503, 507),
    },
)
async def submit_job(
    request: Request,
    response: Response,
    submission: JobSubmission,
    idempotency_key: Annotated[
        str | None, Header(min_length=1, max_length=255, description="the same key and body give the same job")
    ] = None,
) -> JobDocument | EstimateDocument:
    """Submit a job, or say what it would need."""
    parts = services(request)
    earlier = None
    if idempotency_key is not None:
        earlier = await parts.jobs.call(lambda queue: queue.of_key(idempotency_key))
    settings = await asyncio.to_thread(_settings, parts, submission, earlier)
    # What has been submitted already needs no room again.
    if submission.dry_run or earlier is None:
        estimate = await asyncio.to_thread(_estimate, parts, submission.kind, settings)
        if submission.dry_run:
            response.status_code = 200
            return estimate
        if estimate.reason is not None:
            raise Problem(507, "no-room", estimate.reason)
    document = settings.model_dump(mode="json")
    job, is_new = await parts.jobs.call(
        lambda queue: queue.submit(submission.kind, document, priority=submission.priority, key=idempotency_key)
    )
    parts.jobs.executor.ensure()
    response.headers["Location"] = f"/api/v1/jobs/{job.id}"
    if not is_new:
        response.status_code = 200
    return _document(parts, job)


def _settings(parts: Services, submission: JobSubmission, earlier: Job | None) -> Settings:
    """Return the settings with places of captures and files in place of their ids; ``earlier``: of the same key."""
    try:
        settings = KINDS[submission.kind].settings_type.model_validate(submission.settings)
    except ValidationError as error:
        raise invalid_input(error.errors(), ("settings",)) from None
    if isinstance(settings, PrtTransferSettings):
        return settings.model_copy(update={"mesh": str(file_of(parts, settings.mesh, "mesh", "mesh"))})
    if isinstance(settings, IgiRenderSettings):
        return igi_input(parts, settings, earlier)
    directory = parts.captures.resolve(submission.settings["capture"])
    return settings.model_copy(update={"capture": str(directory)})


def _estimate(parts: Services, kind: JobKind, settings: Settings) -> EstimateDocument:
    """Return what the job needs."""
    need = load_kind(kind).estimate(settings, parts.captures.roots)
    reason = space_problem(parts.jobs.settings, parts.jobs.root, need.disk_bytes) or memory_problem(
        parts.jobs.settings, need.memory_bytes
    )
    return EstimateDocument(
        seconds=round(need.seconds, 3),
        memory_bytes=need.memory_bytes,
        disk_bytes=need.disk_bytes,
        fits=reason is None,
        reason=reason,
    )


@router.get("/jobs", dependencies=READ, responses=problems(422, 503))
async def list_jobs(
    request: Request,
    cursor: Annotated[str | None, Query(max_length=200, description="`next` of the page before")] = None,
    limit: Annotated[int, Query(ge=1, le=LARGEST_PAGE)] = 50,
    state: JobState | None = None,
    kind: JobKind | None = None,
) -> JobPage:
    """List the jobs, newest first; jobs that come meanwhile change no page that follows."""
    parts = services(request)
    if cursor is None and not parts.jobs.exists:
        return JobPage(jobs=[], next=None)  # looking does not make a queue where nobody has submitted anything
    jobs, following = await parts.jobs.call(lambda queue: queue.page(cursor, limit, state, kind))
    return JobPage(jobs=[_document(parts, job) for job in jobs], next=following)


@router.get("/jobs/{job}", dependencies=READ, responses=problems(404, 503))
async def get_job(request: Request, job: str) -> JobDocument:
    """Describe one job."""
    parts = services(request)
    return _document(parts, await parts.jobs.call(lambda queue: queue.get(job)))


@router.delete("/jobs/{job}", status_code=204, dependencies=ADMIN, responses=problems(404, 409, 503))
async def delete_job(request: Request, job: str) -> Response:
    """Delete a finished job and its results."""
    await services(request).jobs.call(lambda queue: queue.delete(job))
    return Response(status_code=204)


@router.post("/jobs/{job}/cancel", dependencies=ADMIN, responses=problems(404, 409, 503))
async def cancel_job(request: Request, job: str) -> JobDocument:
    """Cancel a job that is queued or runs."""
    parts = services(request)
    return _document(parts, await parts.jobs.call(lambda queue: queue.cancel(job)))


@router.post("/jobs/{job}/retry", dependencies=ADMIN, responses=problems(404, 409, 503))
async def retry_job(request: Request, job: str) -> JobDocument:
    """Queue a failed or cancelled job again; it goes on from its last checkpoint."""
    parts = services(request)
    result = await parts.jobs.call(lambda queue: queue.retry(job))
    parts.jobs.executor.ensure()
    return _document(parts, result)


@router.get("/jobs/{job}/preview", dependencies=READ, response_class=Response, responses=problems(404, 503))
async def job_preview(request: Request, job: str) -> Response:
    """Return a picture (PNG) of what a running job has so far; not every kind makes one, and not at once."""
    parts = services(request)
    found = await parts.jobs.call(lambda queue: queue.get(job))
    try:
        data = await asyncio.to_thread(JobDirectory(parts.jobs.root, found.id).preview.read_bytes)
    except OSError:
        raise Problem(
            404, "no-preview", f"there is no picture of job {job} yet, or no longer: it is {found.state}"
        ) from None
    return Response(data, media_type="image/png", headers={"Cache-Control": "private, no-cache"})


@router.get("/jobs/{job}/log", dependencies=READ, responses=problems(404, 503))
async def job_log(request: Request, job: str) -> JSONResponse:
    """Return the lines of the job's log, and its changes of state, as a list."""

    def read(queue: Queue) -> list[dict[str, Any]]:
        queue.get(job)
        lines: list[dict[str, Any]] = []
        after = 0
        while events := queue.events(job, after):
            after = events[-1][0]
            lines += [event for _, event in events if event.get("type") != "progress"]
        return lines

    return JSONResponse(await services(request).jobs.call(read))


@router.get(
    "/jobs/{job}/events",
    dependencies=READ,
    response_class=StreamingResponse,
    responses={200: {"content": {"text/event-stream": {}}}, **problems(404, 422, 503)},
)
async def job_events(
    request: Request, job: str, last_event_id: Annotated[int, Header(ge=0, description="go on after this event")] = 0
) -> StreamingResponse:
    """Follow a job as server-sent events ``state``, ``progress`` and ``log``; ends when the job has.

    The last event is ``end``, with the whole job. An interrupted reader goes on with ``Last-Event-ID``.
    """
    parts = services(request)
    await parts.jobs.call(lambda queue: queue.get(job))
    return StreamingResponse(
        _follow(parts, job, last_event_id), media_type="text/event-stream", headers={"Cache-Control": "no-store"}
    )


def _events(queue: Queue, job: str, after: int) -> list[tuple[int, dict[str, Any]]]:
    return queue.events(job, after)


async def _follow(parts: Services, job: str, after: int) -> AsyncIterator[str]:
    idle = 0
    while True:
        # The state first: what is written before a job ends is then in the events that are read next.
        state = (await parts.jobs.call(lambda queue: queue.get(job))).state
        events = await parts.jobs.call(partial(_events, job=job, after=after))
        for number, event in events:
            after = number
            yield f"id: {number}\nevent: {event['type']}\ndata: {json.dumps(event)}\n\n"
        idle = 0 if events else idle + 1
        if state in FINISHED and events:
            continue  # there may be more than are read at once
        if state in FINISHED:
            final = _document(parts, await parts.jobs.call(lambda queue: queue.get(job)))
            yield f"id: {after}\nevent: end\ndata: {final.model_dump_json()}\n\n"
            return
        if idle % KEEP_ALIVE_POLLS == KEEP_ALIVE_POLLS - 1:
            yield ": still here\n\n"
        await asyncio.sleep(POLL_SECONDS)
