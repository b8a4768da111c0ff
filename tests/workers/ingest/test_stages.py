"""The stages by themselves: sizes, bad samples, gain, rotation, changes of settings, backdrop."""

from __future__ import annotations

import dataclasses
import math
import threading

import cv2
import numpy as np
import pytest
import structlog

from lightwell.errors import MappingError
from lightwell.probe.factory import make_mapping
from lightwell.settings import (
    BackdropSettings,
    FilterSettings,
    MappingSettings,
    StreamSettings,
    WindowSettings,
)
from lightwell.sh.rotation import rotate
from lightwell.synthetic.room import Room
from lightwell.wire import Backdrop, unpack_coefficients
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.stages.backdrop import LOG_CAP, LOG_K, BackdropStage, encode_log_jpeg, turn
from lightwell_workers.ingest.stages.finish import Finisher
from lightwell_workers.ingest.stages.map import RECENT_FRAMES, SizeGate, make_geometry
from lightwell_workers.ingest.stages.reduce import Reduced, reduce_frame
from lightwell_workers.ingest.stages.timing import StageAverages

NO_FILTER = FilterSettings(kind="none")


def frame(height: int = 16, width: int = 32, value: float = 1.0, name: str = "f", time_ns: int = 10**18) -> Frame:
    pixels = np.full((height, width, 3), value, np.float32)
    return Frame(pixels=pixels, name=name, capture_time_ns=time_ns, ingest_time_ns=time_ns)


def settings(**changes: object) -> StreamSettings:
    return StreamSettings.model_validate({"source": "synthetic:room", **changes})


def reduced(one: Frame, **changes: object) -> Reduced:
    return reduce_frame(one, settings(**changes))


SMALL, LARGE, OTHER = (8, 16), (16, 32), (4, 8)


def passes(gate: SizeGate, sizes: list[tuple[int, int]]) -> list[bool]:
    return [gate.refusal(frame(*size)) is None for size in sizes]


def test_one_frame_of_another_size_is_refused() -> None:
    gate = SizeGate()
    assert all(passes(gate, [LARGE] * 3))
    error = gate.refusal(frame(*SMALL, name="small"))
    assert error is not None
    assert str(error) == "small: is 16×8, the stream's frames are 32×16"
    assert all(passes(gate, [LARGE] * 20))


