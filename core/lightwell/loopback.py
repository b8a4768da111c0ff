"""Telling a server on this machine, which no proxy can reach, from one elsewhere."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit


def is_loopback(url: str) -> bool:
    """Return whether the URL's host is this machine: ``localhost`` (RFC 6761) or a loopback address.

    Names are not looked up. HTTP clients take proxies from the environment also for such hosts, unless ``NO_PROXY``
    names them.
    """
    host = urlsplit(url).hostname or ""
    if host == "localhost" or host.endswith(".localhost"):
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
