"""The folder of a job."""

from __future__ import annotations

from pathlib import Path

from lightwell_workers.jobs.directory import JobDirectory


def test_what_a_killed_step_left_half_written_is_no_result(tmp_path: Path) -> None:
    directory = JobDirectory(tmp_path, "0123456789")
    results = directory.work / "results"
    for name in ("grid.zarr", ".grid.zarr.77.partial", ".adaptive.zarr.77.partial"):
        (results / name).mkdir(parents=True)
        (results / name / "zarr.json").write_text("{}")
    for name in ("report.json", ".report.json.77.partial"):
        (results / name).write_text("{}")
    for _ in range(2):
        directory.publish(results)
        assert [artifact.path for artifact in directory.read_manifest()] == ["grid.zarr", "report.json"]
    assert sorted(path.name for path in directory.artifacts.iterdir()) == ["grid.zarr", "report.json"]
