"""Finding the files of a recorded sequence."""

from __future__ import annotations

import glob
import re
from dataclasses import dataclass
from pathlib import Path

from lightwell.errors import SourceError

PICTURE_SUFFIX = ".exr"
MOST = 1 << 20
"""Entries of a sequence: ten hours of 30 frames a second."""
_PRINTF = re.compile(r"%(?:0(\d{1,2}))?d")


@dataclass(frozen=True, slots=True)
class SequenceEntry:
    """One position of a sequence."""

    name: str
    path: Path | None
    """None where a numbered sequence has a gap."""


def find_sequence(pattern: str, first: int | None = None, last: int | None = None) -> list[SequenceEntry]:
    """Return the entries of a folder, a file, a glob or a printf pattern (``frame.%04d.exr``), in natural order.

    ``first`` and ``last`` (inclusive) are frame numbers for a printf pattern, whose gaps are entries without a path,
    and positions counted from 0 otherwise.

    Raises
    ------
    SourceError
        Where nothing matches; says what was looked for.
    """
    printf = _PRINTF.search(Path(pattern).name)
    if printf is not None:
        return _numbered(Path(pattern), printf, first, last)
    folder = Path(pattern)
    if folder.is_dir():
        found = [path for path in folder.iterdir() if path.suffix.lower() == PICTURE_SUFFIX and path.is_file()]
        missing = f"folder {pattern!r} holds no *{PICTURE_SUFFIX} file: give the folder of the frames themselves"
    else:
        matches = [pattern] if folder.is_file() else glob.glob(pattern)  # noqa: PTH207, may be absolute
        found = [path for path in map(Path, matches) if path.is_file()]
        missing = f"{pattern!r} matches no file: give a folder, a glob (dir/*.exr) or a printf pattern (frame.%04d.exr)"
    if not found:
        raise SourceError(missing)
    found.sort(key=natural_key)
    chosen = found[first or 0 : None if last is None else last + 1]
    if not chosen:
        raise SourceError(f"{pattern!r} has {len(found)} files, none from position {first} to {last}")
    return [SequenceEntry(path.name, path) for path in chosen]


def natural_key(path: Path) -> tuple[list[tuple[int, str]], str]:
    """Return a sort key that orders the numbers in a name by value: ``f2`` before ``f10``."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if i % 2 else (0, part) for i, part in enumerate(parts)], path.name


def _numbered(pattern: Path, printf: re.Match[str], first: int | None, last: int | None) -> list[SequenceEntry]:
    before, after = pattern.name[: printf.start()], pattern.name[printf.end() :]
    digits = int(printf[1] or 1)
    matcher = re.compile(re.escape(before) + rf"(\d{{{digits},}})" + re.escape(after))
    numbers = {}
    if pattern.parent.is_dir():
        for path in pattern.parent.iterdir():
            match = matcher.fullmatch(path.name)
            if match is not None:
                numbers[int(match[1])] = path
    low = min(numbers, default=0) if first is None else first
    high = max(numbers, default=0) if last is None else last
    if not any(low <= number <= high for number in numbers):
        span = f" numbered {low} to {high}" if numbers else ""
        raise SourceError(f"{str(pattern)!r} matches no file{span} in {str(pattern.parent)!r}")
    if high - low >= MOST:
        raise SourceError(
            f"{str(pattern)!r} goes from {low} to {high}, more than {MOST} frames: move files away that are none of it"
        )
    return [
        SequenceEntry(f"{before}{number:0{digits}d}{after}", numbers.get(number)) for number in range(low, high + 1)
    ]
