"""``/api/v1/artifacts``: the results of jobs as plain files, so that Zarr readers open grids by URL."""

from __future__ import annotations

import asyncio
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, JSONResponse, Response
from starlette.datastructures import Headers
from starlette.responses import MalformedRangeHeader, RangeNotSatisfiable
from starlette.types import Receive, Scope, Send

from lightwell_server.artifacts import ArtifactNotFoundError, find_artifact, find_file
from lightwell_server.problems import Problem, respond
from lightwell_server.routes.access import READ, problems
from lightwell_server.services import services

router = APIRouter(tags=["artifacts"])


def _send(place: Path, sha256: str, media_type: str, request: Request) -> Response:
    etag = f'"{sha256}"'
    known = request.headers.get("If-None-Match", "")
    if etag in known or known.strip() == "*":
        return Response(status_code=304, headers={"ETag": etag})
    try:
        found = place.stat()
    except FileNotFoundError:
        raise Problem(404, "no-such-artifact", f"the file of {request.url.path} has been deleted") from None
    # Whoever has one may keep it, but asks first: a deleted job's idempotency key may make another of its name.
    headers = {"ETag": etag, "Cache-Control": "private, no-cache"}
    return _File(place, media_type=media_type, headers=headers, stat_result=found)


class _File(FileResponse):
    """Answers as RFC 9110 §14 wants: a Range that is none is left out, one beyond the end is a problem."""

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        assert self.stat_result is not None
        size = self.stat_result.st_size
        headers = Headers(scope=scope)
        asked, condition = headers.get("range"), headers.get("if-range")
        try:
            if asked is not None and (condition is None or self._should_use_range(condition)):
                self._parse_range_header(asked, size)
        except MalformedRangeHeader:
            others = [(name, value) for name, value in scope["headers"] if name != b"range"]
            scope = {**scope, "headers": others}
        except RangeNotSatisfiable:
            detail = f"the file has {size} bytes, none of them in the range {asked!r}"
            problem = Problem(416, "range", detail, headers={"Content-Range": f"bytes */{size}"})
            await respond(problem, scope["path"])(scope, receive, send)
            return
        await super().__call__(scope, receive, send)


@router.get("/artifacts/{artifact}", dependencies=READ, response_class=Response, responses=problems(404, 416))
async def get_artifact(request: Request, artifact: str) -> Response:
    """Return a file (Range is honoured), or the list of a folder's files with size and SHA-256."""
    try:
        found, place = await asyncio.to_thread(find_artifact, services(request).jobs.root, artifact)
    except ArtifactNotFoundError as error:
        raise Problem(404, "no-such-artifact", str(error)) from None
    if found.files is None:
        return _send(place, found.sha256, found.media_type, request)
    return JSONResponse(
        {
            "id": found.id,
            "path": found.path,
            "bytes": found.bytes,
            "sha256": found.sha256,
            "files": [{"path": file.path, "bytes": file.bytes, "sha256": file.sha256} for file in found.files],
        },
        headers={"ETag": f'"{found.sha256}"'},
    )


@router.get(
    "/artifacts/{artifact}/{path:path}", dependencies=READ, response_class=Response, responses=problems(404, 416)
)
async def get_artifact_file(request: Request, artifact: str, path: str) -> Response:
    """Return a file of a folder; Range is honoured."""
    try:
        place, sha256, kind = await asyncio.to_thread(find_file, services(request).jobs.root, artifact, path)
    except ArtifactNotFoundError as error:
        raise Problem(404, "no-such-artifact", str(error)) from None
    return _send(place, sha256, kind, request)
