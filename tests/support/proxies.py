"""Proxies in the environment, as company machines have them."""

from __future__ import annotations

import pytest

DEAD_PROXY = "http://127.0.0.1:9"


def set_dead_proxies(monkeypatch: pytest.MonkeyPatch) -> None:
    """Send every connection that asks the environment for a proxy to one that does not answer."""
    for scheme in ("http", "https", "ws", "all"):
        for name in (f"{scheme}_proxy", f"{scheme.upper()}_PROXY"):
            monkeypatch.setenv(name, DEAD_PROXY)
    for name in ("no_proxy", "NO_PROXY"):
        monkeypatch.delenv(name, raising=False)
