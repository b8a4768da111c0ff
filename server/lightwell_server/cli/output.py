"""What commands write: files that appear whole, progress bars; nothing of C libraries."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
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


@contextmanager
def progress_bar(title: str) -> Iterator[Callable[[int, int], None]]:
    """Give a function that moves a progress bar on a terminal, from what is done and how much there is."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty()) as progress:
        task = progress.add_task(title, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
