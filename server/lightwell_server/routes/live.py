"""``WS /api/v1/streams/{name}/live``: follow a stream."""

from __future__ import annotations

import asyncio
import contextlib
import time
from typing import Annotated, TypeVar

import msgspec
import structlog
from fastapi import APIRouter
from starlette.datastructures import QueryParams
from starlette.websockets import WebSocket, WebSocketDisconnect

from lightwell.conventions import CONVENTIONS, MAX_STREAM_BANDS, Convention
from lightwell.wire import CLOSE_NOT_FOUND, CLOSE_POLICY, decode_subscribe
from lightwell_server.auth import Scope
from lightwell_server.hub import Cause, Ending, Subscription, Wishes
from lightwell_server.problems import Problem
from lightwell_server.routes.refusal import RefusedError, admit, converse, refusal, refuse
from lightwell_server.services import services
from lightwell_server.variants import Variant

router = APIRouter()
log = structlog.get_logger("live")

MOST_FPS = 1000.0

_ALLOWED = {
    "bands": f"1 … {MAX_STREAM_BANDS}",
    "max_fps": f"above 0, at most {MOST_FPS:g}",
    "convention": f"one of {', '.join(CONVENTIONS)}",
    "backdrop": "1 or 0",
    "gradients": "1 or 0",
}
"""What each query parameter may be."""

CLOSE_CODES: dict[Cause, int] = {
    "stalled": CLOSE_POLICY,
    "queue-full": CLOSE_POLICY,
    "deleted": CLOSE_NOT_FOUND,
    "shutdown": 1012,
}


class Query(msgspec.Struct):
    """Query parameters of the socket."""

    bands: Annotated[int, msgspec.Meta(ge=1, le=MAX_STREAM_BANDS)] | None = None
    max_fps: Annotated[float, msgspec.Meta(gt=0, le=MOST_FPS)] | None = None
    convention: Convention = "lightwell"
    backdrop: bool = False
    gradients: bool = False

    def wishes(self) -> Wishes:
        """Return them as the hub takes them."""
        return Wishes(Variant(self.convention, self.bands, self.gradients), self.max_fps, self.backdrop)


Asked = TypeVar("Asked", bound=msgspec.Struct)


def read_query(parameters: QueryParams, kind: type[Asked]) -> Asked:
    """Return the query parameters of a socket; raises `RefusedError` with the name, the value and the remedy."""
    values = {key: value for key, value in parameters.items() if key != "token"}
    for key in values:
        if key not in kind.__struct_fields__:
            known = ", ".join((*kind.__struct_fields__, "token"))
            raise RefusedError(CLOSE_POLICY, f"{key} is no parameter of this socket; there are: {known}")
    try:
        return msgspec.convert(values, kind, strict=False)
    except msgspec.ValidationError as error:
        name = str(error).rpartition("$.")[2].rstrip("`")
        raise RefusedError(CLOSE_POLICY, f"{name}={values[name][:20]}: must be {_ALLOWED[name]}") from None


@router.websocket("/streams/{name}/live")
async def live(websocket: WebSocket, name: str) -> None:
    """Send what the stream's channel has, for as long as the subscriber stays."""
    parts = services(websocket)
    try:
        await admit(websocket, Scope.READ)
        channel = parts.catalogue.channel(name)
        query = read_query(websocket.query_params, Query)
        if parts.hub.subscribers() >= parts.config.hub.max_subscribers:
            raise RefusedError(CLOSE_POLICY, f"the server has {parts.config.hub.max_subscribers} subscribers: no more")
    except RefusedError as refused:
        await refuse(websocket, refused.code, refused.reason)
        return
    except Problem as problem:
        await refuse(websocket, refusal(problem).code, problem.detail)
        return
    ready = asyncio.Event()
    ended: asyncio.Future[Ending] = asyncio.get_running_loop().create_future()
    subscription = parts.hub.subscribe(
        channel, query.wishes(), ready.set, ended.set_result, time.monotonic(), time.time_ns()
    )
    try:
        await _serve(websocket, subscription, ready, ended)
    finally:
        subscription.close()


async def _serve(
    websocket: WebSocket, subscription: Subscription, ready: asyncio.Event, ended: asyncio.Future[Ending]
) -> None:
    """Send and receive until the subscriber leaves, makes a mistake or is sent away."""
    await converse(websocket, _send(websocket, subscription, ready), _receive(websocket, subscription), ended)
    if ended.done():
        ending = ended.result()
        if ending.cause in ("stalled", "queue-full"):
            log.warning("subscriber cut off", stream=subscription.channel.name, reason=ending.reason)
        if ending.cause != "stalled":  # a peer that does not read would not read the reason either
            await refuse(websocket, CLOSE_CODES[ending.cause], ending.reason)


async def _send(websocket: WebSocket, subscription: Subscription, ready: asyncio.Event) -> None:
    """Send whatever the subscription has next, for ever."""
    while True:
        ready.clear()
        while (message := subscription.take(time.monotonic())) is not None:
            subscription.sending_since = time.monotonic()
            await websocket.send_bytes(message)
            subscription.sending_since = None
        wait_seconds = subscription.wait_seconds(time.monotonic())
        if wait_seconds is None:
            await ready.wait()
        else:
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(wait_seconds):
                    await ready.wait()


async def _receive(websocket: WebSocket, subscription: Subscription) -> None:
    """Apply the changes that the subscriber asks for; ends where it leaves."""
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            message = await websocket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if message.get("bytes") is None:
                raise RefusedError(CLOSE_POLICY, "that was text: send binary MessagePack")
            try:
                wishes = decode_subscribe(message["bytes"])
            except msgspec.MsgspecError as error:
                raise RefusedError(CLOSE_POLICY, f"that is no subscribe message: {error}") from None
            if wishes.max_fps is not None and not 0 < wishes.max_fps <= MOST_FPS:
                raise RefusedError(CLOSE_POLICY, f"max_fps = {wishes.max_fps}: must be above 0, at most {MOST_FPS:g}")
            subscription.change(wishes, time.monotonic())
