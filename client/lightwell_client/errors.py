"""Errors of the client."""

from __future__ import annotations

from typing import Any

from lightwell.errors import LightwellError


class RefusedError(LightwellError):
    """The server will not serve this subscription: a wrong token, name, parameter or version; says which."""


class ConnectionLostError(LightwellError):
    """There is no connection; raised only where ``reconnect`` is False."""


class LightTimeoutError(LightwellError, TimeoutError):
    """No frame came within the time that was given."""


class ProblemError(LightwellError):
    """The REST API answered with a problem document (RFC 9457)."""

    def __init__(self, status: int, kind: str, detail: str, errors: list[dict[str, Any]] | None = None) -> None:
        super().__init__(detail)
        self.status = status
        """HTTP status."""
        self.kind = kind
        """URN of the kind of problem, such as ``urn:lightwell:problem:stream-exists``."""
        self.detail = detail
        self.errors = errors or []
        """One entry with ``field`` and ``message`` for each mistake in the input."""