def test_a_size_that_lasts_is_adopted_when_most_recent_frames_have_it() -> None:
    gate = SizeGate()
    passes(gate, [LARGE] * 20)
    assert passes(gate, [SMALL] * 20) == [False] * (RECENT_FRAMES // 2) + [True] * (20 - RECENT_FRAMES // 2)
    assert gate.size == SMALL


@pytest.mark.parametrize("lap", [[SMALL] + [LARGE] * 8, [LARGE] * 3 + [SMALL] + [LARGE] * 5])
def test_one_odd_frame_in_a_short_loop_is_all_that_is_lost(lap: list[tuple[int, int]]) -> None:
    gate = SizeGate()
    passes(gate, lap)
    assert passes(gate, lap * 5) == [size == LARGE for size in lap * 5]


def test_an_odd_first_frame_costs_one_good_frame() -> None:
    assert passes(SizeGate(), [SMALL] + [LARGE] * 8) == [True, False] + [True] * 7


def test_sizes_that_take_turns_never_win() -> None:
    gate = SizeGate()
    passes(gate, [LARGE] * 3)
    assert not any(passes(gate, [SMALL, OTHER] * RECENT_FRAMES))


def test_tables_are_kept_by_what_they_depend_on() -> None:
    first = make_geometry(settings(resolution=16), 16, 32)
    again = make_geometry(settings(resolution=16, gain=2.0), 16, 32)
    assert again.downsampler is first.downsampler
    assert again.projector is first.projector
    other_bands = make_geometry(settings(resolution=16, bands=3), 16, 32)
    assert other_bands.downsampler is first.downsampler
    assert other_bands.projector is not first.projector
    assert make_geometry(settings(resolution=8), 16, 32).mapping is first.mapping
    assert make_geometry(settings(resolution=16), 32, 64).mapping is not first.mapping


def test_a_picture_that_cannot_belong_to_the_mapping_is_an_error_with_a_remedy() -> None:
    with pytest.raises(MappingError, match="fov"):
        reduced(frame(), mapping={"kind": "mirror-sphere"})


def test_bad_samples_are_counted_and_repaired() -> None:
    one = frame()
    one.pixels[3, 4] = (math.nan, math.inf, -math.inf)
    one.pixels[5, 6, 0] = -2.0
    result = reduced(one)
    assert (result.counts.nan, result.counts.infinite, result.counts.negative) == (1, 2, 1)
    np.testing.assert_array_equal(result.pixels[3, 4], [0, 65504, 0])
    assert result.pixels[5, 6, 0] == -2.0
    assert np.isfinite(result.coefficients).all()
    assert reduced(one, negatives="clamp").pixels[5, 6, 0] == 0.0


def test_good_pictures_are_not_copied() -> None:
    one = frame()
    assert reduced(one).pixels is one.pixels


@pytest.mark.parametrize("resolution", [0, 8, 4096])
def test_constant_light_has_the_known_coefficient_at_every_resolution(resolution: int) -> None:
    result = reduced(frame(value=2.0), resolution=resolution, gain=1.5)
    np.testing.assert_allclose(result.coefficients[0], 3.0 * math.sqrt(4 * math.pi), rtol=1e-6)
    np.testing.assert_allclose(result.coefficients[[1, 2, 3]], 0.0, atol=1e-6)


def test_message_says_what_was_done() -> None:
    one = frame()
    one.pixels[0, 0, 0] = math.nan
    message = Finisher("s", "session").finish(
        reduced(one, window={"kind": "hann"}, filter=NO_FILTER, units="W.sr-1.m-2", bands=3)
    )
    assert (message.stream, message.session, message.source_frame) == ("s", "session", "f")
    assert (message.bands, message.units, message.window.kind) == (3, "W.sr-1.m-2", "hann")
    np.testing.assert_allclose(message.window.weights, [1, 0.75, 0.25])
    assert message.quality.nan == 1
    assert list(message.quality.stage_ms) == ["source", "merge", "map", "downsample", "project", "window", "filter"]
    assert message.dominant is not None
    assert message.truth is None


def test_settings_may_change_between_frames() -> None:
    finisher = Finisher("s", "session")
    times = [10**18 + n * 33_000_000 for n in range(4)]
    changes: list[dict[str, object]] = [
        {"bands": 5},
        {"bands": 2, "filter": {"kind": "one-euro"}},
        {"bands": 2, "filter": {"kind": "one-euro"}, "window": WindowSettings(kind="auto")},
        {"bands": 1},
    ]
    counts = []
    for time_ns, change in zip(times, changes, strict=True):
        message = finisher.finish(reduced(frame(time_ns=time_ns), **change))
        counts.append(len(unpack_coefficients(message.coefficients)))
    assert counts == [25, 4, 4, 1]


def test_filter_keeps_its_state_while_other_settings_change() -> None:
    finisher = Finisher("s", "session")
    slow = FilterSettings(kind="tau", tau_seconds=10.0)
    finisher.finish(reduced(frame(value=0.0), filter=slow))
    message = finisher.finish(reduced(frame(value=1.0, time_ns=10**18 + 10**8), filter=slow, gain=2.0))
    light = unpack_coefficients(message.coefficients)[0] / math.sqrt(4 * math.pi)
    assert np.all(light < 0.05)


def test_a_recording_read_fast_is_filtered_in_its_own_time_and_published_in_ours() -> None:
    finisher = Finisher("s", "session")
    lights, captured = [], []
    for number, value in enumerate((0.0, 1.0)):
        ingest_time_ns = 10**18 + number * 1_000_000
        one = dataclasses.replace(frame(value=value), ingest_time_ns=ingest_time_ns)
        one = dataclasses.replace(one, capture_time_ns=10**18 + number * 1_000_000_000)
        message = finisher.finish(reduced(one, filter={"kind": "tau", "tau_seconds": 1.0, "cut_threshold": 0}))
        lights.append(unpack_coefficients(message.coefficients)[0, 0] / math.sqrt(4 * math.pi))
        captured.append(message.capture_time_ns - ingest_time_ns)
    assert captured == [0, 0]
    assert lights == pytest.approx([0.0, 1 - math.exp(-1)], abs=1e-6)


def test_turning_camera_is_turned_back_before_the_filter() -> None:
    finisher = Finisher("s", "session")
    with open_source("synthetic:room?realtime=0&frames=6&spin=1.7&lights=0&width=512") as source:
        frames = [item for item in source if isinstance(item, Frame)]
    for item in frames:
        assert item.world_from_camera is not None
        assert item.truth is not None
        truth = item.truth[:25]
        tolerance = 3e-3 * float(np.linalg.norm(truth))
        one = reduced(item, filter={"kind": "tau", "tau_seconds": 5.0})
        message = finisher.finish(one)
        # In world axes a room without moving lights stands still: even a slow filter has nothing to delay.
        np.testing.assert_allclose(unpack_coefficients(message.coefficients), truth, atol=tolerance)
        np.testing.assert_allclose(rotate(one.coefficients, item.world_from_camera), truth, atol=tolerance)
    assert np.linalg.norm(one.coefficients - truth) > 10 * tolerance


def decode(jpeg: bytes) -> np.ndarray:
    """Return the red, green and blue codes of a backdrop, ``(height, width, 3)``."""
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[..., ::-1].astype(np.float64)


def light_of(codes: np.ndarray) -> np.ndarray:
    return ((1 + LOG_K * LOG_CAP) ** (codes / 255.0) - 1) / LOG_K


@pytest.mark.parametrize("peak", [0.001, 0.2, 1.0, 30.0, 511.0])
def test_log_jpeg_keeps_light_within_a_fraction_of_a_stop(peak: float) -> None:
    picture = np.full((16, 32, 3), peak, np.float32)
    light = light_of(decode(encode_log_jpeg(picture, 95)))
    assert np.abs(np.log2((light + 1 / LOG_K) / (peak + 1 / LOG_K))).max() < 0.06


def test_log_jpeg_clips_what_is_no_light_and_keeps_the_channels() -> None:
    picture = np.zeros((16, 32, 3), np.float32)
    picture[..., 0] = 1e9
    picture[..., 1] = -5.0
    red, green, blue = decode(encode_log_jpeg(picture, 100)).reshape(-1, 3).mean(axis=0)
    assert red > 250
    assert green < 5
    assert blue < 5


def test_turned_backdrop_shows_the_world() -> None:
    room = Room(lights=1, texture=0.0)
    latlong = make_mapping(MappingSettings(), 64, 128)
    directions, _ = latlong.directions(*latlong.pixel_centres())
    turned_by = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    in_camera = room.radiance(directions @ turned_by.T, 0.0).astype(np.float32)
    in_world = room.radiance(directions, 0.0).astype(np.float32)
    np.testing.assert_allclose(turn(in_camera, turned_by), in_world, atol=1e-3)


def test_backdrop_comes_at_its_own_rate_and_never_blocks() -> None:
    shown: list[Backdrop] = []
    came = threading.Event()

    def show(backdrop: Backdrop) -> None:
        shown.append(backdrop)
        came.set()

    stage = BackdropStage("s", "session", show)
    result = reduced(frame(), backdrop=BackdropSettings(fps=0.001, width=64), gain=2.0)
    for _ in range(100):
        stage.offer(result)
    assert came.wait(20)
    stage.offer(reduced(frame(), backdrop=BackdropSettings(enabled=False)))
    stage.close()
    assert len(shown) == 1
    assert (shown[0].width, shown[0].height, shown[0].seq) == (64, 32, 0)
    assert light_of(decode(shown[0].jpeg)).mean() == pytest.approx(2.0, rel=0.05)


def test_broken_backdrop_is_logged_and_stops_nothing() -> None:
    def show(backdrop: Backdrop) -> None:
        raise RuntimeError("broken")

    with structlog.testing.capture_logs() as logs:
        stage = BackdropStage("s", "session", show)
        stage.offer(reduced(frame(), backdrop=BackdropSettings(width=64)))
        stage.close()
    assert [entry["event"] for entry in logs] == ["no more backdrops"]


def test_averages_follow() -> None:
    averages = StageAverages()
    averages.add({"merge": 10.0})
    for _ in range(200):
        averages.add({"merge": 2.0, "project": 1.0})
    assert averages.snapshot() == {"merge": pytest.approx(2.0, abs=0.01), "project": 1.0}
