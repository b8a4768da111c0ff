"""Client of the queue: submit long jobs, follow them, fetch what they made, ask a grid for its light."""

from __future__ import annotations

import hashlib
import json
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import httpx
import msgspec
import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import Convention
from lightwell_client.errors import ConnectionLostError, ProblemError

FINISHED = ("cancelled", "failed", "succeeded")
QUIET_SECONDS = 60.0
"""The server says something at least every 15 s."""
RECONNECTS = 10
FIRST_PAUSE_SECONDS = 0.2
LONGEST_PAUSE_SECONDS = 3.0
POINTS_A_REQUEST = 400
"""So many fit into the longest URL that servers take."""
CHUNK_BYTES = 1 << 20


class JobProgress(msgspec.Struct):
    """How far a job is."""

    stage: str
    done: int
    total: int
    rate: float
    eta_seconds: float | None


class JobArtifact(msgspec.Struct):
    """One result of a job."""

    id: str
    path: str
    bytes: int
    sha256: str
    media_type: str


class Job(msgspec.Struct):
    """One job; times are nanoseconds since the Unix epoch."""

    id: str
    kind: str
    state: str
    """queued, running, cancelling, cancelled, failed or succeeded."""
    priority: int
    settings: dict[str, Any]
    progress: JobProgress | None
    attempts: int
    created: int
    started: int | None
    finished: int | None
    artifacts: list[JobArtifact]
    error: str | None = None


class JobEstimate(msgspec.Struct):
    """What a job would need."""

    seconds: float
    memory_bytes: int
    disk_bytes: int
    fits: bool
    reason: str | None = None


class JobPage(msgspec.Struct):
    """Jobs, newest first, and the cursor of the page that follows."""

    jobs: list[Job]
    next: str | None


class GridPoint(msgspec.Struct):
    """The light at one point of a grid."""

    at: list[float]
    coefficients: NDArray[np.float32]
    """``(bands², 3)`` float32."""
    coverage: float
    gradients: NDArray[np.float32] | None = None
    """``(bands², 3, 3)`` per metre."""


class GridSample(msgspec.Struct):
    """The light at some points."""

    grid: str
    points: list[GridPoint]


