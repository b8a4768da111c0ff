"""Recorded light over time: pictures, videos, lines of coefficients; which frame is shown when, and what is said."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from lightwell.errors import LightwellError
from lightwell.io import recorded_lines
from lightwell.io.exr import write_rgb
from lightwell.io.recordings import open_recording, read_recorded_picture
from lightwell.io.scenes import SceneLoader
from lightwell.scene_settings import SceneLightSettings
from lightwell.sh.engines import convert
from lightwell.video_settings import VideoSettings

SECOND = 1_000_000_000
LINEAR = VideoSettings(transfer="linear", range="full")
CODES = (32, 64, 128, 224)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of four flat frames, 10 a second, without compression; a sequence of which one frame is missing."""
    place = tmp_path_factory.mktemp("recordings")
    with av.open(str(place / "hall.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=Fraction(10))
        assert isinstance(stream, av.VideoStream)
        stream.width, stream.height, stream.pix_fmt = 16, 8, "gray"
        for number, code in enumerate(CODES):
            frame = av.VideoFrame.from_ndarray(np.full((8, 16), code, np.uint8), format="gray")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    for number in (3, 4, 6):
        write_rgb(place / f"hall.{number:02d}.exr", np.full((8, 16, 3), number, np.float32))
    return place


def line(seconds: float | None, radiance: float, **more: Any) -> dict[str, Any]:
    when = {} if seconds is None else {"capture_time_ns": 1_795_000_000 * SECOND + round(seconds * SECOND)}
    rows = [[radiance] * 3, *[[0.0, 0.5, -0.5]] * 3]
    return {"stream": "hall", "convention": "lightwell", "units": "relative", "coefficients": rows} | when | more


def write(path: Path, *lines: dict[str, Any] | str, end: str = "\n") -> Path:
    path.write_text("\n".join(one if isinstance(one, str) else json.dumps(one) for one in lines) + end)
    return path


def test_pictures_of_a_video_are_read_in_any_order(folder: Path) -> None:
    recording = open_recording(str(folder / "hall.mkv"), LINEAR)
    assert (recording.count, recording.remarks) == (4, ())
    assert recording.times is not None
    np.testing.assert_allclose(recording.times, [0, 0.1, 0.2, 0.3], atol=1e-6)

    def stop() -> None:
        raise InterruptedError

    # On the way to a frame one may stop, and go on.
    with pytest.raises(InterruptedError):
        read_recorded_picture(*recording.pictures[3], LINEAR, stop)
    for number in (2, 3, 0, 1, 1, 3):
        pixels = read_recorded_picture(*recording.pictures[number], LINEAR)
        np.testing.assert_allclose(pixels, CODES[number] / 255, atol=1e-5)
    # At 25 pictures a second each of the ten is shown two or three times; half as many show every other one.
    assert recording.film_length(25) == 10
    np.testing.assert_array_equal(recording.moments(10, 25), [0, 0, 0, 1, 1, 2, 2, 2, 3, 3])
    np.testing.assert_array_equal(recording.moments(4, 10), [0, 1, 2, 3])
    np.testing.assert_array_equal(recording.moments(2, 24), [0, 2])
    assert [recording.frame(number) for number in (0, 3, -1, -4)] == [0, 3, 3, 0]
    with pytest.raises(LightwellError, match=r"hall\.mkv: has no frame 4: it has 4, 0 … 3"):
        recording.frame(4)
    with pytest.raises(LightwellError, match=r"hall\.mkv: does not say how it is encoded: give light\.video\.transfer"):
        open_recording(str(folder / "hall.mkv"))


def test_a_missing_picture_is_the_one_before(folder: Path) -> None:
    recording = open_recording(str(folder / "hall.%02d.exr"))
    assert [path.name for path, _ in recording.pictures] == [f"hall.{k:02d}.exr" for k in (3, 4, 4, 6)]
    assert recording.remarks == (
        "hall.%02d.exr: 1 of 4 frames are missing, the first is hall.05.exr: the one before is shown instead",
    )
    assert (recording.times, recording.film_length(24)) == (None, 4)
    np.testing.assert_array_equal(recording.moments(8, 24), [0, 0, 1, 1, 2, 2, 3, 3])
    np.testing.assert_array_equal(recording.moments(2, 24), [0, 2])
    assert open_recording(str(folder / "*.exr")).count == 3
    assert open_recording(str(folder / "hall.03.exr")).count == 1


def test_coefficients_are_linear_between_their_times(tmp_path: Path) -> None:
    """Capture times say when; lines of another convention or with fewer bands are the same light."""
    second = line(0.1, 3.0, convention="unity", from_hello=True)
    second["coefficients"] = convert(np.array(second["coefficients"]), "unity", "lightwell").tolist()
    third = line(0.3, 5.0)
    third["coefficients"] = third["coefficients"][:1]
    lines = line(0.0, 1.0), second, line(0.1, 9.0, from_hello=True), "", third, line(0.4, 2.0)
    recording = open_recording(str(write(tmp_path / "hall.jsonl", *lines)))
    assert (recording.count, recording.remarks, recording.film_length(10)) == (4, (), 5)
    light = [recording.light_at(moment) for moment in recording.moments(5, 10)]
    np.testing.assert_allclose([one[0, 0] for one in light], [1, 3, 4, 5, 2], rtol=1e-6)
    np.testing.assert_allclose([one[2, 1] for one in light], [0.5, 0.5, 0.25, 0, 0.5], rtol=1e-6)
    # After the last frame, which is shown as long as the others, nothing is made up.
    assert recording.moments(10, 20)[-1] == 3
    assert open_recording(str(write(tmp_path / "still.json", line(None, 4.0)))).times is None


def test_gaps_and_what_was_before_are_said(tmp_path: Path) -> None:
    lines = [line(-90, 7.0, from_hello=True), *(line(k / 10, 1.0) for k in (0, 1, 2, 30, 31, 32, 33, 50, 51))]
    recording = open_recording(str(write(tmp_path / "hall.jsonl", *lines)))
    assert recording.count == 9
    assert recording.remarks == (
        "hall.jsonl: the frame of line 1 is from before the recording: it is left out",
        "hall.jsonl: has 2 gaps, the longest of 2.8 s after line 4: the light is blended across",
    )
    assert recording.times is not None
    assert recording.times[0] == 0


def test_one_stream_of_several(tmp_path: Path) -> None:
    lines = [line(k / 10, 1.0 + k, stream=("hall", "door")[k % 2]) for k in range(6)]
    path = write(tmp_path / "both.jsonl", *lines)
    door = open_recording(str(path), stream="door")
    assert door.coefficients is not None
    np.testing.assert_array_equal(door.coefficients[:, 0, 0], [2, 4, 6])
    with pytest.raises(LightwellError, match=r"several streams \('hall', 'door'\): say which by light\.stream"):
        open_recording(str(path))
    with pytest.raises(LightwellError, match="no frame of 'roof', but of 'hall', 'door'"):
        open_recording(str(path), stream="roof")
    settings = SceneLightSettings.model_validate({"file": "both.jsonl", "stream": "door", "frame": 1})
    light, picture = SceneLoader(tmp_path, None, "s.toml").light(settings)
    assert picture is None
    assert light.at(np.zeros((1, 3)))[0, 0] == 4


def test_a_line_that_is_cut_short_is_left_out_at_the_end_only(tmp_path: Path) -> None:
    torn = json.dumps(line(0.2, 1.0))[:60]
    path = write(tmp_path / "hall.jsonl", line(0, 1.0), line(0.1, 2.0), torn, end="")
    assert open_recording(str(path)).count == 2
    write(path, line(0, 1.0), torn, line(0.1, 2.0))
    with pytest.raises(LightwellError, match=r"hall\.jsonl: line 2: holds no light"):
        open_recording(str(path))


@pytest.mark.parametrize(
    ("second", "words"),
    [
        (line(0.1, 1.0, convention="blender"), "line 2: its convention 'blender' is none of lightwell, three"),
        (line(0.1, 1.0, units="W·sr⁻¹·m⁻²"), "line 2: its unit is W.*that of the lines before is relative: split"),
        (line(-0.1, 1.0), "line 2: was captured before the frame of line 1"),
        (line(None, 1.0), "line 2: only some lines have a capture_time_ns"),
        (line(0.1, 1.0, coefficients=[[1.0, 1.0, 1.0]] * 3), "line 2: holds no light .3 coefficients"),
        (line(0.1, 1.0, coefficients=[[1.0, 1.0]]), "line 2: holds no light .*length 3"),
        (line(0.1, 1e39), "line 2: its coefficients must lie within"),
        ("not JSON", "line 2: holds no light"),
        ('{"x": ' + "[" * 100_000, "line 2: holds no light .maximum recursion"),
        (line(None, 1.0, capture_time_ns=1 << 64), "line 2: holds no light .*capture_time_ns"),
        (line(None, 1.0, capture_time_ns=-(1 << 63)), "line 2: holds no light .*capture_time_ns"),
        (" " * (1 << 20) + "1", "line 2: is longer than 1 MiB"),
    ],
)
def test_a_bad_line_is_named(tmp_path: Path, second: Any, words: str) -> None:
    path = write(tmp_path / "hall.jsonl", line(0.0, 1.0), second)
    with pytest.raises(LightwellError, match=rf"hall\.jsonl: {words}"):
        open_recording(str(path))


def test_recordings_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One frame of many bands makes all others as large."""
    names = [str(number) for number in range(1000)]
    lines = [line(k / 10, 1.0, coefficients=[[1.0] * 3] * (1 + 8 * (k == 5))) for k in range(6)]
    path = write(tmp_path / "hall.jsonl", *lines, *(line(1.0, 1.0, stream=name) for name in names))
    for limits, stream, words in (
        ({"MAX_VALUES": 100}, "hall", "has more than 5 frames of so many bands: split it"),
        ({"MAX_LINES": 4}, "hall", "has more than 4 frames"),
        ({"MAX_BYTES": 1 << 10}, "hall", "is larger than"),
        ({}, "roof", "no frame of 'roof', but of 'hall', '0', '1', '2', '3', '4', '5', '6'$"),
        ({}, None, r"of several streams \('hall', '0'\)"),
    ):
        with monkeypatch.context() as patch:
            for name, value in limits.items():
                patch.setattr(recorded_lines, name, value)
            with pytest.raises(LightwellError, match=words):
                open_recording(str(path), stream=stream)
    with pytest.raises(LightwellError, match="cannot be read: File name too long"):
        open_recording(str(tmp_path / ("x" * 300 + ".jsonl")))


def test_a_video_is_nothing_that_names_other_files(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "far.mkv").symlink_to(folder / "hall.mkv")
    (tmp_path / "list.mp4").write_text("ffconcat version 1.0\nfile far.mkv\n")
    with pytest.raises(LightwellError, match=r"list\.mp4: cannot be read"):
        open_recording(str(tmp_path / "list.mp4"), LINEAR)
    assert open_recording(str(tmp_path / "far.mkv"), LINEAR).count == 4


def test_a_scene_takes_one_frame_of_each_kind(folder: Path, tmp_path: Path) -> None:
    write(folder / "hall.jsonl", line(0.0, 1.0), line(0.1, 3.0))
    loader = SceneLoader(folder, None, "s.toml")

    def shown(**settings: Any) -> Any:
        light, picture = loader.light(SceneLightSettings.model_validate(settings))
        return light.at(np.zeros((1, 3)))[0, 0] if picture is None else picture[0, 0, 0]

    video = {"transfer": "linear", "range": "full"}
    assert shown(file="hall.jsonl") == 3
    assert shown(file="hall.jsonl", frame=0) == 1
    assert shown(file="hall.%02d.exr", frame=-1, gain=0.5) == 3
    assert shown(file="hall.mkv", frame=2, video=video) == pytest.approx(128 / 255)
    assert shown(file="hall.mkv", video=video) == pytest.approx(32 / 255)
    for settings, words in (
        ({"file": "hall.mkv", "frame": 9, "video": video}, r"s\.toml: light\.file: hall\.mkv: has no frame 9"),
        ({"file": "hall.mkv"}, r"s\.toml: light\.file: hall\.mkv: does not say how it is encoded"),
        ({"file": "gone.mp4"}, r"s\.toml: light\.file: .*gone\.mp4: does not exist"),
        ({"file": "gone.*.exr"}, "matches no file"),
        ({"stream": "hall", "frame": 1}, "name the file"),
    ):
        with pytest.raises((LightwellError, ValueError), match=words):
            shown(**settings)
    (tmp_path / "torn.mkv").write_bytes((folder / "hall.mkv").read_bytes()[:300])
    with pytest.raises(LightwellError, match=r"torn\.mkv"):
        read_recorded_picture(*open_recording(str(tmp_path / "torn.mkv"), LINEAR).pictures[0], LINEAR)
