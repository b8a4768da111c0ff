"""What the routes work with: one object of each kind, made by `lightwell_server.app`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

from starlette.requests import HTTPConnection

from lightwell_server.auth import Auth
from lightwell_server.catalogue import Catalogue
from lightwell_server.config import Config
from lightwell_server.hub import Hub
from lightwell_server.metrics import Metrics
from lightwell_server.store import Store
from lightwell_server.supervisor import Supervisor


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


def services(connection: HTTPConnection) -> Services:
    """Return the services of the application that serves ``connection``."""
    return cast(Services, connection.app.state.services)
