"""Recorded coefficients: the lines that ``lightwell watch STREAM --json`` prints, one a frame.

Each line says its own convention, bands, unit and capture time; what the stream's window has taken stays taken.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import CONVENTIONS, bands_of_count
from lightwell.errors import FrameError
from lightwell.sh.engines import convert

MAX_LINES = 1 << 19
"""Five hours of 30 frames a second."""
LARGEST = 1e20
"""Of coefficients: pictures are computed in single precision."""
MAX_VALUES = 1 << 26
"""Of all frames: 512 MiB."""
MAX_BYTES = 1 << 31
MAX_LINE_BYTES = 1 << 20
"""Of a line, or of a single document that is written over several."""
MOST_NAMED = 8
"""Streams, in an error."""
UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
REMEDY = "write it with `lightwell project --json` or `lightwell watch STREAM --json`"


class RecordedLine(msgspec.Struct):
    """What is read of a line; other keys may be there."""

    coefficients: list[tuple[float, float, float]]
    convention: str = "lightwell"
    units: str = "relative"
    stream: str = ""
    capture_time_ns: Annotated[int, msgspec.Meta(ge=0, le=(1 << 63) - 1)] | None = None
    from_hello: bool = False


class Lines(NamedTuple):
    """The frames of one stream."""

    numbers: NDArray[np.int64]
    """``(n,)``: of each frame's line in the file, from 1."""
    coefficients: NDArray[np.float64]
    """``(n, bands², 3)`` of radiance in Lightwell's convention, as many bands as the largest frame has."""
    times_ns: NDArray[np.int64] | None
    """``(n,)`` rising capture times, nanoseconds since the Unix epoch; None where the lines say none."""
    from_hello: bool
    """Whether the first frame is one that the server had when the recording began, which may be of any age."""


def read_lines(path: Path, stream: str | None = None) -> Lines:
    """Read the frames of one stream of a file.

    A last line that is cut short is left out, as are frames that came twice: after a connection was lost, a stream's
    newest frame comes again.

    Parameters
    ----------
    path
        JSON lines, or one JSON document.
    stream
        Which stream, where the file holds lines of several.

    Raises
    ------
    FrameError
        Names the file, the line, what is wrong with it and what would help.
    """
    numbers: list[int] = []
    rows: list[NDArray[np.float64]] = []
    times: list[int | None] = []
    from_hello = False
    largest = 0
    streams: dict[str, None] = {}
    units = ""
    for number, line in _parsed(path):
        if len(streams) < MOST_NAMED:
            streams[line.stream] = None
        if stream is not None and line.stream != stream:
            continue
        if len(streams) > 1 and stream is None:
            raise FrameError(
                path.name, f"holds lines of several streams ({_named(streams)}): say which by light.stream"
            )
        if units not in ("", line.units):
            raise _wrong(path, number, f"its unit is {line.units}, that of the lines before is {units}: split the file")
        units = line.units
        before = times[-1] if times else None
        if times and (line.capture_time_ns is None) != (before is None):
            raise _wrong(path, number, f"only some lines have a capture_time_ns: {REMEDY}")
        if before is not None and line.capture_time_ns is not None and line.capture_time_ns <= before:
            if line.from_hello or line.capture_time_ns == before:
                continue
            words = f"was captured before the frame of line {numbers[-1]}: keep one recording in a file, in its order"
            raise _wrong(path, number, words)
        row = _radiance(path, number, line)
        largest = max(largest, row.size)
        if len(rows) == MAX_LINES or (len(rows) + 1) * largest > MAX_VALUES:
            raise FrameError(path.name, f"has more than {len(rows)} frames of so many bands: split it")
        from_hello = from_hello or (not rows and line.from_hello)
        numbers.append(number)
        rows.append(row)
        times.append(line.capture_time_ns)
    if not rows:
        why = f"holds no frame of {stream!r}, but of {_named(streams)}" if streams else f"holds no frame: {REMEDY}"
        raise FrameError(path.name, why)
    coefficients = np.zeros((len(rows), largest // 3, 3))
    for place, row in enumerate(rows):
        coefficients[place, : len(row)] = row
    said = None if times[0] is None else np.array(times, np.int64)
    return Lines(np.array(numbers, np.int64), coefficients, said, from_hello)


def _parsed(path: Path) -> Iterator[tuple[int, RecordedLine]]:
    """Yield number and content of the lines that are not empty."""
    decoder = msgspec.json.Decoder(RecordedLine)
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size > MAX_BYTES:
                raise FrameError(path.name, f"is larger than {MAX_BYTES >> 30} GiB: split it")
            for number, text in enumerate(iter(lambda: file.readline(MAX_LINE_BYTES + 1), b""), start=1):
                if len(text) > MAX_LINE_BYTES:
                    raise _wrong(path, number, f"is longer than {MAX_LINE_BYTES >> 20} MiB: {REMEDY}")
                if not text.strip():
                    continue
                try:
                    line = decoder.decode(text)
                except UNREADABLE as error:
                    whole = _document(path, decoder) if number == 1 else None
                    if whole is not None:
                        yield 1, whole
                        return
                    if number > 1 and not text.endswith(b"\n"):
                        return  # the writer was stopped in the middle of it, or has not come to its end
                    raise _wrong(path, number, f"holds no light ({error}): {REMEDY}") from None
                yield number, line
    except OSError as error:
        raise FrameError(path.name, f"cannot be read: {error.strerror}") from None


def _document(path: Path, decoder: msgspec.json.Decoder[RecordedLine]) -> RecordedLine | None:
    """Return the light of a file that is one document over several lines, or None."""
    if path.stat().st_size > MAX_LINE_BYTES:
        return None
    try:
        return decoder.decode(path.read_bytes())
    except UNREADABLE:
        return None


def _radiance(path: Path, number: int, line: RecordedLine) -> NDArray[np.float64]:
    convention = next((name for name in CONVENTIONS if name == line.convention), None)
    if convention is None:
        raise _wrong(path, number, f"its convention {line.convention!r} is none of {', '.join(CONVENTIONS)}")
    rows = np.array(line.coefficients, np.float64).reshape(-1, 3)
    try:
        bands_of_count(len(rows))
        found = convert(rows, "lightwell", convention)
    except ValueError as error:
        raise _wrong(path, number, f"holds no light ({error}): {REMEDY}") from None
    if not (np.abs(found) <= LARGEST).all():
        raise _wrong(path, number, f"its coefficients must lie within ±{LARGEST:g}: {REMEDY}")
    return found


def _named(streams: Iterable[str]) -> str:
    return ", ".join(map(repr, streams))


def _wrong(path: Path, number: int, words: str) -> FrameError:
    return FrameError(path.name, f"line {number}: {words}")
