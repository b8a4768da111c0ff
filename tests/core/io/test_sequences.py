"""Which files a pattern names, and in which order."""

from __future__ import annotations

from pathlib import Path

import pytest

from lightwell.errors import SourceError
from lightwell.io.sequences import find_sequence


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("f1.exr", "f2.exr", "f4.exr", "f10.exr", "g1.EXR", "notes.txt"):
        (tmp_path / name).touch()
    (tmp_path / "deep.exr").mkdir()
    return tmp_path


def names(pattern: object, **limits: int) -> list[str]:
    return [entry.name for entry in find_sequence(str(pattern), **limits)]


def test_folder_in_natural_order(folder: Path) -> None:
    assert names(folder) == ["f1.exr", "f2.exr", "f4.exr", "f10.exr", "g1.EXR"]


def test_glob_in_natural_order(folder: Path) -> None:
    assert names(folder / "f*.exr") == ["f1.exr", "f2.exr", "f4.exr", "f10.exr"]
    assert names(folder / "f?.exr", first=1, last=1) == ["f2.exr"]


def test_a_file_whose_name_looks_like_a_glob(folder: Path) -> None:
    (folder / "f[12].exr").touch()
    assert names(folder / "f[12].exr") == ["f[12].exr"]
    assert names(folder / "[f]1.exr") == ["f1.exr"]


def test_printf_keeps_gaps(folder: Path) -> None:
    entries = find_sequence(str(folder / "f%d.exr"), last=5)
    assert [(entry.name, entry.path is not None) for entry in entries] == [
        ("f1.exr", True),
        ("f2.exr", True),
        ("f3.exr", False),
        ("f4.exr", True),
        ("f5.exr", False),
    ]


def test_printf_pads_and_reads_longer_numbers(tmp_path: Path) -> None:
    for number in (998, 999, 1000):
        (tmp_path / f"x.{number:03d}.exr").touch()
    (tmp_path / "x.7.exr").touch()
    assert names(tmp_path / "x.%03d.exr") == ["x.998.exr", "x.999.exr", "x.1000.exr"]
    assert names(tmp_path / "x.%03d.exr", first=999) == ["x.999.exr", "x.1000.exr"]


@pytest.mark.parametrize("pattern", ["nothing/*.exr", "f%06d.exr", "empty", "nowhere/f%d.exr"])
def test_no_match_is_an_error_with_a_remedy(folder: Path, pattern: str) -> None:
    (folder / "empty").mkdir()
    with pytest.raises(SourceError, match=r"matches no file|holds no \*.exr file"):
        find_sequence(str(folder / pattern))


def test_limits_outside_are_an_error(folder: Path) -> None:
    with pytest.raises(SourceError, match="no file numbered 20"):
        find_sequence(str(folder / "f%d.exr"), first=20)
    with pytest.raises(SourceError, match="has 5 files"):
        find_sequence(str(folder), first=20)


def test_a_stray_number_is_an_error_and_no_list_of_all_between(folder: Path) -> None:
    (folder / "f20261126.exr").touch()
    with pytest.raises(SourceError, match=r"goes from 1 to 20261126, more than \d+ frames: move"):
        find_sequence(str(folder / "f%d.exr"))
    with pytest.raises(SourceError, match="matches no file"):
        find_sequence(str(folder / f"f%0{'9' * 30}d.exr"))
