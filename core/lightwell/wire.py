"""The messages of the live protocol, defined once (no sockets here).

Every WebSocket message is one binary frame that holds one MessagePack map; its ``type`` names the message. The
browser's types are generated from this module by ``lightwell_server.typescript``; a test proves that they are fresh.

Subscribe, ``WS /api/v1/streams/{name}/live``::

    client                          server
      (query: bands, max_fps, convention, backdrop, gradients)
                              <-    Hello            description, and the newest frame when there is one
                              <-    Frame            coefficients: state, the newest wins
                              <-    Missed           how many frames this subscriber did not get
                              <-    Backdrop         a picture of the surroundings, at its own rate, the newest wins
                              <-    Heartbeat        when nothing else was sent for a while
                              <-    StreamStatus     the source's state and counters
      Subscribe               ->                     change any of these without reconnecting

A field, ``WS /api/v1/fields/{name}/live``, is several streams whose probes stand at known places; the frames of all of
them come through one socket, and ``Frame.stream`` tells which is whose::

    client                          server
      (query: bands, max_fps, convention)
                              <-    FieldHello       the member streams, and which of them give light
                              <-    Frame            of any member, always with what gradients there are
                              <-    Missed           as above, for one member
                              <-    FieldStatus      a member came, went, or gives light again
                              <-    Heartbeat

Publish, ``WS /api/v1/streams/{name}/publish``::

    worker                          server
      Announce                ->
                              <-    Welcome          settings to use (those that the API keeps), or Refused
      Frame, Backdrop,        ->
      StreamStatus
                              <-    Configure        settings were changed through the API

Coefficients are state: a slow subscriber gets the newest and is told how many it missed. Every other message is an
event: it is delivered, or the connection is closed. Both ends offer the subprotocol ``lightwell.v1``.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec
import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import Convention, Units, bands_of_count

SUBPROTOCOL = "lightwell.v1"
HEARTBEAT_SECONDS = 2.0

CLOSE_WRONG_PROTOCOL = 1002
CLOSE_POLICY = 1008
CLOSE_NOT_FOUND = 4404
CLOSE_UNAUTHORIZED = 4401
CLOSE_REPLACED = 4409

Nanoseconds = Annotated[int, msgspec.Meta(ge=0, description="since the Unix epoch, UTC")]
Bands = Annotated[int, msgspec.Meta(ge=1, le=8)]
Vector3 = tuple[float, float, float]
StreamState = Literal["starting", "running", "stalled", "ended", "failed", "stopped"]
"""State of a stream's source."""


class Message(msgspec.Struct, kw_only=True, tag_field="type"):
    """Base of every message: a MessagePack map whose ``type`` is the tag."""


class WindowUsed(msgspec.Struct, kw_only=True):
    """The window that has been applied to the coefficients (MATHS §4): ``c'_lm = weights[l] c_lm``."""

    kind: str
    weights: list[float]
    strength: float = 0.0
    """λ of ``1/(1 + λ l²(l+1)²)`` that the automatic search chose; 0 for fixed windows and where none was needed."""


class DominantLight(msgspec.Struct, kw_only=True):
    """The split into one distant light and ambient light (MATHS §11a), in the frame's convention axes."""

    direction: Vector3
    """Unit vector towards the light."""
    irradiance: Vector3
    """RGB irradiance on a surface that faces the light."""
    ambient: Vector3
    """RGB radiance of the constant remainder."""


class Quality(msgspec.Struct, kw_only=True):
    """What happened to one frame on its way: says how far its light can be trusted."""

    nan: int = 0
    """Samples that were NaN; taken as 0."""
    infinite: int = 0
    """Samples that were infinite; +Inf is taken as 65504 (the largest half), −Inf as 0."""
    negative: int = 0
    """Samples below zero; kept, unless the stream clamps them."""
    saturated: int = 0
    """Samples at or above the level at which the source clips."""
    blind_fraction: float = 0.0
    """Share of the sphere that the probe does not see."""
    cut: bool = False
    """True where the temporal filter started anew at this frame."""
    stage_ms: dict[str, float] = {}
    """Milliseconds spent in each stage."""


