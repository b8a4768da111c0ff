"""The hub without sockets: who gets what, and what is never lost."""

from __future__ import annotations

from typing import Any

import pytest
from tests.support.publisher import make_backdrop, make_frame, make_status

from lightwell.settings import StreamSettings
from lightwell.wire import (
    CLOSE_NOT_FOUND,
    CLOSE_REPLACED,
    Backdrop,
    Frame,
    Heartbeat,
    Hello,
    LiveMessage,
    Missed,
    StreamStatus,
    Subscribe,
    decode_live,
    encode,
)
from lightwell_server.config import HubSettings
from lightwell_server.hub import Channel, Ending, Hub, Publisher, Subscription, Wishes
from lightwell_server.session import SubscriberState
from lightwell_server.variants import Variant, make_variant

SETTINGS = StreamSettings(source="exr:/pictures?password=hush", bands=3)


class Subscriber:
    """A subscription and what its shell would do with it."""

    def __init__(self, hub: Hub, channel: Channel, wishes: Wishes | None = None, now: float = 0.0) -> None:
        self.wakes = 0
        self.endings: list[Ending] = []
        self.subscription: Subscription = hub.subscribe(
            channel, wishes or Wishes(), self._wake, self.endings.append, now, time_ns=1
        )

    def _wake(self) -> None:
        self.wakes += 1

    def take(self, now: float = 0.0) -> LiveMessage | None:
        data = self.subscription.take(now)
        return None if data is None else decode_live(data)

    def take_all(self, now: float = 0.0) -> list[LiveMessage]:
        return list(iter(lambda: self.take(now), None))


@pytest.fixture
def hub() -> Hub:
    return Hub(HubSettings(control_queue=4, stall_seconds=10, heartbeat_seconds=2), "run")


@pytest.fixture
def channel(hub: Hub) -> Channel:
    return hub.open("probe", SETTINGS)


def make_publisher(session: str = "s1") -> Publisher:
    return Publisher(
        session=session,
        settings=SETTINGS,
        embedded=False,
        configure=lambda settings: None,
        end=lambda code, reason: None,
    )


def test_the_hello_comes_first_with_the_newest_frame(hub: Hub, channel: Channel) -> None:
    channel.publish_frame(make_frame(6), 0)
    channel.publish_frame(make_frame(7), 0)
    subscriber = Subscriber(hub, channel, Wishes(Variant("three", 2)))
    hello = subscriber.take()
    assert isinstance(hello, Hello)
    assert hello.latest is not None
    assert (hello.latest.seq, hello.latest.bands, hello.latest.convention) == (7, 2, "three")
    assert (hello.server_session, hello.stream.name, hello.stream.convention) == ("run", "probe", "three")
    assert "hush" not in hello.stream.source
    assert subscriber.take() is None


