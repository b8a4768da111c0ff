"""What waits to be sent: decides what is overtaken and what must wait (no sockets here)."""

from __future__ import annotations

import threading
from collections import deque

from lightwell.wire import Backdrop, Frame, StreamStatus

LOSSLESS_CAPACITY = 8
"""Frames that may wait for the socket before a lossless publisher holds the pipeline back."""

Message = Frame | StreamStatus | Backdrop
"""What a worker sends once it is welcome."""


class Outbox:
    """Messages from the pipeline's threads to the sender.

    Frames: the newest replaces a waiting one, which counts as overtaken; a lossless outbox keeps up to
    ``LOSSLESS_CAPACITY`` in order and makes `put_frame` wait instead. Of statuses and backdrops the newest replaces a
    waiting one. Frames go first, then the status, then the backdrop.
    """

    def __init__(self, *, lossless: bool) -> None:
        self._capacity = LOSSLESS_CAPACITY if lossless else 1
        self._lossless = lossless
        self._frames: deque[Frame] = deque()
        self._status: StreamStatus | None = None
        self._backdrop: Backdrop | None = None
        self._changed = threading.Condition()
        self._closed = False
        self._overtaken = 0

    @property
    def overtaken(self) -> int:
        """Frames that a newer one replaced before they were sent."""
        return self._overtaken

    @property
    def empty(self) -> bool:
        """True where nothing waits."""
        with self._changed:
            return not self._frames and self._status is None and self._backdrop is None

    def put_frame(self, frame: Frame) -> None:
        """Leave a frame; a lossless outbox that is full waits for room.

        Once that is closed there is nobody to make room: what does not fit is thrown away.
        """
        with self._changed:
            if self._lossless:
                self._changed.wait_for(lambda: self._closed or len(self._frames) < self._capacity)
                if len(self._frames) >= self._capacity:
                    return
            elif self._frames:
                self._frames.clear()
                self._overtaken += 1
            self._frames.append(frame)

    def put_back(self, message: Message) -> None:
        """Return what could not be sent, unless a newer one waits; in a lossless outbox a frame stays the first."""
        with self._changed:
            if isinstance(message, StreamStatus):
                self._status = self._status or message
            elif isinstance(message, Backdrop):
                self._backdrop = self._backdrop or message
            elif self._lossless or not self._frames:
                self._frames.appendleft(message)
            else:
                self._overtaken += 1

    def put_status(self, status: StreamStatus) -> None:
        """Leave a status in place of a waiting one."""
        with self._changed:
            self._status = status

    def put_backdrop(self, backdrop: Backdrop) -> None:
        """Leave a backdrop in place of a waiting one."""
        with self._changed:
            self._backdrop = backdrop

    def take(self) -> Message | None:
        """Return the next message, or None where nothing waits."""
        with self._changed:
            if self._frames:
                frame = self._frames.popleft()
                self._changed.notify_all()
                return frame
            if self._status is not None:
                status, self._status = self._status, None
                return status
            backdrop, self._backdrop = self._backdrop, None
            return backdrop

    def close(self) -> None:
        """Let every waiting `put_frame` go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
