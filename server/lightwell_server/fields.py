"""Fields: several streams whose probes stand at known places, and the light between them.

A field is a list of names. What its members give is looked up whenever it is asked for, so that streams may come, go
and move: a member that gives no light now is left out, and says why.
"""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import structlog
from pydantic import JsonValue, ValidationError

from lightwell.conventions import coefficient_count
from lightwell.gradients.interpolate import SampleSet
from lightwell.settings import FieldSettings
from lightwell.wire import FieldMember, Frame, Vector3, unpack_coefficients, unpack_gradients
from lightwell_server.catalogue import Catalogue, Origin, etag_of, merge_patch, require_match
from lightwell_server.hub import Channel
from lightwell_server.problems import FieldError, Problem, invalid_input
from lightwell_server.store import Store

ONE_PLACE_M = 1e-3
"""Two probes nearer than this say the same twice."""

log = structlog.get_logger("fields")


@dataclass
class FieldEntry:
    """One field."""

    name: str
    settings: FieldSettings
    origin: Origin
    revision: int = 0

    @property
    def etag(self) -> str:
        """Names these settings in HTTP headers."""
        return etag_of(self.settings)


@dataclass(frozen=True)
class Member:
    """What one stream gives to a field now."""

    told: FieldMember
    channel: Channel | None
    frame: Frame | None = None
    """The newest one; None where ``told.problem`` says why there is none to be used."""
    position: Vector3 | None = None
    """Where its probe stands, world metres, as far as that is known."""


class Fields:
    """The fields by name."""

    def __init__(self, catalogue: Catalogue, store: Store, configured: dict[str, FieldSettings]) -> None:
        self._catalogue = catalogue
        self._store = store
        self._configured = configured
        self._entries: dict[str, FieldEntry] = {}
        self._lock = asyncio.Lock()
        self.followers: Counter[str] = Counter()
        """Sockets that follow each field."""

    def load(self) -> None:
        """Read the file's fields and the store's."""
        for name, settings in self._configured.items():
            self._entries[name] = FieldEntry(name, settings, Origin.FILE)
        for name, row in self._store.all("fields").items():
            try:
                settings = FieldSettings.model_validate_json(row.settings)
            except ValidationError as error:
                log.error("stored field cannot be used", field=name, reason=str(error.errors()[0]["msg"]))
                continue
            self._entries[name] = FieldEntry(name, settings, Origin.API, row.revision)

    def entries(self) -> list[FieldEntry]:
        """Return the fields: those of the file in its order, then the others by name."""
        others = sorted(self._entries.keys() - self._configured.keys())
        return [self._entries[name] for name in (*self._configured, *others) if name in self._entries]

    def entry(self, name: str) -> FieldEntry:
        """Return a field; raises the 404 problem where there is none of that name."""
        entry = self._entries.get(name)
        if entry is None:
            known = ", ".join(sorted(self._entries)) or "none yet"
            raise Problem(404, "no-such-field", f"there is no field {name!r}; there are: {known}")
        return entry

    async def create(self, name: str, settings: FieldSettings) -> FieldEntry:
        """Add a field and keep it.

        Raises the 409 problem where the name is taken, 422 where its streams do not go together, 507 where it cannot
        be kept.
        """
        self._require_usable(settings, "settings.")
        async with self._lock:
            if name in self._entries:
                raise Problem(409, "field-exists", f"there is a field {name!r} already: PATCH it, or take another name")
            return await self._keep(FieldEntry(name, settings, Origin.API, 1))

    async def update(self, name: str, patch: dict[str, JsonValue], if_match: str | None) -> FieldEntry:
        """Apply a JSON merge patch and keep the result; raises as `Catalogue.update`, and as `create`."""
        async with self._lock:
            entry = self.entry(name)
            require_match("field", entry.etag, if_match)
            try:
                settings = FieldSettings.model_validate(merge_patch(entry.settings.model_dump(mode="json"), patch))
            except ValidationError as error:
                raise invalid_input(error.errors()) from None
            self._require_usable(settings, "")
            return await self._keep(FieldEntry(name, settings, Origin.API, entry.revision + 1))

    async def delete(self, name: str, if_match: str | None) -> FieldEntry | None:
        """Forget what the API knows of a field; returns the file's of that name, which applies again, or None.

        Raises the 404 problem where there is none, 409 where the file alone has it, 412 where ``if_match`` names
        another version, 507 where the change cannot be kept.
        """
        async with self._lock:
            entry = self.entry(name)
            require_match("field", entry.etag, if_match)
            if entry.origin is Origin.FILE:
                raise Problem(409, "field-in-file", f"the field {name!r} is in the configuration file: remove it there")
            await asyncio.to_thread(self._store.delete, "fields", name)
            del self._entries[name]
            if name in self._configured:
                self._entries[name] = FieldEntry(name, self._configured[name], Origin.FILE)
            return self._entries.get(name)

    def survey(self, name: str) -> list[Member]:
        """Return what the members of a field give now, in its order; raises as `entry`."""
        return list(self._survey(self.entry(name).settings))

    def _survey(self, settings: FieldSettings) -> Iterator[Member]:
        used: list[Member] = []
        for stream in settings.streams:
            channel = self._catalogue.find(stream)
            member = _look(stream, channel, used)
            if member.frame is not None:
                used.append(member)
            yield member

    def _require_usable(self, settings: FieldSettings, prefix: str) -> None:
        """Raise the 422 problem where a stream is unknown, or what is known of them now does not go together."""
        errors = []
        places: dict[str, Vector3] = {}
        for index, stream in enumerate(settings.streams):
            channel, problem = self._catalogue.find(stream), ""
            place = None if channel is None else _place(channel)
            if channel is None:
                problem = f"there is no stream {stream!r}: create it first"
            elif place is not None:
                places[stream] = place
            elif channel.latest is not None:
                problem = f"of {stream!r} {_NO_PLACE}"
            if problem:
                errors.append(FieldError(field=f"{prefix}streams.{index}", message=problem))
        for (one, here), (other, there) in combinations(places.items(), 2):
            if _is_one_place(here, there):
                message = (
                    f"the probes of {one!r} and {other!r} stand at one place: leave one out, or correct position_m"
                )
                errors.append(FieldError(field=f"{prefix}streams", message=message))
        if errors:
            detail = "; ".join(f"{error.field}: {error.message}" for error in errors)
            raise Problem(422, "invalid-input", detail, errors=errors)

    async def _keep(self, entry: FieldEntry) -> FieldEntry:
        await asyncio.to_thread(self._store.put, "fields", entry.name, entry.settings.model_dump_json(), entry.revision)
        self._entries[entry.name] = entry
        log.info("field changed", field=entry.name, revision=entry.revision, streams=list(entry.settings.streams))
        return entry


