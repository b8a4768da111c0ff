"""What the capture commands say of odd captures and wrong options."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from lightwell.io.exr import write_rgb
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS
from lightwell_server import cli


class Commands:
    """Runs commands in this process."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
        self._monkeypatch = monkeypatch
        self._capsys = capsys

    def __call__(self, *arguments: object, status: int = 0) -> str:
        """Return what a command prints: on standard output, or on standard error where it fails."""
        self._monkeypatch.setattr(sys, "argv", ["lightwell", *map(str, arguments)])
        with pytest.raises(SystemExit) as ended:
            cli.main()
        out, errors = self._capsys.readouterr()
        assert (ended.value.code or 0) == status, errors
        return out if status == 0 else errors


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Commands:
    return Commands(monkeypatch, capsys)


def test_one_probe_has_no_density(run: Commands, tmp_path: Path) -> None:
    said = run("capture", "simulate", tmp_path / "one", "--probes", 1, "--size", 16, "--samples", 1, "--json")
    assert json.loads(said) == {"capture": str(tmp_path / "one"), "probes": 1}
    info = json.loads(run("capture", "info", tmp_path / "one", "--json"))
    assert (info["mean_spacing_m"], info["probes_per_m"]) == (None, [None, None, None])


def test_sorted_captures_have_a_dynamic_range_too(run: Commands, tmp_path: Path) -> None:
    rig = RigSettings(probes=4, size=16, samples=1)
    simulate_capture(tmp_path / "frames", PRESETS["constant"], rig)
    simulate_capture(tmp_path / "sorted", PRESETS["constant"], rig, angular=True)
    one, other = (json.loads(run("capture", "info", tmp_path / name, "--json")) for name in ("frames", "sorted"))
    assert one["luminance"]["median"] > 0
    assert one["luminance"] == pytest.approx(other["luminance"], rel=1e-3)


def test_dynamic_range_counts_what_is_dark_negative_and_missing(run: Commands, tmp_path: Path) -> None:
    frames = tmp_path / "shots"
    frames.mkdir()
    for name, value in (("a.exr", -1.0), ("b.exr", 8.0), ("c.exr", np.nan)):
        write_rgb(frames / name, np.full((8, 16, 3), value, np.float32))
    rows = ["frame,x_m,y_m,z_m", "a.exr,0,0,0", "b.exr,1,0,0", "c.exr,2,0,0"]
    (tmp_path / "poses.csv").write_text("\n".join(rows))
    arguments = ("capture", "import", frames, "--poses", tmp_path / "poses.csv", "--mapping", "latlong")
    gained = (*arguments, "--gain", 2, "--units", "W.sr-1.m-2", "--json")
    assert json.loads(run(*gained, "--out", tmp_path / "out"))["probes"] == 3
    luminance = json.loads(run("capture", "info", tmp_path / "out", "--json"))["luminance"]
    assert luminance["max"] == pytest.approx(16)
    assert (luminance["stops"], luminance["negative"], luminance["not_finite"]) == (0, 128, 128)
    (tmp_path / "out/poses.csv").write_text("frame,x_m,y_m,z_m\nframes/c.exr,2,0,0\n")
    (tmp_path / "out/frames/a.exr").unlink()
    (tmp_path / "out/frames/b.exr").unlink()
    dark = json.loads(run("capture", "info", tmp_path / "out", "--json"))["luminance"]
    assert (dark["max"], dark["stops"], dark["not_finite"]) == (None, None, 128)


def test_mistakes_are_one_line(run: Commands, tmp_path: Path) -> None:
    simulate = ("capture", "simulate", tmp_path / "rig", "--probes", 2, "--size", 12, "--samples", 1)
    assert "--sphere-distance-m: inf" in run(*simulate, "--sphere-distance-m", "inf", status=1)
    assert "--sphere-radius-m: nan" in run(*simulate, "--sphere-radius-m", "nan", status=1)
    run(*simulate)
    reduce = ("capture", "reduce", tmp_path / "rig", "--out", tmp_path / "less")
    assert "--tolerance: input should be less than 2, not 5.0" in run(*reduce, "--tolerance", 5, status=1)
    assert "--max-distance-m: input should be greater than 0" in run(*reduce, "--max-distance-m", -1, status=1)
    run("capture", "simulate", tmp_path / "sorted", "--probes", 2, "--size", 12, "--samples", 1, "--angular")
    of_sorted = ("capture", "reduce", tmp_path / "sorted", "--out", tmp_path / "less")
    assert "is in angular order" in run(*of_sorted, status=1)
    nowhere = tmp_path / "no" / "positions.png"
    assert f"{nowhere}: cannot be written" in run("capture", "info", tmp_path / "rig", "--plot", nowhere, status=1)


def test_places_of_a_capture_that_would_have_been_enough(run: Commands, tmp_path: Path) -> None:
    simulate_capture(tmp_path / "cube", PRESETS["cube"], RigSettings(probes=60, size=24, samples=1))
    wanted = ("--tolerance", 0.5, "--most", 12, "--bands", 2)
    said = run("capture", "place", tmp_path / "cube", *wanted, "--plot", tmp_path / "places.png", "--json")
    placed = json.loads(said)
    assert placed["places_compared"] == 60
    assert 1 <= len(placed["positions_m"]) <= placed["ways"][1]["samples"]
    assert placed["ways"][0]["within_tolerance"]
    assert (tmp_path / "places.png").read_bytes().startswith(b"\x89PNG")
    run("capture", "place", tmp_path / "cube", *wanted, "--out", tmp_path / "places.csv")
    assert len((tmp_path / "places.csv").read_text().splitlines()) == 1 + len(placed["positions_m"])
    simulate_capture(tmp_path / "sorted", PRESETS["cube"], RigSettings(probes=6, size=16, samples=1), angular=True)
    assert "angular order" in run("capture", "place", tmp_path / "sorted", status=1)
