"""Which streams there are and how they are set: the configuration file, then the store, then workers that announce.

The catalogue tells the hub and the supervisor about each change; nobody else changes streams.
"""

from __future__ import annotations

import asyncio
import hashlib
from dataclasses import dataclass
from enum import StrEnum
from typing import Protocol

import structlog
from pydantic import JsonValue, ValidationError

from lightwell.settings import Settings, StreamSettings
from lightwell_server.feasible import require_feasible
from lightwell_server.hub import RESTART_KEYS, Channel, Hub
from lightwell_server.masking import mask, unmask
from lightwell_server.problems import Problem, invalid_input
from lightwell_server.store import Store

log = structlog.get_logger("streams")


class Origin(StrEnum):
    """Where a stream's settings come from."""

    FILE = "file"
    """The configuration file."""
    API = "api"
    """The API; kept in the data directory."""
    WORKER = "worker"
    """A worker that published a name nobody had configured; forgotten when the server stops."""


@dataclass
class Entry:
    """One stream."""

    name: str
    settings: StreamSettings
    origin: Origin
    revision: int = 0

    @property
    def etag(self) -> str:
        """Names these settings in HTTP headers: a digest of what the API shows of them."""
        return etag_of(self.settings.model_copy(update={"source": mask(self.settings.source)}))

    def require_match(self, if_match: str | None) -> None:
        """Raise the 412 problem where an ``If-Match`` header names only other settings."""
        require_match("stream", self.etag, if_match)


def etag_of(shown: Settings) -> str:
    """Return a digest of settings, as HTTP writes it."""
    return f'"{hashlib.sha256(shown.model_dump_json().encode()).hexdigest()[:16]}"'


def require_match(kind: str, etag: str, if_match: str | None) -> None:
    """Raise the 412 problem where an ``If-Match`` header (RFC 9110 §13.1.1) names only other settings."""
    if if_match is not None and not {"*", etag} & {tag.strip() for tag in if_match.split(",")}:
        raise Problem(412, "changed-meanwhile", f"the {kind} is now version {etag}: read it again")


class WorkerControl(Protocol):
    """What the catalogue asks of the supervisor."""

    def apply(self, name: str, settings: StreamSettings) -> None:
        """Start, restart or stop the embedded worker as the settings want it; a change it can follow does nothing."""

    async def remove(self, name: str) -> None:
        """Stop the embedded worker and forget the stream."""


