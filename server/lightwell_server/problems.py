"""Problem documents (RFC 9457): every error of the HTTP API has this one shape.

``type`` is a URN that programs compare, ``title`` the same for every problem of a type, ``detail`` says what happened
here and what to do about it. A problem about input lists each mistake in ``errors``.
"""

from __future__ import annotations

from collections.abc import Sequence
from http import HTTPStatus
from typing import Any

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel, Field
from pydantic_core import ErrorDetails
from starlette.exceptions import HTTPException
from starlette.routing import Match, Mount

from lightwell.errors import LightwellError, RenderError, SourceError
from lightwell.io.grids import GridError
from lightwell.io.meshes import MeshError
from lightwell.io.poses import CaptureError
from lightwell.io.uploads import UploadError
from lightwell.settings import complaint
from lightwell_server.captures import CaptureNameError, CaptureRefusedError, CaptureTakenError, CaptureUnknownError
from lightwell_server.store import StoreError
from lightwell_server.uploads import UploadFullError, UploadTooLargeError, UploadTypeError, UploadUnknownError
from lightwell_workers.jobs.job import CursorError, JobNotFoundError, JobStateError, KeyConflictError, QueueError
from lightwell_workers.jobs.kind import JobError

MEDIA_TYPE = "application/problem+json"
METHODS = ("GET", "POST", "PATCH", "DELETE")
"""Those that any route takes; HEAD goes with GET."""

REFUSALS: dict[type[LightwellError], tuple[int, str]] = {
    JobNotFoundError: (404, "no-such-job"),
    JobStateError: (409, "job-state"),
    KeyConflictError: (409, "idempotency-key"),
    CursorError: (422, "bad-cursor"),
    QueueError: (503, "queue"),
    CaptureUnknownError: (404, "no-such-capture"),
    CaptureRefusedError: (403, "capture-refused"),
    CaptureNameError: (422, "invalid-input"),
    CaptureTakenError: (409, "capture-exists"),
    CaptureError: (422, "bad-capture"),
    GridError: (404, "no-such-grid"),
    MeshError: (422, "bad-mesh"),
    UploadError: (422, "bad-upload"),
    UploadUnknownError: (404, "no-such-upload"),
    UploadTypeError: (415, "upload-type"),
    UploadTooLargeError: (413, "upload-too-large"),
    UploadFullError: (507, "no-room"),
    JobError: (422, "invalid-input"),
    RenderError: (422, "bad-scene"),
    SourceError: (422, "invalid-input"),
}
"""What is answered where the parts of the server raise these."""

log = structlog.get_logger("http")


class FieldError(BaseModel):
    """One mistake in a request."""

    field: str = Field(description="dotted path of the value, such as settings.bands")
    message: str = Field(description="what was given and what it should be")


class ProblemDocument(BaseModel):
    """Body of every error response."""

    type: str = Field(description="URN of the kind of problem")
    title: str
    status: int
    detail: str = Field(description="what happened, and the remedy")
    instance: str | None = Field(None, description="path of the request")
    errors: list[FieldError] | None = Field(None, description="one entry for each mistake in the input")


class Problem(Exception):  # noqa: N818 (RFC 9457's own word)
    """An error that is answered with a problem document."""

    def __init__(
        self,
        status: int,
        kind: str,
        detail: str,
        *,
        errors: Sequence[FieldError] | None = None,
        headers: dict[str, str] | None = None,
    ) -> None:
        super().__init__(detail)
        self.status = status
        self.kind = kind
        self.detail = detail
        self.errors = errors
        self.headers = headers

    def document(self, instance: str | None = None) -> dict[str, Any]:
        """Return the document as JSON-ready values."""
        document = ProblemDocument(
            type=f"urn:lightwell:problem:{self.kind}",
            title=HTTPStatus(self.status).phrase,
            status=self.status,
            detail=self.detail,
            instance=instance,
            errors=list(self.errors) if self.errors else None,
        )
        return document.model_dump(exclude_none=True)


def invalid_input(errors: Sequence[ErrorDetails], prefix: Sequence[str] = ()) -> Problem:
    """Return the 422 problem for pydantic's errors: field, value and remedy of each."""
    fields = [
        FieldError(
            field=".".join(str(part) for part in (*prefix, *item["loc"]) if part != "[key]"),
            message=_said(item),
        )
        for item in errors
    ]
    detail = "; ".join(f"{item.field}: {item.message}" for item in fields)
    return Problem(422, "invalid-input", detail, errors=fields)


