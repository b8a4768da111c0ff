"""The sample recordings: there, whole, repeatable, and what they claim to be."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from lightwell.errors import LightwellError
from lightwell.io.exr import read_rgb
from lightwell.settings import StreamSettings
from lightwell_workers.ingest import samples
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.samples import MAP_NAMES, MIRROR_SPHERE, make_samples, map_path
from lightwell_workers.ingest.stages.reduce import reduce_frame


def test_maps_ship_with_the_package() -> None:
    for name in MAP_NAMES:
        assert read_rgb(map_path(name)).pixels.shape == (256, 512, 3)
    assert (map_path("hall").parent.parent / "LICENSE-CC0.txt").is_file()
    with pytest.raises(LightwellError, match="there are: esplanade, forest"):
        map_path("moon")


def test_recordings_appear_once_and_are_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "FRAMES", 6)
    progress: list[tuple[str, int, int]] = []
    streams = make_samples(tmp_path / "a", lambda *step: progress.append(step))
    assert list(streams) == ["sunset-walk", "mirror-sphere", "room", "room-side"]
    assert progress[5] == ("sunset-walk", 6, 6)
    assert progress[-1] == ("mirror-sphere", 6, 6)
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["mirror-sphere-v1", "sunset-walk-v1"]

    stamp = (tmp_path / "a" / "sunset-walk-v1").stat().st_mtime_ns
    assert make_samples(tmp_path / "a") == streams
    assert (tmp_path / "a" / "sunset-walk-v1").stat().st_mtime_ns == stamp

    make_samples(tmp_path / "b")
    for path in sorted((tmp_path / "a").rglob("*.exr")):
        twin = read_rgb(tmp_path / "b" / path.relative_to(tmp_path / "a"))
        np.testing.assert_array_equal(read_rgb(path).pixels, twin.pixels)


def test_interrupted_recording_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "FRAMES", 4)

    def interrupt(name: str, done: int, total: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make_samples(tmp_path, interrupt)
    assert list(tmp_path.iterdir()) == []


def test_sun_crosses_the_sky(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(samples, "FRAMES", 16)
    render = samples._sunset_walk()
    midnight, morning, noon, evening = (render(n) for n in (0, 5, 8, 11))
    assert noon.mean() > 10 * midnight.mean()
    rows, columns = zip(
        *(np.unravel_index(p[..., 0].argmax(), p.shape[:2]) for p in (morning, noon, evening)), strict=True
    )
    assert rows[1] < rows[0]
    assert rows[1] < rows[2]
    assert columns[0] < columns[1] < columns[2]
    peak = morning[rows[0], columns[0]]
    assert peak[0] > 1.5 * peak[2]  # low sun is red


def test_mirror_sphere_gives_back_the_hall() -> None:
    pixels = samples._mirror_sphere()(0)
    frame = Frame(pixels=pixels, name="0", capture_time_ns=1, ingest_time_ns=1)
    sphere = StreamSettings(source="exr:x", mapping=MIRROR_SPHERE, resolution=0)
    hall = Frame(pixels=samples._radiance("hall"), name="hall", capture_time_ns=1, ingest_time_ns=1)
    truth = reduce_frame(hall, StreamSettings(source="exr:x", resolution=0)).coefficients
    result = reduce_frame(frame, sphere).coefficients
    assert np.linalg.norm(result - truth) < 0.01 * np.linalg.norm(truth)
    assert np.all(pixels[0, 0] == 0)
