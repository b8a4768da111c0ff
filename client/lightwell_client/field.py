"""Follow a field: the light between several probes that stand at known places."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray
from websockets.asyncio.client import ClientConnection

from lightwell.conventions import Convention, coefficient_count
from lightwell.gradients.interpolate import Method, SampleSet
from lightwell.wire import FieldHello, FieldMember, FieldStatus, Frame, Missed, Refused, decode_field
from lightwell_client.blocking import Blocking
from lightwell_client.errors import LightTimeoutError
from lightwell_client.follow import DEFAULT_SERVER, Follower, socket_url
from lightwell_client.frames import LightFrame

ONE_PLACE_M = 1e-3
"""Two probes nearer than this say the same twice."""


@dataclass(frozen=True, eq=False)
class FieldLight:
    """The light of a field at one moment: the newest frame of each stream that gives light."""

    field: str
    frames: Mapping[str, LightFrame]
    """By stream; all have a position."""
    problems: Mapping[str, str]
    """Why the other streams of the field are left out, by stream."""

    @property
    def positions(self) -> NDArray[np.float64]:
        """Where the probes stand, ``(n, 3)`` metres in the convention's axes, in the order of ``frames``."""
        return self.samples.positions

    @cached_property
    def samples(self) -> SampleSet:
        """The frames as samples, with the bands that all have, and the gradients of those that have them."""
        frames = list(self.frames.values())
        count = coefficient_count(min(frame.bands for frame in frames))
        return SampleSet(
            np.array([frame.position for frame in frames], dtype=np.float64),
            np.stack([frame.coefficients[:count] for frame in frames]),
            [None if frame.gradients is None else frame.gradients[:count] for frame in frames],
        )

    def at(self, points: ArrayLike, method: Method = "barycentric") -> NDArray[np.float32]:
        """Return the coefficients ``(…, bands², 3)`` at points ``(…, 3)``, metres in the convention's axes.

        One probe: extrapolated with its gradient. Two: along their line; three: in their triangle; more: in the
        tetrahedra between them; with half of each gradient between and the whole one outside (MATHS §7.8). ``shepard``
        weighs all probes by their distance instead.
        """
        return self.samples.at(points, method).astype(np.float32)


class AsyncField(Follower):
    """The light of a field, as it comes.

    An asynchronous context manager and iterator over `FieldLight`::

        async with AsyncField("stage", convention="three") as field:
            async for light in field:                     # whenever a probe has seen something new
                relight(light.at(places))                 # (n, 25, 3) float32 at (n, 3) metres

    Parameters
    ----------
    field
        Name of the field.
    server, bands, convention, max_fps, reconnect, timeout, token, on_connection
        As in `AsyncLightStream`; ``max_fps`` is that of each stream.
    on_members
        Called with the list of `FieldMember` when it is known and whenever it changes: which streams give light, and
        why the others do not.

    Raises
    ------
    RefusedError
        Where the server refuses: no such field, a wrong token or parameter.
    """

    def __init__(
        self,
        field: str,
        server: str = DEFAULT_SERVER,
        *,
        bands: int | None = None,
        convention: Convention = "lightwell",
        max_fps: float | None = None,
        reconnect: bool = True,
        timeout: float | None = None,
        token: str | None = None,
        on_members: Callable[[list[FieldMember]], object] | None = None,
        on_connection: Callable[[bool], object] | None = None,
    ) -> None:
        super().__init__(
            field,
            socket_url(server, "fields", field),
            {"bands": bands, "convention": convention, "max_fps": max_fps},
            reconnect=reconnect,
            token=token,
            on_connection=on_connection,
        )
        self.field = field
        self._timeout = timeout
        self._on_members = on_members
        self._frames: dict[str, LightFrame] = {}
        self._light: FieldLight | None = None
        self._is_stale = False
        self._is_new = False
        self._untold: dict[str, int] = {}
        self.members: list[FieldMember] = []
        """The streams of the field, and why those that give no light do not."""

    def __aiter__(self) -> Self:
        return self

    async def __anext__(self) -> FieldLight:
        return await self.next()

    async def next(self, within_seconds: float | None = None) -> FieldLight:
        """Return the light when there is newer; ``within_seconds`` comes before the field's own ``timeout``.

        Raises
        ------
        LightTimeoutError
            Where none came in time; says which streams give no light.
        RefusedError, ConnectionLostError
            As the class says.
        """
        self._require_entered()
        seconds = self._timeout if within_seconds is None else within_seconds
        try:
            async with asyncio.timeout(seconds):
                while not self._is_new or (light := self.latest()) is None:
                    self._raise_failure()
                    self._arrived.clear()
                    await self._arrived.wait()
                return light
        except TimeoutError:
            raise LightTimeoutError(f"no light of {self.field!r} within {seconds:g} s{self._reasons()}") from None

    def latest(self) -> FieldLight | None:
        """Return the newest light at once; None where no stream gives any. Raises as `next`, but for the time-out.

        It stays while the connection is away, and while the frame of a stream that gives light again is on its way.
        """
        self._require_entered()
        self._raise_failure()
        self._is_new = False
        light = self._combine()
        return light if self._giving() else None

    def at(self, points: ArrayLike, method: Method = "barycentric") -> NDArray[np.float32]:
        """Return the newest light at points (`FieldLight.at`); where no stream gives any now, the last there was.

        Raises `LightTimeoutError` where there has been none yet.
        """
        return self.last().at(points, method)

    def last(self) -> FieldLight:
        """Return the newest light there has been; raises `LightTimeoutError` where there has been none yet."""
        light = self.latest() or self._light
        if light is None:
            raise LightTimeoutError(f"no light of {self.field!r} yet{self._reasons()}: wait for it with next()")
        return light

    def _giving(self) -> list[str]:
        return [member.stream for member in self.members if not member.problem]

    def _is_complete(self) -> bool:
        """Whether a frame of each stream that gives light has come: light of a part of them would be another."""
        giving = self._giving()
        return bool(giving) and all(name in self._frames for name in giving)

    def _combine(self) -> FieldLight | None:
        if self._is_stale and self._is_complete():
            problems = {member.stream: member.problem for member in self.members if member.problem}
            frames: dict[str, LightFrame] = {}
            for name in self._giving():
                if clash := _clash(self._frames[name], frames):
                    problems[name] = clash
                else:
                    frames[name] = self._frames[name]
            self._light = FieldLight(self.field, frames, problems)
            self._is_stale = False
        return self._light

    def _reasons(self) -> str:
        reasons = [f"{member.stream}: {member.problem}" for member in self.members if member.problem]
        if self.last_error:
            reasons.append(self.last_error)
        return f" ({'; '.join(reasons)})" if reasons else ""

    async def _wait_for_room(self) -> None:
        """Only the newest frame of each stream is kept: there is always room."""

    async def _receive(self, connection: ClientConnection, data: bytes) -> None:
        match message := decode_field(data):
            case Frame():
                if message.position is not None:
                    missed = self._untold.pop(message.stream, 0)
                    self._frames[message.stream] = LightFrame.from_wire(
                        message, mapping="", received_time_ns=time.time_ns(), missed=missed
                    )
                    self._changed()
            case Missed():
                self._untold[message.stream] = self._untold.get(message.stream, 0) + message.count
            case FieldHello():
                self._frames.clear()
                self._greeted(connection, message.heartbeat_seconds)
                self._note(message.members)
            case FieldStatus():
                self._note(message.members)
            case Refused():
                await self._end_refused(connection, message.reason)

    def _note(self, members: list[FieldMember]) -> None:
        self.members = members
        giving = {member.stream for member in members if not member.problem}
        self._frames = {name: frame for name, frame in self._frames.items() if name in giving}
        self._changed()
        self._tell(self._on_members, members)

    def _changed(self) -> None:
        self._is_stale = True
        self._is_new = self._is_complete()
        self._arrived.set()


