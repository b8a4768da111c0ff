from __future__ import annotations

from pathlib import Path

import httpx
from tests.support.server import running_server


def test_looking_at_jobs_makes_no_queue(tmp_path: Path) -> None:
    """The page looks at the queue of every server; those that run no jobs shall not pay for one."""
    with running_server(tmp_path) as url, httpx.Client(base_url=f"{url}/api/v1") as http:
        assert http.get("/jobs").json() == {"jobs": [], "next": None}
        assert http.get("/grids").json() == []
    assert not list(tmp_path.glob("jobs*"))
