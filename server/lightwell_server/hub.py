"""The hub: from one publisher a stream to any number of subscribers. No sockets and no clock of its own.

Coefficients and backdrops are state. A subscriber has one place for each, and what stands there is always the newest:
a subscription notes only *that* something new is there, and takes the channel's newest when its socket is ready. So a
slow subscriber costs nobody memory or time, misses frames, and is told how many. Everything else is an event: it goes
into a bounded queue, and a subscriber that lets that queue overflow is cut off rather than left with a gap.

Each variant (convention, bands, gradients) of a frame is converted and encoded once, when a subscriber first takes it.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import msgspec

from lightwell._version import __version__
from lightwell.settings import StreamSettings
from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_REPLACED,
    SUBPROTOCOL,
    Frame,
    Heartbeat,
    Hello,
    Message,
    Missed,
    StreamInfo,
    StreamState,
    StreamStatus,
    Subscribe,
    Vector3,
    encode,
)
from lightwell_server.config import HubSettings
from lightwell_server.masking import mask
from lightwell_server.session import SubscriberState
from lightwell_server.variants import STRIPPED, Variant, make_variant

Cause = Literal["stalled", "queue-full", "deleted", "shutdown"]
RESTART_KEYS = ("source", "mapping")
"""Settings that a running worker cannot change."""

SILENT_INTERVALS = 3
"""A slow source is late when it gives no frame for so many of its intervals."""


@dataclass(frozen=True)
class Ending:
    """Why the server ends a subscription."""

    cause: Cause
    reason: str


@dataclass
class Wishes:
    """What a subscriber asked for."""

    variant: Variant = STRIPPED
    max_fps: float | None = None
    backdrop: bool = False


@dataclass
class Publisher:
    """The worker that may publish to a channel now."""

    session: str
    settings: StreamSettings
    embedded: bool
    """Whether this server started it."""
    configure: Callable[[StreamSettings], None]
    end: Callable[[int, str], None]
    """Ends the connection, with a close code and a reason."""


@dataclass
class Counters:
    """What a channel has seen since the server started."""

    frames: int = 0
    bytes_in: int = 0
    bytes_out: int = 0
    lost: int = 0
    """Gaps in the worker's sequence numbers."""
    rejected: int = 0
    """Messages that were not valid."""
    missed: int = 0
    """Frames overtaken for a subscriber, over all subscribers."""
    sent: int = 0
    stalled: int = 0
    """Subscribers that were cut off because they did not read."""


