"""Says a thing once in a while, however often it happens."""

from __future__ import annotations

import time
from collections.abc import Hashable

MOST_KEYS = 1000


class OnceInAWhile:
    """Lets each key through at most once in ``seconds``; the rest are counted."""

    def __init__(self, seconds: float) -> None:
        self._seconds = seconds
        self._last: dict[Hashable, float] = {}
        self._held: dict[Hashable, int] = {}

    def held_back(self, key: Hashable) -> int | None:
        """Return how many were held back since the last that passed, or None where this one is held back too."""
        now = time.monotonic()
        last = self._last.get(key)
        if last is not None and now - last < self._seconds:
            self._held[key] = self._held.get(key, 0) + 1
            return None
        if len(self._last) >= MOST_KEYS:
            self._last.clear()
            self._held.clear()
        self._last[key] = now
        return self._held.pop(key, 0)