def _clash(frame: LightFrame, used: Mapping[str, LightFrame]) -> str:
    """Return why a frame cannot be used beside others: the server looks less often than frames come."""
    for name, other in used.items():
        if frame.units != other.units:
            return f"its unit is {frame.units}, that of {name!r} {other.units}"
        assert frame.position is not None
        assert other.position is not None
        if np.linalg.norm(frame.position - other.position) < ONE_PLACE_M:
            return f"its probe stands where that of {name!r} does"
    return ""


class Field(Blocking):
    """The light of a field, from ordinary, blocking code; a thread of its own receives it.

    ::

        from lightwell_client import Field

        with Field("stage", timeout=10) as field:
            field.next()                                       # wait for the first light
            while True:
                draw(field.at([(0.2, 0.0, 1.1), (0.8, 0.1, 1.1)]))   # the newest light there, (2, 25, 3)

    The parameters are those of `AsyncField`; callbacks are called on the receiving thread.
    """

    def __init__(
        self,
        field: str,
        server: str = DEFAULT_SERVER,
        *,
        bands: int | None = None,
        convention: Convention = "lightwell",
        max_fps: float | None = None,
        reconnect: bool = True,
        timeout: float | None = None,
        token: str | None = None,
        on_members: Callable[[list[FieldMember]], object] | None = None,
        on_connection: Callable[[bool], object] | None = None,
    ) -> None:
        self._follower = AsyncField(
            field,
            server,
            bands=bands,
            convention=convention,
            max_fps=max_fps,
            reconnect=reconnect,
            timeout=timeout,
            token=token,
            on_members=on_members,
            on_connection=on_connection,
        )
        super().__init__(self._follower, field)

    @property
    def members(self) -> list[FieldMember]:
        """The streams of the field, and why those that give no light do not."""
        return self._follower.members

    def __iter__(self) -> Self:
        return self

    def __next__(self) -> FieldLight:
        return self.next()

    def next(self, within_seconds: float | None = None) -> FieldLight:
        """Wait for newer light and return it; see `AsyncField.next`."""
        return self._call(self._follower.next(within_seconds))

    def latest(self) -> FieldLight | None:
        """Return the newest light at once; None where no stream gives any."""

        async def newest() -> FieldLight | None:
            return self._follower.latest()

        return self._call(newest())

    def at(self, points: ArrayLike, method: Method = "barycentric") -> NDArray[np.float32]:
        """Return the newest light at points; see `AsyncField.at`."""

        async def last() -> FieldLight:
            return self._follower.last()

        return self._call(last()).at(points, method)
