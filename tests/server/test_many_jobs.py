"""Done when 6: a thousand submissions by ten clients at once, half of them with keys that were used before."""

from __future__ import annotations

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tests.support.jobs import executor, make_capture, wait_for
from tests.support.server import running_server

from lightwell.job_settings import JobKind, JobsSettings
from lightwell_client import Lightwell
from lightwell_workers.jobs.queue import Queue

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]

SUBMISSIONS, CLIENTS, KEYS = 1000, 10, 500


def test_each_unique_submission_runs_once(tmp_path: Path) -> None:
    make_capture(tmp_path / "captures" / "tiny", "constant", probes=3, size=8, probe="latlong")
    settings = {"capture": "captures/tiny", "resolutions": 2, "bands": 2}

    def submit(client_index: int) -> list[str]:
        with Lightwell(url, timeout=60.0) as client:
            return [
                client.submit(*_job(number), key=f"key {number}").id
                for number in (index % KEYS for index in range(client_index, SUBMISSIONS, CLIENTS))
            ]

    def _job(number: int) -> tuple[JobKind, dict[str, object]]:
        # A grid has three times the steps: a tenth of the jobs shows that kinds mix.
        return ("capture-reduce", {"capture": "captures/tiny"}) if number % 10 else ("ilf-grid", settings)

    with running_server(tmp_path, jobs={"embedded": False}) as url, executor(tmp_path):
        with ThreadPoolExecutor(CLIENTS) as pool:
            submitted = [job for jobs in pool.map(submit, range(CLIENTS)) for job in jobs]
        assert len(submitted) == SUBMISSIONS
        assert set(Counter(submitted).values()) == {SUBMISSIONS // KEYS}
        with Lightwell(url, timeout=60.0) as client:
            # While they run, and while more come, pages neither repeat nor leave out what was there.
            seen: list[str] = []
            cursor = None
            late = 0
            while True:
                page = client.jobs(cursor=cursor, limit=37)
                seen += [job.id for job in page.jobs]
                client.submit("ilf-grid", settings, key=f"late {late}")
                late += 1
                cursor = page.next
                if cursor is None:
                    break
            assert len(seen) == len(set(seen)) == KEYS
            assert set(seen) == set(submitted)

            queue = Queue(JobsSettings(), tmp_path)
            wait_for(lambda: queue.counts()["succeeded"] == KEYS + late, "the end of all jobs", 240, pause=1.0)
            again: list[str] = []
            cursor = None
            while True:
                page = client.jobs(cursor=cursor, limit=200, state="succeeded")
                again += [job.id for job in page.jobs]
                cursor = page.next
                if cursor is None:
                    break
            assert again[late:] == seen
            for job in set(submitted):
                events = [event for _, event in queue.events(job)]
                assert [event["state"] for event in events if event["type"] == "state"] == ["running", "succeeded"]
            queue.close()
