"""Room for jobs, and what their events say of interruptions."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest
from filelock import FileLock, Timeout
from tests.support.jobs import make_capture

from lightwell.job_settings import IlfGridSettings, JobsSettings
from lightwell_workers.jobs.context import JobCancelled
from lightwell_workers.jobs.directory import JobDirectory
from lightwell_workers.jobs.events import EventLog, last_state, read_events
from lightwell_workers.jobs.workflow import PREPARE, Runner, memory_problem, space_problem, used_bytes

MEGABYTE = 1 << 20


def test_checkpoints_of_unfinished_jobs_count_against_the_quota(tmp_path: Path) -> None:
    (tmp_path / "job-failed" / "work").mkdir(parents=True)
    (tmp_path / "job-failed" / "work" / "part").write_bytes(bytes(2 * MEGABYTE))
    finished = JobDirectory(tmp_path, "job-finished")
    (finished.work / "results").mkdir(parents=True)
    (finished.work / "results" / "report.json").write_bytes(bytes(MEGABYTE))
    finished.publish(finished.work / "results")
    (tmp_path / "Not A Job").mkdir()
    (tmp_path / "Not A Job" / "manifest.json").write_text("[]")
    assert used_bytes(tmp_path) == 3 * MEGABYTE
    settings = JobsSettings(quota_mb=6, min_free_mb=0)
    assert space_problem(settings, tmp_path, 2 * MEGABYTE) is None
    reason = space_problem(settings, tmp_path, 4 * MEGABYTE)
    assert reason is not None
    assert "jobs use 3 MB of 6 MB" in reason
    # What a job has written already it does not need once more.
    assert space_problem(settings, tmp_path, 4 * MEGABYTE, "job-failed") is None


def test_a_job_needs_only_what_it_has_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "job-retried" / "work").mkdir(parents=True)
    (tmp_path / "job-retried" / "work" / "part").write_bytes(bytes(3 * MEGABYTE))
    monkeypatch.setattr("shutil.disk_usage", lambda _: type("Usage", (), {"free": 2 * MEGABYTE}))
    settings = JobsSettings(min_free_mb=1)
    assert "needs 4 MB" in (space_problem(settings, tmp_path, 3 * MEGABYTE) or "")
    assert space_problem(settings, tmp_path, 4 * MEGABYTE, "job-retried") is None


def test_a_job_larger_than_the_machine_is_refused() -> None:
    assert memory_problem(JobsSettings(), 100 * MEGABYTE) is None
    assert "this machine has" in (memory_problem(JobsSettings(), 1 << 60) or "")
    assert memory_problem(JobsSettings(scheduler="tcp://elsewhere:8786"), 1 << 60) is None


def test_an_executor_that_ends_cancels_no_job(tmp_path: Path) -> None:
    capture = make_capture(tmp_path / "rig")
    document = IlfGridSettings(capture=str(capture), resolutions=((2, 2, 2),), bands=1).model_dump(mode="json")
    root = tmp_path / "jobs"

    def run(runner: Runner, index: int) -> int:
        return runner._run("inline-job", "ilf-grid", document, index, threading.Event())

    first = Runner(JobsSettings(), root)
    steps = run(first, PREPARE)
    first.close()
    stopped = threading.Event()
    stopped.set()
    with pytest.raises(JobCancelled):
        first._run("inline-job", "ilf-grid", document, 0, stopped)
    events = JobDirectory(root, "inline-job").events
    assert last_state(events) == "running"
    assert "interrupted" in read_events(events)[-1][1]["message"]

    second = Runner(JobsSettings(), root)
    cancel = JobDirectory(root, "inline-job").cancel
    cancel.touch()
    with pytest.raises(JobCancelled):
        run(second, 0)
    assert last_state(events) == "cancelled"
    cancel.unlink()
    run(second, 0)
    assert last_state(events) == "running"
    for index in range(1, steps + 1):
        run(second, index)
    assert last_state(events) == "succeeded"
    second.close()


def test_steps_after_the_publication_change_nothing(tmp_path: Path) -> None:
    """A kill may come between the publication and its checkpoint; the steps' plan is gone by then."""
    capture = make_capture(tmp_path / "rig")
    document = IlfGridSettings(capture=str(capture), resolutions=((2, 2, 2),), bands=1).model_dump(mode="json")
    runner = Runner(JobsSettings(), tmp_path / "jobs")

    def run(index: int) -> int:
        return runner._run("inline-job", "ilf-grid", document, index, threading.Event())

    steps = run(PREPARE)
    for index in range(steps + 1):
        run(index)
    directory = JobDirectory(tmp_path / "jobs", "inline-job")
    events, manifest = directory.events.read_bytes(), directory.manifest.read_bytes()
    assert not directory.work.exists()
    for index in (steps, 1, PREPARE):
        run(index)
    assert (directory.events.read_bytes(), directory.manifest.read_bytes()) == (events, manifest)
    assert not directory.work.exists()
    runner.close()


def test_a_cancelled_body_keeps_its_lock_until_it_is_ended(tmp_path: Path) -> None:
    capture = make_capture(tmp_path / "rig")
    document = IlfGridSettings(capture=str(capture), resolutions=((2, 2, 2),), bands=1).model_dump(mode="json")
    runner = Runner(JobsSettings(), tmp_path / "jobs")
    directory = JobDirectory(tmp_path / "jobs", "inline-job")
    directory.path.mkdir(parents=True)
    directory.cancel.touch()
    stop = threading.Event()
    ended: list[BaseException] = []

    def body() -> None:
        try:
            runner._run("inline-job", "ilf-grid", document, PREPARE, stop)
        except JobCancelled as error:
            ended.append(error)

    thread = threading.Thread(target=body)
    thread.start()
    while last_state(directory.events) != "cancelled":
        time.sleep(0.01)
    with pytest.raises(Timeout), FileLock(directory.lock, timeout=0.3):
        pass
    assert not ended
    stop.set()
    thread.join(1)
    assert ended
    with FileLock(directory.lock, timeout=0):
        pass
    runner.close()


def test_the_last_state_is_found_behind_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "events.jsonl"
    assert last_state(path) is None
    log = EventLog(path)
    log.append("state", state="running")
    log.append("log", message="x", at=time.time())
    with path.open("ab") as file:
        file.write(b'{"type": "sta')
    assert last_state(path) == "running"