def _said(item: ErrorDetails) -> str:
    """Return what is wrong with a value; one that is a whole table is not repeated."""
    said = complaint(item)
    if isinstance(item["input"], dict):
        said = said.removeprefix(f"= {item['input']!r}: ")
    return said.lstrip("= ")


def respond(problem: Problem, instance: str | None = None) -> JSONResponse:
    """Return the response that carries a problem."""
    return JSONResponse(
        problem.document(instance), status_code=problem.status, media_type=MEDIA_TYPE, headers=problem.headers
    )


def _is_websocket(request: Request) -> bool:
    """Return whether a WebSocket is served at the request's path."""
    return _matches(request, type="websocket")


def _allowed_methods(request: Request) -> str:
    """Return the methods that the routes of the request's path take; the page's files are there for the others."""
    methods = [method for method in METHODS if _matches(request, method=method)] or ["GET"]
    return ", ".join(methods).replace("GET", "GET, HEAD")


def _matches(request: Request, **changes: str) -> bool:
    """Return whether a route, not a mounted folder, would serve the request with these changes of its scope."""
    scope = {**request.scope, **changes}
    routes = (route for route in request.app.routes if not isinstance(route, Mount))
    return any(route.matches(scope)[0] is Match.FULL for route in routes)


def install(app: FastAPI) -> None:
    """Make every error of the application a problem document."""

    async def on_problem(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, Problem)
        return respond(error, request.url.path)

    async def on_http(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, HTTPException)
        status, headers = error.status_code, dict(error.headers or {})
        match status:
            case 404 | 405 if _is_websocket(request):
                status, headers = 426, {"Upgrade": "websocket", "Connection": "Upgrade"}
                kind, detail = "websocket-only", "this is a WebSocket: connect to it with ws:// or wss://"
            case 404:
                kind, detail = "not-found", f"there is nothing at {request.url.path}"
            case 405:
                headers = {"Allow": _allowed_methods(request)}
                kind, detail = (
                    "method-not-allowed",
                    f"{request.method} is not possible here; allowed: {headers['Allow']}",
                )
            case _:
                kind, detail = "http", str(error.detail)
        return respond(Problem(status, kind, detail, headers=headers), request.url.path)

    async def on_full(request: Request, error: Exception) -> JSONResponse:
        log.error("change not kept", path=request.url.path, reason=str(error))
        return respond(Problem(507, "not-kept", f"{error}; nothing was changed"), request.url.path)

    async def on_invalid(request: Request, error: Exception) -> JSONResponse:
        assert isinstance(error, RequestValidationError)
        if any(item["type"] == "json_invalid" for item in error.errors()):
            reason = error.errors()[0]["ctx"]["error"]
            return respond(Problem(400, "invalid-json", f"the body is no valid JSON: {reason}"), request.url.path)
        if any(item["loc"] == ("body",) and isinstance(item["input"], bytes) for item in error.errors()):
            given = request.headers.get("Content-Type", "no Content-Type")
            detail = f"the body came with {given}: send Content-Type: application/json"
            return respond(Problem(415, "not-json", detail), request.url.path)
        items = [item | {"loc": item["loc"][1:] or ("body",)} for item in error.errors()]
        return respond(invalid_input(items), request.url.path)

    async def on_crash(request: Request, error: Exception) -> JSONResponse:
        log.error("request failed", path=request.url.path, error=repr(error))
        return respond(Problem(500, "internal", "the server made a mistake; its log says more"), request.url.path)

    async def on_refusal(request: Request, error: Exception) -> JSONResponse:
        status, kind = next(answer for type_, answer in REFUSALS.items() if isinstance(error, type_))
        return respond(Problem(status, kind, str(error)), request.url.path)

    for refusal in REFUSALS:
        app.add_exception_handler(refusal, on_refusal)
    app.add_exception_handler(Problem, on_problem)
    app.add_exception_handler(StoreError, on_full)
    app.add_exception_handler(HTTPException, on_http)
    app.add_exception_handler(RequestValidationError, on_invalid)
    app.add_exception_handler(Exception, on_crash)
