"""Source URLs may hold credentials; what leaves the server shows ``***`` in their place."""

from __future__ import annotations

import re

MASK = "***"

_USER_INFO = re.compile(r"(?<=//)[^/@?#\s]+(?=@)")
_SECRET_PARAMETER = re.compile(
    r"(?i)(?<=[?&;])([^=&;#\s]*(?:password|passwd|pwd|secret|token|api[_-]?key|access[_-]?key|credential|auth)[^=&;#\s]*=)"
    r"[^&;#\s'\"]+"
)


def mask(text: str) -> str:
    """Return ``text`` with the user part of each URL, and the values of parameters with telling names, masked."""
    return _SECRET_PARAMETER.sub(rf"\g<1>{MASK}", _USER_INFO.sub(MASK, text))


def unmask(given: str, kept: str) -> str:
    """Return ``kept`` where ``given`` is its masked form, sent back unchanged by a client; else ``given``."""
    return kept if given == mask(kept) else given
