"""Client of the REST API."""

from __future__ import annotations

from types import TracebackType
from typing import Any, Self, TypeVar
from urllib.parse import quote

import httpx
import msgspec
import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.conventions import Convention, Units
from lightwell.loopback import is_loopback
from lightwell.wire import DominantLight, Quality
from lightwell_client.errors import ConnectionLostError, ProblemError
from lightwell_client.follow import DEFAULT_SERVER
from lightwell_client.jobs import JobRoutes

Typed = TypeVar("Typed")


class Worker(msgspec.Struct):
    """The ingest process that the server runs for a stream."""

    state: str
    pid: int | None
    restarts: int
    last_error: str
    stderr_tail: list[str]


class Stream(msgspec.Struct):
    """One stream: settings, state and counters."""

    name: str
    origin: str
    revision: int
    settings: dict[str, Any]
    """As `lightwell.settings.StreamSettings`; credentials in the source are masked."""
    state: str
    session: str | None
    subscribers: int
    fps: float
    frames_received: int
    frames_in: int
    frames_published: int
    frames_skipped: int
    frames_dropped: int
    nan_samples: int
    infinite_samples: int
    negative_samples: int
    last_frame_age_seconds: float | None
    last_error: str
    stage_ms: dict[str, float]
    worker: Worker | None


class Readiness(msgspec.Struct):
    """Whether everything that the server was asked for works."""

    ready: bool
    reasons: list[str]


class _StreamList(msgspec.Struct):
    streams: list[Stream]


class Latest(msgspec.Struct, frozen=True, eq=False):
    """The newest coefficients of a stream."""

    stream: str
    session: str
    seq: int
    capture_time_ns: int
    publish_time_ns: int
    bands: int
    convention: Convention
    units: Units
    window: str
    mapping: str
    coefficients: NDArray[np.float32]
    """``(bands², 3)`` float32."""
    quality: Quality
    dominant: DominantLight | None = None
    position: tuple[float, float, float] | None = None
    """Metres, in the convention's axes."""
    gradients: NDArray[np.float32] | None = None
    """``(bands², 3, 3)`` per metre, where asked for and measured."""
    trust_radius_m: float | None = None


class FieldMember(msgspec.Struct):
    """One stream of a field."""

    stream: str
    state: str
    used: bool
    """Whether its light is in the field now."""
    problem: str
    """Why not, and the remedy."""
    position_m: tuple[float, float, float] | None
    gradients: bool
    trust_radius_m: float | None


class FieldInfo(msgspec.Struct):
    """Several streams whose probes stand at known places."""

    name: str
    origin: str
    revision: int
    streams: list[str]
    members: list[FieldMember]
    subscribers: int


class _FieldList(msgspec.Struct):
    fields: list[FieldInfo]


class FieldPoint(msgspec.Struct, frozen=True, eq=False):
    """The light at one point."""

    at: tuple[float, float, float]
    coefficients: NDArray[np.float32]
    """``(bands², 3)`` float32."""


class FieldSample(msgspec.Struct, frozen=True, eq=False):
    """The light of a field at some points."""

    field: str
    method: str
    convention: Convention
    units: Units
    bands: int
    gradients: bool
    points: list[FieldPoint]
    members: list[FieldMember]


