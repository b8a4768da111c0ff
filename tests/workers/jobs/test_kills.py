"""Done when 4: processes are killed at random moments; every job succeeds with the bytes of an uninterrupted run."""

from __future__ import annotations

import contextlib
import json
import random
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

import psutil
import pytest
from tests.support.jobs import Process, digests, executor, free_port, make_capture, postgres, running, wait_for_end

from lightwell.job_settings import JobsSettings
from lightwell_workers.jobs.queue import Queue

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]

JOBS, KILLS = 5, 20
FEWER_JOBS, FEWER_KILLS = 3, 10
"""On Postgres: what differs there is the database and the cluster, not the jobs."""
LONGEST_SECONDS = 300.0


def _settings(capture: Path, index: int) -> dict[str, Any]:
    """Jobs that differ, of some seconds and some checkpoints each."""
    return {
        "capture": str(capture),
        "resolutions": 16 + index,
        "memory_mb": 64,
        "gradients": "regression" if index == 1 else "central",
        "gradient_projection": index == 0,
        "adaptive_tolerance": 0.1 if index == 2 else None,
        "checkpoint_seconds": 0.2,
    }


def _bodies(queue: Queue, job: str) -> list[tuple[int, int]]:
    """Return when each body of the job began and ended, from its own log, nanoseconds."""
    return [
        (round(event["time_ns"] - event["seconds"] * 1e9), event["time_ns"])
        for _, event in queue.events(job)
        if event.get("message") == "step done"
    ]


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("captures") / "rig", probes=600, size=48)


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory, capture: Path) -> list[dict[str, str]]:
    """The artefacts of runs that nobody disturbs."""
    data = tmp_path_factory.mktemp("undisturbed")
    queue = Queue(JobsSettings(), data)
    with executor(data):
        jobs = [queue.submit("ilf-grid", _settings(capture, index))[0].id for index in range(JOBS)]
        ended = [wait_for_end(queue, job) for job in jobs]
    queue.close()
    assert [job.state for job in ended] == ["succeeded"] * JOBS, [job.error for job in ended]
    return [digests(job) for job in ended]


def _kill_until_done(
    queue: Queue, jobs: list[str], victims: dict[str, list[Process]], chance: random.Random, kills: int
) -> dict[str, int]:
    """Kill random victims and start them again until all jobs have succeeded; stop killing after so many ``kills``."""
    killed = dict.fromkeys(victims, 0)
    until = time.monotonic() + LONGEST_SECONDS
    while time.monotonic() < until:
        states = [queue.get(job).state for job in jobs]
        if all(state == "succeeded" for state in states):
            return killed
        assert "failed" not in states, [queue.get(job).error for job in jobs]
        time.sleep(chance.uniform(0.3, 1.7))
        if sum(killed.values()) >= kills:
            continue
        name = chance.choice(list(victims))
        if name == "task":
            tasks = [task for task in victims["executor"][0].descendants() if _is_task(task)]
            if tasks:
                chance.choice(tasks).kill()
                killed[name] += 1
            continue
        for process in victims[name]:
            process.kill()
            process.start()
        killed[name] += 1
    raise AssertionError(f"not done after {LONGEST_SECONDS:.0f} s: {[queue.get(job) for job in jobs]}")


def _is_task(process: psutil.Process) -> bool:
    """Return whether a process below the executor is a Dask worker."""
    with contextlib.suppress(psutil.Error):
        return "spawn_main" in " ".join(process.cmdline())
    return False


def _check(queue: Queue, jobs: list[str], expected: list[dict[str, str]]) -> None:
    for job, wanted in zip(jobs, expected, strict=True):
        ended = queue.get(job)
        assert digests(ended) == wanted
        spans = sorted(_bodies(queue, job))
        assert all(first[1] <= second[0] for first, second in pairwise(spans)), spans
        assert not (queue.root / job / "work").exists()


def test_random_kills_on_sqlite(
    tmp_path: Path, capture: Path, expected: list[dict[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    queue = Queue(JobsSettings(), tmp_path)
    seed = random.SystemRandom().randrange(1 << 30)
    serving = running(
        "lightwell_server.cli",
        "serve",
        "--port",
        str(port),
        "--data",
        str(tmp_path),
        log=tmp_path / "server.log",
        LIGHTWELL_JOBS__EMBEDDED="false",
    )
    with serving as server, executor(tmp_path) as worker:
        jobs = [queue.submit("ilf-grid", _settings(capture, index))[0].id for index in range(JOBS)]
        victims = {"executor": [worker], "server": [server], "both": [server, worker], "task": []}
        started = time.monotonic()
        killed = _kill_until_done(queue, jobs, victims, random.Random(seed), KILLS)
        seconds = time.monotonic() - started
        below = worker.descendants()
    psutil.wait_procs(below, timeout=5)
    assert not [process for process in below if process.is_running()]
    _check(queue, jobs, expected)
    queue.close()
    with capsys.disabled():
        print(f"\n{json.dumps({'seed': seed, 'seconds': round(seconds, 1), 'kills': killed})}")


def test_kills_with_postgres_and_an_external_cluster(
    tmp_path: Path, capture: Path, expected: list[dict[str, str]], capsys: pytest.CaptureFixture[str]
) -> None:
    port = free_port()
    address = f"tcp://127.0.0.1:{port}"
    seed = random.SystemRandom().randrange(1 << 30)
    log = tmp_path / "dask.log"
    scheduling = running(
        "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", str(port), "--no-dashboard", log=log
    )
    worker_arguments = ("distributed.cli.dask_worker", address, "--nthreads", "1", "--no-dashboard", "--no-nanny")
    with contextlib.ExitStack() as stack:
        url = stack.enter_context(postgres(tmp_path))
        scheduler = stack.enter_context(scheduling)
        workers = [stack.enter_context(running(*worker_arguments, log=log)) for _ in range(2)]
        settings = JobsSettings(database_url=url, scheduler=address, processes=2)
        queue = Queue(settings, tmp_path)
        stack.callback(queue.close)
        worker = stack.enter_context(executor(tmp_path, LIGHTWELL_JOBS_SETTINGS=settings.model_dump_json()))
        jobs = [queue.submit("ilf-grid", _settings(capture, index))[0].id for index in range(FEWER_JOBS)]
        victims = {
            "executor": [worker],
            "one worker": [workers[0]],
            "other worker": [workers[1]],
            # Workers end with their scheduler and are started again by what supervises them.
            "scheduler": [scheduler, *workers],
        }
        started = time.monotonic()
        killed = _kill_until_done(queue, jobs, victims, random.Random(seed), FEWER_KILLS)
        seconds = time.monotonic() - started
        _check(queue, jobs, expected[:FEWER_JOBS])
    with capsys.disabled():
        print(f"\n{json.dumps({'seed': seed, 'seconds': round(seconds, 1), 'kills': killed})}")
