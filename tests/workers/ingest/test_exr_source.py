"""EXR sequences from disk."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from lightwell.errors import FrameError, SourceError
from lightwell.io.exr import write_rgb
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources import open_source


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for number in (1, 2, 3, 5, 6):
        write_rgb(tmp_path / f"f.{number:04d}.exr", np.full((4, 8, 3), number, np.float16))
    return tmp_path


def play(url: str) -> list[str]:
    with open_source(url) as source:
        return [item.name if isinstance(item, Frame) else f"bad {item}" for item in source]


def test_printf_reports_gaps_as_skipped_frames(folder: Path) -> None:
    assert play(f"exr:{folder}/f.%04d.exr?realtime=0") == [
        "f.0001.exr",
        "f.0002.exr",
        "f.0003.exr",
        "bad f.0004.exr: is missing from the sequence",
        "f.0005.exr",
        "f.0006.exr",
    ]


def test_frames_that_cannot_be_opened_are_skipped(folder: Path) -> None:
    (folder / "f.0002.exr").rename(folder / os.fsdecode(b"f.0002\xff.exr"))
    os.mkfifo(folder / "f.0004.exr")
    assert play(f"exr:{folder}/f.%04d.exr?realtime=0")[1:4] == [
        "bad f.0002.exr: is missing from the sequence",
        "f.0003.exr",
        "bad f.0004.exr: is not a file but a pipe, a socket or a device",
    ]
    assert play(f"exr:{folder}?realtime=0")[1] == "bad f.0002\\udcff.exr: has a name that is not UTF-8: rename the file"


def test_first_last_and_step(folder: Path) -> None:
    assert play(f"exr:{folder}/f.%04d.exr?realtime=0&first=2&last=6&step=3") == ["f.0002.exr", "f.0005.exr"]
    assert play(f"exr:{folder}?realtime=0&first=3") == ["f.0005.exr", "f.0006.exr"]


def test_step_and_speed_keep_the_recordings_pace(folder: Path) -> None:
    with open_source(f"exr:{folder}/f.%04d.exr?realtime=0&fps=10&speed=2&step=2") as source:
        times = [item.capture_time_ns for item in source if isinstance(item, Frame)]
    assert np.diff(times).tolist() == [100_000_000, 100_000_000]


def test_pixels_are_those_of_the_files(folder: Path) -> None:
    with open_source(f"exr:{folder}/f.000[56].exr?realtime=0") as source:
        frames = [item for item in source if isinstance(item, Frame)]
    assert [float(frame.pixels[0, 0, 0]) for frame in frames] == [5.0, 6.0]
    assert all(frame.pixels.dtype == np.float16 for frame in frames)


def test_loop_starts_again(folder: Path) -> None:
    names = []
    with open_source(f"exr:{folder}?realtime=0&loop=1") as source:
        for item in source:
            assert not isinstance(item, FrameError)
            names.append(item.name)
            if len(names) == 12:
                source.close()
    assert names[:2] == names[5:7] == names[10:]


def test_real_time_delivers_every_frame_when_nothing_is_late(folder: Path) -> None:
    with open_source(f"exr:{folder}?fps=200") as source:
        frames = [item for item in source if isinstance(item, Frame)]
        assert len(frames) + source.frames_dropped == 5
    assert frames[-1].name == "f.0006.exr"


def test_folder_without_a_readable_frame_is_an_error(tmp_path: Path) -> None:
    (tmp_path / "a.exr").write_bytes(b"")
    (tmp_path / "b.exr").write_text("text")
    with pytest.raises(SourceError, match=r"no frame that can be read \(a\.exr: .*EXR pictures\?"):
        open_source(f"exr:{tmp_path}")
