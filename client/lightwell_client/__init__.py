"""The Python client of Lightwell: follow light as it is measured, and manage streams.

It needs numpy, websockets, httpx and msgspec only. A renderer follows a stream like this::

    from lightwell_client import LightStream

    with LightStream("probe", server="http://127.0.0.1:8400", bands=3, convention="three") as light:
        for frame in light:  # blocks until there is newer light; reconnects by itself
            upload(frame.coefficients)  # (9, 3) float32
            print(frame.seq, frame.latency_seconds, frame.missed)

`AsyncLightStream` is the same for asyncio, `Field` the light between several probes (`AsyncField` for asyncio), and
`Lightwell` the client of the REST API. `render` and `render_igi` make pictures of scene
files; they import the core's renderers when they are called.
"""

from lightwell_client.backdrop import BackdropPicture
from lightwell_client.errors import ConnectionLostError, LightTimeoutError, ProblemError, RefusedError
from lightwell_client.field import AsyncField, Field, FieldLight
from lightwell_client.frames import LightFrame
from lightwell_client.jobs import GridSample, Job, JobEstimate
from lightwell_client.rendering import render, render_igi
from lightwell_client.rest import FieldSample, Lightwell, Stream
from lightwell_client.stream import AsyncLightStream
from lightwell_client.sync import LightStream

__all__ = [
    "AsyncField",
    "AsyncLightStream",
    "BackdropPicture",
    "ConnectionLostError",
    "Field",
    "FieldLight",
    "FieldSample",
    "GridSample",
    "Job",
    "JobEstimate",
    "LightFrame",
    "LightStream",
    "LightTimeoutError",
    "Lightwell",
    "ProblemError",
    "RefusedError",
    "Stream",
    "render",
    "render_igi",
]
