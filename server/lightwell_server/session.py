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


_S = WorkerState
_AFTER: Mapping[WorkerState, frozenset[WorkerState]] = {
    _S.STOPPED: frozenset({_S.STARTING, _S.YIELDED}),
    _S.STARTING: frozenset({_S.RUNNING, _S.ENDED, _S.BACKING_OFF, _S.YIELDED, _S.STOPPING}),
    _S.RUNNING: frozenset({_S.ENDED, _S.BACKING_OFF, _S.YIELDED, _S.STOPPING}),
    _S.BACKING_OFF: frozenset({_S.STARTING, _S.YIELDED}),
    _S.YIELDED: frozenset({_S.STARTING}),
    _S.ENDED: frozenset(),
    _S.STOPPING: frozenset({_S.BACKING_OFF, _S.YIELDED}),
}
"""Beside these, every state may end in STOPPED."""


def follow(state: WorkerState, following: WorkerState) -> WorkerState:
    """Return ``following`` where it may come after ``state``; staying and stopping are always allowed.

    Raises
    ------
    ValueError
        Where it may not: names both and what was expected.
    """
    if following not in (state, WorkerState.STOPPED) and following not in _AFTER[state]:
        expected = ", ".join(sorted(_AFTER[state] | {WorkerState.STOPPED}))
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
