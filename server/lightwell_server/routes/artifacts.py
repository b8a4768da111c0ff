"""``/api/v1/artifacts``: the results of jobs as plain files, so that Zarr readers open grids by URL."""

from __future__ import annotations

import asyncio
from pathlib import Path

from fastapi import APIRouter, Request
from fastapi.responses import FileResponse, JSONResponse, Response

from lightwell_server.artifacts import ArtifactNotFoundError, find_artifact, find_file
from lightwell_server.problems import Problem
from lightwell_server.routes.access import READ, problems
from lightwell_server.services import services

router = APIRouter(tags=["artifacts"])


def _send(place: Path, sha256: str, media_type: str, request: Request) -> Response:
    etag = f'"{sha256}"'
    if etag in request.headers.get("If-None-Match", ""):
        return Response(status_code=304, headers={"ETag": etag})
    if not place.is_file():
        raise Problem(404, "no-such-artifact", f"the file of {request.url.path} has been deleted")
    # Results never change: whoever has one may keep it.
    headers = {"ETag": etag, "Cache-Control": "public, max-age=31536000, immutable"}
    return FileResponse(place, media_type=media_type, headers=headers)


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
