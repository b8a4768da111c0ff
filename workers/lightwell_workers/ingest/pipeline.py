"""From a source's frames to the publisher's messages.

Three kinds of threads::

    capture    pulls frames from the source in order, checks their size, hands them to a reducer
    reducers   merge → map → downsample → project → gradients, two frames at a time, in any order
    finish     window → filter → publish, in the order of the frames

A frame is pulled only when a reducer is free: a live source then delivers the newest frame there is, and a recording
of which every frame counts waits. What happens to frames is counted in `Counters`.
"""

from __future__ import annotations

import contextlib
import queue
import threading
import time
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from lightwell import wire
from lightwell.errors import FrameError
from lightwell.settings import GradientsSettings, StreamSettings
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.log import stage_logger
from lightwell_workers.ingest.sources.base import Source
from lightwell_workers.ingest.stages.backdrop import BackdropStage
from lightwell_workers.ingest.stages.finish import Finisher
from lightwell_workers.ingest.stages.gradients import MOST_BLIND
from lightwell_workers.ingest.stages.map import SizeGate, in_closed_form
from lightwell_workers.ingest.stages.reduce import Reduced, reduce_frame

REDUCERS = 2
"""Frames that are reduced at the same time; the kernels release the GIL."""


class Sink(Protocol):
    """Takes what the pipeline makes."""

    def publish(self, frame: wire.Frame) -> None:
        """Take a frame; may wait where every frame counts."""

    def show(self, backdrop: wire.Backdrop) -> None:
        """Take a backdrop."""


@dataclass(slots=True)
class Counters:
    """What has happened to frames so far."""

    frames_in: int = 0
    frames_finished: int = 0
    frames_skipped: int = 0
    nan_samples: int = 0
    infinite_samples: int = 0
    negative_samples: int = 0
    last_error: str = ""
    last_frame_time_ns: int = 0


