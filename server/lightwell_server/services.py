"""What the routes work with: one object of each kind, made by `lightwell_server.app`."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import cast

from starlette.requests import HTTPConnection

from lightwell_server.auth import Auth
from lightwell_server.captures import Captures
from lightwell_server.catalogue import Catalogue
from lightwell_server.config import Config
from lightwell_server.fields import Fields
from lightwell_server.hub import Hub
from lightwell_server.jobs import Jobs
from lightwell_server.metrics import Metrics
from lightwell_server.store import Store
from lightwell_server.supervisor import Supervisor
from lightwell_server.uploads import Uploads

FAREWELL_SECONDS = 1.0
"""Time that subscribers have to be told that the server stops."""


@dataclass(frozen=True)
class Services:
    """The parts of one running server."""

    config: Config
    session: str
    """Names this run of the server."""
    auth: Auth
    store: Store
    hub: Hub
    metrics: Metrics
    supervisor: Supervisor
    catalogue: Catalogue
    fields: Fields
    captures: Captures
    jobs: Jobs
    uploads: Uploads

    async def wind_down(self) -> None:
        """End the workers, then the subscriptions; doing it twice does no harm."""
        await asyncio.gather(self.supervisor.close(), self.jobs.executor.close())
        self.hub.close()
        for _ in range(100):
            if not self.hub.subscribers():
                return
            await asyncio.sleep(FAREWELL_SECONDS / 100)


def services(connection: HTTPConnection) -> Services:
    """Return the services of the application that serves ``connection``."""
    return cast(Services, connection.app.state.services)
