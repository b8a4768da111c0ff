"""Video files that the test encodes itself, against values worked out from the standards."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from lightwell.errors import FrameError, SourceError
from lightwell.io.video_colour import (
    chroma_taps,
    hlg_inverse_oetf,
    pq_eotf,
    rec709_from,
    signal_from_codes,
    transfer_table,
)
from lightwell.settings import StreamSettings
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.stages.reduce import reduce_frame

HEIGHT, WIDTH = 48, 64


def encode(
    path: Path,
    codes: list[tuple[int, ...]],
    codec: str,
    pixel_format: str,
    options: dict[str, str] | None = None,
    tags: dict[str, int] | None = None,
) -> Path:
    """Write one flat frame for each triple of codes, in the order of the format's planes' components."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=Fraction(25), options=options or {})
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, pixel_format
        for name, value in (tags or {}).items():
            setattr(stream.codec_context, name, value)
        for number, triple in enumerate(codes):
            frame = av.VideoFrame(WIDTH, HEIGHT, pixel_format)
            for component, code in zip(frame.format.components, triple, strict=True):
                plane = frame.planes[component.plane]
                dtype = np.uint8 if component.bits <= 8 else np.dtype("<u2")
                np.frombuffer(memoryview(plane), dtype=dtype)[:] = code
            frame.pts = number
            for name, value in (tags or {}).items():
                setattr(frame, name, value)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def play(url: str) -> list[Frame | FrameError]:
    with open_source(url) as source:
        first = source.first_picture()
        items = list(source)
    if isinstance(items[0], Frame):
        np.testing.assert_array_equal(first, items[0].pixels)
    return items


def means(items: list[Frame | FrameError]) -> list[np.ndarray]:
    frames = [item for item in items if isinstance(item, Frame)]
    for frame in frames:
        assert frame.pixels.shape == (HEIGHT, WIDTH, 3)
        assert frame.pixels.dtype == np.float32
        assert np.ptp(frame.pixels, axis=(0, 1)).max() <= 2e-2 * max(frame.pixels.max(), 1e-6)
    return [frame.pixels.mean(axis=(0, 1), dtype=np.float64) for frame in frames]


def test_pq_has_the_standards_values() -> None:
    # BT.2100 / BT.2408: signal 0.58 is 203 cd/m², 0.508 is 100 cd/m², 1 is 10,000 cd/m².
    assert pq_eotf(1.0) == pytest.approx(10_000)
    assert pq_eotf(0.0) == 0.0
    assert pq_eotf(0.5806888810416109) == pytest.approx(203.0, rel=1e-9)
    assert pq_eotf(0.508078421517399) == pytest.approx(100.0, rel=1e-9)


def test_hlg_has_the_standards_values() -> None:
    # BT.2100 table 5: E = 1/12 at the joint, 1 at the top; BT.2408: reference white is signal 0.75.
    np.testing.assert_allclose(hlg_inverse_oetf([0.0, 0.5, 0.75, 1.0]), [0, 1 / 12, 0.26496256, 1], atol=1e-6)


@pytest.mark.parametrize("transfer", ["pq", "hlg"])
def test_table_is_as_good_as_the_formula(transfer: str) -> None:
    table = transfer_table(transfer, white=1.0)  # type: ignore[arg-type]
    signal = np.linspace(0, 1, 100_003)
    exact = pq_eotf(signal) if transfer == "pq" else hlg_inverse_oetf(signal)
    np.testing.assert_allclose(
        np.interp(signal, np.linspace(0, 1, table.size), table), exact, rtol=1e-4, atol=1e-6 * exact.max()
    )


def test_rec2020_to_rec709_matches_bt2087() -> None:
    np.testing.assert_allclose(
        rec709_from("bt2020"),
        [[1.6605, -0.5876, -0.0728], [-0.1246, 1.1329, -0.0083], [-0.0182, -0.1006, 1.1187]],
        atol=1e-4,
    )
    np.testing.assert_allclose(rec709_from("bt709"), np.eye(3), atol=1e-12)