class Subscription:
    """One subscriber's view of a channel; its shell takes messages and sends them."""

    def __init__(
        self,
        channel: Channel,
        wishes: Wishes,
        on_ready: Callable[[], None],
        on_end: Callable[[Ending], None],
        limit: int,
        *,
        frames_alone: bool = False,
    ) -> None:
        """Prepare; ``frames_alone`` leaves out all events but `Missed`."""
        self.channel = channel
        self.wishes = wishes
        self._on_ready = on_ready
        self._on_end = on_end
        self._limit = limit
        self._frames_alone = frames_alone
        self._events: deque[bytes] = deque()
        self._frame_waits = False
        self._backdrop_waits = False
        self._due = -math.inf
        self._untold = 0
        self.missed = 0
        self.state = SubscriberState.OPEN
        self.last_taken = 0.0
        self.sending_since: float | None = None
        """When the send that is still under way began; the shell keeps it."""

    def put_event(self, event: bytes) -> None:
        """Queue something that must not be lost; a full queue ends the subscription."""
        if self._frames_alone:
            return
        if len(self._events) >= self._limit:
            self.end(Ending("queue-full", f"{self._limit} events were left untaken"))
            return
        self._events.append(event)
        self._on_ready()

    def put_frame(self) -> None:
        """Note that the channel has a new frame.

        One that overtakes another counts as missed, unless it was ``max_fps`` that held the other back.
        """
        if self._frame_waits and (self.wishes.max_fps is None or self.sending_since is not None):
            self.missed += 1
            self._untold += 1
            self.channel.counters.missed += 1
        self._frame_waits = True
        self._on_ready()

    def put_backdrop(self) -> None:
        """Note that the channel has a new backdrop."""
        if self.wishes.backdrop:
            self._backdrop_waits = True
            self._on_ready()

    def take(self, now: float) -> bytes | None:
        """Return what to send next, or None where nothing is due: events, the missed notice, frame, backdrop."""
        message = self._next(now)
        if message is not None:
            self.last_taken = now
            self.channel.counters.bytes_out += len(message)
        return message

    def _next(self, now: float) -> bytes | None:
        if self.state is not SubscriberState.OPEN:
            return None
        if self._events:
            return self._events.popleft()
        if self._frame_waits and now >= self._due:
            if self._untold:
                count, self._untold = self._untold, 0
                return encode(Missed(stream=self.channel.name, count=count, total=self.missed))
            self._frame_waits = False
            self._use_allowance(now)
            self.channel.counters.sent += 1
            return self.channel.encoded(self.wishes.variant)
        if self._backdrop_waits:
            self._backdrop_waits = False
            return self.channel.backdrop
        return None

    def _use_allowance(self, now: float) -> None:
        """Put the next frame off as ``max_fps`` says; its rhythm goes on after a frame that was less than one late."""
        if self.wishes.max_fps is not None:
            interval = 1.0 / self.wishes.max_fps
            self._due = (self._due if now - self._due < interval else now) + interval

    def wait_seconds(self, now: float) -> float | None:
        """Return how long until a frame that ``max_fps`` holds back is due; None where nothing waits."""
        return max(self._due - now, 0.0) if self._frame_waits else None

    def change(self, wishes: Subscribe, now: float) -> None:
        """Apply what the subscriber asks for while connected, and show it the newest frame in that form."""
        variant = self.wishes.variant
        self.wishes = Wishes(
            variant=Variant(
                wishes.convention or variant.convention,
                wishes.bands or variant.bands,
                variant.gradients if wishes.gradients is None else wishes.gradients,
            ),
            max_fps=wishes.max_fps or self.wishes.max_fps,
            backdrop=self.wishes.backdrop if wishes.backdrop is None else wishes.backdrop,
        )
        self._due = now
        if self.wishes.backdrop and self.channel.backdrop is not None:
            self._backdrop_waits = True
        if self.channel.latest is not None:
            self._frame_waits = True
        self._on_ready()

    def end(self, ending: Ending) -> None:
        """End the subscription from the server's side; the first reason stays."""
        if self.state is SubscriberState.OPEN:
            self.state = SubscriberState.CLOSING
            self._events.clear()
            self._on_end(ending)

    def close(self) -> None:
        """Forget the subscription; nothing is sent any more."""
        self.state = SubscriberState.CLOSED
        self.channel.subscriptions.pop(self, None)


