"""Which hosts are this machine."""

from __future__ import annotations

import pytest

from lightwell.loopback import is_loopback


@pytest.mark.parametrize(
    "url", ["http://127.0.0.1:8400", "ws://127.9.9.9/x", "http://LOCALHOST:1", "https://a.localhost", "ws://[::1]:8400"]
)
def test_this_machine(url: str) -> None:
    assert is_loopback(url)


@pytest.mark.parametrize(
    "url", ["http://127.0.0.1.example.org", "http://10.0.0.1:8400", "http://0.0.0.0", "ws://[2001:db8::1]", "localhost"]
)
def test_elsewhere(url: str) -> None:
    assert not is_loopback(url)
