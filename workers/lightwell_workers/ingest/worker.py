"""One ingest worker: a source, the stages and a publisher, with a status that says how they do."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from enum import IntEnum
from pathlib import Path
from types import FrameType
from uuid import uuid4

from pydantic import ValidationError

from lightwell._version import __version__
from lightwell.errors import LightwellError, SourceError
from lightwell.settings import StreamSettings
from lightwell.wire import Announce, Frame, StreamState, StreamStatus
from lightwell_workers.ingest.log import stage_logger
from lightwell_workers.ingest.pipeline import Pipeline
from lightwell_workers.ingest.publisher import Publisher, publish_url
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.sources.base import Source
from lightwell_workers.ingest.stages.timing import StageAverages

STATUS_SECONDS = 1.0
STALLED_SECONDS = 2.0
STALLED_INTERVALS = 3
"""A running source is stalled when it gives no frame for this long and for this many of its intervals."""
RATE_SECONDS = 2.0
"""Span over which the frame rate is counted."""
FAREWELL_SECONDS = 2.0
"""How long a live worker that ends waits for its last messages to be delivered."""

log = stage_logger("worker")


class ExitStatus(IntEnum):
    """How a worker ended."""

    DONE = 0
    """The recording is through and delivered, or the worker was asked to stop."""
    FAILED = 1
    """The source cannot be used, or not everything could be delivered."""
    REFUSED = 3
    """The server does not accept this worker; starting it again would not help."""


def run_worker(
    settings: StreamSettings,
    stream: str,
    server_url: str,
    token: str | None = None,
    on_status: Callable[[StreamStatus], None] | None = None,
    uploads: Path | None = None,
) -> ExitStatus:
    """Run one stream until its source ends, a SIGTERM or SIGINT comes, or the server refuses it.

    Call it on the main thread, because of the signals. ``on_status`` gets each status that the server gets;
    ``uploads`` is where the server keeps what it was sent.

    Raises
    ------
    SourceError
        Where ``server_url`` is no URL; and where the source cannot be opened, after the server has been told.
    """
    url = publish_url(server_url, stream)
    try:
        source = open_source(settings.source, settings.mapping, uploads)
    except SourceError as error:
        _Worker(None, settings, stream, url, token, on_status).report_failure(str(error))
        raise
    with source:
        return _Worker(source, settings, stream, url, token, on_status).run(source, uploads)


class _Worker:
    """What the worker's threads share."""

    def __init__(
        self,
        source: Source | None,
        settings: StreamSettings,
        stream: str,
        url: str,
        token: str | None,
        on_status: Callable[[StreamStatus], None] | None,
    ) -> None:
        self._source = source
        self._settings = settings
        self._stream = stream
        self._session = uuid4().hex
        self._on_status = on_status
        self._state: StreamState = "starting"
        self._error = ""
        self._wake = threading.Event()
        self._stop_asked = False
        self._averages = StageAverages()
        self._sent_at: deque[float] = deque()
        self._pipeline: Pipeline | None = None
        self._publisher = Publisher(
            url,
            token,
            announce=self._announce,
            on_settings=self._adopt,
            on_sent=self._note_sent,
            lossless=source is not None and not source.is_live,
        )

    def report_failure(self, reason: str) -> None:
        """Tell the server that the source cannot be opened."""
        self._publisher.start()
        self._change_state("failed", reason)
        self._deliver(FAREWELL_SECONDS)

    def run(self, source: Source, uploads: Path | None) -> ExitStatus:
        """Run the pipeline on a thread, and report each second until it ends."""
        pipeline = Pipeline(source, self._settings, self._stream, self._session, self._publisher, uploads)
        self._pipeline = pipeline
        failures: list[Exception] = []

        def capture() -> None:
            try:
                pipeline.run()
            except Exception as error:  # any: the main thread reports it
                failures.append(error)
            finally:
                self._wake.set()

        capturing = threading.Thread(target=capture, name="capture", daemon=True)
        with _on_termination(self._stop):
            log.info("started", source=self._settings.source, session=self._session)
            self._publisher.start()
            self._report()
            capturing.start()
            while capturing.is_alive():
                self._wake.wait(STATUS_SECONDS)
                self._wake.clear()
                if self._stop_asked or self._publisher.refused:
                    self._publisher.stop_waiting()
                    source.close()
                    capturing.join()
                else:
                    self._change_state(self._running_state())
            return self._end(failures[0] if failures else None, source)

    def _end(self, failure: Exception | None, source: Source) -> ExitStatus:
        exit_status = ExitStatus.DONE
        if failure is not None:
            log.error("failed", reason=str(failure), exc_info=not isinstance(failure, LightwellError) and failure)
            self._change_state("failed", str(failure))
            exit_status = ExitStatus.FAILED
        elif not self._publisher.refused:
            self._change_state("stopped" if self._stop_asked else "ended")
        patient = not source.is_live and self._state == "ended"
        delivered = self._deliver(None if patient else FAREWELL_SECONDS)
        if self._publisher.refused:
            self._change_state("failed", self._publisher.refused)
            exit_status = ExitStatus.REFUSED
        elif not delivered and self._state == "ended":
            exit_status = ExitStatus.FAILED
        status = self._status()
        log.info(
            self._state,
            frames_in=status.frames_in,
            frames_published=status.frames_published,
            frames_skipped=status.frames_skipped,
            frames_dropped=status.frames_dropped,
            nan_samples=status.nan_samples,
            infinite_samples=status.infinite_samples,
            negative_samples=status.negative_samples,
            reconnects=status.reconnects,
            stage_ms=status.stage_ms,
        )
        return exit_status

    def _deliver(self, timeout_seconds: float | None) -> bool:
        """Send what waits; None waits as long as it takes, unless the worker is asked to stop."""
        deadline = None if timeout_seconds is None else time.monotonic() + timeout_seconds
        self._publisher.drain()
        while not self._publisher.finished.wait(0.1):
            if self._stop_asked and deadline is None:
                deadline = time.monotonic() + FAREWELL_SECONDS
            if deadline is not None and time.monotonic() > deadline:
                break
        return self._publisher.close()

    def _stop(self) -> None:
        self._stop_asked = True
        self._wake.set()

    def _running_state(self) -> StreamState:
        if self._pipeline is None or self._source is None or self._pipeline.counters.frames_finished == 0:
            return "starting"
        age_seconds = (time.time_ns() - self._pipeline.counters.last_frame_time_ns) / 1e9
        patience_seconds = max(STALLED_SECONDS, STALLED_INTERVALS * self._source.interval_seconds)
        return "stalled" if age_seconds > patience_seconds else "running"

    def _change_state(self, state: StreamState, error: str = "") -> None:
        if state != self._state:
            log.info("state", state=state)
        self._state = state
        self._error = error or self._error
        self._report()

    def _report(self) -> None:
        status = self._status()
        self._publisher.report(status)
        if self._on_status is not None:
            self._on_status(status)

    def _status(self) -> StreamStatus:
        status = StreamStatus(
            stream=self._stream,
            session=self._session,
            state=self._state,
            fps=self._rate(),
            interval_seconds=0.0 if self._source is None else self._source.interval_seconds,
            frames_published=self._publisher.published,
            frames_dropped=self._publisher.overtaken,
            reconnects=self._publisher.reconnects,
            last_error=self._publisher.error or self._error,
            stage_ms=self._averages.snapshot(),
        )
        if self._pipeline is not None and self._source is not None:
            counters = self._pipeline.counters
            status.frames_in = counters.frames_in
            status.frames_skipped = counters.frames_skipped
            status.frames_dropped += self._source.frames_dropped
            status.nan_samples = counters.nan_samples
            status.infinite_samples = counters.infinite_samples
            status.negative_samples = counters.negative_samples
            status.last_error = status.last_error or counters.last_error
            status.last_frame_time_ns = counters.last_frame_time_ns
        return status

    def _rate(self) -> float:
        now = time.monotonic()
        recent = [sent for sent in self._sent_at.copy() if now - sent <= RATE_SECONDS]
        if len(recent) < 2:
            return 0.0
        return round((len(recent) - 1) / max(now - recent[0], 1e-3), 2)

    def _note_sent(self, frame: Frame) -> None:
        self._averages.add(frame.quality.stage_ms)
        now = time.monotonic()
        self._sent_at.append(now)
        while now - self._sent_at[0] > RATE_SECONDS:
            self._sent_at.popleft()
        if self._state != "running":
            self._wake.set()

    def _announce(self) -> Announce:
        settings = self._settings if self._pipeline is None else self._pipeline.settings
        return Announce(
            stream=self._stream,
            session=self._session,
            worker_version=__version__,
            settings=settings.model_dump(mode="json"),
            pid=os.getpid(),
            hostname=socket.gethostname(),
        )

    def _adopt(self, document: dict[str, object]) -> None:
        """Use the settings that the server sends, all of them or none."""
        if self._pipeline is None:
            return
        try:
            settings = StreamSettings.model_validate(document)
            if (settings.source, settings.mapping) != (self._settings.source, self._settings.mapping):
                raise SourceError("source and mapping cannot change while a worker runs: start the worker again")
            settings = settings.model_copy(update={"enabled": self._settings.enabled})  # the server's affair
            if settings != self._pipeline.settings:
                self._pipeline.configure(settings)
                log.info("settings changed")
            self._error = ""
        except (ValidationError, LightwellError) as error:
            self._error = f"settings refused: {error}"
            log.warning("settings refused", reason=str(error))
            self._wake.set()


@contextmanager
def _on_termination(stop: Callable[[], None]) -> Iterator[None]:
    """Call ``stop`` on SIGTERM and SIGINT within a ``with`` statement."""

    def handle(number: int, frame: FrameType | None) -> None:
        stop()

    before = {number: signal.signal(number, handle) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
