"""What may be opened as a picture; files that appear whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from lightwell.errors import FrameError


def require_file(path: Path) -> None:
    """Raise `FrameError` where ``path`` is nothing that can be read as a picture: opening a pipe would wait for ever.

    That something is there at all, and may be read, shows when it is opened.
    """
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise FrameError(path.name, "has a name that is not UTF-8: rename the file") from None
    if path.exists() and not path.is_file() and not path.is_dir():
        raise FrameError(path.name, "is not a file but a pipe, a socket or a device")


def write_atomically(path: Path, data: bytes) -> Path:
    """Write a file that appears whole or not at all; return its path. Raises ``OSError``."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        partial.write_bytes(data)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    return path
