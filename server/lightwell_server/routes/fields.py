"""``/api/v1/fields``: several streams with known places, and the light at any point among them."""

from __future__ import annotations

import asyncio
from typing import Annotated, Any

import numpy as np
from fastapi import APIRouter, Body, Query, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from lightwell.conventions import MAX_STREAM_BANDS, Convention, Units, bands_of_count
from lightwell.gradients.interpolate import Method
from lightwell.settings import FieldSettings, FieldStreams, StreamName
from lightwell.sh.engines import convert
from lightwell_server.catalogue import Origin
from lightwell_server.fields import FieldEntry, Member, sample_set
from lightwell_server.problems import Problem
from lightwell_server.routes.access import ADMIN, READ, problems
from lightwell_server.routes.grids import MOST_POINTS, Rows, read_point
from lightwell_server.routes.streams import IfMatch
from lightwell_server.services import Services, services

router = APIRouter(tags=["fields"])


class MemberDescription(BaseModel):
    """One stream of a field."""

    stream: str
    state: str = Field(description="the stream's state; unknown where there is none of that name now")
    used: bool = Field(description="whether its light is in the field now")
    problem: str = Field(description="why not, and the remedy; empty where it is")
    position_m: tuple[float, float, float] | None = Field(None, description="where its probe stands, world metres")
    gradients: bool = Field(description="whether its newest frame has them")
    trust_radius_m: float | None = None


class FieldDescription(BaseModel):
    """One field."""

    name: str
    origin: Origin = Field(description="file: lightwell.toml; api: kept in the data directory")
    revision: int = Field(description="counts changes through the API")
    streams: list[StreamName]
    members: list[MemberDescription]
    subscribers: int


class FieldList(BaseModel):
    """All fields, by name."""

    fields: list[FieldDescription]


class FieldCreation(BaseModel):
    """A new field."""

    model_config = ConfigDict(extra="forbid")

    name: StreamName
    streams: FieldStreams


class FieldPoint(BaseModel):
    """The light at one point."""

    at: tuple[float, float, float]
    coefficients: Rows = Field(description="bands² rows of [r, g, b]")


class FieldSample(BaseModel):
    """The light at some points, from the newest frames."""

    field: str
    method: Method
    convention: Convention
    units: Units
    bands: int
    gradients: bool = Field(description="whether gradients were used: of those members that have them")
    points: list[FieldPoint]
    members: list[MemberDescription]


def _describe_member(member: Member) -> MemberDescription:
    frame = member.channel.latest if member.channel else None
    return MemberDescription(
        stream=member.told.stream,
        state=member.told.state,
        used=member.frame is not None,
        problem=member.told.problem,
        position_m=member.position,
        gradients=frame is not None and frame.gradients is not None,
        trust_radius_m=frame.trust_radius_m if frame else None,
    )


def _describe(parts: Services, entry: FieldEntry) -> FieldDescription:
    return FieldDescription(
        name=entry.name,
        origin=entry.origin,
        revision=entry.revision,
        streams=list(entry.settings.streams),
        members=[_describe_member(member) for member in parts.fields.survey(entry.name)],
        subscribers=parts.fields.followers[entry.name],
    )


@router.get("/fields", dependencies=READ, responses=problems())
async def list_fields(request: Request) -> FieldList:
    """List the fields."""
    parts = services(request)
    return FieldList(fields=[_describe(parts, entry) for entry in parts.fields.entries()])


@router.post("/fields", status_code=201, dependencies=ADMIN, responses=problems(409, 415, 422, 507))
async def create_field(request: Request, response: Response, creation: FieldCreation) -> FieldDescription:
    """Combine streams whose probes stand at known places; the field survives a restart."""
    parts = services(request)
    entry = await parts.fields.create(creation.name, FieldSettings(streams=creation.streams))
    response.headers["Location"] = f"/api/v1/fields/{entry.name}"
    response.headers["ETag"] = entry.etag
    return _describe(parts, entry)


@router.get("/fields/{name}", dependencies=READ, responses=problems(404))
async def get_field(request: Request, response: Response, name: str) -> FieldDescription:
    """Describe one field: which of its streams give light now, and why the others do not."""
    parts = services(request)
    entry = parts.fields.entry(name)
    response.headers["ETag"] = entry.etag
    return _describe(parts, entry)


@router.patch("/fields/{name}", dependencies=ADMIN, responses=problems(404, 412, 415, 422, 507))
async def change_field(
    request: Request,
    response: Response,
    name: str,
    patch: Annotated[
        dict[str, Any],
        Body(description="JSON merge patch (RFC 7396)", examples=[{"streams": ["left", "right"]}]),
    ],
    if_match: IfMatch = None,
) -> FieldDescription:
    """Change which streams a field is made of; who follows it is told."""
    parts = services(request)
    entry = await parts.fields.update(name, patch, if_match)
    response.headers["ETag"] = entry.etag
    return _describe(parts, entry)


@router.delete(
    "/fields/{name}",
    dependencies=ADMIN,
    responses={204: {"description": "the field is gone"}, **problems(404, 409, 412, 507)},
    response_model=FieldDescription,
)
async def delete_field(request: Request, name: str, if_match: IfMatch = None) -> Response | FieldDescription:
    """Delete a field made through the API; where the file has one of this name, that one applies again (200)."""
    parts = services(request)
    restored = await parts.fields.delete(name, if_match)
    return Response(status_code=204) if restored is None else _describe(parts, restored)


@router.get("/fields/{name}/sample", dependencies=READ, responses=problems(404, 422))
async def sample_field(
    request: Request,
    name: str,
    at: Annotated[
        list[str], Query(min_length=1, max_length=MOST_POINTS, description="x,y,z in world metres; may be repeated")
    ],
    method: Annotated[Method, Query(description="weights of the samples")] = "barycentric",
    convention: Convention = "lightwell",
    bands: Annotated[int | None, Query(ge=1, le=MAX_STREAM_BANDS, description="at most this many bands")] = None,
) -> FieldSample:
    """Return the light at points, from the newest frames of all members that give light now (MATHS §7.8)."""
    parts = services(request)
    members = parts.fields.survey(name)
    points = np.array([read_point("at", text) for text in at])
    used = [member.frame for member in members if member.frame is not None]
    if not used:
        reasons = "; ".join(f"{member.told.stream}: {member.told.problem}" for member in members)
        raise Problem(404, "no-light-yet", f"no stream of the field {name!r} gives light now: {reasons}")
    light = sample_set(members, bands)
    values = await asyncio.to_thread(light.at, points, method)
    return FieldSample(
        field=name,
        method=method,
        convention=convention,
        units=used[0].units,
        bands=bands_of_count(values.shape[1]),
        gradients=light.gradients is not None,
        points=[
            FieldPoint(at=tuple(point), coefficients=convert(value, convention).tolist())
            for point, value in zip(points.tolist(), values, strict=True)
        ],
        members=[_describe_member(member) for member in members],
    )
