"""Reading pictures of any kind."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from lightwell.errors import FrameError
from lightwell.io.exr import write_rgb
from lightwell.io.pictures import read_picture


def test_radiance_is_read_as_rgb(tmp_path: Path) -> None:
    pixels = np.random.default_rng(1).lognormal(size=(20, 30, 3)).astype(np.float32)
    path = tmp_path / "a.hdr"
    cv2.imwrite(str(path), pixels[..., ::-1])
    picture = read_picture(path)
    assert picture.pixels.dtype == np.float32
    # Radiance shares one exponent among the three colours.
    assert np.all(np.abs(picture.pixels - pixels) <= pixels.max(axis=-1, keepdims=True) / 127)
    assert picture.name == "a.hdr"


def test_exr_under_another_name(tmp_path: Path) -> None:
    pixels = np.ones((4, 8, 3), np.float16)
    write_rgb(tmp_path / "a.exr", pixels)
    (tmp_path / "a.exr").rename(tmp_path / "a.frame")
    assert np.array_equal(read_picture(tmp_path / "a.frame").pixels, pixels)


def test_a_damaged_picture_is_reported_by_the_error_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.hdr").write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10 +X 20\n")
    with pytest.raises(FrameError, match="damaged"):
        read_picture(tmp_path / "a.hdr")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("name", ["a.exr", "a.hdr", "a.png", "a"])
def test_a_pipe_is_not_waited_for(tmp_path: Path, name: str) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(FrameError, match="is not a file but a pipe"):
        read_picture(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("a.png", b"\x89PNG", "is not HDR: PNG cannot hold real light; use .exr or .hdr"),
        ("a.JPG", b"", "is not HDR: JPG cannot hold real light; use .exr or .hdr"),
        ("a.txt", b"x", r"is not HDR: only OpenEXR \(.exr\) and Radiance \(.hdr\) pictures are read"),
        ("a.hdr", b"", "is empty"),
        ("b.hdr", b"hello", "is not a Radiance picture"),
        ("c.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 10 +X 20\n", "is (truncated or )?damaged"),
        ("xyz.hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_xyze\n\n-Y 1 +X 1\n1234", "XYZ colour .* is not supported"),
        (
            "up.hdr",
            b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n+Y 1 +X 1\n1234",
            r"orientation \+Y 1 \+X 1, .* not supported",
        ),
        ("d.hdr", None, "does not exist"),
        ("e", None, "does not exist"),
    ],
)
def test_what_is_not_hdr(tmp_path: Path, name: str, content: bytes | None, reason: str) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(FrameError, match=reason):
        read_picture(tmp_path / name)
