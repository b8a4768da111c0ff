"""Captures on disk: simulation, import, and what is said of bad ones."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from lightwell.io.angular import AngularStore
from lightwell.io.captures import open_capture
from lightwell.io.exr import write_rgb
from lightwell.io.importing import ImportSettings, import_capture
from lightwell.io.poses import CaptureError, read_poses, read_tum
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.settings import MappingSettings
from lightwell.synthetic.scene import PRESETS

RIG = RigSettings(probes=6, size=16, samples=1)


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("captures") / "rig"
    simulate_capture(folder, PRESETS["scene1"], RIG)
    return folder


def test_a_simulated_capture_can_be_read(rig: Path) -> None:
    capture = open_capture(rig)
    assert (capture.count, capture.rotating, capture.sorted_samples) == (6, False, None)
    assert capture.read_frame(3).shape == (16, 16, 3)
    assert capture.info.scene is not None


def test_the_same_seed_gives_the_same_bytes(rig: Path, tmp_path: Path) -> None:
    simulate_capture(tmp_path / "again", PRESETS["scene1"], RIG)
    for path in sorted(rig.rglob("*")):
        if path.is_file() and path.suffix != ".exr":
            assert path.read_bytes() == (tmp_path / "again" / path.relative_to(rig)).read_bytes()
    assert (open_capture(rig).read_frame(2) == open_capture(tmp_path / "again").read_frame(2)).all()


def test_angular_order_holds_what_the_frames_hold(rig: Path, tmp_path: Path) -> None:
    simulate_capture(tmp_path / "angular", PRESETS["scene1"], RIG, angular=True)
    capture = open_capture(tmp_path / "angular")
    assert capture.sorted_samples is not None
    store = AngularStore.open(capture.sorted_samples)
    frames = open_capture(rig)
    pixels = np.flatnonzero(frames.mapping().solid_angles().reshape(-1) > 0)
    expected = np.stack([frames.read_frame(index).reshape(-1, 3)[pixels] for index in range(6)])
    assert np.allclose(store.read(0, 10_000), expected.transpose(1, 0, 2)[store.order], rtol=1e-3)


def test_rotating_rigs_are_noticed(tmp_path: Path) -> None:
    simulate_capture(tmp_path / "turned", PRESETS["distant"], RigSettings(probes=3, size=12, samples=1, rotating=True))
    assert open_capture(tmp_path / "turned").rotating


def test_an_existing_folder_is_not_overwritten(rig: Path) -> None:
    with pytest.raises(CaptureError, match="exists"):
        simulate_capture(rig, PRESETS["scene1"], RIG)


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("x_m", "nan", r"line 4: x_m = nan"),
        ("z_m", "up", r"line 4: z_m = 'up' is no number"),
        ("qw", "0.5", r"line 4: the quaternion .* length 0.5"),
        ("time_ns", "1.5", r"line 4: time_ns = '1.5'"),
        ("frame", "frames/000001.exr", r"line 4: frame 'frames/000001.exr' is already in line 3"),
        ("frame", "../../etc/passwd.exr", "must lie in the capture's folder"),
        ("frame", "", "frame is empty"),
    ],
)
def test_bad_poses_name_line_and_field(rig: Path, tmp_path: Path, column: str, value: str, words: str) -> None:
    shutil.copytree(rig, tmp_path / "bad")
    lines = (rig / "poses.csv").read_text().splitlines()
    cells = lines[3].split(",")
    cells[lines[0].split(",").index(column)] = value
    (tmp_path / "bad" / "poses.csv").write_text("\n".join([*lines[:3], ",".join(cells), *lines[4:]]))
    with pytest.raises(CaptureError, match=words):
        open_capture(tmp_path / "bad")


def test_missing_things_are_named(rig: Path, tmp_path: Path) -> None:
    with pytest.raises(CaptureError, match="no such folder"):
        open_capture(tmp_path / "none")
    for name, words in {
        "capture.json": "capture.json: there is no such file",
        "poses.csv": "poses.csv: there is no",
    }.items():
        folder = tmp_path / name
        shutil.copytree(rig, folder)
        (folder / name).unlink()
        with pytest.raises(CaptureError, match=words):
            open_capture(folder)
    (tmp_path / "none").mkdir()
    folder = tmp_path / "frame"
    shutil.copytree(rig, folder)
    (folder / "frames" / "000002.exr").unlink()
    with pytest.raises(CaptureError, match=r"1 of 6 frames .* missing, the first is frames/000002.exr"):
        open_capture(folder)
    document = folder / "capture.json"
    document.write_text(document.read_text().replace('"version"', '"colour": 1, "version"'))
    with pytest.raises(CaptureError, match=r"capture\.json: colour"):
        open_capture(folder)


def test_frames_that_cannot_be_used_are_named(rig: Path, tmp_path: Path) -> None:
    shutil.copytree(rig, tmp_path / "bad")
    write_rgb(tmp_path / "bad" / "frames" / "000001.exr", np.zeros((8, 8, 3), np.float16))
    frame = tmp_path / "bad" / "frames" / "000002.exr"
    frame.write_bytes(frame.read_bytes()[:300])
    capture = open_capture(tmp_path / "bad")
    with pytest.raises(CaptureError, match=r"000001.exr has 8×8 pixels, but capture.json says 16×16"):
        capture.read_frame(1)
    with pytest.raises(CaptureError, match=r"000002.exr"):
        capture.read_frame(2)


def _frames(folder: Path, count: int = 4) -> Path:
    folder.mkdir()
    for index in range(count):
        write_rgb(folder / f"f{index}.exr", np.full((16, 32, 3), index, np.float16))
    return folder


def test_import_with_csv(tmp_path: Path) -> None:
    frames = _frames(tmp_path / "frames")
    poses = tmp_path / "poses.csv"
    poses.write_text("frame,x_m,y_m,z_m\n" + "".join(f"f{index}.exr,{index},0,1\n" for index in range(4)))
    settings = ImportSettings(MappingSettings(kind="latlong"))
    assert import_capture(frames, poses, tmp_path / "out", settings) == 4
    capture = open_capture(tmp_path / "out")
    np.testing.assert_array_equal(capture.poses.positions[:, 0], np.arange(4))
    assert capture.read_frame(2).max() == 2
    poses.write_text("frame,x_m,y_m,z_m\nf0.exr,0,0,0\n")
    with pytest.raises(CaptureError, match=r"fewer poses than frames: 3 frames have none, the first is f1.exr"):
        import_capture(frames, poses, tmp_path / "other", settings)
    poses.write_text("frame,x_m,y_m\nf0.exr,0,0\n")
    with pytest.raises(CaptureError, match="the header lacks z_m"):
        read_poses(poses)


def test_import_with_a_tum_trajectory(tmp_path: Path) -> None:
    frames = _frames(tmp_path / "frames")
    trajectory = tmp_path / "groundtruth.txt"
    lines = [f"{1000 + step / 100:.4f} {step / 100} 0 0 0 0 0 1" for step in range(40)]
    trajectory.write_text("# timestamp tx ty tz qx qy qz qw\n" + "\n".join(lines) + "\n")
    settings = ImportSettings(MappingSettings(kind="latlong"), tum=True, fps=10)
    import_capture(frames, trajectory, tmp_path / "out", settings)
    np.testing.assert_allclose(open_capture(tmp_path / "out").poses.positions[:, 0], [0, 0.1, 0.2, 0.3], atol=1e-9)
    with pytest.raises(CaptureError, match=r"f0.exr: has no capDate .* give --fps"):
        import_capture(frames, trajectory, tmp_path / "b", ImportSettings(MappingSettings(kind="latlong"), tum=True))
    late = ImportSettings(MappingSettings(kind="latlong"), tum=True, fps=1)
    with pytest.raises(CaptureError, match="--max-gap-seconds"):
        import_capture(frames, trajectory, tmp_path / "c", late)
    trajectory.write_text("1000 0 0\n")
    with pytest.raises(CaptureError, match="line 1: has 3 values, not 8"):
        read_tum(trajectory)


HEADER = "frame,time_ns,x_m,y_m,z_m,qx,qy,qz,qw"
ROWS = ["a.exr,1,0.1,0.2,0.3,0,0,0,1", "b.exr,2,0.4,0.5,0.6,0,0,0,1"]


@pytest.mark.parametrize(
    "text",
    [
        "\r\n".join([HEADER, *ROWS]) + "\r\n",
        "\ufeff" + "\n".join([HEADER, *ROWS]),
        "\n".join(["# by a tracker", HEADER.upper(), ROWS[0], "", "# half way", ROWS[1]]),
        "\n".join(line.replace(",", ", ") for line in (HEADER, *ROWS)),
    ],
    ids=["crlf", "byte-order mark", "comments and capitals", "spaces"],
)
def test_spreadsheets_of_all_kinds_are_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "poses.csv").write_bytes(text.encode())
    poses = read_poses(tmp_path / "poses.csv")
    assert poses.frames == ("a.exr", "b.exr")
    np.testing.assert_allclose(poses.positions, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    assert poses.times_ns.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("c.exr,3,0,0", "line 3: has 4 values, the header 9"),
        ("c.exr,3,0,0,0,0,0,0,1,7", "line 3: has 10 values, the header 9"),
        (f"c.exr,{10**20},0,0,0,0,0,0,1", "line 3: time_ns = 1000.*are these nanoseconds"),
        ("c.exr,3,2e6,0,0,0,0,0,1", r"line 3: x_m = 2e6 must be a finite number, at most 1e\+06"),
    ],
)
def test_odd_rows_are_named(tmp_path: Path, row: str, words: str) -> None:
    (tmp_path / "poses.csv").write_text("\n".join([HEADER, ROWS[0], row]))
    with pytest.raises(CaptureError, match=words):
        read_poses(tmp_path / "poses.csv")


def test_trajectories_of_all_kinds_are_read(tmp_path: Path) -> None:
    path = tmp_path / "track.txt"
    path.write_text(
        "\ufeff# timestamp tx ty tz qx qy qz qw\r\n"
        "1.767323040123456789e9 1 2 3 0 0 0 1  # the first\r\n"
        "-1.5,4,5,6,0,0,0,1\r\n"
        "-1.5 4 5 6 0 0 0 1\r\n",
        "utf-8",
    )
    times, positions, _ = read_tum(path)
    assert times.tolist() == [1767323040123456789, -1500000000]
    np.testing.assert_allclose(positions, [[1, 2, 3], [4, 5, 6]])
    path.write_text("1 0 0 0 0 0 0 1\n1.0 9 0 0 0 0 0 1\n")
    with pytest.raises(CaptureError, match=r"line 2: timestamp 1.0 has another pose in line 1"):
        read_tum(path)
    path.write_text("inf 0 0 0 0 0 0 1\n")
    with pytest.raises(CaptureError, match=r"line 1: timestamp = 'inf'"):
        read_tum(path)


def test_hidden_frames_are_passed_over_and_doubles_are_named(tmp_path: Path) -> None:
    frames = tmp_path / "Lichtproben Süd"
    frames.mkdir()
    for name in ("a.exr", "b.exr"):
        write_rgb(frames / name, np.ones((8, 16, 3), np.float16))
    (frames / "._a.exr").write_bytes(b"macOS")
    poses = tmp_path / "poses.csv"
    poses.write_text("\n".join([HEADER, *ROWS]))
    settings = ImportSettings(MappingSettings(kind="latlong"))
    assert import_capture(frames, poses, tmp_path / "out", settings) == 2
    (tmp_path / "out/frames/._a.exr").write_bytes(b"macOS")
    assert open_capture(tmp_path / "out").info.name == "Lichtproben Süd"
    poses.write_text("\n".join([HEADER, f"one/{ROWS[0]}", f"two/{ROWS[0]}", ROWS[1]]))
    with pytest.raises(CaptureError, match=r"several rows name the frame 'a\.exr'"):
        import_capture(frames, poses, tmp_path / "twice", settings)
    with pytest.raises(CaptureError, match="--gain -1: must be a positive number"):
        import_capture(frames, poses, tmp_path / "dark", ImportSettings(MappingSettings(kind="latlong"), gain=-1))
