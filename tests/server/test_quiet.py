"""Saying a thing once in a while."""

from __future__ import annotations

from lightwell_server import quiet
from lightwell_server.quiet import OnceInAWhile


def test_repetitions_are_held_back_and_counted() -> None:
    once = OnceInAWhile(seconds=3600)
    assert once.held_back("a") == 0
    assert once.held_back("a") is None
    assert once.held_back("a") is None
    assert once.held_back("b") == 0
    always = OnceInAWhile(seconds=0)
    assert [always.held_back("a") for _ in range(3)] == [0, 0, 0]


def test_memory_is_bounded() -> None:
    once = OnceInAWhile(seconds=3600)
    for key in range(3 * quiet.MOST_KEYS):
        once.held_back(key)
    assert len(once._last) <= quiet.MOST_KEYS
