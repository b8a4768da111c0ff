"""Time as the sources see it, so that tests can bring their own."""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """A steady clock to pace by and the wall clock to stamp with."""

    def steady_ns(self) -> int:
        """Return nanoseconds that never jump."""

    def wall_ns(self) -> int:
        """Return nanoseconds since the Unix epoch."""

    def wait_until(self, steady_ns: int, cancelled: threading.Event) -> bool:
        """Wait for an instant of the steady clock; return False as soon as ``cancelled`` is set."""


class SystemClock:
    """The machine's clocks."""

    def steady_ns(self) -> int:
        """Return the monotonic clock."""
        return time.monotonic_ns()

    def wall_ns(self) -> int:
        """Return the real-time clock."""
        return time.time_ns()

    def wait_until(self, steady_ns: int, cancelled: threading.Event) -> bool:
        """Sleep until the instant or until ``cancelled`` is set."""
        remaining_ns = steady_ns - time.monotonic_ns()
        return not cancelled.wait(max(remaining_ns, 0) / 1e9)
