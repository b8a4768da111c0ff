"""Health, readiness and metrics."""

from __future__ import annotations

from pathlib import Path

import httpx
from prometheus_client.parser import text_string_to_metric_families
from tests.support.publisher import Publisher, make_status
from tests.support.server import receive, running_server, subscribe, wait_until


def ready(url: str) -> tuple[int, list[str]]:
    response = httpx.get(f"{url}/readyz")
    body = response.json()
    assert body["ready"] == (response.status_code == 200)
    return response.status_code, body["reasons"]


def test_alive_is_not_ready(tmp_path: Path) -> None:
    streams = {"probe": {"source": "exr:x"}, "off": {"source": "exr:x", "enabled": False}}
    with running_server(tmp_path, streams=streams, supervisor={"stale_seconds": 0.3}) as url:
        assert httpx.get(f"{url}/healthz").json() == {"status": "ok"}
        assert ready(url) == (503, ["stream probe: no frame yet (stopped)"])
        with Publisher(url) as worker:
            worker.publish()
            wait_until(lambda: ready(url) == (200, []))
            wait_until(lambda: ready(url)[0] == 503)
            (reason,) = ready(url)[1]
            assert reason.startswith("stream probe: last frame 0.")
            worker.send(make_status("ended"))
            wait_until(lambda: ready(url) == (200, []))


def test_a_slow_source_is_not_stale(tmp_path: Path) -> None:
    streams = {"probe": {"source": "exr:x?fps=0.05"}}
    with running_server(tmp_path, streams=streams, supervisor={"stale_seconds": 0.1}) as url, Publisher(url) as worker:
        worker.send(make_status(interval_seconds=20.0))
        worker.publish()
        wait_until(lambda: (httpx.get(f"{url}/api/v1/streams/probe").json()["last_frame_age_seconds"] or 0.0) > 0.2)
        assert ready(url) == (200, [])


def test_a_full_disk_is_a_reason(tmp_path: Path) -> None:
    with running_server(tmp_path, server={"min_free_mb": 10**9}) as url:
        status, (reason,) = ready(url)
        assert status == 503
        assert reason.startswith("disk: ")
        assert reason.endswith("MB free, 1000000000 MB wanted")


def test_metrics_say_what_happened(server: str) -> None:
    with Publisher(server) as worker:
        light = subscribe(server)
        receive(light)
        status = make_status(frames_in=9, frames_skipped=2, nan_samples=5, stage_ms={"project": 1.5, "source": 3.0})
        worker.send(status)
        for _ in range(4):
            worker.publish()
            receive(light)
        receive(light)
        text = httpx.get(f"{server}/metrics").text
        families = {family.name: family for family in text_string_to_metric_families(text)}

        def value(name: str, **labels: str) -> float:
            family = families[name.removesuffix("_total").removesuffix("_count")]
            (sample,) = [s for s in family.samples if s.name == name and labels.items() <= s.labels.items()]
            return sample.value

        stream = {"stream": "probe"}
        assert value("lightwell_frames_received_total", **stream) == 4
        assert value("lightwell_frames_sent_total", **stream) == 4
        assert value("lightwell_frames_in_total", **stream) == 9
        assert value("lightwell_frames_skipped_total", **stream) == 2
        assert value("lightwell_nan_samples_total", **stream) == 5
        assert value("lightwell_subscribers", **stream) == 1
        assert value("lightwell_source_up", **stream) == 1
        assert 0 <= value("lightwell_last_frame_age_seconds", **stream) < 60
        assert value("lightwell_stage_milliseconds", stage="project", **stream) == 1.5
        assert value("lightwell_capture_to_publish_seconds_count", **stream) == 4
        assert value("lightwell_publish_to_hub_seconds_count", **stream) == 4
        assert value("lightwell_received_bytes_total", **stream) > 400
        assert value("lightwell_sent_bytes_total", **stream) > 400
        for name in ("frames_missed", "frames_dropped", "frames_published", "frames_lost", "reconnects"):
            assert value(f"lightwell_{name}_total", **stream) == 0
        assert families["lightwell_worker_restarts"].type == "counter"
        light.close()
