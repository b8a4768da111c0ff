"""``/api/v1/uploads``: meshes for transfer jobs and light maps for streams."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING, Annotated, Literal

from fastapi import APIRouter, Query, Request, Response
from fastapi.responses import FileResponse
from pydantic import BaseModel, Field

from lightwell.io.uploads import UploadRecord
from lightwell_server.problems import Problem
from lightwell_server.routes.access import ADMIN, READ, problems
from lightwell_server.services import Services, services

if TYPE_CHECKING:
    from lightwell_workers.jobs.queue import Queue

router = APIRouter(tags=["uploads"])

BODY = {
    "requestBody": {
        "required": True,
        "description": "the file's bytes",
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


class UploadDocument(BaseModel):
    """One upload."""

    id: str
    kind: Literal["mesh", "map"]
    name: str
    bytes: int
    sha256: str
    created: int = Field(description="nanoseconds since the Unix epoch")
    vertices: int | None = None
    triangles: int | None = None
    objects: list[str] | None = Field(None, description="names of the meshes")
    width: int | None = None
    height: int | None = None
    source: str | None = Field(None, description="maps: the source of a stream that shows it, for POST /streams")


class UploadList(BaseModel):
    """All uploads, newest first."""

    uploads: list[UploadDocument]
    max_bytes: int = Field(description="largest file that is taken")
    max_triangles: int


def _document(parts: Services, record: UploadRecord) -> UploadDocument:
    contents = record.contents
    return UploadDocument(
        id=record.id,
        kind=record.kind,
        name=record.name,
        bytes=record.bytes,
        sha256=record.sha256,
        created=record.created,
        vertices=contents.vertices,
        triangles=contents.triangles,
        objects=contents.objects,
        width=contents.width,
        height=contents.height,
        source=parts.uploads.source(record),
    )


@router.get("/uploads", dependencies=READ, responses=problems())
async def list_uploads(request: Request) -> UploadList:
    """List the uploads, newest first, and say how much is taken."""
    parts = services(request)
    records = await asyncio.to_thread(parts.uploads.all)
    return UploadList(
        uploads=[_document(parts, record) for record in records],
        max_bytes=parts.uploads.settings.max_mb << 20,
        max_triangles=parts.uploads.settings.max_triangles,
    )


@router.post(
    "/uploads",
    status_code=201,
    dependencies=ADMIN,
    openapi_extra=BODY,
    responses={200: {"description": "the same bytes are here already"}, **problems(413, 415, 422, 507)},
)
async def send_upload(
    request: Request,
    response: Response,
    name: Annotated[str, Query(min_length=1, max_length=1024, description="file name; its suffix says the type")],
) -> UploadDocument:
    """Send a mesh (GLB, glTF, PLY, OBJ) or a lat-long light map (EXR, HDR) as the body; it is checked and kept."""
    parts = services(request)
    announced = request.headers.get("Content-Length", "")
    record, is_new = await parts.uploads.receive(
        name, request.stream(), int(announced) if announced.isdigit() else None
    )
    response.headers["Location"] = f"/api/v1/uploads/{record.id}"
    if not is_new:
        response.status_code = 200
    return _document(parts, record)


@router.get("/uploads/{upload}", dependencies=READ, responses=problems(404))
async def get_upload(request: Request, upload: str) -> UploadDocument:
    """Describe an upload."""
    parts = services(request)
    return _document(parts, await asyncio.to_thread(parts.uploads.find, upload))


@router.get("/uploads/{upload}/file", dependencies=READ, response_class=FileResponse, responses=problems(404))
async def get_upload_file(request: Request, upload: str) -> FileResponse:
    """Return an upload's bytes; of a map those that a stream shows (EXR)."""
    parts = services(request)
    record = await asyncio.to_thread(parts.uploads.find, upload)
    return FileResponse(parts.uploads.path(record), media_type="application/octet-stream")


@router.delete("/uploads/{upload}", status_code=204, dependencies=ADMIN, responses=problems(404, 409, 507))
async def delete_upload(request: Request, upload: str) -> Response:
    """Delete an upload that no stream and no unfinished job needs; results that were made from it stay."""
    parts = services(request)
    record = await asyncio.to_thread(parts.uploads.find, upload)
    place = str(parts.uploads.path(record))
    for entry in parts.catalogue.entries():
        source = entry.settings.source
        if source == parts.uploads.source(record) or place in source:
            raise Problem(409, "upload-in-use", f"the stream {entry.name!r} shows it; delete the stream first")
    if parts.jobs.exists:
        busy = await parts.jobs.call(lambda queue: _job_with(queue, place))
        if busy is not None:
            raise Problem(409, "upload-in-use", f"the job {busy} works on it; cancel it first, or wait for its end")
    await asyncio.to_thread(parts.uploads.delete, upload)
    return Response(status_code=204)


def _job_with(queue: Queue, place: str) -> str | None:
    """Return a job that is not finished and needs the file, or None."""
    for state in ("queued", "running"):
        cursor: str | None = None
        while True:
            jobs, cursor = queue.page(cursor, 200, state)
            for job in jobs:
                light = job.settings.get("light") or {}
                if place in (job.settings.get("mesh"), job.settings.get("scene"), light.get("map")):
                    return job.id
            if cursor is None:
                break
    return None
