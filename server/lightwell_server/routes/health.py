"""``/healthz``, ``/readyz`` and ``/metrics``: for those who run the server."""

from __future__ import annotations

import asyncio
import contextlib
import shutil
import time

from fastapi import APIRouter, Request, Response
from prometheus_client import CONTENT_TYPE_LATEST
from pydantic import BaseModel, Field

from lightwell_server.services import Services, services
from lightwell_workers.jobs.job import QueueError

router = APIRouter(tags=["health"])

MEGABYTE = 1 << 20


class Health(BaseModel):
    """The process answers."""

    status: str = "ok"


class Readiness(BaseModel):
    """Whether everything that was asked for works."""

    ready: bool
    reasons: list[str] = Field(description="what does not; empty where everything does")


@router.get("/healthz")
async def healthz() -> Health:
    """Say that the process is alive, whatever its sources do."""
    return Health()


@router.get("/readyz", responses={503: {"model": Readiness}})
async def readyz(request: Request, response: Response) -> Readiness:
    """Say whether streams have fresh frames, the disk has room and jobs can run; 503 with the reasons where not."""
    parts = services(request)
    reasons = [*_stale(parts), *await asyncio.to_thread(_disk, parts), *await _queue(parts)]
    if reasons:
        response.status_code = 503
    return Readiness(ready=not reasons, reasons=reasons)


@router.get("/metrics", response_class=Response)
async def metrics(request: Request) -> Response:
    """Return the metrics in the Prometheus text format."""
    parts = services(request)
    if parts.jobs.in_use:
        with contextlib.suppress(QueueError):
            parts.metrics.jobs = await parts.jobs.call(lambda queue: queue.counts())
    return Response(parts.metrics.text(), media_type=CONTENT_TYPE_LATEST)


async def _queue(parts: Services) -> list[str]:
    reasons = [f"jobs: {parts.jobs.executor.trouble}"] if parts.jobs.executor.trouble else []
    if parts.jobs.in_use:
        try:
            await parts.jobs.call(lambda queue: queue.page(limit=1))
        except QueueError as error:
            reasons.append(f"jobs: {error}")
    return reasons


def _stale(parts: Services) -> list[str]:
    now = time.monotonic()
    limit = parts.config.supervisor.stale_seconds
    reasons = []
    for channel in parts.hub:
        if not channel.settings.enabled or channel.state == "ended":
            continue
        if channel.latest_at is None:
            reasons.append(f"stream {channel.name}: no frame yet ({channel.state})")
        elif now - channel.latest_at > channel.patience_seconds(limit):
            reasons.append(f"stream {channel.name}: last frame {now - channel.latest_at:.1f} s ago ({channel.state})")
    return reasons


def _disk(parts: Services) -> list[str]:
    wanted = parts.config.server.min_free_mb
    try:
        free = shutil.disk_usage(parts.config.server.data_dir).free // MEGABYTE
    except OSError as error:
        return [f"data directory: {error.strerror}"]
    return [f"disk: {free} MB free, {wanted} MB wanted"] if free < wanted else []
