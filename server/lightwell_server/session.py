"""The states that the server keeps, and which may follow which."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from enum import StrEnum


class WorkerState(StrEnum):
    """State of the embedded ingest process of one stream."""

    STOPPED = "stopped"
    """Not wanted: the stream is disabled, or the server is shutting down."""
    STARTING = "starting"
    """The process runs; no frame has come yet."""
    RUNNING = "running"
    """Frames come."""
    BACKING_OFF = "backing-off"
    """The process ended; it starts again after a pause."""
    YIELDED = "yielded"
    """A worker that was started elsewhere publishes this stream."""
    ENDED = "ended"
    """The source came to its end; there is nothing to restart."""
    STOPPING = "stopping"
    """The process has been told to end."""


_AFTER: Mapping[WorkerState, frozenset[WorkerState]] = {
    WorkerState.STOPPED: frozenset({WorkerState.STARTING, WorkerState.YIELDED}),
    WorkerState.STARTING: frozenset(
        {WorkerState.RUNNING, WorkerState.BACKING_OFF, WorkerState.ENDED, WorkerState.STOPPING, WorkerState.YIELDED}
    ),
    WorkerState.RUNNING: frozenset(
        {WorkerState.BACKING_OFF, WorkerState.ENDED, WorkerState.STOPPING, WorkerState.YIELDED}
    ),
    WorkerState.BACKING_OFF: frozenset({WorkerState.STARTING, WorkerState.YIELDED, WorkerState.STOPPED}),
    WorkerState.YIELDED: frozenset({WorkerState.STARTING, WorkerState.STOPPED}),
    WorkerState.ENDED: frozenset({WorkerState.STOPPED}),
    WorkerState.STOPPING: frozenset({WorkerState.STOPPED}),
}


def follow(state: WorkerState, following: WorkerState) -> WorkerState:
    """Return ``following`` where it may come after ``state``; staying is always allowed.

    Raises
    ------
    ValueError
        Where it may not: names both and what was expected.
    """
    if following is not state and following not in _AFTER[state]:
        expected = ", ".join(sorted(_AFTER[state]))
        raise ValueError(f"a worker that is {state} cannot become {following}; expected one of: {expected}")
    return following


class SubscriberState(StrEnum):
    """State of one subscription."""

    OPEN = "open"
    CLOSING = "closing"
    """The server has decided to end it; what waits is no longer sent."""
    CLOSED = "closed"


def new_session() -> str:
    """Return a name for one run of the server or of a worker."""
    return secrets.token_hex(8)
