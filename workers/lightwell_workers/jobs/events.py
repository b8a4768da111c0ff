"""What happens to a job, as lines of JSON in a file that only grows.

An event's number is the file's size after its line. A reader that has seen number n goes on at byte n, after whatever
interruption. A line that was torn by a kill is cut off before the next one is written; readers take whole lines only.
"""

from __future__ import annotations

import contextlib
import json
import os
import threading
import time
from pathlib import Path
from typing import Any

import msgspec

SHORTEST_PAUSE_SECONDS = 0.25
"""Progress is told at most so often."""
TAIL_BYTES = 65536


class Progress(msgspec.Struct):
    """How far a job is."""

    stage: str
    done: int
    total: int
    rate: float
    """Units of ``total`` a second, in this run of the stage."""
    eta_seconds: float | None
    """Left of this stage."""


class EventLog:
    """Appends events; safe to use from several threads of the one process that works on the job."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._lock = threading.Lock()
        self._stage = ""
        self._stage_started = 0.0
        self._stage_first = 0
        self._last_progress = 0.0
        _heal(path)

    def append(self, kind: str, **fields: Any) -> None:  # noqa: ANN401
        """Write one event. A disk that is full loses it: the job's own writes say so."""
        line = json.dumps({"type": kind, "time_ns": time.time_ns(), **fields}, ensure_ascii=False) + "\n"
        with self._lock, contextlib.suppress(OSError), self._path.open("ab") as file:
            file.write(line.encode())

    def progress(self, stage: str, done: int, total: int) -> None:
        """Tell how far a stage is, with its rate and the time left; not every call is written."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._stage_started, self._stage_first = stage, now, done
        elif now - self._last_progress < SHORTEST_PAUSE_SECONDS and done < total:
            return
        self._last_progress = now
        elapsed = now - self._stage_started
        rate = (done - self._stage_first) / elapsed if elapsed > 0 else 0.0
        eta = (total - done) / rate if rate > 0 else None
        self.append("progress", stage=stage, done=done, total=total, rate=rate, eta_seconds=eta)


def _heal(path: Path) -> None:
    """Cut off a line that was not finished."""
    with contextlib.suppress(OSError), path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        start = max(0, size - TAIL_BYTES)
        file.seek(start)
        tail = file.read()
        if tail and not tail.endswith(b"\n"):
            file.truncate(start + tail.rfind(b"\n") + 1)


def read_events(path: Path, after: int = 0, limit: int = 1 << 20) -> list[tuple[int, dict[str, Any]]]:
    """Return (number, event) of the events after number ``after``, at most ``limit`` bytes of them."""
    try:
        with path.open("rb") as file:
            file.seek(after)
            data = file.read(limit)
    except OSError:
        return []
    events = []
    number = after
    for line in data.splitlines(keepends=True):
        if not line.endswith(b"\n"):
            break
        number += len(line)
        with contextlib.suppress(ValueError):
            events.append((number, json.loads(line)))
    return events


def last_progress(path: Path) -> Progress | None:
    """Return the newest progress event."""
    event = _last(path, "progress")
    with contextlib.suppress(msgspec.MsgspecError):
        return None if event is None else msgspec.convert(event, Progress)
    return None


def last_state(path: Path) -> str | None:
    """Return the newest state that is among the last events."""
    event = _last(path, "state")
    return None if event is None else str(event.get("state"))


def _last(path: Path, kind: str) -> dict[str, Any] | None:
    """Return the newest event of a kind that lies in the last `TAIL_BYTES`."""
    try:
        with path.open("rb") as file:
            file.seek(max(0, file.seek(0, os.SEEK_END) - TAIL_BYTES))
            lines = file.read().splitlines()
    except OSError:
        return None
    for line in reversed(lines):
        with contextlib.suppress(ValueError):
            event = json.loads(line)
            if isinstance(event, dict) and event.get("type") == kind:
                return event
    return None
