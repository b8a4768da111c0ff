"""``/api/v1/captures``: sequences of light probes with poses."""

from __future__ import annotations

import asyncio

from fastapi import APIRouter, Request, Response
from pydantic import BaseModel, ConfigDict, Field

from lightwell.errors import LightwellError
from lightwell.io.captures import Capture, open_capture
from lightwell_server.captures import Registered
from lightwell_server.routes.access import ADMIN, READ, problems
from lightwell_server.services import services

router = APIRouter(tags=["captures"])

Point = tuple[float, float, float]


class CaptureRegistration(BaseModel):
    """A capture to remember."""

    model_config = ConfigDict(extra="forbid")

    path: str = Field(min_length=1, max_length=4096, description="its folder, below one of the data roots")
    id: str | None = Field(None, description="lower-case letters, digits, - and _; default: the folder's name")


class CaptureDocument(BaseModel):
    """One capture."""

    id: str
    path: str
    valid: bool
    error: str | None = Field(None, description="what is wrong with it")
    name: str = ""
    probes: int = 0
    width: int = 0
    height: int = 0
    mapping: str = ""
    rotating: bool = False
    sorted: bool = Field(False, description="whether its samples are in angular order already")
    simulated: bool = False
    bounds_m: tuple[Point, Point] | None = None
    digest: str = Field("", description="SHA-256 of capture.json and poses.csv")


class CaptureList(BaseModel):
    """All registered captures, by id."""

    captures: list[CaptureDocument]


def _describe(registered: Registered, capture: Capture) -> CaptureDocument:
    lower, upper = capture.bounds
    info = capture.info
    return CaptureDocument(
        id=registered.id,
        path=str(registered.directory),
        valid=True,
        name=info.name,
        probes=capture.count,
        width=info.width,
        height=info.height,
        mapping=info.mapping.kind,
        rotating=capture.rotating,
        sorted=capture.sorted_samples is not None,
        simulated=info.scene is not None,
        bounds_m=(tuple(lower.tolist()), tuple(upper.tolist())),
        digest=capture.digest,
    )


def _look(registered: Registered) -> CaptureDocument:
    try:
        return _describe(registered, open_capture(registered.directory))
    except LightwellError as error:
        return CaptureDocument(id=registered.id, path=str(registered.directory), valid=False, error=str(error))


@router.get("/captures", dependencies=READ, responses=problems())
async def list_captures(request: Request) -> CaptureList:
    """List the registered captures; those that cannot be used say why."""
    known = services(request).captures.all()
    return CaptureList(captures=await asyncio.to_thread(lambda: [_look(item) for item in known]))


@router.post("/captures", status_code=201, dependencies=ADMIN, responses=problems(409, 422, 507))
async def register_capture(request: Request, response: Response, registration: CaptureRegistration) -> CaptureDocument:
    """Remember a capture by an id; its folder must lie below one of the data roots."""
    parts = services(request)
    registered, capture = await asyncio.to_thread(parts.captures.register, registration.path, registration.id)
    response.headers["Location"] = f"/api/v1/captures/{registered.id}"
    return _describe(registered, capture)


@router.get("/captures/{capture}", dependencies=READ, responses=problems(404))
async def get_capture(request: Request, capture: str) -> CaptureDocument:
    """Describe one capture."""
    registered = services(request).captures.find(capture)
    return await asyncio.to_thread(_look, registered)


@router.get("/captures/{capture}/plot", dependencies=READ, response_class=Response, responses=problems(404, 422))
async def plot_capture(request: Request, capture: str) -> Response:
    """Return a PNG of where the probes stand, from above and from two sides."""
    registered = services(request).captures.find(capture)

    def plot() -> bytes:
        from lightwell.io.plots import plot_positions  # matplotlib takes half a second to import

        return plot_positions(open_capture(registered.directory).poses.positions)

    return Response(await asyncio.to_thread(plot), media_type="image/png")


@router.delete("/captures/{capture}", status_code=204, dependencies=ADMIN, responses=problems(404, 507))
async def forget_capture(request: Request, capture: str) -> Response:
    """Forget a capture; its folder stays."""
    services(request).captures.forget(capture)
    return Response(status_code=204)