class Lightwell(JobRoutes):
    """A Lightwell server.

    ::

        from lightwell_client import Lightwell, ProblemError

        with Lightwell("http://127.0.0.1:8400", token="…") as server:
            for stream in server.streams():
                print(stream.name, stream.state, stream.fps, stream.last_error)
            server.create("hall", {"source": "exr:/data/hall/*.exr?fps=30&loop=1", "bands": 5})
            server.update("hall", {"filter": {"tau_seconds": 0.2}})
            print(server.latest("hall", convention="three", bands=3).coefficients)   # (9, 3)
            try:
                server.update("hall", {"bands": 99})
            except ProblemError as problem:
                print(problem.status, problem.detail)      # 422 bands: 99: must be less than or equal to 8
            server.delete("hall")

    Every method raises `ProblemError` where the server answers with a problem document, and `ConnectionLostError`
    where it does not answer.
    """

    def __init__(self, server: str = DEFAULT_SERVER, *, token: str | None = None, timeout: float = 10.0) -> None:
        headers = {"Authorization": f"Bearer {token}"} if token else {}
        trust_env = not is_loopback(server)  # its proxies cannot reach this machine
        self._client = httpx.Client(base_url=server, headers=headers, timeout=timeout, trust_env=trust_env)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the connections."""
        self._client.close()

    def streams(self) -> list[Stream]:
        """Return all streams, by name."""
        return self._typed(_StreamList, self._request("GET", "/api/v1/streams")).streams

    def stream(self, name: str) -> Stream:
        """Return one stream."""
        return self._typed(Stream, self._request("GET", _path(name)))

    def create(self, name: str, settings: dict[str, Any]) -> Stream:
        """Add a stream; it survives a restart of the server."""
        body = {"name": name, "settings": settings}
        return self._typed(Stream, self._request("POST", "/api/v1/streams", json=body))

    def update(self, name: str, patch: dict[str, Any]) -> Stream:
        """Change a stream's settings with a JSON merge patch: what is left out stays, None restores a default."""
        return self._typed(Stream, self._request("PATCH", _path(name), json=patch))

    def delete(self, name: str) -> None:
        """Delete a stream that was made through the API."""
        self._request("DELETE", _path(name))

    def latest(
        self, name: str, *, convention: Convention = "lightwell", bands: int | None = None, gradients: bool = False
    ) -> Latest:
        """Return the newest coefficients; a `ProblemError` with status 404 where there has been no frame yet."""
        query: dict[str, str | int] = {"convention": convention, "gradients": gradients}
        if bands is not None:
            query["bands"] = bands
        return self._typed(Latest, self._request("GET", f"{_path(name)}/latest", params=query))

    def is_alive(self) -> bool:
        """Return whether the server answers."""
        try:
            return self._request("GET", "/healthz").status_code == httpx.codes.OK
        except ConnectionLostError:
            return False

    def fields(self) -> list[FieldInfo]:
        """Return all fields, by name."""
        return self._typed(_FieldList, self._request("GET", "/api/v1/fields")).fields

    def field(self, name: str) -> FieldInfo:
        """Return one field: which of its streams give light now, and why the others do not."""
        return self._typed(FieldInfo, self._request("GET", _path(name, "fields")))

    def create_field(self, name: str, streams: list[str]) -> FieldInfo:
        """Combine streams whose probes stand at known places; the field survives a restart of the server."""
        body = {"name": name, "streams": streams}
        return self._typed(FieldInfo, self._request("POST", "/api/v1/fields", json=body))

    def update_field(self, name: str, streams: list[str]) -> FieldInfo:
        """Make a field of other streams."""
        return self._typed(FieldInfo, self._request("PATCH", _path(name, "fields"), json={"streams": streams}))

    def delete_field(self, name: str) -> None:
        """Delete a field that was made through the API; its streams stay."""
        self._request("DELETE", _path(name, "fields"))

    def sample_field(
        self,
        name: str,
        points: ArrayLike,
        *,
        method: str = "barycentric",
        convention: Convention = "lightwell",
        bands: int | None = None,
    ) -> FieldSample:
        """Return the light at points ``(n, 3)`` or ``(3,)``, world metres, from the newest frames.

        A `ProblemError` with status 404 where no stream of the field gives light.
        """
        places = np.asarray(points, dtype=np.float64).reshape(-1, 3).tolist()
        query: dict[str, Any] = {
            "at": [",".join(repr(value) for value in place) for place in places],
            "method": method,
            "convention": convention,
        }
        if bands is not None:
            query["bands"] = bands
        return self._typed(FieldSample, self._request("GET", f"{_path(name, 'fields')}/sample", params=query))

    def readiness(self) -> Readiness:
        """Return whether every source is fresh and the disk has room, and the reasons where not."""
        return self._typed(Readiness, self._request("GET", "/readyz", accept=503))

    def _request(
        self,
        method: str,
        path: str,
        *,
        json: dict[str, Any] | None = None,
        params: dict[str, Any] | None = None,
        headers: dict[str, str] | None = None,
        accept: int | None = None,
    ) -> httpx.Response:
        try:
            response = self._client.request(method, path, json=json, params=params, headers=headers)
        except httpx.TransportError as error:
            raise ConnectionLostError(f"no answer from {self._client.base_url}: {error}") from None
        if response.is_success or response.status_code == accept:
            return response
        try:
            problem = response.json()
            raise ProblemError(response.status_code, problem["type"], problem["detail"], problem.get("errors"))
        except (ValueError, KeyError, TypeError):
            reason = f"{response.status_code} {response.reason_phrase} from {response.url}"
            raise ProblemError(response.status_code, "about:blank", reason) from None

    def _typed(self, kind: type[Typed], response: httpx.Response) -> Typed:
        return msgspec.json.decode(response.content, type=kind, dec_hook=_array)


def _array(kind: type, value: object) -> NDArray[np.float32]:
    """Return a JSON list of lists as an array: the one type in the answers that msgspec does not know."""
    return np.array(value, dtype=np.float32)


def _path(name: str, kind: str = "streams") -> str:
    return f"/api/v1/{kind}/{quote(name, safe='')}"
