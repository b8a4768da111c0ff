"""Scene files: what they mean, and what is said about mistakes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lightwell.errors import LightwellError, RenderError
from lightwell.field.adaptive import AnyGrid
from lightwell.field.grid import Grid
from lightwell.field.spec import GridSpec
from lightwell.geometry.shapes import box, sphere
from lightwell.gradients.extrapolate import extrapolate
from lightwell.gradients.interpolate import SampleSet
from lightwell.io.exr import write_rgb
from lightwell.io.glb import encode_glb
from lightwell.io.grids import write_grid
from lightwell.io.scenes import (
    EV_MOST,
    LoadedScene,
    Probe,
    SceneLoader,
    load_scene,
    meter,
    read_scene_settings,
    read_transfer,
    scene_settings,
)
from lightwell.render import DistantLight, FieldLight, Harmonics, Light, ModulatedLight, Panorama, render
from lightwell.scene_settings import SceneLightSettings, SceneSettings
from lightwell.sh.engines import convert
from lightwell.sh.window import fixed_window

EXAMPLES = Path(__file__).parents[3] / "docs" / "scenes"
BASE: dict[str, Any] = {"camera": {"position": [0, -4, 1]}, "light": {"file": "light.json"}}


def coefficients(bands: int = 3) -> np.ndarray:
    values = np.random.default_rng(bands).normal(size=(bands**2, 3)) * 0.1
    values[0] = [3.0, 2.0, 1.0]
    return values


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    document = {"bands": 3, "convention": "lightwell", "coefficients": coefficients().tolist()}
    (tmp_path / "light.json").write_text(json.dumps(document))
    return tmp_path


def load(folder: Path, server: Any = None, **changes: Any) -> LoadedScene:
    return load_scene(scene_settings(BASE | changes, "s.toml"), folder, server, where="s.toml")


def field_grid(bands: int = 2) -> Grid:
    spec = GridSpec((-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), (2, 3, 4))
    values = np.random.default_rng(1).uniform(0.5, 1, (4, 3, 2, bands**2, 3)).astype(np.float32)
    return Grid(spec, values, np.ones((4, 3, 2), np.float32))


@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.toml")), ids=lambda path: path.stem)
def test_the_examples_render(path: Path) -> None:
    settings = read_scene_settings(path)
    if settings.method == "igi":  # test_igi_scenes.py renders them
        return
    few = settings.model_copy(update={"shadows": settings.shadows.model_copy(update={"directions": 64})})
    loaded = load_scene(few, path.parent, where=str(path))
    picture = render(loaded.scene, loaded.camera, (32, 18))
    assert np.isfinite(picture.colour).all()
    assert picture.colour.mean() > 0
    assert picture.coverage.max() == 1


def test_light_of_a_document_in_any_convention_or_of_the_last_line_of_watch(folder: Path) -> None:
    for convention in ("lightwell", "three", "unity"):
        rows = convert(coefficients(), convention).tolist()
        (folder / "light.json").write_text(json.dumps({"convention": convention, "coefficients": rows}))
        light = load(folder).scene.light
        assert isinstance(light, DistantLight)
        np.testing.assert_allclose(light.coefficients, coefficients(), atol=1e-12)
    lines = [json.dumps({"coefficients": (k * coefficients()).tolist()}) for k in (1, 2)]
    (folder / "light.json").write_text("\n".join(lines) + "\n")
    light = load(folder).scene.light
    assert isinstance(light, DistantLight)
    np.testing.assert_allclose(light.coefficients, 2 * coefficients())


def test_light_of_a_picture_is_its_projection_with_the_picture_behind(folder: Path) -> None:
    write_rgb(folder / "map.exr", np.full((8, 16, 3), [1.0, 2.0, 4.0], np.float32))
    loaded = load(folder, light={"file": "map.exr", "gain": 0.5})
    assert isinstance(loaded.scene.light, DistantLight)
    assert loaded.scene.light.bands == 5
    np.testing.assert_allclose(loaded.scene.light.coefficients[0], 0.5 * np.sqrt(4 * np.pi) * np.array([1, 2, 4]))
    assert isinstance(loaded.scene.backdrop, Panorama)
    np.testing.assert_allclose(loaded.scene.backdrop.radiance(np.array([[0.6, 0, 0.8]]))[0], [0.5, 1, 2])
    off = load(folder, light={"file": "map.exr"}, backdrop={"kind": "none"})
    assert off.scene.backdrop is None
    assert isinstance(load(folder, backdrop={"file": "map.exr"}).scene.backdrop, Panorama)


def test_bands_and_windows(folder: Path) -> None:
    assert load(folder, light={"file": "light.json", "bands": 2}).scene.light.bands == 2
    plain, windowed = (
        load(folder, light={"file": "light.json", "window": {"kind": kind}}).scene.light.at(np.zeros((1, 3)))
        for kind in ("none", "nonneg")
    )
    assert windowed[0] == pytest.approx(plain[0])
    assert np.abs(windowed[4:]).sum() < np.abs(plain[4:]).sum()
    assert isinstance(load(folder).scene.backdrop, Harmonics)


def test_light_of_a_grid_and_its_harmonics_at_the_camera(folder: Path) -> None:
    grid = field_grid()
    write_grid(folder / "grid.zarr", grid)
    changed: dict[str, Any] = {"light": {"grid": "grid.zarr", "gain": 2}, "camera": {"position": [0.4, -0.5, 0.1]}}
    loaded = load(folder, **changed, backdrop={"kind": "harmonics"})
    points = np.array([[0.4, -0.5, 0.1], [0.0, 0.2, 0.3]])
    expected = 2 * grid.sample(points).coefficients
    np.testing.assert_allclose(loaded.scene.light.at(points), expected, rtol=1e-6)
    assert isinstance(loaded.scene.backdrop, Harmonics)
    np.testing.assert_allclose(loaded.scene.backdrop.coefficients, expected[0], rtol=1e-6)
    assert load(folder, **changed).scene.backdrop is None
    light = load(folder, **(changed | {"light": {"grid": "grid.zarr", "window": {"kind": "hann"}}})).scene.light
    assert isinstance(light, FieldLight)
    np.testing.assert_allclose(light.at(points)[:, 1:], 0.5 * grid.sample(points).coefficients[:, 1:], rtol=1e-6)


def test_a_grid_follows_a_probe(folder: Path) -> None:
    write_grid(folder / "grid.zarr", field_grid())
    loaded = load(folder, light={"grid": "grid.zarr", "file": "light.json", "probe_at": [0.2, 0.1, 0.0]})
    assert isinstance(loaded.scene.light, ModulatedLight)
    np.testing.assert_allclose(loaded.scene.light.at(np.array([[0.2, 0.1, 0.0]]))[0], coefficients(), atol=1e-12)
    assert loaded.scene.backdrop is None


def test_several_grids_are_light_groups(folder: Path) -> None:
    one = field_grid()
    other = replace(one, coefficients=one.coefficients[..., ::-1].copy())
    write_grid(folder / "one.zarr", one)
    write_grid(folder / "other.zarr", other)
    points = np.array([[0.4, -0.5, 0.1], [0.0, 0.2, 0.3]])
    groups = {"grid": ["one.zarr", "other.zarr"]}
    values = [np.asarray(grid.sample(points).coefficients) for grid in (one, other)]
    np.testing.assert_allclose(load(folder, light=groups).scene.light.at(points), values[0] + values[1], rtol=1e-6)
    # One lamp is dimmed, the other is off.
    document = {"bands": 2, "convention": "lightwell", "coefficients": (0.4 * values[1][0]).tolist()}
    (folder / "now.json").write_text(json.dumps(document))
    followed = groups | {"file": "now.json", "probe_at": points[0].tolist()}
    light = load(folder, light=followed).scene.light
    assert isinstance(light, ModulatedLight)
    assert light.method == "groups"
    np.testing.assert_allclose(light.at(points), 0.4 * values[1], atol=1e-6)


def slopes(bands: int) -> np.ndarray:
    return 0.1 * np.random.default_rng(5).normal(size=(bands * bands, 3, 3))


class FakeServer:
    """A server with one stream, one grid and one transfer."""

    place: tuple[float, float, float] | None = None

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def stream(self, name: str) -> np.ndarray:
        assert name == "hall"
        return coefficients(4)

    def position(self, name: str) -> tuple[float, float, float] | None:
        assert name == "hall"
        return self.place

    def probe(self, name: str) -> Probe:
        gradients = None if name == "plain" else slopes(4)
        return Probe(name, coefficients(4), gradients, self.place)

    def field(self, name: str) -> list[Probe]:
        places = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)]
        names = ["hall", "plain" if name == "half" else "hall"]
        return [replace(self.probe(each), position=place) for each, place in zip(names, places, strict=True)]

    def grid(self, grid: str) -> AnyGrid:
        assert grid == "job.grid"
        return field_grid()

    def transfer(self, job: str) -> Path:
        assert job == "abc"
        return self.folder


def write_transfer(folder: Path, bands: int = 2) -> list[np.ndarray]:
    meshes = [box(albedo=(0.1, 0.2, 0.3)), sphere(4, 6)]
    values = [
        np.random.default_rng(0).uniform(size=(len(mesh.positions), bands**2)).astype(np.float32) for mesh in meshes
    ]
    entries = []
    for index, part in enumerate(values):
        part.astype("<f4").tofile(folder / f"mesh-{index}.f32.bin")
        entries.append({"name": meshes[index].name, "float32": f"mesh-{index}.f32.bin"})
    (folder / "scene.glb").write_bytes(encode_glb(meshes))
    document = {"version": 1, "bands": bands, "channels": 1, "meshes": entries, "glb": "scene.glb"}
    (folder / "transfer.json").write_text(json.dumps(document))
    return values


def test_light_beside_probes(folder: Path) -> None:
    server = FakeServer(folder)
    points = np.array([[0.3, 0.2, -0.1], [0.5, 0.1, 0.0], [0.2, -0.3, 0.4]])

    def light(**settings: Any) -> Light:
        return load(folder, server, light=settings).scene.light

    # Where the probe stands: as the file says, else as its frames say, else at the origin.
    for place, at in ((None, None), ((0.3, 0.2, -0.1), None), ((0.3, 0.2, -0.1), (0.1, 0.0, 0.0))):
        server.place = place
        more = {} if at is None else {"probe_at": list(at)}
        found = light(stream="hall", gradients=True, **more).at(points)
        wanted = extrapolate(coefficients(4), slopes(4), points - np.array(at or place or (0.0, 0.0, 0.0)))
        np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert isinstance(light(stream="hall", gradients=False), DistantLight)
    # Between two probes; where one has no gradients, by those of the other; where they are not wanted, straight.
    ends, each = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0)], [coefficients(4)] * 2
    np.testing.assert_allclose(light(field="stage").at(points), SampleSet(ends, each, [slopes(4)] * 2).at(points))
    np.testing.assert_allclose(light(field="half").at(points), SampleSet(ends, each, [slopes(4), None]).at(points))
    straight = light(field="stage", gradients=False).at(points)
    np.testing.assert_allclose(straight, SampleSet(ends, each).at(points))
    # Gradients are windowed and multiplied as the light is, and cut to the same bands.
    plain, hann = light(field="stage", bands=3), light(field="stage", bands=3, gain=2.0, window={"kind": "hann"})
    weights = 2 * fixed_window("hann", 3)
    assert hann.bands == 3
    np.testing.assert_allclose(
        hann.at(points)[:, 1:], (np.repeat(weights, [1, 3, 5])[:, None] * plain.at(points))[:, 1:], rtol=1e-9
    )
    refused: list[tuple[dict[str, Any], str]] = [
        ({"stream": "plain", "gradients": True}, "'plain' has none: give it a proxy"),
        ({"stream": "hall", "probe_at": [0, 0, 0]}, "probe_at needs a grid"),
        ({"field": "stage", "probe_at": [0, 0, 0]}, "probe_at needs a grid"),
        ({"grid": "job.grid", "stream": "hall", "gradients": True}, "without a grid"),
        ({"grid": "job.grid", "field": "stage"}, "field and grid"),
        ({"field": "stage", "stream": "hall"}, "stream and field"),
        ({"field": "stage", "window": {"kind": "auto"}}, "fixed window"),
    ]
    for settings, words in refused:
        with pytest.raises(RenderError, match=words):
            light(**settings)
    with pytest.raises(RenderError, match=r"light\.field: needs a server"):
        load(folder, light={"field": "stage"})


def test_what_comes_from_a_server(folder: Path) -> None:
    write_transfer(folder)
    server = FakeServer(folder)
    assert load(folder, server, light={"stream": "hall"}).scene.light.bands == 4
    assert load(folder, server, light={"stream": "hall", "bands": 3}).scene.light.bands == 3
    assert isinstance(load(folder, server, light={"grid": "job.grid"}).scene.light, FieldLight)
    assert len(load(folder, server, objects=[{"transfer": "abc"}]).scene.objects) == 2
    # The live light is exact where the probe stands: as the file says, else as the stream says, else in the middle.
    live: dict[str, Any] = {"grid": "job.grid", "stream": "hall"}
    for stands, light in (
        ((0.0, 0.0, 0.0), live),
        ((0.3, 0.2, -0.1), live),
        ((0.1, 0.1, 0.1), live | {"probe_at": [0.1, 0.1, 0.1]}),
    ):
        server.place = (0.3, 0.2, -0.1) if stands != (0.0, 0.0, 0.0) else None
        found = load(folder, server, light=light).scene.light.at(np.array([stands, (0.9, 0.9, 0.9)]))
        np.testing.assert_allclose(found[0], coefficients(4), atol=1e-12)
        assert np.abs(found[1] - coefficients(4)).max() > 1e-3
    without: dict[str, dict[str, Any]] = {
        "light.stream": {"light": {"stream": "hall"}},
        "light.grid": {"light": {"grid": "job.grid"}},
        "objects[0].transfer": {"objects": [{"transfer": "abc"}]},
    }
    for name, changes in without.items():
        with pytest.raises(RenderError, match=r"s\.toml: " + name.replace("[", r"\[") + ": needs a server"):
            load(folder, **changes)


def test_results_of_a_transfer_job_are_read_with_their_meshes(folder: Path) -> None:
    values = write_transfer(folder)
    found = read_transfer(folder)
    assert [mesh.name for mesh, _ in found] == ["box", "sphere"]
    np.testing.assert_allclose(found[0][0].positions, box().positions, atol=1e-6)
    np.testing.assert_allclose(found[0][0].albedo[0], [0.1, 0.2, 0.3], atol=1e-6)
    for (_, transfer), expected in zip(found, values, strict=True):
        np.testing.assert_array_equal(transfer[:, :, 0], expected)
    loaded = load(folder, objects=[{"transfer": str(folder), "position": [0, 0, 2], "scale": 0.5, "albedo": 0.5}])
    assert loaded.scene.objects[0].transfer is not None
    assert loaded.scene.objects[0].mesh.positions[:, 2].min() == pytest.approx(1.5)
    (folder / "mesh-1.f32.bin").write_bytes(b"1234")
    with pytest.raises(RenderError, match="has 1 numbers, not"):
        read_transfer(folder)
    (folder / "transfer.json").unlink()
    with pytest.raises(RenderError, match=r"holds no results of a prt-transfer job"):
        read_transfer(folder)


def test_objects_are_scaled_then_turned_then_moved(folder: Path) -> None:
    loaded = load(
        folder, objects=[{"shape": "box", "scale": 2, "turn_degrees": 90, "position": [10, 0, 0], "albedo": "#ff0000"}]
    )
    item = loaded.scene.objects[0]
    np.testing.assert_allclose(item.mesh.bounds[0], [8, -2, -2], atol=1e-5)
    front = item.mesh.normals[box().normals[:, 0] > 0.5]
    np.testing.assert_allclose(front, np.tile([0, 1, 0], (len(front), 1)), atol=1e-6)
    assert item.material.albedo == (1.0, 0.0, 0.0)


def test_a_mesh_file_may_hold_several_objects(folder: Path) -> None:
    (folder / "two.glb").write_bytes(encode_glb([box(), sphere(4, 6)]))
    assert len(load(folder, objects=[{"mesh": "two.glb", "gloss": 0.5}]).scene.objects) == 2


def test_shadows_darken_what_is_below(folder: Path) -> None:
    objects = [{"shape": "plane", "scale": 2}, {"shape": "box", "scale": 0.3, "position": [0, 0, 0.35]}]
    lit = load(folder, objects=objects)
    assert lit.scene.objects[0].transfer is None
    shadowed = load(folder, objects=objects, shadows={"mode": "shadowed", "directions": 128})
    assert [item.transfer.shape[1:] for item in shadowed.scene.objects if item.transfer is not None] == [(9, 1)] * 2
    bounced = load(folder, objects=objects, shadows={"mode": "interreflected", "directions": 128})
    camera = shadowed.camera
    plain, dark, between = (render(loaded.scene, camera, (16, 12)).colour.mean() for loaded in (lit, shadowed, bounced))
    assert dark < between < plain


def test_exposure_is_metered_from_the_light(folder: Path) -> None:
    loaded = load(folder)
    mean = np.array([3.0, 2.0, 1.0]) @ [0.2126, 0.7152, 0.0722] / np.sqrt(4 * np.pi)
    assert loaded.ev == pytest.approx(np.log2(0.3 / mean))
    assert load(folder, picture={"ev": -3}).ev == -3
    dark = load(folder, light={"file": "light.json", "gain": 0})
    assert (dark.ev, meter(dark.scene)) == (0, 0)
    assert load(folder, light={"file": "light.json", "gain": 1e-30}).ev == EV_MOST


def test_other_light_takes_the_place_of_the_files(folder: Path) -> None:
    settings = scene_settings(BASE | {"light": {"stream": "gone"}})
    loaded = load_scene(settings, folder, light=coefficients(2))
    assert loaded.scene.light.bands == 2


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"camera": {}}, "s.toml: camera.position is missing"),
        ({"camera": {"position": [0, 0]}}, r"s.toml: camera.position\[2\] is missing"),
        ({"camera": {"position": [0, 0, 0]}}, "position and target must differ"),
        ({"camera": {"position": [1, 0, 0], "up": [0, 0, 0]}}, "up must have a length"),
        ({"light": {}}, "s.toml: light = {}: give file, stream, field, grid, or .*, not none of them"),
        ({"light": {"file": "a.exr", "stream": "b"}}, "not file and stream"),
        ({"light": {"file": "a.exr", "probe_at": [0, 0, 0]}}, "probe_at needs a grid"),
        ({"light": {"grid": "b", "window": {"kind": "auto"}}}, "fixed window"),
        ({"light": {"file": "a", "bands": 12}}, "s.toml: light.bands = 12: input must be less|must be less"),
        ({"lamp": 1}, "s.toml: lamp is no option: check its spelling"),
        ({"objects": [{"shape": "box"}, {"gloss": 2, "shape": "box"}]}, r"s.toml: objects\[1\].gloss = 2: .*less"),
        ({"objects": [{"shape": "cone"}]}, r"objects\[0\].shape = 'cone'"),
        ({"objects": [{}]}, "give one of mesh, shape and transfer, not none of them"),
        ({"objects": [{"mesh": "a.glb", "shape": "box"}]}, "not mesh and shape"),
        ({"objects": [{"shape": "box", "albedo": "red"}]}, "must be #rrggbb"),
        ({"objects": [{"transfer": "x", "turn_degrees": 5}]}, "cannot turn shadows"),
        ({"picture": {"ev": "bright"}}, "picture.ev"),
        ({"picture": {"width": 16384, "height": 16384}}, "at most 67108864 pixels"),
        ({"objects": [{"shape": "box", "position": [1e300, 0, 0]}]}, r"position\[0\] = 1e\+300: .*less"),
        ({"objects": [{"shape": "box", "scale": 1e-9}]}, "scale = 1e-09"),
        ({"light": {"stream": ""}}, "light.stream = ''"),
        ({"light": {"grid": ["a"] * 5}}, "light.grid = .*at most 4 values"),
        ({"light": {"grid": []}}, "light.grid = .*at least 1 item"),
        ({"light": {"grid": ["a", ""]}}, r"light.grid\[1\] = ''"),
    ],
)
def test_mistakes_name_the_file_and_the_field(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(RenderError, match=message):
        scene_settings(BASE | changes, "s.toml")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"light": {"file": "none.exr"}}, "s.toml: light.file: .*none.exr: does not exist"),
        ({"light": {"file": "none.json"}}, "s.toml: light.file: .*none.json: does not exist"),
        (
            {"light": {"file": "bad.json"}},
            r"bad.json: line 1: holds no light .*write it with `lightwell project --json`",
        ),
        ({"light": {"file": "light.json", "bands": 4}}, "s.toml: light.bands = 4: this light has 3"),
        ({"light": {"grid": "./nothing"}}, "nothing: is no grid"),
        ({"light": {"file": "\0.exr"}}, "null character"),
        ({"light": {"file": "~nobody-here/a.exr"}}, "home directory"),
        ({"objects": [{"mesh": "\0"}]}, "null character"),
        ({"backdrop": {"kind": "picture"}}, "s.toml: backdrop.kind = 'picture': this light has no picture"),
        ({"backdrop": {"kind": "none", "file": "x.exr"}}, "backdrop.file: means nothing"),
        ({"objects": [{"mesh": "none.glb"}]}, r"s.toml: objects\[0\].mesh: .*none.glb"),
        ({"objects": [{"mesh": "bad.json"}]}, r"objects\[0\].mesh: bad.json: has the type .json"),
    ],
)
def test_what_cannot_be_read_is_named(folder: Path, changes: dict[str, Any], message: str) -> None:
    (folder / "bad.json").write_text('{"bands": 3}')
    with pytest.raises(LightwellError, match=message):
        load(folder, **changes)


def test_files_that_are_no_scenes(tmp_path: Path) -> None:
    file = tmp_path / "x.toml"
    with pytest.raises(RenderError, match="there is no such file"):
        read_scene_settings(file)
    file.write_text("[camera\n")
    with pytest.raises(RenderError, match=r"x.toml: is not valid TOML: .*line 1"):
        read_scene_settings(file)
    file.write_bytes(b"\xff\xfe")
    with pytest.raises(RenderError, match="cannot be read"):
        read_scene_settings(file)
    with pytest.raises(RenderError, match="cannot be read"):
        read_scene_settings(tmp_path)


def test_every_option_says_what_it_is() -> None:
    schema = SceneSettings.model_json_schema()
    models = [schema, *schema["$defs"].values()]
    for model in models:
        for name, field in model.get("properties", {}).items():
            assert "description" in field or "$ref" in field or "default" in field, name


def test_scenes_of_a_server_take_files_of_its_folders_only(folder: Path, tmp_path: Path) -> None:
    """What a scene file names, links followed, must lie below the roots."""
    outside = tmp_path / "elsewhere"
    outside.mkdir()
    write_rgb(outside / "sky.exr", np.ones((4, 8, 3), np.float32))
    inside = tmp_path / "scenes"
    (inside / "hall").mkdir(parents=True)
    (inside / "link.exr").symlink_to(outside / "sky.exr")
    (inside / "hall" / "0.exr").symlink_to(outside / "sky.exr")
    (inside / "sky.exr").write_bytes((outside / "sky.exr").read_bytes())
    loader = SceneLoader(inside, None, "s.toml", (inside.resolve(),))

    def light(file: str, **more: Any) -> Any:
        return loader.light(SceneLightSettings.model_validate({"file": file} | more))

    assert light("sky.exr")[1] is not None
    assert light("../scenes/sky.exr")[1] is not None
    for file in ("../elsewhere/sky.exr", str(outside / "sky.exr"), "link.exr", "~/sky.exr", "/etc/passwd", "hall"):
        with pytest.raises(LightwellError, match=r"s\.toml: light: .* lies outside the folders .*\[jobs\] data_roots"):
            light(file)
    assert SceneLoader(inside, None, "s.toml").path(Path("link.exr")) == inside / "link.exr"
