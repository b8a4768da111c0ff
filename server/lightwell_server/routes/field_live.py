"""``WS /api/v1/fields/{name}/live``: the frames of all streams of a field, through one socket."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections import deque
from typing import Annotated

import msgspec
from fastapi import APIRouter
from starlette.websockets import WebSocket, WebSocketDisconnect

from lightwell._version import __version__
from lightwell.conventions import MAX_STREAM_BANDS, Convention
from lightwell.wire import CLOSE_POLICY, SUBPROTOCOL, FieldHello, FieldMember, FieldStatus, Heartbeat, encode
from lightwell_server.auth import Scope
from lightwell_server.fields import Member
from lightwell_server.hub import Ending, Subscription
from lightwell_server.problems import Problem
from lightwell_server.routes.live import CLOSE_CODES, MOST_FPS, read_query
from lightwell_server.routes.refusal import RefusedError, admit, converse, refusal, refuse
from lightwell_server.services import Services, services
from lightwell_server.variants import Variant

router = APIRouter()

LOOK_SECONDS = 0.5
"""Pause between looks at which members give light."""
STALLS = 1.5
"""The hub cuts off who does not take a frame for its ``stall_seconds``. What is not a stream's frame, or no longer, is
waited for so many times as long."""


class Query(msgspec.Struct):
    """Query parameters of the socket."""

    bands: Annotated[int, msgspec.Meta(ge=1, le=MAX_STREAM_BANDS)] | None = None
    max_fps: Annotated[float, msgspec.Meta(gt=0, le=MOST_FPS)] | None = None
    convention: Convention = "lightwell"


class View:
    """What one socket sees of a field: subscriptions to the members that give light, and what was told of the rest."""

    def __init__(self, parts: Services, name: str, query: Query, ended: asyncio.Future[Ending]) -> None:
        self._parts = parts
        self._name = name
        self._variant = Variant(query.convention, query.bands, gradients=True)
        self._max_fps = query.max_fps
        self._ended = ended
        self._events: deque[bytes] = deque()
        self._told: list[FieldMember] = []
        self._subscriptions: dict[str, Subscription] = {}
        self._sent_at = time.monotonic()
        self.sending: Subscription | None = None
        self.ready = asyncio.Event()
        hub = parts.hub
        self.patience_seconds = STALLS * hub.settings.stall_seconds
        members = self._attach()
        self._events.append(
            encode(
                FieldHello(
                    protocol=SUBPROTOCOL,
                    server_version=__version__,
                    server_session=hub.server_session,
                    server_time_ns=time.time_ns(),
                    heartbeat_seconds=hub.settings.heartbeat_seconds,
                    field=name,
                    convention=query.convention,
                    members=[member.told for member in members],
                )
            )
        )

    def look(self) -> None:
        """Follow the members that give light now, and tell where that has changed; raises where the field is gone."""
        before = self._told
        self._attach()
        if self._told != before:
            self._events.append(encode(FieldStatus(field=self._name, members=self._told)))
        elif time.monotonic() - self._sent_at >= self._parts.hub.settings.heartbeat_seconds:
            self._events.append(encode(Heartbeat(server_time_ns=time.time_ns())))

    def take(self) -> bytes | None:
        """Return what to send next; the members take turns."""
        now = time.monotonic()
        if self._events:
            self._sent_at, self.sending = now, None
            return self._events.popleft()
        for stream, subscription in list(self._subscriptions.items()):
            message = subscription.take(now)
            if message is not None:
                self._subscriptions[stream] = self._subscriptions.pop(stream)
                self._sent_at, self.sending = now, subscription
                return message
        return None

    def wait_seconds(self) -> float:
        """Return how long until something may be due: a frame that ``max_fps`` holds back, or the next look."""
        now = time.monotonic()
        waits = [subscription.wait_seconds(now) for subscription in self._subscriptions.values()]
        return min([wait for wait in waits if wait is not None], default=LOOK_SECONDS)

    def close(self) -> None:
        """Forget the subscriptions."""
        for subscription in self._subscriptions.values():
            subscription.close()
        self._subscriptions.clear()

    def _attach(self) -> list[Member]:
        members = self._parts.fields.survey(self._name)
        given = {member.told.stream: member.channel for member in members if member.frame is not None}
        for stream, subscription in list(self._subscriptions.items()):
            if given.get(stream) is not subscription.channel:
                self._subscriptions.pop(stream).close()
        for stream, channel in given.items():
            if channel is not None and stream not in self._subscriptions:
                self._subscriptions[stream] = self._parts.hub.follow(
                    channel, self._variant, self._max_fps, self.ready.set, self._on_end, time.monotonic()
                )
        self._told = [member.told for member in members]
        return members

    def _on_end(self, ending: Ending) -> None:
        """Go on without a stream that is deleted; end where the server sends this socket away."""
        if ending.cause == "deleted":
            self.ready.set()
        elif not self._ended.done():
            self._ended.set_result(ending)


@router.websocket("/fields/{name}/live")
async def field_live(websocket: WebSocket, name: str) -> None:
    """Send the frames of the field's streams, with gradients and positions, for as long as the follower stays."""
    parts = services(websocket)
    ended: asyncio.Future[Ending] = asyncio.get_running_loop().create_future()
    try:
        await admit(websocket, Scope.READ)
        parts.fields.entry(name)
        query = read_query(websocket.query_params, Query)
        # A field none of whose streams gives light has a socket, but no subscription.
        if max(parts.hub.subscribers(), parts.fields.followers.total()) >= parts.config.hub.max_subscribers:
            raise RefusedError(CLOSE_POLICY, f"the server has {parts.config.hub.max_subscribers} subscribers: no more")
        view = View(parts, name, query, ended)
    except RefusedError as refused:
        await refuse(websocket, refused.code, refused.reason)
        return
    except Problem as problem:
        await refuse(websocket, refusal(problem).code, problem.detail)
        return
    parts.fields.followers[name] += 1
    try:
        await _serve(websocket, view, ended)
    finally:
        view.close()
        parts.fields.followers[name] -= 1


async def _serve(websocket: WebSocket, view: View, ended: asyncio.Future[Ending]) -> None:
    """Send until the follower leaves, says something, or is sent away."""
    await converse(websocket, _send(websocket, view), _receive(websocket), ended)
    if ended.done() and (ending := ended.result()).cause != "stalled":  # who does not read would not read why
        await refuse(websocket, CLOSE_CODES[ending.cause], ending.reason)


async def _send(websocket: WebSocket, view: View) -> None:
    looked = time.monotonic()
    while True:
        view.ready.clear()
        while (message := view.take()) is not None:
            if view.sending is not None:
                view.sending.sending_since = time.monotonic()
            try:
                async with asyncio.timeout(view.patience_seconds):
                    await websocket.send_bytes(message)
            except TimeoutError:
                raise WebSocketDisconnect(CLOSE_POLICY, "takes nothing") from None
            if view.sending is not None:
                view.sending.sending_since = None
            if time.monotonic() - looked >= LOOK_SECONDS:
                break
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(max(min(view.wait_seconds(), looked + LOOK_SECONDS - time.monotonic()), 0)):
                await view.ready.wait()
        if time.monotonic() - looked >= LOOK_SECONDS:
            looked = time.monotonic()
            view.look()


async def _receive(websocket: WebSocket) -> None:
    with contextlib.suppress(WebSocketDisconnect):
        message = await websocket.receive()
        if message["type"] != "websocket.disconnect":
            raise RefusedError(CLOSE_POLICY, "a field's socket takes no messages: connect again with another query")