@dataclass
class Channel:
    """What the hub knows of one stream."""

    name: str
    settings: StreamSettings
    publisher: Publisher | None = None
    latest: Frame | None = None
    latest_at: float | None = None
    backdrop: bytes | None = None
    status: StreamStatus | None = None
    counters: Counters = field(default_factory=Counters)
    subscriptions: dict[Subscription, None] = field(default_factory=dict)
    _encoded: dict[Variant, bytes] = field(default_factory=dict)
    _session: str = ""
    _seq: int = -1
    _place_then: Vector3 | None = None
    """``position_m`` of the settings when the newest frame came."""

    @property
    def state(self) -> StreamState:
        """State of the source, as the worker said it or as its absence shows."""
        if self.publisher is None:
            if self.status is not None and self.status.state in ("ended", "failed"):
                return self.status.state
            return "stalled" if self.settings.enabled and self.latest is not None else "stopped"
        if self.status is None or self.status.session != self.publisher.session:
            return "starting" if self.latest is None else "running"
        return self.status.state

    def patience_seconds(self, limit_seconds: float) -> float:
        """Return how long a frame may be awaited: the limit, and longer where the source itself is slower."""
        interval_seconds = self.status.interval_seconds if self.status else 0.0
        return max(limit_seconds, SILENT_INTERVALS * interval_seconds)

    def info(self) -> StreamInfo:
        """Return what a subscriber learns about the stream."""
        settings = self.publisher.settings if self.publisher else self.settings
        return StreamInfo(
            name=self.name,
            source=mask(settings.source),
            mapping=settings.mapping.kind,
            bands=settings.bands,
            units=settings.units,
            state=self.state,
            backdrop=settings.backdrop.enabled,
            gradients=settings.gradients.proxy != "none"
            or (self.latest is not None and self.latest.gradients is not None),
        )

    def encoded(self, variant: Variant) -> bytes | None:
        """Return the newest frame's message in this form, made at most once a frame."""
        if self.latest is None:
            return None
        message = self._encoded.get(variant)
        if message is None:
            message = encode(make_variant(self.latest, variant))
            self._encoded[variant] = message
        return message

    def publish_frame(self, frame: Frame, now: float) -> None:
        """Make ``frame`` the newest."""
        if frame.session == self._session:
            self.counters.lost += max(frame.seq - self._seq - 1, 0)
        self._session, self._seq = frame.session, frame.seq
        self.counters.frames += 1
        if frame.position is None and self.settings.position_m is not None:  # of a worker that does not look there
            frame = msgspec.structs.replace(frame, position=self.settings.position_m)
        self.latest, self.latest_at = frame, now
        self._place_then = self.settings.position_m
        self._encoded = {}
        for subscription in self.subscriptions:
            subscription.put_frame()

    def publish_backdrop(self, backdrop: bytes) -> None:
        """Make a backdrop, as it came from the worker, the newest."""
        self.backdrop = backdrop
        for subscription in self.subscriptions:
            subscription.put_backdrop()

    def publish_status(self, status: StreamStatus) -> None:
        """Keep the status and hand it to every subscriber."""
        self.status = status
        self._broadcast(status)

    def attach(self, publisher: Publisher) -> None:
        """Let ``publisher`` publish; the one before it is told to go: the newer session wins."""
        if self.publisher is not None:
            self.publisher.end(CLOSE_REPLACED, "replaced: a newer worker publishes this stream")
        self.publisher = publisher
        self.status = None

    def detach(self, publisher: Publisher) -> None:
        """Forget ``publisher`` where it has not been replaced already, and tell subscribers that it has gone."""
        if self.publisher is not publisher:
            return
        self.publisher = None
        if self.state in ("stalled", "stopped"):
            before = self.status or StreamStatus(stream=self.name, session=publisher.session, state=self.state)
            gone = {"state": self.state, "fps": 0.0, "last_error": "the ingest worker is not connected"}
            self.publish_status(msgspec.structs.replace(before, **gone))

    def reconfigure(self, settings: StreamSettings) -> None:
        """Take new settings and hand them to the worker, which keeps its source and its mapping while it runs."""
        self.settings = settings
        self._correct_place()
        if self.publisher is not None:
            kept = {key: getattr(self.publisher.settings, key) for key in RESTART_KEYS}
            self.publisher.settings = settings.model_copy(update=kept)
            self.publisher.configure(self.publisher.settings)

    def _correct_place(self) -> None:
        """Let the newest frame stand where the settings now say, unless its source knew: no other may follow it."""
        before, place = self._place_then, self.settings.position_m
        if self.latest is None or place in (None, before) or self.latest.position not in (None, before):
            return
        self._place_then = place
        self.latest = msgspec.structs.replace(self.latest, position=place)
        self._encoded = {}
        for subscription in self.subscriptions:
            subscription.put_frame()

    def _broadcast(self, message: Message) -> None:
        event = encode(message)
        for subscription in self.subscriptions:
            subscription.put_event(event)


