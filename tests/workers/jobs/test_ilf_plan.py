"""What a grid job is expected to need, and how it is divided."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from tests.support.inline_jobs import run_inline
from tests.support.jobs import make_capture

from lightwell.job_settings import IlfGridSettings
from lightwell_workers.jobs.ilf_plan import PROCESS_BYTES, Field, estimate, make_plan


@pytest.fixture(scope="module")
def capture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_capture(tmp_path_factory.mktemp("captures") / "rig")


def _settings(capture: Path, **changes: Any) -> IlfGridSettings:
    return IlfGridSettings.model_validate({"capture": str(capture), "resolutions": 32} | changes)


def test_slow_repairs_are_expected_to_take_longer(capture: Path) -> None:
    seconds = [estimate(_settings(capture, repair=repair)).seconds for repair in ("pull-push", "bilateral", "mipmap")]
    assert 3 * seconds[0] < seconds[1] < seconds[2]


def test_each_grid_costs(capture: Path) -> None:
    one, other, both = (estimate(_settings(capture, resolutions=sizes)).seconds for sizes in ([8], [9], [8, 9]))
    assert both == pytest.approx(one + other, rel=0.2)


def test_a_small_job_is_not_expected_to_fill_its_memory(capture: Path) -> None:
    small = estimate(_settings(capture, resolutions=2)).memory_bytes
    assert PROCESS_BYTES < small < 1.1 * PROCESS_BYTES


def test_checkpoints_come_in_time_with_slow_repairs(capture: Path) -> None:
    fast, slow = (
        make_plan(Field(_settings(capture, repair=repair, checkpoint_seconds=0.5)), 1)
        for repair in ("pull-push", "mipmap")
    )
    assert len(slow.parts) > len(fast.parts)
    assert slow.parts[-1].last == fast.parts[-1].last


def test_no_error_is_told_of_a_grid_in_the_dark(tmp_path: Path) -> None:
    """JSON has no infinity."""
    outside = [[50.0, 50.0, 50.0], [55.0, 55.0, 55.0]]
    dark = make_capture(tmp_path / "dark", "cube")
    _, report = run_inline("ilf-grid", tmp_path, capture=str(dark), resolutions=2, bounds=outside, bands=2)
    assert report["error_relative"] is None
    assert 0.9 < report["grids"][0]["dark_share"] <= 1
