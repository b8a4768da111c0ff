"""Keeping C libraries off the terminal."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager


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