class Hub:
    """All channels, and what must be done to them from time to time."""

    def __init__(self, settings: HubSettings, server_session: str) -> None:
        self.settings = settings
        self.server_session = server_session
        self._channels: dict[str, Channel] = {}

    def __iter__(self) -> Iterator[Channel]:
        return iter(list(self._channels.values()))

    def get(self, name: str) -> Channel | None:
        """Return a channel, or None where there is none of that name."""
        return self._channels.get(name)

    def open(self, name: str, settings: StreamSettings) -> Channel:
        """Return the channel of a stream, made if there is none; its settings become ``settings``."""
        channel = self._channels.get(name)
        if channel is None:
            channel = Channel(name, settings)
            self._channels[name] = channel
        channel.settings = settings
        return channel

    def remove(self, name: str) -> None:
        """Remove a channel; its subscribers and its publisher are sent away."""
        channel = self._channels.pop(name, None)
        if channel is None:
            return
        for subscription in list(channel.subscriptions):
            subscription.end(Ending("deleted", f"the stream {name!r} has been deleted"))
        if channel.publisher is not None:
            channel.publisher.end(CLOSE_NOT_FOUND, f"the stream {name!r} has been deleted")

    def subscribers(self) -> int:
        """Return the number of subscriptions to all channels."""
        return sum(len(channel.subscriptions) for channel in self._channels.values())

    def subscribe(
        self,
        channel: Channel,
        wishes: Wishes,
        on_ready: Callable[[], None],
        on_end: Callable[[Ending], None],
        now: float,
        time_ns: int,
    ) -> Subscription:
        """Add a subscriber; its first message is the hello, with the newest frame in the form it asked for.

        ``on_ready`` is called when there may be something to take, ``on_end`` once, when the hub ends it.
        """
        subscription = Subscription(channel, wishes, on_ready, on_end, self.settings.control_queue)
        latest = make_variant(channel.latest, wishes.variant) if channel.latest is not None else None
        info = channel.info()
        info.convention = wishes.variant.convention
        hello = Hello(
            protocol=SUBPROTOCOL,
            server_version=__version__,
            server_session=self.server_session,
            stream=info,
            server_time_ns=time_ns,
            heartbeat_seconds=self.settings.heartbeat_seconds,
            latest=latest,
        )
        subscription.last_taken = now
        subscription.put_event(encode(hello))
        if channel.status is not None:
            subscription.put_event(encode(channel.status))
        if wishes.backdrop and channel.backdrop is not None:
            subscription.put_backdrop()
        channel.subscriptions[subscription] = None
        return subscription

    def follow(
        self,
        channel: Channel,
        variant: Variant,
        max_fps: float | None,
        on_ready: Callable[[], None],
        on_end: Callable[[Ending], None],
        now: float,
    ) -> Subscription:
        """Add a subscriber that gets frames alone, the newest at once; the callbacks are those of `subscribe`."""
        wishes = Wishes(variant, max_fps)
        subscription = Subscription(channel, wishes, on_ready, on_end, self.settings.control_queue, frames_alone=True)
        subscription.last_taken = now
        channel.subscriptions[subscription] = None
        if channel.latest is not None:
            subscription.put_frame()
        return subscription

    def sweep(self, now: float, time_ns: int) -> None:
        """Send heartbeats to idle subscribers and cut off those whose send does not end."""
        heartbeat = encode(Heartbeat(server_time_ns=time_ns))
        for subscription in self._subscriptions():
            if subscription.state is not SubscriberState.OPEN:
                continue
            sending = subscription.sending_since
            if sending is not None:
                if now - sending > self.settings.stall_seconds:
                    subscription.channel.counters.stalled += 1
                    subscription.end(Ending("stalled", f"took nothing for {self.settings.stall_seconds:g} s"))
            elif now - subscription.last_taken >= self.settings.heartbeat_seconds:
                subscription.put_event(heartbeat)

    def close(self) -> None:
        """Send everybody away: the server stops."""
        for subscription in self._subscriptions():
            subscription.end(Ending("shutdown", "the server is shutting down"))

    def _subscriptions(self) -> Iterable[Subscription]:
        return [subscription for channel in self for subscription in channel.subscriptions]