_NO_PLACE = 'the probe\'s place is not known: PATCH the stream with {"position_m": [x, y, z]}, world metres'


def _place(channel: Channel) -> Vector3 | None:
    """Return where a stream's probe is: as its newest frame says, else as its settings do."""
    if channel.latest is not None and channel.latest.position is not None:
        return channel.latest.position
    return channel.settings.position_m


def _is_one_place(here: Vector3, there: Vector3) -> bool:
    return float(np.linalg.norm(np.subtract(here, there))) < ONE_PLACE_M


def _look(stream: str, channel: Channel | None, used: list[Member]) -> Member:
    """Return what a stream gives beside those that are used already."""
    if channel is None:
        return Member(FieldMember(stream=stream, state="unknown", problem="there is no such stream now"), None)
    state, frame, place = channel.state, channel.latest, _place(channel)
    problem = ""
    if state in ("stalled", "stopped", "failed"):
        said = channel.status.last_error if channel.status else ""
        problem = f"the stream is {state}{said and ': '}{said}"
    elif frame is None:
        problem = "the stream has had no frame yet"
    elif place is None:
        problem = _NO_PLACE
    elif used and used[0].frame is not None and used[0].frame.units != frame.units:
        problem = (
            f"its unit is {frame.units}, that of {used[0].told.stream!r} {used[0].frame.units}: set units and gain"
        )
    else:
        same = next((one for one in used if one.position is not None and _is_one_place(one.position, place)), None)
        if same is not None:
            problem = f"its probe stands where that of {same.told.stream!r} does: move one, or leave one out"
    told = FieldMember(stream=stream, state=state, problem=problem)
    return Member(told, channel, None if problem else frame, place)


def sample_set(members: list[Member], bands: int | None, *, gradients: bool = True) -> SampleSet:
    """Return the light of the members that give any, with as many bands as all of them have and ``bands`` at most.

    Gradients are used of those that have them, unless they are not wanted.

    Raises
    ------
    ValueError
        Where no member gives light.
    """
    frames = [member.frame for member in members if member.frame is not None]
    if not frames:
        raise ValueError("no stream of the field gives light now")
    count = coefficient_count(min([frame.bands for frame in frames] + ([bands] if bands else [])))
    changes = [
        unpack_gradients(frame.gradients)[:count] if gradients and frame.gradients is not None else None
        for frame in frames
    ]
    return SampleSet(
        np.array([member.position for member in members if member.frame is not None], dtype=np.float64),
        np.stack([unpack_coefficients(frame.coefficients)[:count] for frame in frames]),
        changes,
    )
