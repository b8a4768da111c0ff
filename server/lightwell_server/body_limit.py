"""Refuses HTTP bodies that are larger than anything the API takes, before they are held in memory."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping

from starlette.types import ASGIApp, Message, Receive, Scope, Send

from lightwell_server.problems import Problem, respond


class _TooLarge(Exception):  # noqa: N818, never leaves this module
    pass


class BodyLimit:
    """ASGI middleware that answers 413 as soon as a body is known to be longer than ``limit`` bytes.

    ``larger`` gives paths whose bodies may be longer: their routes read them piece by piece.
    """

    def __init__(self, app: ASGIApp, limit: int, larger: Mapping[str, int] | None = None) -> None:
        self._app = app
        self._limit = limit
        self._larger = larger or {}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve one connection."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = self._larger.get(scope["path"], self._limit)
        problem = Problem(413, "body-too-large", f"the body may have at most {limit} bytes")
        announced = dict(scope["headers"]).get(b"content-length", b"0")
        if announced.isdigit() and int(announced) > limit:
            await respond(problem, scope["path"])(scope, receive, send)
            return
        received = 0
        answered = False

        async def limited_receive() -> Message:
            nonlocal received
            message = await receive()
            received += len(message.get("body", b""))
            if received > limit:
                raise _TooLarge
            return message

        async def checked_send(message: Message) -> None:
            nonlocal answered
            if received <= limit:  # what the application makes of the broken body is not sent
                answered = True
                await send(message)

        with contextlib.suppress(_TooLarge):
            await self._app(scope, limited_receive, checked_send)
        if received > limit and not answered:
            await respond(problem, scope["path"])(scope, receive, send)
