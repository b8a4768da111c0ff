"""Rigs that are turned: together, or each probe differently."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tests.support.inline_jobs import run_inline

from lightwell.io import simulate
from lightwell.io.captures import open_capture
from lightwell.io.grids import open_grid
from lightwell.io.simulate import RigSettings, simulate_capture
from lightwell.synthetic.scene import PRESETS

TURN = np.array([0.1, 0.6, -0.1, 0.0])  # mostly a roll: the area light stays away from the rim
TURN[3] = np.sqrt(1 - TURN @ TURN)


def _capture(folder: Path, scene: str, **rig: object) -> Path:
    simulate_capture(folder, PRESETS[scene], RigSettings(probes=60, size=32, **rig))  # type: ignore[arg-type]
    return folder


@pytest.mark.parametrize("probe", ["latlong", "mirror-sphere"])
@pytest.mark.parametrize("scene", ["distant", "cube"])
def test_a_rig_that_is_turned_for_good_sees_the_same_light(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, probe: str, scene: str
) -> None:
    straight = _capture(tmp_path / "straight", scene, probe=probe)
    monkeypatch.setattr(simulate, "turns", lambda count, _seed: np.tile(TURN, (count, 1)))
    turned = _capture(tmp_path / "turned", scene, probe=probe, rotating=True)
    assert not open_capture(turned).rotating
    errors = [
        run_inline("ilf-grid", tmp_path / name, capture=str(capture), resolutions=4, bands=3)[1]["error_relative"]
        for name, capture in (("a", straight), ("b", turned))
    ]
    assert errors[1] < max(0.05, 1.3 * errors[0])


@pytest.mark.parametrize("probe", ["latlong", "mirror-sphere"])
def test_probes_that_are_turned_differently_agree(tmp_path: Path, probe: str) -> None:
    """A constant field is exact to the frames' half floats, distant light nearly so, an area light as without turns."""
    limits = {"constant": 5e-4, "distant": 0.02, "cube": 0.2}
    for scene, limit in limits.items():
        capture = _capture(tmp_path / scene, scene, probe=probe, rotating=True)
        assert open_capture(capture).rotating
        results, report = run_inline(
            "ilf-grid", tmp_path / f"{scene}-job", capture=str(capture), resolutions=4, bands=3, directions=4000
        )
        assert report["error_relative"] < limit
        assert np.isfinite(open_grid(results / "grid.zarr").coefficients).all()