def test_a_subscriber_that_keeps_up_gets_every_frame(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    subscriber.take_all()
    for seq in range(5):
        channel.publish_frame(make_frame(seq), 0)
        (frame,) = subscriber.take_all()
        assert isinstance(frame, Frame)
        assert frame.seq == seq
    assert subscriber.subscription.missed == 0


def test_a_slow_subscriber_gets_the_newest_and_is_told_how_many_it_missed(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    subscriber.take_all()
    for seq in range(5):
        channel.publish_frame(make_frame(seq), 0)
    missed, frame = subscriber.take_all()
    assert isinstance(missed, Missed)
    assert (missed.count, missed.total) == (4, 4)
    assert isinstance(frame, Frame)
    assert frame.seq == 4
    channel.publish_frame(make_frame(5), 0)
    channel.publish_frame(make_frame(6), 0)
    (missed, frame) = subscriber.take_all()
    assert isinstance(missed, Missed)
    assert (missed.count, missed.total) == (1, 5)
    assert channel.counters.missed == 5


def test_each_variant_is_made_once_a_frame(hub: Hub, channel: Channel, monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Variant] = []

    def counted(frame: Frame, variant: Variant) -> Frame:
        made.append(variant)
        return make_variant(frame, variant)

    monkeypatch.setattr("lightwell_server.hub.make_variant", counted)
    variants = [Variant(), Variant("three"), Variant("three", 2)]
    subscribers = [Subscriber(hub, channel, Wishes(variant)) for variant in variants * 10]
    for subscriber in subscribers:
        subscriber.take_all()
    channel.publish_frame(make_frame(1), 0)
    messages = [subscriber.subscription.take(0) for subscriber in subscribers]
    assert made == variants
    assert len({id(message) for message in messages}) == len(variants)


def test_max_fps_holds_frames_back_without_counting_them(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel, Wishes(max_fps=10))
    subscriber.take_all()
    got = []
    for step in range(101):  # ten seconds at 100 steps a tenth
        now = step / 10 / 3 + 1
        channel.publish_frame(make_frame(step), now)
        got += [frame for frame in subscriber.take_all(now) if isinstance(frame, Frame)]
    assert 33 <= len(got) <= 36
    assert subscriber.subscription.missed == 0


def test_the_last_frame_comes_when_max_fps_lets_it(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel, Wishes(max_fps=2))
    subscriber.take_all()
    for seq in range(3):
        channel.publish_frame(make_frame(seq), 1.0)
        subscriber.take_all(1.0)
    wait_seconds = subscriber.subscription.wait_seconds(1.0)
    assert wait_seconds is not None
    (frame,) = subscriber.take_all(1.0 + wait_seconds)
    assert isinstance(frame, Frame)
    assert frame.seq == 2
    assert subscriber.subscription.wait_seconds(9.0) is None


def test_max_fps_holds_from_the_first_frame_on(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel, Wishes(max_fps=0.5), now=100.0)
    subscriber.take_all(100.0)
    got = []
    for step in range(61):  # six seconds
        now = 100.0 + step / 10
        channel.publish_frame(make_frame(step), now)
        got += [step for message in subscriber.take_all(now) if isinstance(message, Frame)]
    assert got == [0, 20, 40, 60]


def test_a_send_under_way_counts_as_slow_even_with_max_fps(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel, Wishes(max_fps=10))
    subscriber.subscription.sending_since = 0.0
    for seq in range(3):
        channel.publish_frame(make_frame(seq), 0)
    assert subscriber.subscription.missed == 2


def test_backdrops_go_to_those_who_asked_and_the_newest_wins(hub: Hub, channel: Channel) -> None:
    one, other = Subscriber(hub, channel, Wishes(backdrop=True)), Subscriber(hub, channel)
    one.take_all(), other.take_all()
    channel.publish_backdrop(encode(make_backdrop(1)))
    channel.publish_backdrop(encode(make_backdrop(2)))
    (backdrop,) = one.take_all()
    assert isinstance(backdrop, Backdrop)
    assert backdrop.seq == 2
    assert other.take_all() == []
    late = Subscriber(hub, channel, Wishes(backdrop=True))
    assert isinstance(late.take_all()[1], Backdrop)


def test_events_keep_their_order_and_come_before_frames(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    subscriber.take_all()
    channel.publish_frame(make_frame(1), 0)
    channel.publish_status(make_status(frames_in=1))
    channel.publish_status(make_status(frames_in=2))
    first, second, frame = subscriber.take_all()
    assert isinstance(first, StreamStatus)
    assert isinstance(second, StreamStatus)
    assert (first.frames_in, second.frames_in) == (1, 2)
    assert isinstance(frame, Frame)


def test_a_full_event_queue_ends_the_subscription(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    for count in range(10):
        channel.publish_status(make_status(frames_in=count))
    assert [ending.cause for ending in subscriber.endings] == ["queue-full"]
    assert subscriber.subscription.state is SubscriberState.CLOSING
    assert subscriber.take() is None


def test_the_sweep_sends_heartbeats_to_the_idle_only(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    subscriber.take_all(1.0)
    hub.sweep(2.9, time_ns=5)
    assert subscriber.take_all(2.9) == []
    hub.sweep(3.0, time_ns=6)
    (heartbeat,) = subscriber.take_all(3.0)
    assert isinstance(heartbeat, Heartbeat)
    assert heartbeat.server_time_ns == 6


def test_the_sweep_cuts_off_a_send_that_does_not_end(hub: Hub, channel: Channel) -> None:
    stalled, other = Subscriber(hub, channel), Subscriber(hub, channel)
    stalled.subscription.sending_since = 5.0
    hub.sweep(15.0, 0)
    assert stalled.endings == []
    hub.sweep(15.1, 0)
    hub.sweep(15.2, 0)
    assert [ending.cause for ending in stalled.endings] == ["stalled"]
    assert other.endings == []
    assert channel.counters.stalled == 1


def test_a_change_is_answered_with_the_newest_frame_in_the_new_form(hub: Hub, channel: Channel) -> None:
    channel.publish_frame(make_frame(3), 0)
    channel.publish_backdrop(encode(make_backdrop(1)))
    subscriber = Subscriber(hub, channel, Wishes(Variant("three", 2), max_fps=1))
    subscriber.take_all()
    subscriber.subscription.change(Subscribe(bands=1, backdrop=True), 0.1)
    frame, backdrop = subscriber.take_all(0.1)
    assert isinstance(frame, Frame)
    assert (frame.bands, frame.convention) == (1, "three")
    assert isinstance(backdrop, Backdrop)
    assert subscriber.subscription.wishes.max_fps == 1


def test_gradients_go_to_those_who_ask(hub: Hub, channel: Channel) -> None:
    gradients = bytes(9 * 9 * 4)
    channel.publish_frame(make_frame(0, gradients=gradients, position=(1.0, 2.0, 3.0), trust_radius_m=0.5), 0)
    subscriber = Subscriber(hub, channel)
    hello = subscriber.take()
    assert isinstance(hello, Hello)
    assert hello.latest is not None
    assert hello.stream.gradients
    assert (hello.latest.gradients, hello.latest.position, hello.latest.trust_radius_m) == (None, (1, 2, 3), 0.5)
    for wishes, length in ((Subscribe(gradients=True), 9), (Subscribe(bands=2), 4), (Subscribe(gradients=False), None)):
        subscriber.subscription.change(wishes, 0)
        (frame,) = subscriber.take_all()
        assert isinstance(frame, Frame)
        assert frame.gradients == (None if length is None else bytes(length * 9 * 4))


def test_the_newer_publisher_wins_and_the_older_leaves_no_trace(channel: Channel) -> None:
    told: list[tuple[int, str]] = []
    older, newer = make_publisher("old"), make_publisher("new")
    older.end = lambda code, reason: told.append((code, reason))
    channel.attach(older)
    channel.attach(newer)
    assert told == [(CLOSE_REPLACED, "replaced: a newer worker publishes this stream")]
    channel.detach(older)
    assert channel.publisher is newer


def test_the_state_follows_worker_and_status(hub: Hub, channel: Channel) -> None:
    states = [channel.state]
    publisher = make_publisher()
    channel.attach(publisher)
    states.append(channel.state)
    channel.publish_status(make_status("running"))
    channel.publish_frame(make_frame(0), 0)
    states.append(channel.state)
    subscriber = Subscriber(hub, channel)
    subscriber.take_all()
    channel.detach(publisher)
    states.append(channel.state)
    assert states == ["stopped", "starting", "running", "stalled"]
    (status,) = subscriber.take_all()
    assert isinstance(status, StreamStatus)
    assert (status.state, status.last_error) == ("stalled", "the ingest worker is not connected")


def test_a_slow_source_is_given_time_for_three_of_its_frames(channel: Channel) -> None:
    assert channel.patience_seconds(5.0) == 5.0
    channel.publish_status(make_status(interval_seconds=1.0))
    assert channel.patience_seconds(5.0) == 5.0
    channel.publish_status(make_status(interval_seconds=20.0))
    assert channel.patience_seconds(5.0) == 60.0


def test_an_ended_source_stays_ended(channel: Channel) -> None:
    publisher = make_publisher()
    channel.attach(publisher)
    channel.publish_status(make_status("ended"))
    channel.detach(publisher)
    assert channel.state == "ended"


def test_gaps_between_worker_and_hub_are_counted_within_a_session(channel: Channel) -> None:
    for seq in (0, 1, 5):
        channel.publish_frame(make_frame(seq), 0)
    assert channel.counters.lost == 3
    channel.publish_frame(make_frame(9, session="s2"), 0)
    assert channel.counters.lost == 3


def test_removing_a_channel_sends_everybody_away(hub: Hub, channel: Channel) -> None:
    told: list[tuple[int, str]] = []
    publisher = make_publisher()
    publisher.end = lambda code, reason: told.append((code, reason))
    channel.attach(publisher)
    subscriber = Subscriber(hub, channel)
    hub.remove("probe")
    assert hub.get("probe") is None
    assert [ending.cause for ending in subscriber.endings] == ["deleted"]
    assert told == [(CLOSE_NOT_FOUND, "the stream 'probe' has been deleted")]
    hub.remove("probe")


def test_closing_forgets_the_subscription(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel)
    assert hub.subscribers() == 1
    subscriber.subscription.close()
    assert hub.subscribers() == 0
    assert subscriber.subscription.state is SubscriberState.CLOSED


def test_nothing_is_kept_for_a_subscriber_that_never_takes(hub: Hub, channel: Channel) -> None:
    subscriber = Subscriber(hub, channel, Wishes(backdrop=True))
    for seq in range(1000):
        channel.publish_frame(make_frame(seq), 0)
        channel.publish_backdrop(encode(make_backdrop(seq)))
    messages = subscriber.take_all()
    assert [type(message) for message in messages] == [Hello, Missed, Frame, Backdrop]


def test_frames_stand_where_the_settings_say_unless_their_source_knows(hub: Hub, channel: Channel) -> None:
    """Also the last one, after which none may come: a recording has ended, and its place is corrected."""
    placed = SETTINGS.model_copy(update={"position_m": (1.0, 2.0, 3.0)})
    subscriber = Subscriber(hub, channel)
    subscriber.take_all()

    def stands() -> Any:
        assert channel.latest is not None
        return channel.latest.position

    def settle(settings: StreamSettings) -> Any:
        hub.open("probe", settings)  # as the catalogue does
        channel.reconfigure(settings)
        return stands()

    channel.publish_frame(make_frame(0), 0)
    assert settle(placed) == (1, 2, 3)
    frame = subscriber.take_all()[-1]
    assert isinstance(frame, Frame)
    assert list(frame.position or ()) == [1, 2, 3]
    assert settle(placed.model_copy(update={"position_m": (4.0, 5.0, 6.0)})) == (4, 5, 6)
    channel.publish_frame(make_frame(1), 0)
    assert stands() == (4, 5, 6)
    channel.publish_frame(make_frame(2, position=(7.0, 8.0, 9.0)), 0)
    assert settle(placed) == (7, 8, 9)
