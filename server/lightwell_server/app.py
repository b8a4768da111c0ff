"""Composition root: the parts are made here, once, and given to each other."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import AsyncIterator
from pathlib import Path

import structlog
from fastapi import FastAPI
from starlette.middleware.cors import CORSMiddleware

from lightwell._version import __version__
from lightwell_server import problems
from lightwell_server.auth import Auth
from lightwell_server.body_limit import BodyLimit
from lightwell_server.captures import Captures
from lightwell_server.catalogue import Catalogue
from lightwell_server.config import Config
from lightwell_server.fields import Fields
from lightwell_server.head import HeadAsGet
from lightwell_server.hub import Hub
from lightwell_server.jobs import Jobs
from lightwell_server.metrics import Metrics
from lightwell_server.routes import (
    artifacts,
    captures,
    field_live,
    fields,
    grids,
    health,
    jobs,
    live,
    page,
    publish,
    streams,
    uploads,
)
from lightwell_server.services import Services
from lightwell_server.session import new_session
from lightwell_server.store import Store
from lightwell_server.supervisor import Supervisor
from lightwell_server.uploads import Uploads

log = structlog.get_logger("server")

API = "/api/v1"
SWEEP_SECONDS = 0.25
LOCAL_ORIGINS = r"https?://(localhost|127\.0\.0\.1|\[::1\])(:\d+)?"


def create_app(config: Config, server_url: str, page_directory: Path | None = None) -> FastAPI:
    """Return the application; its parts live from start-up to shut-down.

    ``server_url`` is where the embedded workers find it. Raises `ConfigError` where the data directory cannot be used.
    """
    store = Store(config.server.data_dir / "lightwell.sqlite")

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        async with _run(config, store, server_url) as parts:
            app.state.services = parts
            yield

    app = FastAPI(
        title="Lightwell",
        version=__version__,
        summary="Captures real light and serves it live as spherical harmonics",
        openapi_url=f"{API}/openapi.json",
        docs_url=None,
        redoc_url=None,
        lifespan=lifespan,
    )
    app.add_middleware(
        CORSMiddleware,
        allow_origins=list(config.server.allowed_origins),
        allow_origin_regex=LOCAL_ORIGINS,
        allow_methods=["GET", "POST", "PATCH", "DELETE"],
        allow_headers=["Authorization", "Content-Type", "Idempotency-Key", "If-Match", "Last-Event-ID", "Range"],
        expose_headers=["Content-Range", "ETag", "Location"],
    )
    app.add_middleware(
        BodyLimit,
        limit=config.server.max_body_kb * 1024,
        larger={f"{API}/uploads": config.uploads.max_mb * 1024 * 1024},
    )
    problems.install(app)
    app.add_middleware(HeadAsGet)
    for module in (health, streams, live, publish, fields, field_live, jobs, captures, artifacts, grids, uploads):
        app.include_router(module.router, prefix=API)
    app.include_router(health.router, include_in_schema=False)  # where probes and Prometheus look by custom
    page.install(app, page_directory or page.static_directory())
    return app


@contextlib.asynccontextmanager
async def _run(config: Config, store: Store, server_url: str) -> AsyncIterator[Services]:
    """Make the parts, run what runs in the background, and take all of it down in order."""
    session = new_session()
    auth = Auth(config.auth, config.server)
    hub = Hub(config.hub, session)
    uploads = Uploads(config.uploads, config.server.data_dir, config.server.min_free_mb)
    supervisor = Supervisor(
        hub,
        config.supervisor,
        server_url=server_url,
        token=auth.worker_token,
        uploads=uploads.root,
        log_settings=config.log,
    )
    catalogue = Catalogue(hub, store, supervisor, config.streams)
    fields = Fields(catalogue, store, config.fields)
    parts = Services(
        config=config,
        session=session,
        auth=auth,
        store=store,
        hub=hub,
        metrics=Metrics(hub, supervisor.restarts, fields),
        supervisor=supervisor,
        catalogue=catalogue,
        fields=fields,
        captures=Captures(store, config.jobs, config.server.data_dir),
        jobs=Jobs(config),
        uploads=uploads,
    )
    for warning in auth.warnings(config.server.host):
        log.warning(warning, host=config.server.host)
    parts.catalogue.load()
    parts.fields.load()
    parts.jobs.start()
    sweeping = asyncio.create_task(_sweep(hub))
    try:
        yield parts
    finally:
        sweeping.cancel()
        await parts.wind_down()
        await parts.jobs.close()
        await asyncio.to_thread(store.close)


async def _sweep(hub: Hub) -> None:
    while True:
        await asyncio.sleep(SWEEP_SECONDS)
        hub.sweep(time.monotonic(), time.time_ns())
