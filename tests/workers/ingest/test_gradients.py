"""The stage gradients: every mapping against exact scenes, every proxy, mistakes, and probes that move."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import structlog
from pydantic import ValidationError
from tests.workers.ingest.test_pipeline import ListSink, ListSource

from lightwell.errors import FrameError, LightwellError, ProxyError
from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.gradients.proxy import BoxProxy
from lightwell.gradients.sphere import sphere_gradients
from lightwell.io.exr import write_rgb
from lightwell.io.glb import encode_glb
from lightwell.io.meshes import MeshError
from lightwell.io.uploads import RECORD
from lightwell.probe.factory import make_mapping
from lightwell.settings import MappingSettings, StreamSettings
from lightwell.sh.rotation import rotate_gradients
from lightwell.synthetic.room import Room
from lightwell.wire import unpack_coefficients, unpack_gradients
from lightwell_workers.ingest.frame import Frame
from lightwell_workers.ingest.pipeline import Pipeline
from lightwell_workers.ingest.sources import open_source
from lightwell_workers.ingest.stages.finish import Finisher
from lightwell_workers.ingest.stages.reduce import reduce_frame

ROOM = Room(lights=0)
LOWER, UPPER = ((float(x), float(y), float(z)) for x, y, z in ROOM.bounds())
BOX = {"proxy": "box", "box_lower_m": LOWER, "box_upper_m": UPPER}
AT = (0.3, -0.2, 0.4)
NO_FILTER = {"kind": "none"}


def exact_gradients(at: tuple[float, float, float] = AT, bands: int = 5, step: float = 1e-4) -> np.ndarray:
    """Return central differences of the room's exact coefficients, ``(bands², 3, 3)``."""
    sides = []
    for axis in np.eye(3):
        ahead, behind = (tuple(np.add(at, sign * step * axis).tolist()) for sign in (1, -1))
        sides.append((ROOM.coefficients(bands, 0.0, ahead) - ROOM.coefficients(bands, 0.0, behind)) / (2 * step))
    return np.stack(sides, axis=-1)


EXACT = exact_gradients()


def settings(**changes: Any) -> StreamSettings:
    return StreamSettings.model_validate({"source": "synthetic:room", "gradients": BOX, **changes})


def frames(query: str = "", mapping: MappingSettings | None = None, scene: str = "room") -> list[Frame]:
    lights = "&lights=0" if scene == "room" else ""
    at = "" if "at=" in query else f"&at={AT[0]},{AT[1]},{AT[2]}"
    with open_source(f"synthetic:{scene}?realtime=0{lights}{at}&{query}", mapping) as source:
        return [item for item in source if isinstance(item, Frame)]


def error(gradients: np.ndarray, exact: np.ndarray = EXACT) -> float:
    return float(np.linalg.norm(gradients - exact) / np.linalg.norm(exact))


@pytest.mark.parametrize(
    ("mapping", "width"),
    [
        (MappingSettings(), 256),
        (MappingSettings(kind="octahedral"), 256),
        (MappingSettings(kind="mirror-ball"), 200),
        (MappingSettings(kind="angular"), 200),
        (MappingSettings(kind="mirror-sphere", sphere_radius_m=0.05, sphere_distance_m=1.25, fov_degrees=4.8), 200),
    ],
    ids=lambda value: value.kind if isinstance(value, MappingSettings) else "",
)
def test_every_mapping_finds_the_exact_gradients_also_while_the_camera_turns(
    mapping: MappingSettings, width: int
) -> None:
    still, turned = frames(f"frames=2&fps=3&spin=0.4&width={width}", mapping)
    assert turned.world_from_camera is not None
    reduced = reduce_frame(turned, settings(mapping=mapping))
    assert reduced.slope is not None
    assert error(rotate_gradients(reduced.slope.gradients, turned.world_from_camera)) < 0.03
    assert error(reduced.slope.gradients) > 0.3
    message = Finisher("s", "x").finish(reduced)
    assert message.gradients is not None
    assert error(unpack_gradients(message.gradients)) < 0.03
    assert message.position == pytest.approx(AT)
    assert message.trust_radius_m == pytest.approx(0.17 * 2.25, rel=0.05)
    assert list(message.quality.stage_ms)[4:6] == ["project", "gradients"]
    assert still.position_m is not None


