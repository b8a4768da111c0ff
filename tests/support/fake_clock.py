"""A clock that moves when it is told to, and when somebody waits."""

from __future__ import annotations

import threading


class FakeClock:
    def __init__(self, wall_offset_ns: int = 1_700_000_000_000_000_000) -> None:
        self.now_ns = 5_000_000_000
        self.wall_offset_ns = wall_offset_ns

    def steady_ns(self) -> int:
        return self.now_ns

    def wall_ns(self) -> int:
        return self.now_ns + self.wall_offset_ns

    def wait_until(self, steady_ns: int, cancelled: threading.Event) -> bool:
        self.now_ns = max(self.now_ns, steady_ns)
        return not cancelled.is_set()

    def advance_ms(self, milliseconds: float) -> None:
        self.now_ns += round(milliseconds * 1e6)
