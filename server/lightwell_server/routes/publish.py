"""``WS /api/v1/streams/{name}/publish``: a worker hands in what it measures.

One worker a stream: the newer one wins, the older is told that it has been replaced. A message that is not valid ends
the connection with the reason, so that nobody downstream ever sees it.
"""

from __future__ import annotations

import asyncio
import contextlib
import re
import time

import msgspec
import structlog
from fastapi import APIRouter
from pydantic import ValidationError
from starlette.websockets import WebSocket, WebSocketDisconnect

from lightwell.settings import STREAM_NAME_PATTERN, StreamSettings, complaint
from lightwell.wire import (
    CLOSE_POLICY,
    Announce,
    Backdrop,
    Configure,
    Frame,
    StreamStatus,
    Welcome,
    WorkerMessage,
    decode_worker,
    encode,
)
from lightwell_server.auth import Scope
from lightwell_server.hub import Channel, Publisher
from lightwell_server.intake import Punctuality, check_message
from lightwell_server.problems import Problem
from lightwell_server.quiet import OnceInAWhile
from lightwell_server.routes.refusal import RefusedError, admit, refusal, refuse
from lightwell_server.services import Services, services

router = APIRouter()
log = structlog.get_logger("publish")
_quiet = OnceInAWhile(seconds=10.0)


@router.websocket("/streams/{name}/publish")
async def publish(websocket: WebSocket, name: str) -> None:
    """Take a worker's messages until it leaves, makes a mistake, is replaced, or the stream is deleted."""
    parts = services(websocket)
    address = f"{websocket.client.host}:{websocket.client.port}" if websocket.client else ""
    try:
        await admit(websocket, Scope.PUBLISH)
        announce, settings = await _announced(websocket, name, parts)
        await _serve(websocket, name, announce, settings, parts, address)
    except RefusedError as refused:
        held_back = _quiet.held_back((name, refused.code))
        if held_back is not None:
            log.warning("worker refused", stream=name, address=address, reason=refused.reason, held_back=held_back)
        await refuse(websocket, refused.code, refused.reason)
    except WebSocketDisconnect:
        pass


async def _announced(websocket: WebSocket, name: str, parts: Services) -> tuple[Announce, StreamSettings]:
    """Return the worker's first message and the settings in it, valid."""
    if re.fullmatch(STREAM_NAME_PATTERN, name) is None:
        raise RefusedError(CLOSE_POLICY, f"{name[:63]!r} is no stream name: lower-case letters, digits, - and _")
    seconds = parts.config.hub.announce_seconds
    try:
        async with asyncio.timeout(seconds):
            message, _ = await _next(websocket)
    except TimeoutError:
        raise RefusedError(CLOSE_POLICY, f"no announce message came within {seconds:g} s") from None
    if not isinstance(message, Announce):
        raise RefusedError(CLOSE_POLICY, "the first message must be announce")
    if message.stream != name:
        raise RefusedError(CLOSE_POLICY, f"announced stream {message.stream[:63]!r} on the socket of {name!r}")
    try:
        return message, StreamSettings.model_validate(message.settings)
    except ValidationError as error:
        item = error.errors()[0]
        place = ".".join(str(part) for part in item["loc"])
        raise RefusedError(CLOSE_POLICY, f"announced settings: {place} {complaint(item)}") from None


async def _serve(
    websocket: WebSocket, name: str, announce: Announce, announced: StreamSettings, parts: Services, address: str
) -> None:
    embedded = parts.auth.is_embedded(websocket)
    try:
        channel, settings = parts.catalogue.announce(name, announced, embedded=embedded)
    except Problem as problem:
        raise refusal(problem) from None
    outgoing: asyncio.Queue[StreamSettings] = asyncio.Queue()
    ended: asyncio.Future[RefusedError] = asyncio.get_running_loop().create_future()
    publisher = Publisher(
        session=announce.session,
        settings=settings,
        embedded=embedded,
        configure=outgoing.put_nowait,
        end=lambda code, reason: None if ended.done() else ended.set_result(RefusedError(code, reason)),
    )
    channel.attach(publisher)
    log.info(
        "worker connected",
        stream=name,
        address=address,
        embedded=embedded,
        host=announce.hostname,
        pid=announce.pid,
        version=announce.worker_version,
    )
    receiving = asyncio.ensure_future(_receive(websocket, channel, publisher, parts))
    sending = asyncio.ensure_future(_send(websocket, settings, outgoing, parts.session))
    try:
        await asyncio.wait((receiving, sending, ended), return_when=asyncio.FIRST_COMPLETED)
    finally:
        channel.detach(publisher)
        receiving.cancel()
        sending.cancel()
        await asyncio.gather(receiving, sending, return_exceptions=True)
        log.info("worker left", stream=name, address=address, embedded=embedded)
    if ended.done():
        raise ended.result()
    for task in (receiving, sending):
        if not task.cancelled():
            task.result()


async def _send(
    websocket: WebSocket, settings: StreamSettings, outgoing: asyncio.Queue[StreamSettings], server_session: str
) -> None:
    welcome = Welcome(settings=settings.model_dump(mode="json"), server_session=server_session)
    await websocket.send_bytes(encode(welcome))
    while True:
        changed = await outgoing.get()
        await websocket.send_bytes(encode(Configure(settings=changed.model_dump(mode="json"))))


async def _receive(websocket: WebSocket, channel: Channel, publisher: Publisher, parts: Services) -> None:
    """Check each message and hand it to the channel."""
    punctuality = Punctuality()
    with contextlib.suppress(WebSocketDisconnect):
        while True:
            message, data = await _next(websocket)
            try:
                if isinstance(message, Announce):
                    raise ValueError("announce may only be the first message")
                check_message(message, channel.name, publisher.session)
            except ValueError as error:
                channel.counters.rejected += 1
                raise RefusedError(CLOSE_POLICY, str(error)) from None
            channel.counters.bytes_in += len(data)
            match message:
                case Frame():
                    received_ns = time.time_ns()
                    channel.publish_frame(message, time.monotonic())
                    parts.metrics.observe(message, received_ns)
                    # Two frames that come together both reach those subscribers that are ready. Where frames come
                    # late there is a queue of them, and the newest of it may overtake the others.
                    if not punctuality.is_late(message.publish_time_ns, received_ns):
                        await asyncio.sleep(0)
                case Backdrop():
                    channel.publish_backdrop(data)
                case StreamStatus():
                    channel.publish_status(message)


async def _next(websocket: WebSocket) -> tuple[WorkerMessage, bytes]:
    """Return the next message and its bytes; raises `RefusedError` where it is none of the protocol's."""
    event = await websocket.receive()
    if event["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(event.get("code", 1006))
    data = event.get("bytes") or b""
    try:
        return decode_worker(data), data
    except msgspec.MsgspecError as error:
        raise RefusedError(CLOSE_POLICY, f"that is no message of the publish socket: {error}") from None
