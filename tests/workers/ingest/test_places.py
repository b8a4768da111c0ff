"""Where frames were taken: rooms and scenes that the probe moves through, recordings with poses, captures."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from lightwell.errors import SourceError
from lightwell.io.captures import open_capture
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.settings import MappingSettings, StreamSettings
from lightwell.sh.rotation import rotate
from lightwell.synthetic.rig import rotation_of
from lightwell.synthetic.room import Room
from lightwell.synthetic.scene import PRESETS
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.stages.reduce import reduce_frame


def frames(url: str, mapping: MappingSettings | None = None) -> list[Frame]:
    with open_source(url, mapping) as source:
        return [item for item in source if isinstance(item, Frame)]


def error(frame: Frame, mapping: MappingSettings | None = None) -> float:
    """Return how far a frame's projection is from its truth."""
    settings = StreamSettings(source="synthetic:room", mapping=mapping or MappingSettings())
    light = reduce_frame(frame, settings).coefficients
    if frame.world_from_camera is not None:
        light = rotate(light, frame.world_from_camera)
    assert frame.truth is not None
    return float(np.linalg.norm(light - frame.truth[:25]) / np.linalg.norm(frame.truth[:25]))


def test_a_probe_moves_through_the_room_and_back() -> None:
    seen = frames("synthetic:room?realtime=0&frames=5&fps=1&travel=2&at=0,0,0&to=0.8,0,0.4&spin=0.1&light_radius=0.2")
    places = [frame.position_m for frame in seen]
    expected = [(0, 0, 0), (0.4, 0, 0.2), (0.8, 0, 0.4), (0.4, 0, 0.2), (0, 0, 0)]
    np.testing.assert_allclose(places, expected, atol=1e-12)  # type: ignore[arg-type]
    assert max(map(error, seen)) < 5e-3


def test_rooms_at_two_places_are_one_room() -> None:
    """What the balls add is the same light, from elsewhere: exact coefficients agree with quadrature at any place."""
    room = Room()
    at = (-0.3, 0.4, 0.1)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    phi = 2 * np.pi * (np.arange(400) + 0.5) / 400
    sine = np.sqrt(1 - nodes**2)[:, None]
    directions = np.stack([sine * np.cos(phi), sine * np.sin(phi), np.repeat(nodes[:, None], 400, 1)], axis=-1)
    mean = np.einsum("tpc,t->c", room.radiance(directions, 1.0, at), weights) * 2 * np.pi / 400 / np.sqrt(4 * np.pi)
    np.testing.assert_allclose(mean, room.coefficients(1, 1.0, at)[0], rtol=2e-3)


def test_a_scene_gives_its_truth_at_every_place() -> None:
    for mapping, width in ((MappingSettings(), 256), (MappingSettings(kind="octahedral"), 128)):
        seen = frames(f"synthetic:panel?realtime=0&frames=2&fps=1&travel=1&to=0.5,0.2,0.4&width={width}", mapping)
        assert [frame.name for frame in seen] == ["panel 0", "panel 1"]
        assert max(error(frame, mapping) for frame in seen) < 0.02
        assert seen[1].truth is not None
        np.testing.assert_allclose(seen[1].truth[:9], PRESETS["panel"].coefficients((0.5, 0.2, 0.4), 3))


@pytest.mark.parametrize(
    ("query", "reason"),
    [
        ("room?at=5,0,0&lights=0", r"the probe at \(5, 0, 0\) m is not inside the room"),
        ("room?to=1.3,0,0", "the balls would reach the probe"),
        ("room?at=1,2", "option 'at"),
        ("panel?at=0,0,1.5", r"is not inside the room ±\(2.6, 2.2, 1.4\) m"),
        ("panel?lights=3", "has no option 'lights'"),
    ],
)
def test_impossible_places_are_refused(query: str, reason: str) -> None:
    with pytest.raises(SourceError, match=reason):
        open_source(f"synthetic:{query}")


def test_rooms_follow_the_wall_clock() -> None:
    one, other = (frames("synthetic:room?realtime=0&frames=1&wall=1&period=1000&width=32")[0] for _ in range(2))
    assert one.truth is not None
    assert other.truth is not None
    assert np.linalg.norm(one.truth - other.truth) < 0.05 * np.linalg.norm(one.truth)
    start = frames("synthetic:room?realtime=0&frames=1&period=1000&width=32")[0].truth
    assert start is not None


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures") / "walk"
    rig = RigSettings(probes=6, size=64, rotating=True)
    simulate_capture(folder, PRESETS["panel"], rig)
    return folder


def test_a_capture_is_played_with_its_places(capture: Path) -> None:
    opened = open_capture(capture)
    mapping = opened.info.mapping
    seen = frames(f"exr:{capture}?realtime=0&first=1&last=4", mapping)
    np.testing.assert_allclose([frame.position_m for frame in seen], opened.poses.positions[1:5])  # type: ignore[arg-type]
    turned = rotation_of(opened.poses.orientations)
    settings = StreamSettings(source="exr:x", mapping=mapping)
    for index, frame in enumerate(seen, start=1):
        assert frame.world_from_camera is not None
        np.testing.assert_allclose(frame.world_from_camera, turned[index])
        light = rotate(reduce_frame(frame, settings).coefficients, frame.world_from_camera)
        exact = PRESETS["panel"].coefficients(opened.poses.positions[index], 5)
        assert np.linalg.norm(light - exact) < 0.15 * np.linalg.norm(exact)
    with pytest.raises(SourceError, match=r"its frames are .* pictures: set the stream's mapping to \{"):
        open_source(f"exr:{capture}", MappingSettings(kind="cube"))


def test_a_recording_takes_its_poses_from_a_file(capture: Path, tmp_path: Path) -> None:
    opened = open_capture(capture)
    for frame in opened.poses.frames:
        shutil.copy(capture / frame, tmp_path / Path(frame).name)
    seen = frames(f"exr:{tmp_path}/*.exr?realtime=0&poses={capture}/poses.csv")
    np.testing.assert_allclose([frame.position_m for frame in seen], opened.poses.positions)  # type: ignore[arg-type]
    assert frames(f"exr:{tmp_path}?realtime=0&last=0")[0].position_m is None
    shutil.copy(tmp_path / Path(opened.poses.frames[0]).name, tmp_path / "more.exr")
    with pytest.raises(SourceError, match=r"1 of 7 frames have no pose, the first is more\.exr"):
        open_source(f"exr:{tmp_path}?poses={capture}/poses.csv")
    with pytest.raises(SourceError, match=r"nothing\.csv: there is no such file"):
        open_source(f"exr:{tmp_path}?poses={tmp_path}/nothing.csv")
