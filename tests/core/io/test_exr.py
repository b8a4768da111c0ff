"""Every EXR that a camera or artist may hand over, and every way in which one can be bad."""

from __future__ import annotations

import os
import struct
import threading
from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR
import pytest
from numpy.typing import DTypeLike, NDArray

from lightwell.errors import FrameError
from lightwell.io.exr import COMPRESSIONS, MAX_PIXELS, read_depth, read_rgb, write_rgb

LOSSY = {"b44", "b44a", "dwaa", "dwab", "lj2k", "pxr24"}


@pytest.fixture
def pixels() -> np.ndarray:
    rng = np.random.default_rng(7)
    return (rng.lognormal(size=(70, 96, 3))).astype(np.float16)


def window_of(x: int, y: int, width: int, height: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


def write_channels(path: Path, channels: dict[str, Any], **header: Any) -> None:
    OpenEXR.File(header, channels, num_threads=0).write(str(path))


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
@pytest.mark.parametrize("dtype", [np.float16, np.float32])
def test_round_trip_of_every_compression(
    tmp_path: Path, pixels: NDArray[Any], compression: str, dtype: DTypeLike
) -> None:
    path = tmp_path / "a.exr"
    write_rgb(path, pixels.astype(dtype), compression)
    picture = read_rgb(path)
    assert picture.pixels.dtype == dtype
    assert picture.pixels.flags.c_contiguous
    assert picture.name == "a.exr"
    if compression in LOSSY:
        error = np.abs(picture.pixels.astype(float) - pixels.astype(float))
        assert np.mean(error) < 0.05 * np.mean(pixels.astype(float))
    else:
        assert np.array_equal(picture.pixels, pixels.astype(dtype))
    assert [file.name for file in tmp_path.iterdir()] == ["a.exr"]


def test_channels_in_any_order_and_of_any_type(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    red, green, blue = (np.ascontiguousarray(pixels[..., channel]) for channel in range(3))
    write_channels(path, {"B": blue, "A": red, "R": red, "G": green})
    assert np.array_equal(read_rgb(path).pixels, pixels)

    write_channels(path, {"B": blue, "G": green.astype(np.float32), "R": red})
    mixed = read_rgb(path).pixels
    assert mixed.dtype == np.float32
    assert np.array_equal(mixed, pixels.astype(np.float32))

    counts = np.arange(70 * 96, dtype=np.uint32).reshape(70, 96)
    write_channels(path, {"R": counts, "G": counts, "B": counts})
    assert np.array_equal(read_rgb(path).pixels[..., 1], counts.astype(np.float32))


def test_alpha_is_ignored(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    write_channels(path, {"RGBA": np.dstack([pixels, pixels[..., :1]])})
    picture = read_rgb(path)
    assert np.array_equal(picture.pixels, pixels)
    assert picture.pixels.flags.c_contiguous


def test_layers_and_luminance(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    planes = {f"left.{name}": np.ascontiguousarray(pixels[..., i]) for i, name in enumerate("RGB")}
    write_channels(path, {"Z": pixels[..., 0].astype(np.float32), **planes})
    assert np.array_equal(read_rgb(path).pixels, pixels)

    write_channels(path, {"Y": np.ascontiguousarray(pixels[..., 0])})
    assert np.array_equal(read_rgb(path).pixels, np.repeat(pixels[..., :1], 3, axis=2))


def test_first_part_with_colour_counts(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    depth = OpenEXR.Part({"name": "depth"}, {"Z": pixels[..., 0].astype(np.float32)})
    beauty = OpenEXR.Part({"name": "beauty"}, {"RGB": pixels})
    other = OpenEXR.Part({"name": "other"}, {"RGB": pixels * np.float16(2)})
    OpenEXR.File([depth, beauty, other]).write(str(path))
    picture = read_rgb(path)
    assert np.array_equal(picture.pixels, pixels)
    assert picture.attributes["name"] == "beauty"
    path.write_bytes(path.read_bytes()[:-400])
    assert np.array_equal(read_rgb(path).pixels, pixels), "damage in a part that is not read does not matter"


def test_depth_of_any_name_part_and_layer(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    metres = np.ascontiguousarray(pixels[..., 0], dtype=np.float32)
    planes = {name: np.ascontiguousarray(pixels[..., 1]) for name in "RGB"}
    for name in ("Z", "depth", "left.Z", "scan.Depth", "V"):
        write_channels(path, {name: metres, **planes})
        depth = read_depth(path)
        assert depth.dtype == np.float32
        assert np.array_equal(depth, metres), name
    write_rgb(path, np.repeat(metres[..., None], 3, axis=-1))
    assert np.array_equal(read_depth(path), metres)
    parts = [OpenEXR.Part({"name": "beauty"}, {"RGB": pixels}), OpenEXR.Part({"name": "far"}, {"Z": metres})]
    OpenEXR.File(parts).write(str(path))
    assert np.array_equal(read_depth(path), metres)
    write_channels(path, {"id": metres})
    with pytest.raises(FrameError, match=r"a\.exr: has no depth: its channels are id, one of Z, depth"):
        read_depth(path)
    with pytest.raises(FrameError, match="does not exist"):
        read_depth(tmp_path / "b.exr")


def test_tiles(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    write_channels(path, {"RGB": pixels}, type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription())
    assert np.array_equal(read_rgb(path).pixels, pixels)


@pytest.mark.parametrize(
    ("origin", "display"),
    [((2, 3), (120, 90)), ((-5, -3), (40, 30)), ((-5, 20), (96, 70)), ((200, 0), (50, 40))],
)
def test_data_window_in_display_window(
    tmp_path: Path, pixels: NDArray[Any], origin: tuple[int, int], display: tuple[int, int]
) -> None:
    path = tmp_path / "a.exr"
    (x, y), (width, height) = origin, display
    write_channels(
        path, {"RGB": pixels}, dataWindow=window_of(x, y, 96, 70), displayWindow=window_of(0, 0, width, height)
    )
    expected = np.zeros((height, width, 3), np.float16)
    for i in range(height):
        for j in range(width):
            if 0 <= i - y < 70 and 0 <= j - x < 96:
                expected[i, j] = pixels[i - y, j - x]
    picture = read_rgb(path).pixels
    assert np.array_equal(picture, expected)
    assert picture.flags.c_contiguous


def test_capture_time(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    # 12:00:30 local time where one hour has to be added to get UTC.
    write_rgb(path, pixels, attributes={"capDate": "2026:11:22 12:00:30", "utcOffset": 3600.0})
    assert read_rgb(path).capture_time_ns == 1_795_352_430_000_000_000
    write_rgb(path, pixels, attributes={"capDate": "yesterday"})
    assert read_rgb(path).capture_time_ns is None
    write_rgb(path, pixels)
    assert read_rgb(path).capture_time_ns is None


@pytest.mark.parametrize("compression", sorted(COMPRESSIONS))
@pytest.mark.parametrize("share", [0.02, 0.3, 0.9, 0.9995])
def test_truncated(tmp_path: Path, pixels: NDArray[Any], compression: str, share: float) -> None:
    path = tmp_path / "cut.exr"
    write_rgb(path, pixels, compression)
    data = path.read_bytes()
    path.write_bytes(data[: min(int(len(data) * share), len(data) - 1)])
    with pytest.raises(FrameError, match=r"cut\.exr: is (truncated or )?damaged"):
        read_rgb(path)


def test_not_a_picture(tmp_path: Path) -> None:
    def reason(name: str, content: bytes | None) -> str:
        path = tmp_path / name
        if content is not None:
            path.write_bytes(content)
        with pytest.raises(FrameError) as caught:
            read_rgb(path)
        assert caught.value.frame == name
        return caught.value.reason

    assert reason("empty.exr", b"") == "is empty"
    assert reason("missing.exr", None) == "does not exist"
    assert reason("png.exr", b"\x89PNG\r\n\x1a\n" + bytes(50)) == "is not an OpenEXR file; it is a PNG"
    assert reason("jpeg.exr", b"\xff\xd8\xff\xe0" + bytes(50)) == "is not an OpenEXR file; it is a JPEG"
    assert reason("text.exr", b"hello, world") == "is not an OpenEXR file"
    assert reason("short.exr", b"\x76\x2f\x31\x01").startswith("is damaged")
    (tmp_path / "folder.exr").mkdir()
    assert reason("folder.exr", None) == "cannot be read: Is a directory"


def test_no_colour(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "depth.exr"
    write_channels(path, {"Z": pixels[..., 0].astype(np.float32)})
    with pytest.raises(FrameError, match="no colour: its channels are Z"):
        read_rgb(path)


def test_deep(tmp_path: Path) -> None:
    path = tmp_path / "deep.exr"
    deep = np.empty((4, 4), dtype=object)
    for index in np.ndindex(4, 4):
        deep[index] = np.array([1.0, 2.0], np.float32)
    write_channels(path, dict.fromkeys("RGB", deep), type=OpenEXR.deepscanline, compression=OpenEXR.ZIPS_COMPRESSION)
    with pytest.raises(FrameError, match="deep data"):
        read_rgb(path)


def test_subsampled(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "sub.exr"
    planes = {name: OpenEXR.Channel(np.ascontiguousarray(pixels[::2, ::2, 0]), 2, 2) for name in "RGB"}
    window = (np.array([0, 0], np.int32), np.array([95, 69], np.int32))
    write_channels(path, planes, dataWindow=window)
    with pytest.raises(FrameError, match="subsampled channel"):
        read_rgb(path)


def test_absurd_size_is_refused_before_memory_is_taken(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "huge.exr"
    write_rgb(path, pixels)
    data = bytearray(path.read_bytes())
    for attribute in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        start = data.find(attribute) + len(attribute) + 4
        data[start : start + 16] = struct.pack("<4i", 0, 0, 99_999, 59_999)
    path.write_bytes(data)
    with pytest.raises(FrameError, match=f"100000×60000 pixels; at most {MAX_PIXELS}"):
        read_rgb(path)


def test_a_header_that_openexr_refuses_is_called_damaged(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "huge.exr"
    write_rgb(path, pixels)
    data = bytearray(path.read_bytes())
    start = data.find(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    data[start : start + 16] = struct.pack("<4i", 0, 0, 2**31 - 2, 2**31 - 2)
    path.write_bytes(data)
    with pytest.raises(FrameError) as caught:
        read_rgb(path)
    assert caught.value.reason == "is damaged: its header cannot be read"


def test_a_name_that_is_not_utf8_is_an_error_that_can_be_printed(tmp_path: Path, pixels: NDArray[Any]) -> None:
    write_rgb(tmp_path / "a.exr", pixels)
    path = tmp_path / os.fsdecode(b"a\xff.exr")
    (tmp_path / "a.exr").rename(path)
    with pytest.raises(FrameError, match="not UTF-8") as caught:
        read_rgb(path)
    assert str(caught.value).encode().startswith(b"a\\udcff.exr: has a name")


def test_write_refuses_what_would_be_lost(tmp_path: Path, pixels: NDArray[Any]) -> None:
    with pytest.raises(ValueError, match="65504"):
        write_rgb(tmp_path / "a.exr", np.full((2, 2, 3), np.inf, np.float16))
    with pytest.raises(ValueError, match="shape"):
        write_rgb(tmp_path / "a.exr", pixels[..., 0])
    with pytest.raises(ValueError, match="none of"):
        write_rgb(tmp_path / "a.exr", pixels, "lzw")
    with pytest.raises(FrameError, match="cannot be written"):
        write_rgb(tmp_path / "no such folder" / "a.exr", pixels)
    assert list(tmp_path.iterdir()) == []
    write_rgb(tmp_path / "b.exr", np.full((2, 2, 3), 1e6))
    assert read_rgb(tmp_path / "b.exr").pixels.max() == np.float32(1e6)


def test_threads_read_side_by_side(tmp_path: Path, pixels: NDArray[Any]) -> None:
    path = tmp_path / "a.exr"
    write_rgb(path, pixels, "zip")
    results: list[bool] = []
    threads = [
        threading.Thread(target=lambda: results.append(np.array_equal(read_rgb(path).pixels, pixels))) for _ in range(8)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [True] * 8