@pytest.mark.parametrize(("code_range", "white", "black"), [("limited", 940, 64), ("full", 1023, 0)])
@pytest.mark.parametrize("matrix", ["bt601", "bt709", "bt2020"])
def test_grey_codes_have_no_colour(matrix: str, code_range: str, white: int, black: int) -> None:
    scale, offset = signal_from_codes(matrix, 10, code_range)  # type: ignore[arg-type]
    np.testing.assert_allclose(scale @ [white, 512, 512] + offset, 1.0, atol=1e-12)
    np.testing.assert_allclose(scale @ [black, 512, 512] + offset, 0.0, atol=1e-12)


def test_pure_red_has_the_luma_of_red() -> None:
    scale, offset = signal_from_codes("bt709", 8, "limited")
    red = [16 + 219 * 0.2126, 128 - 224 * 0.2126 / (2 * (1 - 0.0722)), 128 + 224 * 0.5]
    np.testing.assert_allclose(scale @ red + offset, [1, 0, 0], atol=1e-12)


def test_chroma_taps_reproduce_a_ramp() -> None:
    ramp = 2.0 * np.arange(8) + 0.5  # value of the luma row at which each chroma row of 4:2:0 lies
    first, weight = chroma_taps(16, 8, centred=True)
    values = ramp[first] * (1 - weight) + ramp[np.minimum(first + 1, 7)] * weight
    np.testing.assert_allclose(values[1:-1], np.arange(1, 15), atol=1e-5)


def test_ten_bit_pq_rec2020_from_hevc_tags(tmp_path: Path) -> None:
    tags = {"color_trc": 16, "color_primaries": 9, "colorspace": 9, "color_range": 1}
    path = encode(
        tmp_path / "pq.mkv",
        [(572, 512, 512), (940, 512, 512)],
        "libx265",
        "yuv420p10le",
        {"x265-params": "lossless=1:log-level=none"},
        tags,
    )
    grey = float(pq_eotf((572 - 64) / 876)) / 203
    for mean, expected in zip(means(play(f"video:{path}?realtime=0")), [grey, 10_000 / 203], strict=True):
        np.testing.assert_allclose(mean, expected, rtol=1e-4)  # white is white in any primaries


@pytest.mark.parametrize(
    ("pixel_format", "codes", "expected"),
    [
        ("yuv422p12le", (64 * 4, 2048, 2048), 0.0),
        ("yuv444p12le", (940 * 4, 2048, 2048), 1.0),
        ("gbrp12le", (4095, 4095, 4095), 1.0),
        ("gray12le", (16 * 16 + 219 * 8,), 0.5),
    ],
)
def test_twelve_bit_linear_from_ffv1(
    tmp_path: Path, pixel_format: str, codes: tuple[int, ...], expected: float
) -> None:
    path = encode(tmp_path / "linear.mkv", [codes] * 3, "ffv1", pixel_format)
    result = means(play(f"video:{path}?transfer=linear&realtime=0"))
    assert len(result) == 3
    np.testing.assert_allclose(result[0], expected, atol=1e-6)


def test_rgb_keeps_its_channels(tmp_path: Path) -> None:
    path = encode(tmp_path / "rgb.mkv", [(4095, 2048, 0)], "ffv1", "gbrp12le")
    mean = means(play(f"video:{path}?transfer=hlg&realtime=0"))[0]
    np.testing.assert_allclose(mean, hlg_inverse_oetf(np.array([4095, 2048, 0]) / 4095), atol=1e-5)


def test_red_of_rec2020_leaves_rec709(tmp_path: Path) -> None:
    path = encode(tmp_path / "red.mkv", [(255, 0, 0)], "ffv1", "gbrp9le")
    mean = means(play(f"video:{path}?transfer=linear&primaries=bt2020&realtime=0"))[0]
    np.testing.assert_allclose(mean, rec709_from("bt2020")[:, 0] * 255 / 511, atol=1e-5)


