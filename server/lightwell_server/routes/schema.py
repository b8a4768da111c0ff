"""Bodies of the REST API."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field

from lightwell.conventions import Convention, Units
from lightwell.settings import StreamName, StreamSettings
from lightwell.wire import StreamState
from lightwell_server.catalogue import Entry, Origin
from lightwell_server.hub import Channel
from lightwell_server.masking import mask
from lightwell_server.session import WorkerState
from lightwell_server.supervisor import WorkerReport


class WorkerDescription(BaseModel):
    """The embedded ingest process of a stream."""

    state: WorkerState
    pid: int | None = None
    restarts: int = Field(0, description="starts after the first")
    last_error: str = Field("", description="why it was started again the last time")
    stderr_tail: list[str] = Field([], description="the last lines of its log")


class StreamDescription(BaseModel):
    """One stream: settings, state and counters. Credentials in source URLs are masked."""

    name: str
    origin: Origin = Field(description="file: lightwell.toml; api: kept in the data directory; worker: announced")
    revision: int = Field(description="counts changes through the API")
    settings: StreamSettings
    state: StreamState
    session: str | None = Field(None, description="names one run of the worker; null where none is connected")
    subscribers: int
    fps: float = Field(description="frames per second, as the worker measures it")
    frames_received: int = Field(description="frames that the server has taken since it started")
    frames_in: int = Field(description="counters of the worker's run from here")
    frames_published: int
    frames_skipped: int
    frames_dropped: int
    nan_samples: int
    infinite_samples: int
    negative_samples: int
    last_frame_age_seconds: float | None = None
    last_error: str
    stage_ms: dict[str, float] = Field(description="moving average of the milliseconds of each stage")
    worker: WorkerDescription | None = Field(None, description="null where the server starts none")


class StreamList(BaseModel):
    """All streams, by name."""

    streams: list[StreamDescription]


class StreamCreation(BaseModel):
    """A new stream."""

    model_config = ConfigDict(extra="forbid")

    name: StreamName
    settings: StreamSettings


class Latest(BaseModel):
    """The newest coefficients of a stream; ``lightwell watch --json`` prints the same keys."""

    stream: str
    session: str
    seq: int
    capture_time_ns: int
    ingest_time_ns: int
    publish_time_ns: int
    bands: int
    convention: Convention
    units: Units
    window: str = Field(description="kind of the window that was applied")
    window_weights: list[float]
    mapping: str
    coefficients: list[tuple[float, float, float]] = Field(description="bands² rows of [r, g, b]")
    position: tuple[float, float, float] | None = Field(
        None, description="where the probe stood, metres, in the convention's axes; null where that is not known"
    )
    gradients: list[list[tuple[float, float, float]]] | None = Field(
        None, description="where asked for: per metre, for each coefficient and colour, [d/dx, d/dy, d/dz]"
    )
    trust_radius_m: float | None = Field(
        None, description="how far from the probe coefficients and gradients are right to about ten per cent, metres"
    )
    dominant: dict[str, tuple[float, float, float]] | None = Field(None, description="direction, irradiance, ambient")
    quality: dict[str, Any]
    source_frame: str
    missed: int = Field(0, description="always 0 here: frames that a follower did not get")


def describe(entry: Entry, channel: Channel, report: WorkerReport | None, now: float) -> StreamDescription:
    """Return the description of a stream at the monotonic time ``now``."""
    status = channel.status
    publisher = channel.publisher
    settings = entry.settings if publisher is None or publisher.embedded else publisher.settings
    return StreamDescription(
        name=entry.name,
        origin=entry.origin,
        revision=entry.revision,
        settings=settings.model_copy(update={"source": mask(settings.source), "enabled": entry.settings.enabled}),
        state=channel.state,
        session=None if publisher is None else publisher.session,
        subscribers=len(channel.subscriptions),
        fps=status.fps if status else 0.0,
        frames_received=channel.counters.frames,
        frames_in=status.frames_in if status else 0,
        frames_published=status.frames_published if status else 0,
        frames_skipped=status.frames_skipped if status else 0,
        frames_dropped=status.frames_dropped if status else 0,
        nan_samples=status.nan_samples if status else 0,
        infinite_samples=status.infinite_samples if status else 0,
        negative_samples=status.negative_samples if status else 0,
        last_frame_age_seconds=None if channel.latest_at is None else round(now - channel.latest_at, 3),
        last_error=mask((status.last_error if status else "") or (report.last_error if report else "")),
        stage_ms=status.stage_ms if status else {},
        worker=report
        and WorkerDescription(
            state=report.state,
            pid=report.pid,
            restarts=report.restarts,
            last_error=mask(report.last_error),
            stderr_tail=list(report.stderr_tail),
        ),
    )