class JobRoutes(ABC):
    """The part of `lightwell_client.Lightwell` that deals with jobs and their results.

    ::

        job = server.submit("ilf-grid", {"capture": "hall", "resolutions": 32})
        for event in server.events(job.id):
            print(event)
        grid = server.job(job.id).artifacts[0].id
        print(server.sample(grid, [(0.1, 0.0, 0.2)]).points[0].coefficients)
    """

    _client: httpx.Client

    @abstractmethod
    def _request(
        self,
        method: str,
        path: str,
        *,
        json: dict[str, Any] | None = None,
        params: dict[str, Any] | None = None,
        headers: dict[str, str] | None = None,
        accept: int | None = None,
    ) -> httpx.Response: ...

    @abstractmethod
    def _typed(self, kind: type[Any], response: httpx.Response) -> Any: ...  # noqa: ANN401

    def register_capture(self, path: str | Path, name: str | None = None) -> dict[str, Any]:
        """Make a capture's folder known to the server by an id; return its description."""
        body: dict[str, Any] = {"path": str(path)} | ({"id": name} if name else {})
        return self._typed(dict, self._request("POST", "/api/v1/captures", json=body))  # type: ignore[no-any-return]

    def captures(self) -> list[dict[str, Any]]:
        """Return the captures that the server knows, by id; those that cannot be used say why in ``error``."""
        return self._request("GET", "/api/v1/captures").json()["captures"]  # type: ignore[no-any-return]

    def submit(self, kind: str, settings: dict[str, Any], *, priority: int = 100, key: str | None = None) -> Job:
        """Submit a job; the same ``key`` and settings give the same job, however often they are sent."""
        body = {"kind": kind, "settings": settings, "priority": priority}
        headers = {"Idempotency-Key": key} if key else None
        return self._typed(Job, self._request("POST", "/api/v1/jobs", json=body, headers=headers))  # type: ignore[no-any-return]

    def estimate(self, kind: str, settings: dict[str, Any]) -> JobEstimate:
        """Return what a job would need, without submitting it."""
        body = {"kind": kind, "settings": settings, "dry_run": True}
        return self._typed(JobEstimate, self._request("POST", "/api/v1/jobs", json=body))  # type: ignore[no-any-return]

    def jobs(
        self, *, cursor: str | None = None, limit: int = 50, state: str | None = None, kind: str | None = None
    ) -> JobPage:
        """Return a page of jobs, newest first."""
        given = {"cursor": cursor, "limit": limit, "state": state, "kind": kind}
        params = {name: value for name, value in given.items() if value is not None}
        return self._typed(JobPage, self._request("GET", "/api/v1/jobs", params=params))  # type: ignore[no-any-return]

    def job(self, job: str) -> Job:
        """Return one job."""
        return self._typed(Job, self._request("GET", _path(job)))  # type: ignore[no-any-return]

    def cancel(self, job: str) -> Job:
        """Cancel a job that is queued or runs."""
        return self._typed(Job, self._request("POST", f"{_path(job)}/cancel"))  # type: ignore[no-any-return]

    def retry(self, job: str) -> Job:
        """Queue a failed or cancelled job again; it goes on from its last checkpoint."""
        return self._typed(Job, self._request("POST", f"{_path(job)}/retry"))  # type: ignore[no-any-return]

    def delete_job(self, job: str) -> None:
        """Delete a finished job and its results."""
        self._request("DELETE", _path(job))

    def job_log(self, job: str) -> list[dict[str, Any]]:
        """Return the lines of a job's log."""
        return self._typed(list, self._request("GET", f"{_path(job)}/log"))  # type: ignore[no-any-return]

    def events(self, job: str, after: int = 0) -> Iterator[dict[str, Any]]:
        """Yield what happens to a job until it has ended; the last event has the type ``end`` and the whole ``job``.

        A connection that breaks is made again where it broke off, also to a server that restarts meanwhile; after some
        20 s without an answer that is a `ConnectionLostError`.
        """
        self.job(job)  # an unknown job, and a server that is not there at all, are told at once
        last, failures = after, 0
        while True:
            reason = "the server ended the stream of events"
            try:
                for number, kind, event in self._stream(job, last):
                    last, failures = number, 0
                    if kind == "end":
                        yield {"type": "end", "job": event}
                        return
                    yield event
            except (httpx.TransportError, ConnectionLostError) as error:
                reason = str(error)
            except ProblemError as problem:
                if problem.status != httpx.codes.SERVICE_UNAVAILABLE:
                    raise
                reason = problem.detail
            failures += 1
            if failures > RECONNECTS:
                raise ConnectionLostError(f"no answer from {self._client.base_url}: {reason}") from None
            time.sleep(min(FIRST_PAUSE_SECONDS * 2 ** (failures - 1), LONGEST_PAUSE_SECONDS))

    def _stream(self, job: str, after: int) -> Iterator[tuple[int, str, dict[str, Any]]]:
        self.job(job)  # a job that has been deleted is a problem, not an empty stream
        headers = {"Last-Event-ID": str(after)}
        timeout = httpx.Timeout(10.0, read=QUIET_SECONDS)
        with self._client.stream("GET", f"{_path(job)}/events", headers=headers, timeout=timeout) as response:
            fields: dict[str, str] = {}
            for line in response.iter_lines():
                if line:
                    name, _, value = line.partition(": ")
                    fields[name] = value
                elif "data" in fields:
                    yield int(fields.get("id", 0)), fields.get("event", ""), json.loads(fields["data"])
                    fields = {}
                else:
                    fields = {}

    def wait(self, job: str) -> Job:
        """Return a job when it has ended."""
        for event in self.events(job):
            if event["type"] == "end":
                break
        return self.job(job)

    def artifact(self, artifact: str, path: str | None = None) -> bytes:
        """Return a result that is a file, or the file ``path`` of one that is a folder."""
        place = f"/api/v1/artifacts/{quote(artifact, safe='')}"
        return self._request("GET", place if path is None else f"{place}/{quote(path)}").content

    def download(self, artifact: str, target: Path) -> None:
        """Write a result, a file or a folder, to ``target``.

        Raises `ConnectionLostError` where a file of a folder is not what the server says it is.
        """
        response = self._request("GET", f"/api/v1/artifacts/{quote(artifact, safe='')}")
        listing = response.json() if response.headers.get("Content-Type") == "application/json" else None
        if not isinstance(listing, dict) or "files" not in listing:
            target.write_bytes(response.content)
            return
        for file in listing["files"]:
            place = target / file["path"]
            place.parent.mkdir(parents=True, exist_ok=True)
            data = self.artifact(artifact, file["path"])
            if hashlib.sha256(data).hexdigest() != file["sha256"]:
                raise ConnectionLostError(f"{artifact}: {file['path']} came damaged; download it again")
            place.write_bytes(data)

    def grids(self) -> list[dict[str, Any]]:
        """Return the finished grids: id, job, path, bytes and sha256 of each."""
        return self._typed(list, self._request("GET", "/api/v1/grids"))  # type: ignore[no-any-return]

    def sample(
        self,
        grid: str,
        points: Sequence[Sequence[float]],
        *,
        gradients: bool = False,
        convention: Convention = "lightwell",
        bands: int | None = None,
    ) -> GridSample:
        """Return the light at points of a grid, metres."""
        params: dict[str, Any] = {"gradients": gradients, "convention": convention}
        if bands is not None:
            params["bands"] = bands
        at = [",".join(repr(float(value)) for value in point) for point in points]
        place = f"/api/v1/grids/{quote(grid, safe='')}/sample"
        found = []
        for first in range(0, max(1, len(at)), POINTS_A_REQUEST):
            some = params | {"at": at[first : first + POINTS_A_REQUEST]}
            part: GridSample = self._typed(GridSample, self._request("GET", place, params=some))
            found += part.points
        return GridSample(grid, found)


def _path(job: str) -> str:
    return f"/api/v1/jobs/{quote(job, safe='')}"
