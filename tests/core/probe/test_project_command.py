"""``lightwell project``."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.reference_probe import HDRI, MAP_NAMES, ROOT_4PI, project_latlong, real_map, relative_error
from typer.testing import CliRunner, Result

from lightwell.errors import FrameError, MappingError
from lightwell.io.exr import write_rgb
from lightwell.probe.factory import make_mapping
from lightwell.probe.latlong import LatLong
from lightwell.probe.unwrap import resample
from lightwell.settings import MappingSettings
from lightwell.sh.engines import convert
from lightwell_server.cli import app


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["project", *map(str, arguments)])


def document(*arguments: object) -> dict[str, Any]:
    result = run(*arguments, "--json")
    assert result.exit_code == 0, result.output
    answer: dict[str, Any] = json.loads(result.stdout)
    return answer


@pytest.mark.parametrize("name", MAP_NAMES)
def test_every_real_map(name: str) -> None:
    answer = document(HDRI / f"{name}.exr", "--mapping", "latlong", "--bands", 5)
    assert {key: answer[key] for key in answer if key != "coefficients"} == {
        "bands": 5,
        "convention": "lightwell",
        "units": "relative",
        "window": "none",
        "mapping": "latlong",
    }
    assert relative_error(np.array(answer["coefficients"]), project_latlong(real_map(name), 5)) < 1e-6


MAPPING_ARGUMENTS = [
    ("octahedral", []),
    ("cube", []),
    ("mirror-ball", ["--forward", "1,0,0", "--up", "0,0,1"]),
    ("angular", ["--forward", "-1,0,0", "--up", "0,0,1"]),
    ("fisheye", ["--fov-degrees", "200"]),
    ("mirror-sphere", ["--sphere-radius-m", "0.05", "--sphere-distance-m", "1.25", "--disc", "48,48,48"]),
]


@pytest.mark.parametrize(("mapping", "arguments"), MAPPING_ARGUMENTS)
@pytest.mark.parametrize("resolution", [0, 40])
def test_constant_picture_in_every_mapping(tmp_path: Path, mapping: str, arguments: list[str], resolution: int) -> None:
    height, width = (96, 128) if mapping == "cube" else (96, 96)
    write_rgb(tmp_path / "one.exr", np.ones((height, width, 3), np.float16))
    answer = document(tmp_path / "one.exr", "--mapping", mapping, *arguments, "--resolution", resolution)
    expected = np.zeros((25, 3))
    expected[0] = ROOT_4PI
    assert np.array(answer["coefficients"]) == pytest.approx(expected, abs=1e-6 * ROOT_4PI)


def test_camera_axes_turn_the_light(tmp_path: Path) -> None:
    axes = {"forward": (0.0, 1.0, 0.0), "up": (0.0, 0.0, 1.0)}
    mapping = make_mapping(MappingSettings(kind="angular", **axes), 128, 128)
    write_rgb(tmp_path / "a.exr", resample(real_map("venice"), LatLong(256, 512), mapping, 4))
    answer = document(tmp_path / "a.exr", "--mapping", "angular", "--forward", "0,1,0", "--up", "0,0,1")
    assert relative_error(np.array(answer["coefficients"]), project_latlong(real_map("venice"), 5)) < 0.005


def test_convention_window_and_bands() -> None:
    path = HDRI / "hall.exr"
    plain = np.array(document(path, "--bands", 3)["coefficients"])
    three = document(path, "--bands", 3, "--convention", "three")
    assert three["convention"] == "three"
    assert np.array(three["coefficients"]) == pytest.approx(convert(plain, "three"))
    windowed = document(path, "--bands", 3, "--window", "hann")
    assert windowed["window"] == "hann"
    factor = np.repeat([1, 0.75, 0.25], [1, 3, 5])[:, None]
    assert np.array(windowed["coefficients"]) == pytest.approx(plain * factor)


def test_weights_and_resolution() -> None:
    path = HDRI / "forest.exr"
    solid, paper = (np.array(document(path, "--weights", kind)["coefficients"]) for kind in ("solid-angle", "paper"))
    assert paper[0] / solid[0] == pytest.approx(np.full(3, 1 + np.pi**2 / (24 * 256**2)), rel=1e-8)
    small = np.array(document(path, "--resolution", 128)["coefficients"])
    assert small[0] == pytest.approx(solid[0], rel=1e-6)
    assert relative_error(small, solid) < 2e-3


def test_table_for_people(tmp_path: Path) -> None:
    image = np.full((16, 32, 3), 2.0, np.float32)
    image[3, 4, 0], image[5, 5, 1], image[6, 6, 2] = np.nan, np.inf, -1
    write_rgb(tmp_path / "a.exr", image)
    result = run(tmp_path / "a.exr", "--bands", 2, "--window", "auto")
    assert result.exit_code == 0
    for text in (
        "2 bands, lightwell",
        "█",
        "Mean radiance",
        "Dominant light",
        "Ambient",
        "1 NaN",
        "1 infinite",
        "1 neg",
    ):
        assert text in result.output
    quiet = run(tmp_path / "a.exr", "--json")
    assert "1 NaN" in quiet.stderr
    json.loads(quiet.stdout)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        (["--mapping", "fisheye"], MappingError, "--fov-degrees"),
        (["--mapping", "mirror-sphere", "--sphere-radius-m", "1"], MappingError, "Missing: --fov-degrees"),
        (["--mapping", "cube"], MappingError, "no cube map"),
        (["--forward", "1,2"], MappingError, "--forward: three numbers"),
        (["--mapping", "angular", "--disc", "a,b,c"], MappingError, "--disc: three numbers"),
        (["--mapping", "fisheye", "--fov-degrees", "-3"], MappingError, "--fov-degrees: input should be greater"),
        (["--mapping", "octahedral", "--weights", "fejer"], MappingError, "square"),
    ],
)
def test_errors_name_the_option(arguments: list[str], error: type[Exception], message: str) -> None:
    result = run(HDRI / "hall.exr", *arguments)
    assert isinstance(result.exception, error)
    assert message in str(result.exception)


def test_unreadable_pictures(tmp_path: Path) -> None:
    for name in ("missing.exr", "a.png"):
        assert isinstance(run(tmp_path / name).exception, FrameError)


def test_one_line_and_exit_status_1(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "lightwell_server.cli", "project", str(tmp_path / "no.exr")]
    finished = subprocess.run(command, capture_output=True, text=True, check=False)
    assert finished.returncode == 1
    assert finished.stderr == "lightwell: no.exr: does not exist\n"
    assert finished.stdout == ""


def test_a_damaged_file_leaves_standard_output_empty(tmp_path: Path) -> None:
    # OpenEXR itself prints warnings there.
    (tmp_path / "cut.exr").write_bytes((HDRI / "venice.exr").read_bytes()[:100_000])
    command = [sys.executable, "-m", "lightwell_server.cli", "project", str(tmp_path / "cut.exr"), "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr == "lightwell: cut.exr: is truncated or damaged: its pixels cannot be decoded\n"


def test_notes_on_pictures_that_do_not_look_like_their_mapping(tmp_path: Path) -> None:
    write_rgb(tmp_path / "square.exr", np.ones((16, 16, 3), np.float32))
    assert "is --mapping right?" in run(tmp_path / "square.exr", "--json").stderr
    unused = run(tmp_path / "square.exr", "--mapping", "octahedral", "--fov-degrees", 90, "--json")
    assert "they are not used" in unused.stderr
