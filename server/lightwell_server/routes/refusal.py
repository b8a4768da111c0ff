"""How a WebSocket is refused so that its user learns why.

A browser hides everything about a handshake that fails. So the handshake is accepted, the reason is sent as a `Refused`
message and, shortened, as the reason of the close frame.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Coroutine
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect, WebSocketState

from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_POLICY,
    CLOSE_UNAUTHORIZED,
    CLOSE_WRONG_PROTOCOL,
    SUBPROTOCOL,
    Refused,
    encode,
)
from lightwell_server.auth import Scope
from lightwell_server.hub import Ending
from lightwell_server.problems import Problem
from lightwell_server.services import services

_CODES = {401: CLOSE_UNAUTHORIZED, 403: CLOSE_UNAUTHORIZED, 404: CLOSE_NOT_FOUND}


class RefusedError(Exception):
    """A WebSocket that will not be served: the close code and the reason."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


async def admit(websocket: WebSocket, scope: Scope) -> None:
    """Accept a connection that speaks the protocol and may do this; else raise `RefusedError`.

    A client that offers no subprotocol at all, such as a command-line tool, is taken at its word that it speaks ours.
    """
    offered = websocket.scope.get("subprotocols", [])
    if offered and SUBPROTOCOL not in offered:
        # A browser drops the connection unless one of the subprotocols it offered is named, and would see no reason.
        await websocket.accept(subprotocol=offered[0])
        said = ", ".join(offered)
        raise RefusedError(
            CLOSE_WRONG_PROTOCOL, f"this server speaks the subprotocol {SUBPROTOCOL}; offered: {said[:40]}"
        )
    await websocket.accept(subprotocol=SUBPROTOCOL if offered else None)
    try:
        services(websocket).auth.require(websocket, scope)
    except Problem as problem:
        raise refusal(problem) from None


def refusal(problem: Problem) -> RefusedError:
    """Return the refusal that says what a problem document would say."""
    return RefusedError(_CODES.get(problem.status, CLOSE_POLICY), problem.detail)


async def converse(
    websocket: WebSocket,
    send: Coroutine[Any, Any, None],
    receive: Coroutine[Any, Any, None],
    ended: asyncio.Future[Ending],
) -> None:
    """Send and receive at once until one of the two stops or the hub ends it; refuse what the peer got wrong.

    A peer that has gone is no error; whatever else either raises, this raises.
    """
    sending, receiving = asyncio.ensure_future(send), asyncio.ensure_future(receive)
    try:
        await asyncio.wait((sending, receiving, ended), return_when=asyncio.FIRST_COMPLETED)
    finally:
        sending.cancel()
        receiving.cancel()
        results = await asyncio.gather(sending, receiving, return_exceptions=True)
    for result in results:
        fault = refusal(result) if isinstance(result, Problem) else result
        if isinstance(fault, RefusedError):
            await refuse(websocket, fault.code, fault.reason)
        elif isinstance(fault, Exception) and not isinstance(fault, WebSocketDisconnect):
            raise fault


async def refuse(websocket: WebSocket, code: int, reason: str) -> None:
    """Say why, then close; a peer that has gone is no error."""
    with contextlib.suppress(WebSocketDisconnect, RuntimeError, OSError):
        if websocket.application_state is WebSocketState.CONNECTED:
            await websocket.send_bytes(encode(Refused(reason=reason)))
            await websocket.close(code, shorten(reason))


def shorten(reason: str) -> str:
    """Return a reason that fits a close frame: at most 123 bytes of UTF-8 (RFC 6455 §5.5)."""
    data = reason.encode()
    return reason if len(data) <= 123 else data[:120].decode(errors="ignore") + "…"
