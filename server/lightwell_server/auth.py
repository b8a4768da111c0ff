"""Who may do what: tokens with scopes, and what this machine may do without one.

Scopes: ``read`` follows streams, ``publish`` sends them, ``admin`` changes them; each includes those before it.

* A scope without tokens of its own is open, whatever the others have: ``read`` to everybody, ``publish`` and ``admin``
  to this machine only.
* ``/healthz``, ``/readyz`` and ``/metrics`` need no token: they say how streams do, not what they show.
* A token that is given must be right, also where none is needed.
* Tokens come as ``Authorization: Bearer TOKEN``, or as ``?token=TOKEN`` where a browser opens a WebSocket and cannot
  set headers. They are compared in constant time and appear in no answer and no log.

Web pages: a browser sends the page's ``Origin``. Pages of this machine (``http://localhost:…``), of the server itself
and of ``allowed_origins`` may use the API; others may not. What this machine may do without a token, only a page that
was loaded from this machine may do: a page that a hostile name server has pointed at 127.0.0.1 gains nothing.
"""

from __future__ import annotations

import hmac
import secrets
from collections.abc import Iterable
from enum import IntEnum
from urllib.parse import urlsplit

from pydantic import SecretStr
from starlette.requests import HTTPConnection

from lightwell.loopback import is_loopback, is_loopback_host
from lightwell_server.config import AuthSettings, ServerSettings
from lightwell_server.problems import Problem


class Scope(IntEnum):
    """What a caller may do; a larger one includes the smaller."""

    NONE = 0
    READ = 1
    PUBLISH = 2
    ADMIN = 3


class Auth:
    """Decides the scope of each connection."""

    def __init__(self, settings: AuthSettings, server: ServerSettings) -> None:
        self._tokens = {
            Scope.READ: _plain(settings.read_tokens),
            Scope.PUBLISH: _plain(settings.publish_tokens),
            Scope.ADMIN: _plain(settings.admin_tokens),
        }
        self._allowed_origins = frozenset(origin.rstrip("/").lower() for origin in server.allowed_origins)
        self.worker_token = secrets.token_urlsafe(32)
        """Lets the embedded workers of this run publish."""

    def warnings(self, host: str) -> list[str]:
        """Return what should be said when the server listens on ``host``."""
        if is_loopback_host(host):
            return []
        unsaid = []
        if not self._tokens[Scope.READ]:
            unsaid.append("everybody on the network may follow streams: set [auth] read_tokens to change that")
        if not self._tokens[Scope.ADMIN]:
            unsaid.append("only this machine may change streams: set [auth] admin_tokens to change them from elsewhere")
        if not self._tokens[Scope.PUBLISH]:
            unsaid.append("only this machine may publish: set [auth] publish_tokens to publish from elsewhere")
        return unsaid

    def is_embedded(self, connection: HTTPConnection) -> bool:
        """Return whether the caller is a worker that this server started."""
        token = _given_token(connection)
        return token is not None and _equal(token, self.worker_token)

    def require(self, connection: HTTPConnection, scope: Scope) -> None:
        """Let the caller pass, or raise the 401 or 403 problem that says why not and what would help."""
        self._check_origin(connection)
        token = _given_token(connection)
        if token is not None:
            granted = self._scope_of(token)
            if granted is Scope.NONE:
                raise _unauthorized("the token is not one of this server's")
        else:
            granted = self._scope_without_token(connection)
        if granted >= scope:
            return
        name = scope.name.lower()
        if token is not None:
            raise Problem(403, "forbidden", f"the token may {granted.name.lower()}, this needs {name}")
        raise _unauthorized(f"this needs a token that may {name}: send Authorization: Bearer TOKEN, or ?token=TOKEN")

    def _scope_of(self, token: str) -> Scope:
        granted = Scope.PUBLISH if _equal(token, self.worker_token) else Scope.NONE
        for scope, known in self._tokens.items():
            for candidate in known:
                if _equal(token, candidate):
                    granted = max(granted, scope)
        return granted

    def _scope_without_token(self, connection: HTTPConnection) -> Scope:
        origin = connection.headers.get("origin")
        local = (
            connection.client is not None
            and is_loopback_host(connection.client.host)
            and (origin is None or _is_local_origin(origin))
        )
        if local:
            for scope in (Scope.ADMIN, Scope.PUBLISH):
                if not self._tokens[scope]:
                    return scope
        return Scope.NONE if self._tokens[Scope.READ] else Scope.READ

    def _check_origin(self, connection: HTTPConnection) -> None:
        origin = connection.headers.get("origin")
        if origin is None or origin.lower() in self._allowed_origins or _is_local_origin(origin):
            return
        if urlsplit(origin).netloc.lower() == connection.headers.get("host", "").lower():
            return
        raise Problem(403, "origin", f"pages of {origin} may not use this server: add it to [server] allowed_origins")


def _is_local_origin(origin: str) -> bool:
    try:
        return is_loopback(origin)
    except ValueError:
        return False


def _given_token(connection: HTTPConnection) -> str | None:
    scheme, _, token = connection.headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer" and token.strip():
        return token.strip()
    return connection.query_params.get("token")


def _equal(left: str, right: str) -> bool:
    return hmac.compare_digest(left.encode(), right.encode())


def _plain(tokens: Iterable[SecretStr]) -> tuple[str, ...]:
    return tuple(token.get_secret_value() for token in tokens)


def _unauthorized(detail: str) -> Problem:
    return Problem(401, "unauthorized", detail, headers={"WWW-Authenticate": "Bearer"})