class Frame(Message, tag="frame", kw_only=True):
    """SH coefficients of one captured frame."""

    stream: str
    session: str
    """Names one run of the ingest worker: ``seq`` starts anew with each."""
    seq: int
    """Counts published frames from 0. A gap means that frames were lost between worker and server."""
    capture_time_ns: Nanoseconds
    ingest_time_ns: Nanoseconds
    """When the worker had the whole frame."""
    publish_time_ns: Nanoseconds
    """When the worker handed it to its socket."""
    bands: Bands
    coefficients: bytes
    """Little-endian float32, ``(bands², 3)``, coefficient-major: R, G, B of coefficient 0 first."""
    convention: Convention = "lightwell"
    units: Units = "relative"
    window: WindowUsed
    position: Vector3 | None = None
    """Where the probe stood, metres, in the frame's convention axes; nil where that is not known."""
    gradients: bytes | None = None
    """Little-endian float32, ``(bands², 3, 3)``: coefficient, channel, ∂/∂(x, y, z) per metre; only where asked for."""
    trust_radius_m: float | None = None
    """How far from the probe coefficients and gradients together are within about ten per cent, metres (MATHS §7.4)."""
    dominant: DominantLight | None = None
    quality: Quality
    source_frame: str = ""
    """What the source calls this frame: a file name, a frame number."""
    truth: bytes | None = None
    """Exact coefficients, as ``coefficients``, where the source knows them (synthetic rooms)."""


class Backdrop(Message, tag="backdrop", kw_only=True):
    """A lat-long picture of the surroundings, log-encoded in a JPEG.

    Sample ``y = log2(1 + k x) / log2(1 + k cap)`` in 0 … 1, quantised to 8 bits; so ``x = ((1 + k cap)^y − 1) / k``.
    Row 0 is +Z, columns as in `lightwell.conventions`; values above ``cap`` are clipped (the light comes from the
    coefficients).
    """

    stream: str
    session: str
    seq: int
    capture_time_ns: Nanoseconds
    width: int
    height: int
    k: float
    cap: float
    jpeg: bytes


class StreamStatus(Message, tag="status", kw_only=True):
    """State and counters of a source, sent by the worker once a second and at each change of state."""

    stream: str
    session: str
    state: StreamState
    fps: float = 0.0
    interval_seconds: float = 0.0
    """Time between the source's frames, as far as it knows; 0 where it does not."""
    frames_in: int = 0
    frames_published: int = 0
    frames_skipped: int = 0
    """Frames that could not be read."""
    frames_dropped: int = 0
    """Frames that were overtaken by a newer one before they were processed or sent."""
    nan_samples: int = 0
    infinite_samples: int = 0
    negative_samples: int = 0
    reconnects: int = 0
    last_error: str = ""
    last_frame_time_ns: int = 0
    stage_ms: dict[str, float] = {}
    """Moving average of the milliseconds that each stage takes."""


class StreamInfo(msgspec.Struct, kw_only=True):
    """What a subscriber learns about a stream when it connects."""

    name: str
    source: str
    mapping: str
    bands: int
    units: Units
    state: StreamState
    convention: Convention = "lightwell"
    backdrop: bool = False
    gradients: bool = False
    """Whether its frames have gradients for who asks for them."""


class Hello(Message, tag="hello", kw_only=True):
    """First message to a subscriber."""

    protocol: str
    server_version: str
    server_session: str
    """Names one run of the server."""
    stream: StreamInfo
    server_time_ns: Nanoseconds
    heartbeat_seconds: float
    latest: Frame | None = None


class Missed(Message, tag="missed", kw_only=True):
    """``count`` frames were overtaken by newer ones before this subscriber took them (``max_fps`` does not count)."""

    stream: str
    count: int
    total: int
    """Missed by this subscription so far."""


class Heartbeat(Message, tag="heartbeat", kw_only=True):
    """Proves that the connection lives while no frame comes."""

    server_time_ns: Nanoseconds


class Subscribe(Message, tag="subscribe", kw_only=True):
    """Change a subscription; what is left out stays as it is.

    So ``max_fps`` can be changed and not be taken away: for frames without a limit, connect again.
    """

    bands: Bands | None = None
    max_fps: float | None = None
    convention: Convention | None = None
    backdrop: bool | None = None
    gradients: bool | None = None


class FieldMember(msgspec.Struct, kw_only=True):
    """One stream of a field."""

    stream: str
    state: StreamState | Literal["unknown"]
    """The stream's state; ``unknown`` where there is no stream of that name now."""
    problem: str = ""
    """Why its light is not in the field now, and the remedy; empty where it is."""


class FieldHello(Message, tag="field_hello", kw_only=True):
    """First message of a field's socket."""

    protocol: str
    server_version: str
    server_session: str
    server_time_ns: Nanoseconds
    heartbeat_seconds: float
    field: str
    convention: Convention = "lightwell"
    members: list[FieldMember]