class Pipeline:
    """Runs the stages on the frames of one source."""

    def __init__(
        self,
        source: Source,
        settings: StreamSettings,
        stream: str,
        session: str,
        sink: Sink,
        uploads: Path | None = None,
    ) -> None:
        """Prepare; ``uploads`` is where the server keeps what it was sent."""
        self.counters = Counters()
        self.settings = settings
        """Those for the frames that come next; replaced as a whole, by `configure` alone."""
        self._source = source
        self._sink = sink
        self._uploads = uploads
        self._newest: Frame | None = None
        self._size_gate = SizeGate()
        self._finisher = Finisher(stream, session)
        self._backdrop = BackdropStage(stream, session, sink.show)
        self._bad_frames = BadFrames()
        self._has_slope = True
        self._told_blind = 0.0
        self._skipping = threading.Lock()
        self._free_reducers = threading.Semaphore(REDUCERS)
        self._in_order: queue.SimpleQueue[Future[Reduced] | None] = queue.SimpleQueue()
        self._failure: Exception | None = None

    def configure(self, settings: StreamSettings) -> None:
        """Use other settings from the next frame on; source and mapping must be the same as before.

        The tables are made here, on the caller's thread, so that the stream does not wait for them.

        Raises
        ------
        LightwellError
            Where the settings do not suit the stream's pictures; nothing has changed then.
        """
        if self._newest is not None:
            reduce_frame(self._newest, settings, self._uploads)
        self.settings = settings

    def run(self) -> None:
        """Run until the source ends or is closed; then every frame that came has been given to the sink.

        Raises
        ------
        MappingError, ProxyError, MeshError
            Where the pictures cannot belong to the stream's mapping, or its gradients' proxy cannot be used.
        """
        self._prepare()
        finishing = threading.Thread(target=self._finish_frames, name="finish", daemon=True)
        finishing.start()
        try:
            with ThreadPoolExecutor(REDUCERS, thread_name_prefix="reduce") as reducers:
                self._capture(reducers)
        finally:
            self._in_order.put(None)
            finishing.join()
            self._backdrop.close()
        if self._failure is not None:
            raise self._failure

    def _prepare(self) -> None:
        """Make the tables and load the kernels with the first picture, before the first frame is due."""
        pixels = self._source.first_picture()
        if pixels is not None:
            frame = Frame(pixels=pixels, name="", capture_time_ns=0, ingest_time_ns=0)
            with contextlib.suppress(FrameError):  # it is skipped when its turn comes
                Finisher("", "").finish(reduce_frame(frame, _rehearsal(self.settings), self._uploads))

    def _capture(self, reducers: ThreadPoolExecutor) -> None:
        frames = iter(self._source)
        while True:
            self._free_reducers.acquire()
            item = next(frames, None)
            if item is None or self._failure is not None:
                return
            self.counters.frames_in += 1
            error = item if isinstance(item, FrameError) else self._size_gate.refusal(item)
            if isinstance(item, Frame) and error is None:
                self._newest = item
                self._in_order.put(reducers.submit(reduce_frame, item, self.settings, self._uploads))
            elif error is not None:
                self._skip(error)
                self._free_reducers.release()

    def _finish_frames(self) -> None:
        while (future := self._in_order.get()) is not None:
            try:
                self._finish(future.result())
            except FrameError as error:
                self._skip(error)
            except Exception as error:  # ends the pipeline: `run` raises it
                self._failure = error
                self._source.close()
            finally:
                self._free_reducers.release()

    def _finish(self, reduced: Reduced) -> None:
        message = self._finisher.finish(reduced)
        self._sink.publish(message)
        self._backdrop.offer(reduced)
        counters, counts = self.counters, reduced.counts
        counters.frames_finished += 1
        counters.nan_samples += counts.nan
        counters.infinite_samples += counts.infinite
        counters.negative_samples += counts.negative
        counters.last_frame_time_ns = time.time_ns()
        if reduced.no_slope:
            counters.last_error = f"no gradients: {reduced.no_slope}"
            if self._has_slope:  # the reason names the place, which changes with every frame
                stage_logger("gradients").warning("no gradients", frame=reduced.frame.name, reason=reduced.no_slope)
        self._has_slope = not reduced.no_slope
        blind = reduced.geometry.blind_fraction
        if reduced.slope is not None and blind > MOST_BLIND and blind != self._told_blind:
            self._told_blind = blind
            counters.last_error = (
                f"gradients are those of the light that the probe sees: it does not see {blind:.0%} of the sphere "
                f"({reduced.settings.mapping.kind}); a mirror sphere sees all round"
            )
            stage_logger("gradients").warning("much is not seen", blind_fraction=blind)

    def _skip(self, error: FrameError) -> None:
        with self._skipping:  # both the capture and the finish thread skip
            self.counters.frames_skipped += 1
            self.counters.last_error = str(error)
            self._bad_frames.report(error)


def _rehearsal(settings: StreamSettings) -> StreamSettings:
    """Return settings that load the same kernels and need nothing that only a source's frames know."""
    wanted = settings.gradients
    of_the_frame = wanted.proxy == "depth" and "{stem}" in (wanted.depth or "")
    if settings.position_m is None and wanted.proxy in ("box", "mesh", "sphere") and not in_closed_form(wanted):
        of_the_frame = True
    if not of_the_frame:
        return settings
    stand_in = GradientsSettings(proxy="sphere", radius_m=1.0, centre_m=(0.0, 0.0, 0.0))
    return settings.model_copy(update={"gradients": stand_in, "position_m": (0.0, 0.0, 0.0)})


class BadFrames:
    """Logs each bad frame once, also when a recording loops over it."""

    def __init__(self) -> None:
        self._reported: set[tuple[str, str]] = set()

    def report(self, error: FrameError) -> None:
        """Log the frame's name and the reason, the first time."""
        if (error.frame, error.reason) in self._reported:
            return
        self._reported.add((error.frame, error.reason))
        stage_logger("source").warning("frame skipped", frame=error.frame, reason=error.reason)