def test_the_picture_of_a_whole_frame_is_made_smaller_first() -> None:
    (one,) = frames("frames=1&width=640")
    reduced = reduce_frame(one, settings(resolution=0))
    assert reduced.slope is not None
    assert error(reduced.slope.gradients) < 0.03


def test_gain_and_window_scale_gradients_as_they_do_coefficients() -> None:
    (one,) = frames("frames=1")
    plain = reduce_frame(one, settings()).slope
    changed = settings(gain=2.5, window={"kind": "hann"}, filter=NO_FILTER)
    message = Finisher("s", "x").finish(reduce_frame(one, changed))
    assert plain is not None
    assert message.gradients is not None
    degrees = np.floor(np.sqrt(np.arange(25))).astype(int)
    weights = np.array(message.window.weights)[degrees]
    assert weights[-1] < 0.2
    expected = 2.5 * plain.gradients * weights[:, None, None]
    np.testing.assert_allclose(unpack_gradients(message.gradients), expected, rtol=1e-5, atol=1e-6)


def test_a_sphere_that_goes_with_the_probe_needs_no_picture() -> None:
    (one,) = frames("frames=1")
    sphere = settings(gradients={"proxy": "sphere", "radius_m": 2.0}, gain=0.5)
    reduced = reduce_frame(one, sphere)
    more = reduce_frame(one, settings(bands=6, gain=0.5))
    assert reduced.slope is not None
    np.testing.assert_allclose(reduced.coefficients, more.coefficients[:25], rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(reduced.slope.gradients, sphere_gradients(more.coefficients, 2.0), atol=1e-6)
    assert reduced.slope.trust_radius_m == pytest.approx(0.34)
    # A sphere whose centre is said to be where the probe is gives the same, from the picture.
    fixed = settings(gradients={"proxy": "sphere", "radius_m": 2.0, "centre_m": AT}, gain=0.5)
    slope = reduce_frame(one, fixed).slope
    assert slope is not None
    assert error(slope.gradients, reduced.slope.gradients) < 0.02


def room_mesh() -> Mesh:
    """Return the room's six walls."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    triangles = [[f[0], f[a], f[a + 1]] for f in faces for a in (1, 2)]
    return make_mesh("room", np.array(LOWER) + corners * (np.array(UPPER) - np.array(LOWER)), triangles)


def test_a_mesh_of_the_room_is_as_good_as_its_box(tmp_path: Path) -> None:
    file = tmp_path / "room.glb"
    file.write_bytes(encode_glb([room_mesh()]))
    (one,) = frames("frames=1")
    box = reduce_frame(one, settings()).slope
    mesh = reduce_frame(one, settings(gradients={"proxy": "mesh", "mesh": str(file)})).slope
    assert box is not None
    assert mesh is not None
    assert error(mesh.gradients, box.gradients) < 0.03  # pixels that straddle an edge of a mesh go to its near side

    upload = "0123456789abcdef0123"
    by_id = settings(gradients={"proxy": "mesh", "mesh": upload})
    with pytest.raises(ProxyError, match=f"gradients.mesh = '{upload}': there is no such upload"):
        reduce_frame(one, by_id)
    folder = tmp_path / "uploads" / upload
    folder.mkdir(parents=True)
    file.rename(folder / "file.glb")
    record = {
        "id": upload,
        "kind": "mesh",
        "name": "room.glb",
        "file": "file.glb",
        "bytes": 1,
        "sha256": "",
        "created": 0,
    }
    (folder / RECORD).write_text(json.dumps(record | {"contents": {}}))
    uploaded = reduce_frame(one, by_id, tmp_path / "uploads").slope
    assert uploaded is not None
    np.testing.assert_array_equal(uploaded.gradients, mesh.gradients)
    with pytest.raises(MeshError, match=r"nothing\.glb"):
        reduce_frame(one, settings(gradients={"proxy": "mesh", "mesh": str(tmp_path / "nothing.glb")}))


def test_depth_beside_the_frames(tmp_path: Path) -> None:
    frames_seen = frames("frames=2")
    latlong = make_mapping(MappingSettings(), 128, 256)
    directions, _ = latlong.directions(*latlong.pixel_centres())
    metres = BoxProxy(LOWER, UPPER).distances(AT, directions).astype(np.float32)

    def write(name: str, depth: np.ndarray) -> None:
        write_rgb(tmp_path / name, np.repeat(depth[..., None], 3, axis=-1))

    write("all.exr", metres)
    write("room 0.exr", metres)
    write("small.exr", metres[::2, ::2])
    box = reduce_frame(frames_seen[0], settings()).slope
    assert box is not None
    for pattern in ("all.exr", "{stem}.exr"):
        wanted = settings(gradients={"proxy": "depth", "depth": str(tmp_path / pattern)})
        slope = reduce_frame(frames_seen[0], wanted).slope
        assert slope is not None
        assert error(slope.gradients, box.gradients) < 0.03
    missing = reduce_frame(frames_seen[1], wanted)  # its own file is not there: the light goes on
    assert missing.slope is None
    assert missing.no_slope == "gradients.depth: room 1.exr: does not exist"
    with pytest.raises(ProxyError, match=r"small\.exr is 128×64, but the frames are 256×128"):
        reduce_frame(frames_seen[0], settings(gradients={"proxy": "depth", "depth": str(tmp_path / "small.exr")}))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"gradients": {"proxy": "sphere"}}, "proxy = 'sphere' needs radius_m"),
        ({"gradients": {"proxy": "box"}}, "proxy = 'box' needs box_lower_m and box_upper_m"),
        ({"gradients": {"proxy": "mesh", "mesh": ""}}, "proxy = 'mesh' needs mesh"),
        ({"gradients": {"proxy": "depth"}}, "proxy = 'depth' needs depth"),
        ({"gradients": BOX | {"box_upper_m": (3, -9, 3)}}, r"box_lower_m has y = -2.8, which must be below .* -9"),
        ({"position_m": (0, 0, 5)}, r"the box spans z = -1.4 … 1.8, but the probe stands at z = 5"),
        (
            {"position_m": (3, 0, 0), "gradients": {"proxy": "sphere", "radius_m": 2, "centre_m": (0, 0, 0)}},
            "the sphere's radius is 2 m; the probe is 3 m from its centre",
        ),
    ],
)
def test_measures_that_do_not_fit_are_refused(changes: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValidationError, match=reason):
        settings(**changes)


def test_a_proxy_in_the_world_needs_the_probes_place() -> None:
    (one,) = frames("frames=1")
    lost = dataclasses.replace(one, position_m=None)
    with pytest.raises(ProxyError, match=r"'box' needs the probe's place: set position_m"):
        reduce_frame(lost, settings())
    told = reduce_frame(lost, settings(position_m=AT))
    assert told.slope is not None
    assert error(told.slope.gradients) < 0.03
    assert Finisher("s", "x").finish(told).position == AT


def test_a_place_that_is_corrected_is_no_movement() -> None:
    one, two = (dataclasses.replace(frame, position_m=None) for frame in frames("frames=2"))
    finisher = Finisher("s", "x")
    slow = {"kind": "tau", "tau_seconds": 10.0}
    finisher.finish(reduce_frame(one, settings(position_m=AT, filter=slow)))
    corrected = reduce_frame(two, settings(position_m=(0.35, -0.2, 0.4), filter=slow))
    message = finisher.finish(corrected)
    assert message.quality.cut
    np.testing.assert_allclose(unpack_coefficients(message.coefficients), corrected.coefficients, rtol=1e-5, atol=1e-6)


def test_a_probe_that_leaves_its_box_keeps_its_light() -> None:
    inside, outside = frames("frames=2&fps=1&at=0,0,0&to=1,0,0&travel=1")
    small = settings(gradients={"proxy": "box", "box_lower_m": (-0.5,) * 3, "box_upper_m": (0.5,) * 3})
    sink = ListSink()
    pipeline = Pipeline(ListSource([inside, outside]), small, "s", "x", sink)
    with structlog.testing.capture_logs() as logs:
        pipeline.run()
    assert [message.gradients is None for message in sink.frames] == [False, True]
    assert sink.frames[1].position == pytest.approx((1, 0, 0))
    assert "no gradients: the probe at (1, 0, 0) m is not inside" in pipeline.counters.last_error
    assert [entry["frame"] for entry in logs if entry["event"] == "no gradients"] == ["room 1"]


def test_settings_change_while_the_stream_runs(tmp_path: Path) -> None:
    off = settings(gradients={"proxy": "none"})
    pipeline = Pipeline(ListSource([*frames("frames=2")]), off, "s", "x", ListSink())
    pipeline.run()
    with pytest.raises(LightwellError, match=r"nothing\.glb"):
        pipeline.configure(settings(gradients={"proxy": "mesh", "mesh": str(tmp_path / "nothing.glb")}))
    assert pipeline.settings.gradients.proxy == "none"
    pipeline.configure(settings())
    assert pipeline.settings == settings()


def test_a_probe_that_sees_half_says_so() -> None:
    """Its gradients are those of that half; how far they hold for all of the light is not known."""
    fisheye = MappingSettings(kind="fisheye", fov_degrees=180)
    sink = ListSink()
    wanted = settings(mapping=fisheye, filter=NO_FILTER)
    pipeline = Pipeline(ListSource([*frames("frames=2&width=128", fisheye)]), wanted, "s", "x", sink)
    with structlog.testing.capture_logs() as logs:
        pipeline.run()
    assert [(message.gradients is None, message.trust_radius_m) for message in sink.frames] == [(False, None)] * 2
    assert "it does not see 50% of the sphere (fisheye)" in pipeline.counters.last_error
    assert [entry["blind_fraction"] for entry in logs if entry["event"] == "much is not seen"] == [pytest.approx(0.5)]


@pytest.mark.parametrize(("degrees", "most"), [(350, 0.04), (320, 0.2), (180, 1.05)])
def test_gradients_are_wrong_by_what_is_not_seen(degrees: int, most: float) -> None:
    """A fisheye that looks away from the lamps (docs/gradients.md)."""
    fisheye = MappingSettings(kind="fisheye", fov_degrees=degrees)
    (one,) = frames("frames=1&width=256", fisheye)
    slope = reduce_frame(one, settings(mapping=fisheye)).slope
    assert slope is not None
    assert most / 2.5 < error(slope.gradients) < most


def test_gradients_that_no_message_can_hold_are_refused() -> None:
    (one,) = frames("frames=1")
    reduced = reduce_frame(one, settings())
    assert reduced.slope is not None
    for value in (np.nan, np.inf, 1e31):
        bad = dataclasses.replace(reduced.slope, gradients=np.full((25, 3, 3), value))
        with pytest.raises(FrameError, match="damaged"):
            Finisher("s", "x").finish(dataclasses.replace(reduced, slope=bad))


@pytest.mark.parametrize("kind", ["tau", "alpha", "one-euro", "kalman"])
def test_the_light_of_a_moving_probe_does_not_lag(kind: str) -> None:
    """Half a metre a second through a standing room, towards its bright ceiling: what lags is what is not predicted.

    The camera turns on its way: gradients are in its axes, the way is in the world's.
    """
    options: dict[str, dict[str, float]] = {
        "tau": {"tau_seconds": 0.3},
        "alpha": {"alpha": 9.0},
        "one-euro": {"min_cutoff_hz": 0.3, "beta": 0.0},
        "kalman": {"process_noise": 1e-3, "measurement_noise": 0.02},
    }
    smooth = {"kind": kind, **options[kind]}
    moving = frames("frames=24&fps=12&at=0.2,0.1,-0.4&to=0.4,-0.1,1.0&travel=2&width=96&spin=0.25")
    lag = {}
    for proxy in ("box", "none"):
        finisher = Finisher("s", "x")
        wanted = settings(filter=smooth, gradients=BOX if proxy == "box" else {"proxy": "none"})
        errors = []
        for one in moving:
            message = finisher.finish(reduce_frame(one, wanted))
            assert one.truth is not None
            assert message.quality.cut == (one is moving[0])
            errors.append(error(unpack_coefficients(message.coefficients), one.truth[:25]))
        lag[proxy] = math.sqrt(float(np.mean(np.square(errors))))
    assert lag["box"] < 0.15 * lag["none"], lag
