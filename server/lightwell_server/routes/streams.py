"""``/api/v1/streams``: which streams there are, their settings, their newest coefficients."""

from __future__ import annotations

import time
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Body, Header, Query, Request, Response

from lightwell.conventions import MAX_STREAM_BANDS, Convention
from lightwell.wire import unpack_coefficients, unpack_gradients
from lightwell_server.catalogue import Entry
from lightwell_server.problems import Problem
from lightwell_server.routes.access import ADMIN, READ, problems
from lightwell_server.routes.schema import Latest, StreamCreation, StreamDescription, StreamList, describe
from lightwell_server.services import Services, services
from lightwell_server.variants import Variant, make_variant

IfMatch = Annotated[str | None, Header(description="only where the stream still has one of these ETags")]

router = APIRouter(tags=["streams"])


def _description(parts: Services, entry: Entry) -> StreamDescription:
    return describe(entry, parts.catalogue.channel(entry.name), parts.supervisor.report(entry.name), time.monotonic())


@router.get("/streams", dependencies=READ, responses=problems())
async def list_streams(request: Request) -> StreamList:
    """List the streams."""
    parts = services(request)
    return StreamList(streams=[_description(parts, entry) for entry in parts.catalogue.entries()])


@router.post("/streams", status_code=201, dependencies=ADMIN, responses=problems(409, 415, 422, 507))
async def create_stream(request: Request, response: Response, creation: StreamCreation) -> StreamDescription:
    """Add a stream; it survives a restart."""
    parts = services(request)
    entry = await parts.catalogue.create(creation.name, creation.settings)
    response.headers["Location"] = f"/api/v1/streams/{entry.name}"
    response.headers["ETag"] = entry.etag
    return _description(parts, entry)


@router.get("/streams/{name}", dependencies=READ, responses=problems(404))
async def get_stream(request: Request, response: Response, name: str) -> StreamDescription:
    """Describe one stream."""
    parts = services(request)
    entry = parts.catalogue.entry(name)
    response.headers["ETag"] = entry.etag
    return _description(parts, entry)


@router.patch("/streams/{name}", dependencies=ADMIN, responses=problems(404, 412, 415, 422, 507))
async def change_stream(
    request: Request,
    response: Response,
    name: str,
    patch: Annotated[
        dict[str, Any],
        Body(
            description="JSON merge patch of the settings (RFC 7396): what is left out stays, null restores a default",
            examples=[{"bands": 4, "filter": {"tau_seconds": 0.2}}],
        ),
    ],
    if_match: IfMatch = None,
) -> StreamDescription:
    """Change a stream's settings; they survive a restart, and the worker follows at once."""
    parts = services(request)
    entry = await parts.catalogue.update(name, patch, if_match)
    response.headers["ETag"] = entry.etag
    return _description(parts, entry)


@router.delete(
    "/streams/{name}",
    dependencies=ADMIN,
    responses={204: {"description": "the stream is gone"}, **problems(404, 409, 412, 507)},
    response_model=StreamDescription,
)
async def delete_stream(request: Request, name: str, if_match: IfMatch = None) -> Response | StreamDescription:
    """Delete a stream made through the API; where the file has one of this name, that one applies again (200)."""
    parts = services(request)
    restored = await parts.catalogue.delete(name, if_match)
    return Response(status_code=204) if restored is None else _description(parts, restored)


@router.get("/streams/{name}/latest", dependencies=READ, responses=problems(404, 422))
async def latest(
    request: Request,
    name: str,
    convention: Annotated[Convention, Query(description="coefficient convention")] = "lightwell",
    bands: Annotated[int | None, Query(ge=1, le=MAX_STREAM_BANDS, description="at most this many bands")] = None,
    gradients: Annotated[bool, Query(description="also the change per metre, where the stream has it")] = False,
) -> Latest:
    """Return the newest coefficients; 404 where there has been no frame yet."""
    channel = services(request).catalogue.channel(name)
    if channel.latest is None:
        raise Problem(404, "no-frame-yet", f"the stream {name!r} is {channel.state} and has had no frame yet")
    frame = make_variant(channel.latest, Variant(convention, bands, gradients))
    return Latest(
        stream=frame.stream,
        session=frame.session,
        seq=frame.seq,
        capture_time_ns=frame.capture_time_ns,
        ingest_time_ns=frame.ingest_time_ns,
        publish_time_ns=frame.publish_time_ns,
        bands=frame.bands,
        convention=frame.convention,
        units=frame.units,
        window=frame.window.kind,
        window_weights=frame.window.weights,
        mapping=channel.info().mapping,
        coefficients=unpack_coefficients(frame.coefficients).tolist(),
        position=frame.position,
        gradients=None if frame.gradients is None else unpack_gradients(frame.gradients).tolist(),
        trust_radius_m=frame.trust_radius_m,
        dominant=None if frame.dominant is None else msgspec.to_builtins(frame.dominant),
        quality=msgspec.to_builtins(frame.quality),
        source_frame=frame.source_frame,
    )
