"""What has come and has not been taken yet. No sockets and no clock."""

from __future__ import annotations

from collections import deque

from lightwell.wire import Frame
from lightwell_client.frames import LightFrame

EVERY_FRAME_LIMIT = 256
"""Frames kept for a program that wants every one; beyond that the socket is left unread, and the server drops."""


class Inbox:
    """Frames between the socket and the program: the newest one, or every one up to a limit."""

    def __init__(self, *, newest: bool) -> None:
        self._newest = newest
        self._frames: deque[tuple[Frame, int, int, bool]] = deque()
        self._untold = 0
        self._last: tuple[object, ...] = ()
        self.missed = 0
        """Frames that the program did not get so far, overtaken at the server or here."""

    @property
    def full(self) -> bool:
        """Whether reading should wait until the program has taken something."""
        return not self._newest and len(self._frames) >= EVERY_FRAME_LIMIT

    def put_missed(self, count: int) -> None:
        """Note frames that the server overtook."""
        self.missed += count
        self._untold += count

    def put(self, frame: Frame, received_time_ns: int, *, from_hello: bool = False) -> None:
        """Keep a frame; one that has been here before (the newest, shown again after a reconnect) is dropped."""
        name = (frame.session, frame.seq, frame.convention, frame.bands, frame.gradients is None)
        if name == self._last:
            return
        self._last = name
        if self._newest and self._frames:
            _, _, told, _ = self._frames.popleft()
            self._untold += told + 1
            self.missed += 1
        self._frames.append((frame, received_time_ns, self._untold, from_hello))
        self._untold = 0

    def take(self, mapping: str) -> LightFrame | None:
        """Return the next frame, or None where there is none."""
        if not self._frames:
            return None
        frame, received_time_ns, missed, from_hello = self._frames.popleft()
        return LightFrame.from_wire(
            frame, mapping=mapping, received_time_ns=received_time_ns, missed=missed, from_hello=from_hello
        )
