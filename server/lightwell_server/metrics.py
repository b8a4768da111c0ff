"""Prometheus metrics: counters are read from the hub when they are asked for, histograms are fed by each frame."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

from prometheus_client import CollectorRegistry, Histogram, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric
from prometheus_client.registry import Collector

from lightwell._version import __version__
from lightwell.wire import Frame
from lightwell_server.fields import Fields
from lightwell_server.hub import Channel, Hub

LATENCY_BUCKETS = (0.001, 0.0025, 0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5)

_FROM_HUB: dict[str, tuple[str, str]] = {
    "frames_received": ("frames", "Frames that the server took from workers."),
    "frames_lost": ("lost", "Gaps in workers' sequence numbers: lost between worker and server."),
    "frames_missed": ("missed", "Frames overtaken by newer ones, summed over subscribers."),
    "frames_sent": ("sent", "Frames sent, summed over subscribers."),
    "messages_rejected": ("rejected", "Messages of workers that were not valid."),
    "received_bytes": ("bytes_in", "Bytes of messages from workers."),
    "sent_bytes": ("bytes_out", "Bytes of messages to subscribers."),
    "subscribers_stalled": ("stalled", "Subscribers that were cut off because they did not read."),
}
_FROM_WORKER: dict[str, str] = {
    "frames_in": "Frames that the worker read from the source.",
    "frames_published": "Frames that the worker published.",
    "frames_skipped": "Frames that could not be read.",
    "frames_dropped": "Frames overtaken by newer ones before they were processed or sent.",
    "nan_samples": "Samples that were NaN.",
    "infinite_samples": "Samples that were infinite.",
    "negative_samples": "Samples below zero.",
    "reconnects": "Connections that the worker made after its first.",
}


class Metrics:
    """The registry of one server."""

    def __init__(self, hub: Hub, restarts: Callable[[], dict[str, int]], fields: Fields) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_FieldCollector(fields))
        self._registry.register(_HubCollector(hub, restarts))
        self.jobs: dict[str, int] = {}
        """Jobs by state, as of the last request; empty where the queue has not been used."""
        self._registry.register(_JobCollector(lambda: self.jobs))
        self._capture_to_publish = self._histogram(
            "capture_to_publish_seconds", "Time from the capture of a frame to its sending by the worker."
        )
        self._publish_to_hub = self._histogram(
            "publish_to_hub_seconds", "Time from sending by the worker to arrival at the hub."
        )

    def _histogram(self, name: str, text: str) -> Histogram:
        return Histogram(f"lightwell_{name}", text, ["stream"], registry=self._registry, buckets=LATENCY_BUCKETS)

    def observe(self, frame: Frame, received_ns: int) -> None:
        """Record the latencies of one frame; clocks of two machines may differ, so none is below zero."""
        captured = max(frame.publish_time_ns - frame.capture_time_ns, 0) / 1e9
        travelled = max(received_ns - frame.publish_time_ns, 0) / 1e9
        self._capture_to_publish.labels(frame.stream).observe(captured)
        self._publish_to_hub.labels(frame.stream).observe(travelled)

    def text(self) -> bytes:
        """Return the exposition text."""
        return generate_latest(self._registry)


class _FieldCollector(Collector):
    """Turns what fields are made of into metrics."""

    def __init__(self, fields: Fields) -> None:
        self._fields = fields

    def describe(self) -> Iterator[Metric]:
        """Declare nothing."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """Return the metrics of this moment."""
        members = GaugeMetricFamily("lightwell_field_members", "Streams of a field.", labels=["field"])
        used = GaugeMetricFamily(
            "lightwell_field_members_used", "Streams of a field that give light now.", labels=["field"]
        )
        followers = GaugeMetricFamily("lightwell_field_subscribers", "Subscribers connected now.", labels=["field"])
        for entry in self._fields.entries():
            survey = self._fields.survey(entry.name)
            members.add_metric([entry.name], len(survey))
            used.add_metric([entry.name], sum(member.frame is not None for member in survey))
            followers.add_metric([entry.name], self._fields.followers[entry.name])
        yield from (members, used, followers)


class _JobCollector(Collector):
    """Turns the numbers of jobs into metrics."""

    def __init__(self, jobs: Callable[[], dict[str, int]]) -> None:
        self._jobs = jobs

    def describe(self) -> Iterator[Metric]:
        """Declare nothing."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """Return the metrics of this moment."""
        family = GaugeMetricFamily("lightwell_jobs", "Jobs that are kept, by state.", labels=["state"])
        for state, count in self._jobs().items():
            family.add_metric([state], count)
        yield family


class _HubCollector(Collector):
    """Turns what the hub has counted into metrics."""

    def __init__(self, hub: Hub, restarts: Callable[[], dict[str, int]]) -> None:
        self._hub = hub
        self._restarts = restarts

    def describe(self) -> Iterator[Metric]:
        """Declare nothing: the registry need not ask the hub before it runs."""
        return iter(())

    def collect(self) -> Iterator[Metric]:
        """Return the metrics of this moment."""
        channels = list(self._hub)
        info = GaugeMetricFamily("lightwell_build_info", "Version of the server.", labels=["version"])
        info.add_metric([__version__], 1)
        yield info
        for name, (attribute, text) in _FROM_HUB.items():
            family = CounterMetricFamily(f"lightwell_{name}", text, labels=["stream"])
            for channel in channels:
                family.add_metric([channel.name], getattr(channel.counters, attribute))
            yield family
        for name, text in _FROM_WORKER.items():
            family = CounterMetricFamily(f"lightwell_{name}", text, labels=["stream"])
            for channel in channels:
                if channel.status is not None:
                    family.add_metric([channel.name], getattr(channel.status, name))
            yield family
        restarts = CounterMetricFamily("lightwell_worker_restarts", "Restarts of embedded workers.", labels=["stream"])
        for name, count in self._restarts().items():
            restarts.add_metric([name], count)
        yield restarts
        yield from _gauges(channels)


def _gauges(channels: list[Channel]) -> Iterator[Metric]:
    subscribers = GaugeMetricFamily("lightwell_subscribers", "Subscribers connected now.", labels=["stream"])
    age = GaugeMetricFamily("lightwell_last_frame_age_seconds", "Time since the last frame.", labels=["stream"])
    up = GaugeMetricFamily("lightwell_source_up", "1 where a worker is connected.", labels=["stream"])
    stages = GaugeMetricFamily(
        "lightwell_stage_milliseconds", "Moving average of each stage.", labels=["stream", "stage"]
    )
    now = time.monotonic()
    for channel in channels:
        subscribers.add_metric([channel.name], len(channel.subscriptions))
        up.add_metric([channel.name], channel.publisher is not None)
        if channel.latest_at is not None:
            age.add_metric([channel.name], now - channel.latest_at)
        if channel.status is not None:
            for stage, milliseconds in channel.status.stage_ms.items():
                stages.add_metric([channel.name, stage], milliseconds)
    yield from (subscribers, age, up, stages)