class Catalogue:
    """The streams by name."""

    def __init__(self, hub: Hub, store: Store, workers: WorkerControl, configured: dict[str, StreamSettings]) -> None:
        self._hub = hub
        self._store = store
        self._workers = workers
        self._configured = configured
        self._entries: dict[str, Entry] = {}
        self._lock = asyncio.Lock()

    def load(self) -> None:
        """Read the file's streams and the store's, open their channels and start their workers."""
        for name, settings in self._configured.items():
            self._entries[name] = Entry(name, settings, Origin.FILE)
        for name, row in self._store.all("streams").items():
            try:
                settings = StreamSettings.model_validate_json(row.settings)
            except ValidationError as error:
                log.error("stored stream cannot be used", stream=name, reason=str(error.errors()[0]["msg"]))
                continue
            self._entries[name] = Entry(name, settings, Origin.API, row.revision)
        for entry in self._entries.values():
            self._hub.open(entry.name, entry.settings)
            self._workers.apply(entry.name, entry.settings)

    def entries(self) -> list[Entry]:
        """Return the streams: those of the file in its order, then the others by name."""
        others = sorted(self._entries.keys() - self._configured.keys())
        return [self._entries[name] for name in (*self._configured, *others) if name in self._entries]

    def find(self, name: str) -> Channel | None:
        """Return a stream's channel, or None where there is no stream of that name."""
        return self._hub.get(name) if name in self._entries else None

    def entry(self, name: str) -> Entry:
        """Return a stream; raises the 404 problem where there is none of that name."""
        entry = self._entries.get(name)
        if entry is None:
            known = ", ".join(sorted(self._entries)) or "none yet"
            raise Problem(404, "no-such-stream", f"there is no stream {name!r}; there are: {known}")
        return entry

    def channel(self, name: str) -> Channel:
        """Return a stream's channel; raises as `entry`."""
        channel = self._hub.get(self.entry(name).name)
        assert channel is not None
        return channel

    async def create(self, name: str, settings: StreamSettings) -> Entry:
        """Add a stream and keep it.

        Raises the 409 problem where the name is taken, 422 where the settings can never work, 507 where they cannot
        be kept.
        """
        await asyncio.to_thread(require_feasible, settings, "settings.")
        async with self._lock:
            if name in self._entries:
                raise Problem(
                    409, "stream-exists", f"there is a stream {name!r} already: PATCH it, or take another name"
                )
            entry = Entry(name, settings, Origin.API, 1)
            await self._keep(entry)
            self._hub.open(name, settings)
            self._workers.apply(name, settings)
            return entry

    async def update(self, name: str, patch: dict[str, JsonValue], if_match: str | None) -> Entry:
        """Apply a JSON merge patch (RFC 7396) to a stream's settings and keep the result.

        The worker follows at once; a new source, mapping or ``enabled`` restarts the embedded one.

        Raises
        ------
        Problem
            404 where there is no such stream, 412 where ``if_match`` names another version, 422 where the result is
            not valid or can never work, 507 where it cannot be kept: nothing is changed then.
        """
        async with self._lock:
            entry = self.entry(name)
            entry.require_match(if_match)
            merged = merge_patch(entry.settings.model_dump(mode="json"), patch)
            if isinstance(source := merged.get("source"), str):
                merged["source"] = unmask(source, entry.settings.source)
            try:
                settings = StreamSettings.model_validate(merged)
            except ValidationError as error:
                raise invalid_input(error.errors()) from None
            await asyncio.to_thread(require_feasible, settings)
            changed = Entry(name, settings, Origin.API, entry.revision + 1)
            await self._keep(changed)
            channel = self._hub.open(name, settings)
            self._workers.apply(name, settings)
            channel.reconfigure(settings)
            return changed

    async def delete(self, name: str, if_match: str | None) -> Entry | None:
        """Forget what the API knows of a stream.

        Returns the file's stream of that name, which applies again, or None where the stream is gone. Raises the 404
        problem where there is none, 409 where the file alone has it, 412 where ``if_match`` names another version.
        """
        async with self._lock:
            entry = self.entry(name)
            entry.require_match(if_match)
            if entry.origin is Origin.FILE:
                raise Problem(
                    409,
                    "stream-in-file",
                    f"the stream {name!r} is in the configuration file: remove it there,"
                    ' or PATCH {"enabled": false} to stop it',
                )
            await asyncio.to_thread(self._store.delete, "streams", name)
            if name in self._configured:
                restored = Entry(name, self._configured[name], Origin.FILE)
                self._entries[name] = restored
                channel = self._hub.open(name, restored.settings)
                self._workers.apply(name, restored.settings)
                channel.reconfigure(restored.settings)
                return restored
            del self._entries[name]
            self._hub.remove(name)  # before the wait: a worker that announces meanwhile gets a channel of its own
            await self._workers.remove(name)
            return None

    def announce(self, name: str, announced: StreamSettings, *, embedded: bool) -> tuple[Channel, StreamSettings]:
        """Return the channel that a worker publishes to and the settings it shall use.

        What is configured wins over what the worker announces, except for the source and the mapping of a worker that
        was started elsewhere: it knows its pictures. A name that nobody configured becomes a stream of its own.

        Raises
        ------
        Problem
            404 where an embedded worker announces a stream that has been deleted while the worker started.
        """
        entry = self.entry(name) if embedded else self._entries.get(name)
        if entry is None or entry.origin is Origin.WORKER:
            settings = announced.model_copy(update={"enabled": False})
            revision = entry.revision + 1 if entry else 0
            self._entries[name] = Entry(name, settings, Origin.WORKER, revision)
            return self._hub.open(name, settings), settings
        settings = entry.settings
        if not embedded:
            settings = settings.model_copy(update={key: getattr(announced, key) for key in RESTART_KEYS})
        channel = self._hub.get(name)
        assert channel is not None
        return channel, settings

    async def _keep(self, entry: Entry) -> None:
        await asyncio.to_thread(
            self._store.put, "streams", entry.name, entry.settings.model_dump_json(), entry.revision
        )
        self._entries[entry.name] = entry
        log.info("stream changed", stream=entry.name, revision=entry.revision, source=mask(entry.settings.source))


def merge_patch(target: dict[str, JsonValue], patch: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """Return ``target`` with a JSON merge patch applied (RFC 7396): null removes, which restores a default."""
    merged = dict(target)
    for key, value in patch.items():
        if value is None:
            merged.pop(key, None)
        elif isinstance(value, dict):
            inner = merged.get(key)
            merged[key] = merge_patch(inner if isinstance(inner, dict) else {}, value)
        else:
            merged[key] = value
    return merged
