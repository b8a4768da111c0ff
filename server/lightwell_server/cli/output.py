"""What commands write: files that appear whole; nothing of C libraries."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Send what is written to the file descriptors 1 and 2 meanwhile to nowhere.

    OpenEXR prints warnings about damaged files to both, in the middle of a program's JSON; the exception that it raises
    says the same. Only for a process with one thread.
    """
    kept = [(descriptor, os.dup(descriptor)) for descriptor in (1, 2)]
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        for descriptor, _ in kept:
            os.dup2(nowhere, descriptor)
        yield
    finally:
        os.close(nowhere)
        for descriptor, copy in kept:
            os.dup2(copy, descriptor)
            os.close(copy)


def write_picture(path: Path, data: bytes) -> None:
    """Write a picture; raises `LightwellError` where its folder cannot be written."""
    from lightwell.errors import LightwellError
    from lightwell.io.files import write_atomically

    try:
        write_atomically(path, data)
    except OSError as error:
        raise LightwellError(f"{path}: cannot be written: {error.strerror}; give another file") from None
