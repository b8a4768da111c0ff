"""The commands of captures, jobs and grids, as processes."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from tests.support.server import running_server


def _run(*arguments: str, ok: bool = True) -> str:
    command = [sys.executable, "-m", "lightwell_server.cli", *arguments]
    result = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert (result.returncode == 0) == ok, result.stderr
    return result.stdout if ok else result.stderr


@pytest.mark.slow
def test_from_simulation_to_sample(tmp_path: Path) -> None:
    capture = tmp_path / "captures" / "rig"
    capture.parent.mkdir()
    _run("capture", "simulate", str(capture), "--probes", "30", "--size", "16", "--samples", "1")
    assert "exists" in _run("capture", "simulate", str(capture), ok=False)
    info = json.loads(_run("capture", "info", str(capture), "--json", "--plot", str(tmp_path / "positions.png")))
    assert (info["probes"], info["mapping"]) == (30, "mirror-sphere")
    assert info["blind_half_angle_degrees"] == pytest.approx(2.1, abs=0.01)
    assert (tmp_path / "positions.png").stat().st_size > 1000
    reduced = json.loads(
        _run(
            "capture",
            "reduce",
            str(capture),
            "--out",
            str(tmp_path / "less"),
            "--tolerance",
            "1.9",
            "--max-distance-m",
            "9",
            "--json",
        )
    )
    assert reduced["kept"] < 30
    truth = json.loads(_run("capture", "truth", str(capture), "--at", "0,0,0", "--bands", "2", "--json"))
    assert len(truth["points"][0]["coefficients"]) == 4
    with running_server(tmp_path) as url:
        there = ("--server", url)
        job = json.loads(
            _run(
                "submit",
                "ilf-grid",
                "-p",
                "capture=captures/rig",
                "-p",
                "resolutions=4",
                "-p",
                "window.kind=nonneg",
                "--wait",
                "--json",
                *there,
            )
        )
        assert job["state"] == "succeeded"
        assert set(job) >= {
            "id",
            "kind",
            "state",
            "progress",
            "attempts",
            "created",
            "started",
            "finished",
            "artifacts",
        }
        listed = [json.loads(line) for line in _run("jobs", "--json", *there).splitlines()]
        assert [item["id"] for item in listed] == [job["id"]]
        assert job["id"] in _run("jobs", *there)
        assert "succeeded" in _run("job", job["id"], *there)
        assert "prepared" in _run("job", job["id"], "--log", *there)
        _run("job", job["id"], "--download", str(tmp_path / "results"), *there)
        for command in ("cancel", "retry"):
            assert "succeeded" in _run(command, job["id"], *there, ok=False)
        assert "no job" in _run("job", "0" * 20, *there, ok=False)
        estimate = json.loads(_run("submit", "ilf-grid", "-p", "capture=captures/rig", "--dry-run", "--json", *there))
        assert estimate["fits"]
        remote = json.loads(_run("grid", "sample", f"{job['id']}.grid", "--at", "0,0,0", "--json", *there))
    grid = str(tmp_path / "results" / "grid.zarr")
    local = json.loads(_run("grid", "sample", grid, "--at", "0,0,0", "--at", "0.1,0,0", "--gradients", "--json"))
    assert set(local) == {"grid", "points"}
    assert set(local["points"][0]) == {"at", "coefficients", "gradients", "coverage"}
    assert local["points"][0]["coefficients"] == remote["points"][0]["coefficients"]
    summary = json.loads(_run("grid", "info", grid, "--json", "--plot", str(tmp_path / "grid.png")))
    assert summary["resolution"] == [4, 4, 4]
    places, picture = tmp_path / "places.csv", tmp_path / "places.png"
    wanted = ("--tolerance", "0.3", "--most", "12", "--out", str(places), "--plot", str(picture))
    placed = json.loads(_run("grid", "place", grid, *wanted, "--json"))
    assert len(placed["positions_m"]) == placed["ways"][0]["samples"] == len(places.read_text().splitlines()) - 1
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert "placed, with gradients" in _run("grid", "place", grid, "--tolerance", "0.5", "--most", "4")
    assert "must end in .csv or .json" in _run("grid", "place", grid, "--out", "places.txt", ok=False)
    for kind in ("npz", "three", "ktx2"):
        for path in _run("grid", "export", grid, str(tmp_path / f"out.{kind}"), "--format", kind).split():
            assert Path(path).stat().st_size > 0
    assert "is no grid" in _run("grid", "info", str(tmp_path), ok=False)
    assert "three numbers" in _run("grid", "sample", grid, "--at", "1,2", ok=False)
