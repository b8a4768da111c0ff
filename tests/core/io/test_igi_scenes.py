"""Scene files for virtual point lights: what they mean, what comes out, and what is said about mistakes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
from tests.core.io.test_scenes import FakeServer, coefficients, field_grid
from tests.support.gltf_files import File

from lightwell.errors import LightwellError, RenderError
from lightwell.geometry.shapes import box, plane
from lightwell.igi import DirectionalLight, IgiRendering, PointLight, render_igi, sky_of_harmonics
from lightwell.igi.materials import phong_exponent
from lightwell.io.exr import read_rgb, write_rgb
from lightwell.io.glb import encode_glb
from lightwell.io.grids import write_grid
from lightwell.io.igi_renders import igi_layers, igi_png, write_igi_rendering
from lightwell.io.igi_scenes import LoadedIgiScene, load_igi_scene, meter
from lightwell.io.scenes import load_scene, read_scene_settings, scene_settings
from lightwell.probe.latlong import LatLong
from lightwell.probe.octahedral import Octahedral
from lightwell.probe.unwrap import resample

EXAMPLES = Path(__file__).parents[3] / "docs" / "scenes"
FEW = {"sets": "2x2", "vpls": 16, "bounces": 1}
BASE: dict[str, Any] = {"method": "igi", "camera": {"position": [0, -4, 1]}, "igi": FEW}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A room.glb: a floor of 2 m, a lamp above it that shines down, a camera."""
    file = File()
    square = [[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]
    attributes = {"POSITION": file.add(square), "NORMAL": file.add([[0, 1, 0]] * 4)}
    file.document["meshes"] = [
        {"name": "floor", "primitives": [{"attributes": attributes, "indices": file.add([0, 1, 2, 0, 2, 3], "<u2")}]}
    ]
    file.document["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point", "intensity": 9}]}}
    file.document["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}}]
    file.document["nodes"] += [
        {"translation": [0, 2, 0], "extensions": {"KHR_lights_punctual": {"light": 0}}},
        {"camera": 0, "name": "above", "translation": [0, 3, 0], "rotation": [-0.70710678, 0, 0, 0.70710678]},
    ]
    file.document["scenes"] = [{"nodes": [0, 1, 2]}]
    (tmp_path / "room.glb").write_bytes(file.glb())
    return tmp_path


def load(folder: Path, server: Any = None, **changes: Any) -> LoadedIgiScene:
    return load_igi_scene(scene_settings(BASE | changes, "s.toml"), folder, server, where="s.toml")


def shoot(loaded: LoadedIgiScene, size: tuple[int, int] = (16, 12)) -> IgiRendering:
    return render_igi(loaded.scene, loaded.camera, size, loaded.settings)


@pytest.mark.parametrize(
    "path",
    [path for path in sorted(EXAMPLES.glob("*.toml")) if "igi" in path.read_text("utf-8")],
    ids=lambda path: path.stem,
)
def test_the_examples_render(path: Path) -> None:
    loaded = load_igi_scene(read_scene_settings(path, {"igi": FEW}), path.parent, where=str(path))
    assert loaded.remarks == ()
    picture = shoot(loaded)
    assert np.isfinite(picture.colour).all()
    assert picture.colour.mean() > 0
    assert picture.coverage.max() == 1


def test_a_gltf_file_is_a_scene_with_its_lamps_and_camera(folder: Path) -> None:
    settings = read_scene_settings(folder / "room.glb", {"igi": FEW, "picture": {"width": 9, "height": 9}})
    loaded = load_igi_scene(settings, folder)
    (lamp,) = loaded.scene.lamps
    assert isinstance(lamp, PointLight)
    assert loaded.camera.position == pytest.approx((0, 0, 3))
    picture = shoot(loaded, (9, 9))
    # Straight below the lamp: intensity over distance², times albedo over π; the lobe of the rough paint is little.
    assert picture.colour[4, 4, 0] == pytest.approx(0.8 / np.pi * 9 / 4, rel=0.1)
    assert 2 ** meter(picture.colour) * np.exp(np.log(picture.colour[..., 0]).mean()) == pytest.approx(0.18, rel=1e-3)
    assert picture.depth is not None
    assert picture.depth[4, 4] == pytest.approx(3)


def test_without_a_camera_all_is_shown(folder: Path) -> None:
    (folder / "plain.glb").write_bytes(encode_glb([plane(1)]))
    shown = load(folder, scene="plain.glb", camera={})
    assert "plain.glb: has no camera: all of it is shown; [camera] of a scene file places one" in shown.remarks
    covered = shoot(shown, (40, 30)).coverage
    assert covered.mean() > 0.1
    assert not covered[[0, -1]].any()
    assert not covered[:, [0, -1]].any()


def test_cameras(folder: Path) -> None:
    assert load(folder, scene="room.glb").camera.position == pytest.approx((0, -4, 1))
    named = load(folder, scene="room.glb", camera={"name": "above"})
    assert named.camera.position == pytest.approx((0, 0, 3))
    for changes, message in (
        ({"scene": "room.glb", "camera": {"name": "below"}}, "s.toml: camera: room.glb: has no camera 'below'"),
        ({"camera": {}}, "s.toml: camera.position is missing"),
        ({"scene": "room.glb", "camera": {"fov_degrees": 50}}, "camera has fov_degrees but no position"),
        ({"scene": "room.glb", "camera": {"name": "a", "position": [1, 2, 3]}}, "give one of them"),
    ):
        with pytest.raises(RenderError, match=message):
            load(folder, **changes)


def test_objects_of_the_file_and_what_replaces_their_materials(folder: Path) -> None:
    (folder / "box.glb").write_bytes(encode_glb([box(albedo=(0.1, 0.2, 0.3))]))
    entries = [
        {"mesh": "box.glb", "position": [0, 0, 5]},
        {"mesh": "box.glb", "albedo": 0.5, "gloss": 0.25, "exponent": 20, "emission": [1, 2, 3], "up_axis": "z"},
        {"shape": "sphere", "two_sided": True, "mirror": 0.4},
    ]
    loaded = load(folder, scene="room.glb", objects=entries)
    own, other, ball = (item for item in loaded.scene.objects[1:])
    assert own.material.base is None, "the vertices have it"
    np.testing.assert_allclose(own.mesh.albedo[0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(own.mesh.bounds, [[-1, -1, 4], [1, 1, 6]])
    assert other.material.base == pytest.approx((0.5, 0.5, 0.5))
    assert other.material.specular == 0.25
    assert phong_exponent(other.material.roughness) == pytest.approx(20)
    assert other.material.emission == pytest.approx((1, 2, 3))
    assert (ball.material.two_sided, ball.material.specular) == (True, 0)
    assert loaded.remarks == ("s.toml: objects[2].mirror: is left out; a high gloss and exponent come near it",)


def test_light_of_a_picture_a_document_a_stream_a_grid_and_a_grid_that_follows(folder: Path) -> None:
    write_rgb(folder / "map.exr", np.full((8, 16, 3), [1.0, 2.0, 4.0], np.float32))
    sky = load(folder, light={"file": "map.exr", "gain": 0.5}).scene.sky
    assert sky is not None
    np.testing.assert_allclose(sky.pixels, np.broadcast_to([0.5, 1, 2], (8, 16, 3)))
    server = FakeServer(folder)
    up = np.array([[0.0, 0.0, 1.0]])
    streamed = load(folder, server, light={"stream": "hall", "bands": 1}).scene.sky
    assert streamed is not None
    np.testing.assert_allclose(streamed.radiance(up)[0], coefficients(4)[0] / np.sqrt(4 * np.pi), rtol=1e-5)
    (folder / "light.json").write_text(json.dumps({"coefficients": coefficients(2).tolist()}))
    assert load(folder, light={"file": "light.json"}).scene.sky is not None
    write_grid(folder / "grid.zarr", field_grid())
    scene = load(folder, light={"grid": "grid.zarr", "gain": 2}).scene
    assert scene.sky is None
    assert scene.field is not None
    place = np.zeros((1, 3))
    np.testing.assert_allclose(scene.field.at(place), 2 * field_grid().sample(place).coefficients, rtol=1e-6)
    follows = load(folder, light={"grid": "grid.zarr", "file": "light.json"}).scene
    assert follows.field is not None
    assert follows.sky is not None
    groups = load(folder, light={"grid": ["grid.zarr", "grid.zarr"], "gain": 3}).scene
    assert groups.field is not None
    np.testing.assert_allclose(groups.field.at(place), 6 * field_grid().sample(place).coefficients, rtol=1e-6)
    for one, other in zip(groups.field.box, scene.field.box, strict=True):
        np.testing.assert_array_equal(one, other)
    with pytest.raises(RenderError, match=r"name it as light\.file"):
        load(folder, light={"file": "map.exr"}, backdrop={"file": "map.exr"})


def test_light_among_probes_is_that_in_the_middle_of_the_objects(folder: Path) -> None:
    server, objects = FakeServer(folder), [{"shape": "box", "position": [0.5, 0, 0]}]
    scene = load(folder, server, light={"field": "stage"}, objects=objects).scene
    assert scene.sky is not None
    light = load_scene(scene_settings(BASE | {"method": "harmonics", "light": {"field": "stage"}}), folder, server)
    expected = sky_of_harmonics(light.scene.light.at(np.array([[0.5, 0.0, 0.0]]))[0])
    np.testing.assert_allclose(scene.sky.pixels, expected.pixels, rtol=1e-6)


def test_a_recorded_frame_of_another_mapping(folder: Path) -> None:
    latlong = np.zeros((64, 128, 3), np.float32) + np.linspace(2, 0, 64, dtype=np.float32)[:, None, None]
    write_rgb(folder / "frame.exr", resample(latlong, LatLong(64, 128), Octahedral(64, 64)))
    light = {"file": "frame.exr", "mapping": {"kind": "octahedral"}}
    loaded = load(folder, light=light)
    assert loaded.scene.sky is not None
    heights = np.array([[0, 0, 1.0], [0.6, 0, 0.8], [1, 0, 0], [0, 0.6, -0.8]])
    np.testing.assert_allclose(
        loaded.scene.sky.radiance(heights)[:, 0], 2 * (1 - np.arccos(heights[:, 2]) / np.pi), atol=0.04
    )
    with pytest.raises(RenderError, match=r"s\.toml: light\.mapping: .*frame\.exr: "):
        load(folder, light={"file": "frame.exr", "mapping": {"kind": "cube"}})


def test_lamps_of_the_scene_file(folder: Path) -> None:
    lamps = [
        {"kind": "point", "position": [0, 0, 2], "intensity": 3},
        {"kind": "spot", "position": [1, 0, 2], "direction": [0, 0, -1], "intensity": [1, 2, 3], "outer_degrees": 30},
        {"kind": "directional", "direction": [0, 1, -1], "intensity": 0.5},
    ]
    point, spot, sun = load(folder, lamps=lamps, objects=[{"shape": "plane"}]).scene.lamps
    assert point == PointLight((0, 0, 2), (3, 3, 3))
    assert spot == PointLight((1, 0, 2), (1, 2, 3), (0, 0, -1), 0.0, float(np.radians(30)))
    assert sun == DirectionalLight((0, -1, 1), (0.5, 0.5, 0.5))
    floor = [{"shape": "plane", "albedo": 0.8}]
    shown = shoot(load(folder, lamps=lamps[:1], objects=floor, camera={"position": [0, 0, 4]}), (9, 9))
    assert shown.colour[4, 4, 0] == pytest.approx(0.8 / np.pi * 3 / 4, rel=0.05)
    for lamp, message in (
        ({"kind": "point", "intensity": 1}, r"s\.toml: lamps\[0\] = .*: a point lamp needs a position"),
        (lamps[0] | {"direction": [0, 0, 1]}, "a point lamp has no direction: leave it out"),
        (lamps[0] | {"outer_degrees": 9}, "those of a spot"),
        (lamps[1] | {"inner_degrees": 40}, "inner_degrees must be less"),
        (lamps[2] | {"direction": [0, 0, 0]}, "direction must have a length"),
        (lamps[2] | {"intensity": -1}, r"intensity\[0\] = -1"),
    ):
        with pytest.raises(RenderError, match=message):
            load(folder, lamps=[lamp])
    with pytest.raises(RenderError, match="lamps needs method = 'igi'"):
        load(folder, lamps=lamps, method="harmonics", light={"file": "x.json"})


def test_bumps_of_the_scene_file(folder: Path) -> None:
    ramp = np.tile(np.linspace(0, 65535, 32).astype(np.uint16), (32, 1))
    cv2.imwrite(str(folder / "ramp.png"), ramp)
    write_rgb(folder / "ramp.exr", np.repeat((ramp / np.float32(65535))[:, :, None], 3, axis=2))
    (folder / "bad.png").write_bytes(b"no picture")
    mesh = {"mesh": str(folder / "floor.glb"), "bump_metres": 0.2}
    file = File()
    attributes = {
        "POSITION": file.add([[-1, 0, 1], [1, 0, 1], [1, 0, -1], [-1, 0, -1]]),
        "TEXCOORD_0": file.add([[0, 1], [1, 1], [1, 0], [0, 0]]),
    }
    file.document["meshes"] = [
        {"name": "floor", "primitives": [{"attributes": attributes, "indices": file.add([0, 1, 2, 0, 2, 3], "<u2")}]}
    ]
    (folder / "floor.glb").write_bytes(file.glb())
    for name in ("ramp.png", "ramp.exr"):
        picture = shoot(load(folder, objects=[mesh | {"bump": name}], camera={"position": [0, 0, 4]}), (9, 9))
        assert picture.normal is not None
        # 0.2 m higher from the first to the last centre of 32 texels, over 2 m along x.
        slope = 0.1 * 32 / 31
        np.testing.assert_allclose(picture.normal[4, 4], np.array([-slope, 0, 1]) / np.hypot(slope, 1), atol=1e-4)
    for bump, message in (
        ("bad.png", r"s\.toml: objects\[0\]\.bump: bad\.png: is no picture"),
        ("none.png", "none.png: does not exist"),
    ):
        with pytest.raises(RenderError, match=message):
            load(folder, objects=[mesh | {"bump": bump}])
    with pytest.raises(RenderError, match="object 'box' has no texture coordinates"):
        load(folder, objects=[{"shape": "box", "bump": "ramp.png"}])
    with pytest.raises(RenderError, match=r"objects\.bump needs method = 'igi'"):
        load(folder, objects=[{"shape": "box", "bump": "x.png"}], method="harmonics", light={"file": "x.json"})


def test_no_light_is_a_black_picture_and_is_said(folder: Path) -> None:
    loaded = load(folder, objects=[{"shape": "sphere"}])
    assert loaded.remarks == (
        "s.toml: there is no light: no [light], no lamp shines and nothing emits; the picture is black: give light.file"
        " or light.stream (--light, --stream)",
    )
    black = {"coefficients": [[0.0, 0.0, 0.0]]}
    (folder / "black.json").write_text(json.dumps(black))
    assert "what [light] names is black" in load(folder, light={"file": "black.json"}).remarks[0]
    picture = shoot(loaded)
    assert picture.coverage.max() == 1
    assert not picture.colour.any()
    assert picture.normal is not None
    assert picture.normal.any()
    assert meter(picture.colour) == 0
    write_rgb(folder / "black.exr", np.zeros((4, 8, 3), np.float32))
    assert "there is no light" in load(folder, light={"file": "black.exr"}, objects=[{"shape": "box"}]).remarks[0]
    # Nothing at all to be seen is no mistake either.
    assert not shoot(load(folder, light={"file": "black.exr"})).coverage.any()


def test_a_camera_inside_a_wall(folder: Path) -> None:
    objects = [{"shape": "box", "position": [0, -4, 1]}]
    with pytest.raises(RenderError, match=r"the camera stands inside object 'box', at \(0, -4, 1\): move it out"):
        shoot(load(folder, scene="room.glb", objects=objects))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": "none.glb"}, "s.toml: scene: .*none.glb: cannot be read: No such file"),
        ({"scene": "broken.glb"}, r"s.toml: scene: broken\.glb: is no GLB file"),
        ({"scene": "s.ply"}, r"s.toml: scene: s\.ply: has the type \.ply; scenes are read from"),
        ({"objects": [{"mesh": "none.glb"}]}, r"s.toml: objects\[0\].mesh: .*none.glb"),
        ({"objects": [{"transfer": "x"}]}, "s.toml: objects with transfer need method = 'harmonics'"),
        ({"objects": [{"shape": "box", "emission": -1}]}, "emission"),
        ({"igi": {"sets": "17x1"}}, r"igi.sets\[0\] = 17"),
        ({"igi": {"sets": "many"}}, "igi.sets = 'many': must be written like 4x4"),
        ({"method": "photons"}, "method = 'photons'"),
    ],
)
def test_mistakes(folder: Path, changes: dict[str, Any], message: str) -> None:
    (folder / "broken.glb").write_bytes(b"nothing of the kind, but long enough")
    (folder / "s.ply").write_bytes(b"ply")
    with pytest.raises(LightwellError, match=message):
        load(folder, **changes)


def test_what_needs_igi_says_so(folder: Path) -> None:
    light = {"light": {"file": "light.json"}, "camera": {"position": [0, -4, 1]}}
    for changes, message in (
        ({"scene": "room.glb"}, "s.toml: scene needs method = 'igi'"),
        ({"scene": "room.glb", "camera": {"name": "above"}}, "needs method = 'igi'"),
        ({"objects": [{"shape": "box", "emission": 1}]}, "objects.emission needs method = 'igi'"),
    ):
        with pytest.raises(RenderError, match=message):
            scene_settings(light | changes, "s.toml")
    with pytest.raises(RenderError, match="method = 'igi': this renders by harmonics: call render_igi"):
        load_scene(scene_settings(BASE), folder)


def test_files_hold_all_layers(folder: Path) -> None:
    layers = ["normal", "depth", "albedo", "direct", "indirect", "set", "coefficients"]
    loaded = load(folder, scene="room.glb", igi=FEW | {"layers": layers})
    picture = shoot(loaded)
    write_igi_rendering(folder / "x.exr", picture, backdrop=loaded.has_backdrop)
    assert not [path for path in folder.iterdir() if "partial" in path.name]
    np.testing.assert_array_equal(read_rgb(folder / "x.exr").pixels, picture.colour)
    channels = OpenEXR.File(str(folder / "x.exr"), separate_channels=True).channels()
    names = {f"{name}.{c}" for name in ("albedo", "direct", "indirect", *(f"sh.{k}" for k in range(9))) for c in "RGB"}
    assert set(channels) == names | {*"RGBAZ", "coverage", "set", "normal.X", "normal.Y", "normal.Z"}
    assert picture.coefficients is not None
    np.testing.assert_array_equal(channels["sh.6.G"].pixels, picture.coefficients[:, :, 6, 1])
    np.testing.assert_allclose(
        channels["direct.B"].pixels + channels["indirect.B"].pixels, picture.colour[..., 2], atol=1e-6
    )
    np.testing.assert_array_equal(channels["A"].pixels, picture.coverage)
    read = cv2.imdecode(np.frombuffer(igi_png(picture, backdrop=False), np.uint8), cv2.IMREAD_UNCHANGED)
    assert read is not None
    np.testing.assert_array_equal(read[..., 3], 255 * picture.coverage)
    with pytest.raises(RenderError, match=r"as \.exr or \.png, not as \.jpg"):
        write_igi_rendering(folder / "x.jpg", picture)


def test_pictures_without_backdrop_go_over_any_other(folder: Path) -> None:
    """Over the grey of the sky they are the picture with it; exposure goes by what is shown."""
    grey = 0.25
    harmonics = np.zeros((1, 3))
    harmonics[0] = grey * np.sqrt(4 * np.pi)
    document = BASE | {"objects": [{"shape": "sphere", "albedo": 0.1}], "igi": FEW, "backdrop": {"kind": "none"}}
    loaded = load_igi_scene(scene_settings(document, "s.toml"), folder, light=harmonics)
    assert not loaded.has_backdrop
    picture = render_igi(loaded.scene, loaded.camera, (24, 16), loaded.settings, samples=3)
    opaque, clear = igi_layers(picture), igi_layers(picture, backdrop=False)
    left = 1 - clear["A"]
    assert {0, 1} < set(np.unique(left))
    for channel in "RGB":
        np.testing.assert_allclose(clear[channel] + left * grey, opaque[channel], atol=1e-6)
        for layers in (opaque, clear):
            together = layers[f"direct.{channel}"] + layers[f"indirect.{channel}"]
            np.testing.assert_allclose(together, layers[channel], atol=1e-6)
    assert meter(picture.shown(loaded.has_backdrop)) > meter(picture.colour) + 1
