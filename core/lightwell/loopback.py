"""Telling this machine from others: no proxy reaches a server here, and a caller from here may do more."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit


def is_loopback_host(host: str) -> bool:
    """Return whether a host is this machine: ``localhost`` (RFC 6761) or a loopback address; no name is looked up."""
    host = host.lower()
    if host == "localhost" or host.endswith(".localhost"):
        return True
    try:
        address = ipaddress.ip_address(host.split("%")[0])
    except ValueError:
        return False
    mapped = address.ipv4_mapped if isinstance(address, ipaddress.IPv6Address) else None
    return (mapped or address).is_loopback


def is_loopback(url: str) -> bool:
    """Return whether the URL's host is this machine.

    HTTP clients take proxies from the environment also for such hosts, unless ``NO_PROXY`` names them.
    """
    return is_loopback_host(urlsplit(url).hostname or "")
