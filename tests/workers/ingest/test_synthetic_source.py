"""The room as a source: its frames project to its truth, in every mapping."""

from __future__ import annotations

import numpy as np
import pytest

from lightwell.settings import MappingSettings, StreamSettings
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.stages.reduce import reduce_frame


def frames(url: str, mapping: MappingSettings | None = None) -> list[Frame]:
    with open_source(url, mapping) as source:
        items = list(source)
    assert all(isinstance(item, Frame) for item in items)
    return [item for item in items if isinstance(item, Frame)]


@pytest.mark.parametrize(
    ("mapping", "width", "tolerance"),
    [
        (MappingSettings(), 512, 2e-3),
        (MappingSettings(kind="octahedral"), 256, 4e-3),
        (MappingSettings(kind="mirror-ball"), 512, 1.5e-2),
        (
            MappingSettings(kind="mirror-sphere", sphere_radius_m=0.05, sphere_distance_m=1.25, fov_degrees=4.8),
            512,
            1.5e-2,
        ),
    ],
    ids=["latlong", "octahedral", "mirror-ball", "mirror-sphere"],
)
def test_frames_project_to_the_truth(mapping: MappingSettings, width: int, tolerance: float) -> None:
    (one, *_) = frames(f"synthetic:room?realtime=0&frames=2&width={width}", mapping)
    settings = StreamSettings(source="synthetic:room", mapping=mapping, resolution=0)
    assert one.truth is not None
    truth = one.truth[:25]
    result = reduce_frame(one, settings).coefficients
    assert np.linalg.norm(result - truth) < tolerance * np.linalg.norm(truth)


def test_frames_move_and_are_named() -> None:
    first, second = frames("synthetic:room?realtime=0&frames=2&fps=2")
    assert (first.name, second.name) == ("room 0", "room 1")
    assert first.truth is not None
    assert second.truth is not None
    assert not np.allclose(first.truth, second.truth)
    assert second.capture_time_ns - first.capture_time_ns == 500_000_000
    assert first.world_from_camera is None


def test_noise_is_repeatable_and_unbiased() -> None:
    url = "synthetic:room?realtime=0&frames=2&noise=0.3&seed={}"
    clean, noisy, again, other = (
        frames(u)[1] for u in ("synthetic:room?realtime=0&frames=2", *map(url.format, (5, 5, 6)))
    )
    np.testing.assert_array_equal(noisy.pixels, again.pixels)
    assert not np.array_equal(noisy.pixels, other.pixels)
    ratio = noisy.pixels / clean.pixels
    assert ratio.mean(dtype=np.float64) == pytest.approx(1.0, abs=5e-3)
    assert ratio.std(dtype=np.float64) == pytest.approx(0.3, rel=0.02)
    assert noisy.truth is not None
    np.testing.assert_array_equal(noisy.truth, clean.truth)