class FieldStatus(Message, tag="field_status", kw_only=True):
    """Which members of a field give light, whenever that changes; the others are to be left out."""

    field: str
    members: list[FieldMember]


class Announce(Message, tag="announce", kw_only=True):
    """First message of a worker on the publish socket."""

    stream: str
    session: str
    worker_version: str
    settings: dict[str, Any]
    """The stream's settings as JSON (`lightwell.settings.StreamSettings`)."""
    pid: int = 0
    hostname: str = ""


class Welcome(Message, tag="welcome", kw_only=True):
    """The worker may publish, with these settings: those that the API keeps win over those announced."""

    settings: dict[str, Any]
    server_session: str


class Configure(Message, tag="configure", kw_only=True):
    """The stream's settings have been changed through the API."""

    settings: dict[str, Any]


class Refused(Message, tag="refused", kw_only=True):
    """The server does not accept this connection or message, and why."""

    reason: str


LiveMessage = Hello | Frame | Missed | Backdrop | Heartbeat | StreamStatus | Refused
"""What a subscriber may receive."""

FieldMessage = FieldHello | Frame | Missed | FieldStatus | Heartbeat | Refused
"""What a field's socket may receive."""

WorkerMessage = Announce | Frame | Backdrop | StreamStatus
"""What the server may receive on the publish socket."""

PublishReply = Welcome | Configure | Refused
"""What a worker may receive on the publish socket."""

_encoder = msgspec.msgpack.Encoder()
_live_decoder: msgspec.msgpack.Decoder[LiveMessage] = msgspec.msgpack.Decoder(LiveMessage)
_field_decoder: msgspec.msgpack.Decoder[FieldMessage] = msgspec.msgpack.Decoder(FieldMessage)
_worker_decoder: msgspec.msgpack.Decoder[WorkerMessage] = msgspec.msgpack.Decoder(WorkerMessage)
_publish_reply_decoder: msgspec.msgpack.Decoder[PublishReply] = msgspec.msgpack.Decoder(PublishReply)
_subscribe_decoder = msgspec.msgpack.Decoder(Subscribe)


def encode(message: Message) -> bytes:
    """Return the MessagePack bytes of a message."""
    return _encoder.encode(message)


def decode_live(data: bytes) -> LiveMessage:
    """Decode what a subscriber received; raises ``msgspec.ValidationError`` or ``DecodeError`` on anything else."""
    return _live_decoder.decode(data)


def decode_field(data: bytes) -> FieldMessage:
    """Decode what came on a field's socket; raises as `decode_live`."""
    return _field_decoder.decode(data)


def decode_worker(data: bytes) -> WorkerMessage:
    """Decode what a worker sent; raises ``msgspec.ValidationError`` or ``DecodeError`` on anything else."""
    return _worker_decoder.decode(data)


def decode_publish_reply(data: bytes) -> PublishReply:
    """Decode what the server sent to a worker; raises as `decode_live`."""
    return _publish_reply_decoder.decode(data)


def decode_subscribe(data: bytes) -> Subscribe:
    """Decode what a subscriber sent; raises as `decode_live`."""
    return _subscribe_decoder.decode(data)


def pack_coefficients(coefficients: NDArray[np.floating[Any]]) -> bytes:
    """Return ``(bands², 3)`` coefficients as little-endian float32 bytes."""
    return np.ascontiguousarray(coefficients, dtype="<f4").tobytes()


def unpack_coefficients(data: bytes) -> NDArray[np.float32]:
    """Return the ``(bands², 3)`` float32 array that `pack_coefficients` packed.

    Raises
    ------
    ValueError
        Where the length is no whole number of bands.
    """
    if len(data) % 12:
        raise ValueError(f"{len(data)} bytes are no whole number of RGB float32 coefficients")
    bands_of_count(len(data) // 12)
    return np.frombuffer(data, dtype="<f4").reshape(-1, 3)


def unpack_gradients(data: bytes) -> NDArray[np.float32]:
    """Return the ``(bands², 3, 3)`` float32 array of a frame's gradients: coefficient, channel, axis.

    Raises
    ------
    ValueError
        Where the length is no whole number of bands.
    """
    if len(data) % 36:
        raise ValueError(f"{len(data)} bytes are no whole number of RGB float32 gradients")
    bands_of_count(len(data) // 36)
    return np.frombuffer(data, dtype="<f4").reshape(-1, 3, 3)
