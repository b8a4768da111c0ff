"""Poses of probes: ``poses.csv`` of a capture, other CSV files, TUM trajectories."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import LightwellError

COLUMNS = ("frame", "time_ns", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")
QUATERNION_TOLERANCE = 1e-3
LARGEST_METRES = 1e6
LARGEST_TIME_NS = 1 << 62


class CaptureError(LightwellError):
    """A capture cannot be used: names file, row or frame, field, value and the remedy."""


@dataclass(frozen=True)
class Poses:
    """Where each frame was taken."""

    frames: tuple[str, ...]
    times_ns: NDArray[np.int64]
    positions: NDArray[np.float64]
    """``(P, 3)`` metres: the probe's centre."""
    orientations: NDArray[np.float64]
    """``(P, 4)`` unit quaternions x y z w: how far the rig was turned from its base axes."""


def read_poses(path: Path) -> Poses:
    """Read a CSV file with a header of `COLUMNS`; time and quaternion may be left out (0, unturned).

    Spaces after commas, a byte-order mark, capital letters in the header, empty lines and lines that begin with ``#``
    do no harm.

    Raises
    ------
    CaptureError
        Naming file, line, field and value.
    """
    header: list[str] | None = None
    rows: list[tuple[str, dict[str, str]]] = []
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file, skipinitialspace=True)
            for values in reader:
                if not values or values[0].startswith("#"):
                    continue
                if header is None:
                    header = _header(path, values)
                    continue
                where = f"{path}, line {reader.line_num}"
                if len(values) != len(header):
                    raise CaptureError(f"{where}: has {len(values)} values, the header {len(header)}")
                rows.append((where, dict(zip(header, (value.strip() for value in values), strict=True))))
    except FileNotFoundError:
        raise CaptureError(f"{path}: there is no such file; poses are needed, one row a frame") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise CaptureError(f"{path}: cannot be read: {error}; it must be CSV in UTF-8") from None
    if header is None:
        _header(path, [])
    return collect_poses([(where, row["frame"], row) for where, row in rows])


def _header(path: Path, values: list[str]) -> list[str]:
    header = [value.strip().lower() for value in values]
    missing = [name for name in ("frame", "x_m", "y_m", "z_m") if name not in header]
    if missing:
        raise CaptureError(f"{path}: the header lacks {', '.join(missing)}; it should be {','.join(COLUMNS)}")
    twice = next((name for name in header if header.count(name) > 1), None)
    if twice is not None:
        raise CaptureError(f"{path}: the header names {twice!r} twice")
    return header


def collect_poses(rows: list[tuple[str, str, dict[str, str]]]) -> Poses:
    """Return poses from rows of (place, frame, fields); raises `CaptureError` that names the place."""
    seen: dict[str, str] = {}
    for where, frame, _ in rows:
        if not frame:
            raise CaptureError(f"{where}: frame is empty")
        if frame in seen:
            raise CaptureError(f"{where}: frame {frame!r} is already in {seen[frame].rpartition(', ')[2]}")
        if Path(frame).is_absolute() or ".." in Path(frame).parts:
            raise CaptureError(f"{where}: frame {frame!r} must lie in the capture's folder")
        seen[frame] = where
    numbers = {name: np.array([_number(where, row, name) for where, _, row in rows]) for name in COLUMNS[2:]}
    orientations = np.stack([numbers[name] for name in COLUMNS[5:]], axis=-1).reshape(-1, 4)
    lengths = np.linalg.norm(orientations, axis=1)
    for (where, _, _), length in zip(rows, lengths, strict=True):
        if abs(length - 1) > QUATERNION_TOLERANCE:
            raise CaptureError(f"{where}: the quaternion qx,qy,qz,qw has the length {length:.6g}; it must be 1")
    return Poses(
        tuple(seen),
        np.array([_time(where, row) for where, _, row in rows], dtype=np.int64),
        np.stack([numbers[name] for name in COLUMNS[2:5]], axis=-1).reshape(-1, 3),
        orientations / np.maximum(lengths, 0.5)[:, None],
    )


def _number(where: str, row: dict[str, str], name: str) -> float:
    text = row.get(name)
    if text in (None, "") and name.startswith("q"):
        return 1.0 if name == "qw" else 0.0
    try:
        value = float(text or "")
    except ValueError:
        raise CaptureError(f"{where}: {name} = {text!r} is no number") from None
    if not math.isfinite(value) or abs(value) > LARGEST_METRES:
        raise CaptureError(
            f"{where}: {name} = {text} must be a finite number, at most {LARGEST_METRES:g}: metres, or a part of a "
            "unit quaternion"
        )
    return value


def _time(where: str, row: dict[str, str]) -> int:
    text = row.get("time_ns") or "0"
    try:
        value = int(text)
    except ValueError:
        raise CaptureError(f"{where}: time_ns = {text!r} is no whole number of nanoseconds") from None
    if abs(value) > LARGEST_TIME_NS:
        raise CaptureError(f"{where}: time_ns = {text} is more than {LARGEST_TIME_NS}: are these nanoseconds?")
    return value


def write_poses(path: Path, poses: Poses) -> None:
    """Write ``poses.csv``; numbers in full precision."""
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        rows = zip(poses.frames, poses.times_ns, poses.positions, poses.orientations, strict=True)
        for frame, time_ns, position, orientation in rows:
            writer.writerow([frame, int(time_ns), *(repr(float(value)) for value in (*position, *orientation))])


def read_tum(path: Path) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Read a TUM trajectory: lines of ``timestamp tx ty tz qx qy qz qw``, seconds and metres; ``#`` starts a comment.

    As in TUM's own tools, commas count as spaces. Of lines that say the same twice, one counts.

    Returns
    -------
    Times ``(n,)`` nanoseconds, positions ``(n, 3)``, quaternions ``(n, 4)``.

    Raises
    ------
    CaptureError
        Naming file, line and value.
    """
    try:
        lines = path.read_text("utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path}: cannot be read: {error}") from None
    rows: list[tuple[str, str, dict[str, str]]] = []
    seen: dict[int, tuple[int, list[str]]] = {}
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        where = f"{path}, line {number}"
        if len(words) != 8:
            raise CaptureError(f"{where}: has {len(words)} values, not 8: timestamp tx ty tz qx qy qz qw")
        time_ns = _seconds(where, words[0])
        if time_ns in seen:
            if seen[time_ns][1] != words[1:]:
                raise CaptureError(f"{where}: timestamp {words[0]} has another pose in line {seen[time_ns][0]}")
            continue
        seen[time_ns] = (number, words[1:])
        fields = dict(zip(COLUMNS[2:], words[1:], strict=True)) | {"time_ns": str(time_ns)}
        rows.append((where, str(number), fields))
    if not rows:
        raise CaptureError(f"{path}: holds no poses")
    poses = collect_poses(rows)
    return poses.times_ns, poses.positions, poses.orientations


def _seconds(where: str, text: str) -> int:
    """Return decimal seconds as nanoseconds: a float has too few digits for today's date."""
    try:
        value = Decimal(text) * 10**9
    except InvalidOperation:
        value = Decimal("NaN")
    if not value.is_finite() or abs(value) > LARGEST_TIME_NS:
        raise CaptureError(f"{where}: timestamp = {text!r} is no number of seconds")
    return int(value)