def test_eight_bit_vp9_with_overrides(tmp_path: Path) -> None:
    path = encode(tmp_path / "vp9.webm", [(235, 128, 128)] * 2, "libvpx-vp9", "yuv420p", {"lossless": "1"})
    limited = means(play(f"video:{path}?transfer=linear&range=limited&realtime=0"))[0]
    full = means(play(f"video:{path}?transfer=linear&range=full&realtime=0"))[0]
    np.testing.assert_allclose(limited, 1.0, atol=1e-5)
    np.testing.assert_allclose(full, 235 / 255, atol=3e-3)  # 128 is half a code off the middle of the full range


@pytest.mark.parametrize(
    ("pixel_format", "peak", "below", "query"),
    [
        ("gbrp12le", (4095,) * 3, (4094,) * 3, "transfer=pq"),
        ("gbrp12le", (4095,) * 3, (4094,) * 3, "transfer=hlg"),
        ("gbrp12le", (4095,) * 3, (4094,) * 3, "transfer=linear"),
        ("gbrp16le", (65535,) * 3, (65534,) * 3, "transfer=linear&primaries=bt2020"),
        ("yuv420p10le", (940, 512, 512), (939, 512, 512), "transfer=pq&matrix=bt2020&primaries=bt2020&white=100"),
        ("yuv420p10le", (1019, 512, 512), (939, 512, 512), "transfer=hlg&matrix=bt709"),
    ],
)
def test_samples_at_the_peak_count_as_saturated(
    tmp_path: Path, pixel_format: str, peak: tuple[int, ...], below: tuple[int, ...], query: str
) -> None:
    path = encode(tmp_path / "peak.mkv", [peak, below], "ffv1", pixel_format)
    frames = [item for item in play(f"video:{path}?{query}&realtime=0") if isinstance(item, Frame)]
    settings = StreamSettings.model_validate({"source": f"video:{path}", "mapping": {"kind": "angular"}})
    saturated = [reduce_frame(frame, settings).counts.saturated for frame in frames]
    assert saturated == [HEIGHT * WIDTH * 3, 0]


def test_loop_goes_on_and_names_frames(tmp_path: Path) -> None:
    path = encode(tmp_path / "loop.mkv", [(1000, 1000, 1000)] * 3, "ffv1", "gbrp12le")
    names = []
    with open_source(f"video:{path}?transfer=linear&loop=1&realtime=0") as source:
        for item in source:
            assert isinstance(item, Frame)
            names.append(item.name)
            if len(names) == 7:
                source.close()
    assert names == [f"loop.mkv frame {number}" for number in (0, 1, 2, 0, 1, 2, 0)]


def test_damaged_frames_are_reported_and_skipped(tmp_path: Path) -> None:
    path = encode(tmp_path / "damaged.mkv", [(2000, 2000, 2000)] * 12, "ffv1", "gbrp12le", {"slicecrc": "1"})
    with av.open(str(path)) as container:
        positions = [packet.pos for packet in container.demux(video=0) if packet.size and packet.pos is not None]
    data = bytearray(path.read_bytes())
    for at in range(positions[5] + 40, positions[5] + 80):
        data[at] ^= 0xFF
    path.write_bytes(data)
    items = play(f"video:{path}?transfer=linear&realtime=0")
    errors = [item for item in items if isinstance(item, FrameError)]
    assert [error.frame for error in errors] == ["damaged.mkv frame 5"]
    assert len(items) - len(errors) == 11


@pytest.mark.parametrize(
    ("url", "message"),
    [
        ("video:/nowhere.mkv", "no file"),
        ("video:{text}", "is it a video file"),
        ("video:{untagged}", "transfer=pq"),
        ("video:{untagged}?transfer=gamma", "option 'transfer'"),
        ("video:{untagged}?speed=2", "no option 'speed'.*transfer.*loop"),
    ],
)
def test_remedies(tmp_path: Path, url: str, message: str) -> None:
    text = tmp_path / "text.mkv"
    text.write_text("not a video")
    untagged = encode(tmp_path / "untagged.mkv", [(0, 0, 0)], "ffv1", "gbrp12le")
    with pytest.raises(SourceError, match=message):
        open_source(url.format(text=text, untagged=untagged))
