"""What routes ask of their callers, and the problems that they answer with."""

from __future__ import annotations

from typing import Any

from fastapi import Depends, Request

from lightwell_server.auth import Scope
from lightwell_server.problems import ProblemDocument
from lightwell_server.services import services

_TEXTS = {
    401: "a token is needed or wrong",
    403: "the token, the page or the folder is not allowed",
    404: "there is none of this name",
    409: "in conflict with what there is, or its state does not allow it",
    412: "changed meanwhile",
    413: "larger than the server takes",
    415: "of a type that is not taken",
    416: "the range lies outside the file",
    422: "not valid; `errors` names field, value and remedy",
    503: "the queue's database does not answer",
    507: "there is no room for it, or it cannot be kept",
}


def _require_read(request: Request) -> None:
    services(request).auth.require(request, Scope.READ)


def _require_admin(request: Request) -> None:
    services(request).auth.require(request, Scope.ADMIN)


READ = [Depends(_require_read)]
ADMIN = [Depends(_require_admin)]


def problems(*statuses: int) -> dict[int | str, dict[str, Any]]:
    """Return OpenAPI's description of the problems that a route may answer with."""
    content = {"application/problem+json": {"schema": ProblemDocument.model_json_schema()}}
    return {status: {"description": _TEXTS[status], "content": content} for status in (401, 403, *statuses)}
