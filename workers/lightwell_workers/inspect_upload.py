"""Looks into a file that a stranger has sent, in a process of its own: ``python -m lightwell_workers.inspect_upload``.

A damaged file may make its reader slow, large or crash; none of that happens to the server then. It prints one JSON
object: ``{"contents": {…}}``, or ``{"refused": "…"}``.
"""

from __future__ import annotations

import contextlib
import sys
import warnings
from pathlib import Path

import msgspec

from lightwell.errors import LightwellError
from lightwell.io.uploads import Contents, inspect_map, inspect_mesh, kind_of

MEMORY_FACTOR = 24
"""Memory for each byte of the file: text becomes numbers, and numbers normals, colours and copies."""
LEAST_MEMORY = 3 << 30
"""Of address space, most of which libraries only reserve."""


class Answer(msgspec.Struct, omit_defaults=True):
    """What is printed."""

    contents: Contents | None = None
    refused: str | None = None


def inspect(path: Path, name: str, max_triangles: int) -> Answer:
    """Return what a file holds, or why it is refused."""
    try:
        kind, _ = kind_of(name)
        contents = inspect_mesh(path, name, max_triangles) if kind == "mesh" else inspect_map(path, name)
    except LightwellError as error:
        return Answer(refused=str(error))
    except MemoryError:
        return Answer(refused=f"{name}: takes too much memory to read; simplify it or make it smaller")
    return Answer(contents=contents)


def _limit_memory(size: int) -> None:
    with contextlib.suppress(ImportError, ValueError, OSError):
        import resource

        limit = LEAST_MEMORY + MEMORY_FACTOR * size
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


def main() -> int:
    """Inspect the file that the command line names: path, name, largest number of triangles."""
    path, name, most = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    _limit_memory(path.stat().st_size)
    warnings.simplefilter("ignore")
    sys.stdout.buffer.write(msgspec.json.encode(inspect(path, name, most)) + b"\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
