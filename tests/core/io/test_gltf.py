"""Reading glTF: what programs really write (quantised, sparse, strips, skins, transformed pictures), and what lies."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.support.gltf_files import File

from lightwell.io.meshes import MeshError, load_meshes, read_meshes

CORNERS: list[list[float]] = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]
WORLD: list[list[float]] = [[0, 0, 0], [1, 0, 0], [0, 0, 1]]


def triangle(**document: Any) -> File:
    file = File(**document)
    return file.mesh({"attributes": {"POSITION": file.add(CORNERS)}})


@pytest.mark.parametrize(("dtype", "most"), [("i1", 127), ("u1", 255), ("<i2", 32767), ("<u2", 65535)])
@pytest.mark.parametrize("normalized", [True, False])
def test_quantised_vertices(dtype: str, most: int, normalized: bool) -> None:
    """As gltfpack and glTF-Transform write them: integers that a node's scale makes metres."""
    file = File(extensionsRequired=["KHR_mesh_quantization"])
    rows = np.round(np.array(CORNERS) * (most if normalized else 100))
    attributes = {"POSITION": file.add(rows, dtype, stride=8, normalized=normalized)}
    if dtype[-2:] in ("i1", "i2"):
        attributes["NORMAL"] = file.add(np.tile([0, 0, most], (3, 1)), dtype, stride=8, normalized=True)
    scale = 2.0 if normalized else 0.02
    file.document["nodes"][0] |= {"scale": [scale] * 3, "translation": [0, 0, 1]}
    found = file.mesh({"attributes": attributes}).read()
    np.testing.assert_allclose(found.positions, np.array(WORLD) * 2 + [0, -1, 0], atol=1e-6)
    np.testing.assert_allclose(found.normals, np.tile([0, -1, 0], (3, 1)), atol=1e-6)


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessors(based: bool) -> None:
    file = File()
    index = file.add(np.full((3, 3), 7.0) * 0)
    if not based:
        del file.document["accessors"][index]["bufferView"]
    file.document["accessors"][index]["sparse"] = {
        "count": 2,
        "indices": {"bufferView": file.view(np.array([1, 2], "u1").tobytes()), "componentType": 5121},
        "values": {"bufferView": file.view(np.array(CORNERS[1:], "<f4").tobytes())},
    }
    file.mesh({"attributes": {"POSITION": index}})
    np.testing.assert_allclose(file.read().positions, WORLD)
    file.document["accessors"][index]["sparse"]["indices"]["componentType"] = 5123  # reads 0x0201
    with pytest.raises(MeshError, match=r"t\.glb: accessor 0 reaches to byte 4 of a view of 2"):
        file.read()
    file.document["accessors"][index]["sparse"]["count"] = 9
    with pytest.raises(MeshError, match=r"accessor 0 has 9 sparse items of 3; export it again"):
        file.read()


@pytest.mark.parametrize("dtype", ["u1", "<u2", "<u4", None])
@pytest.mark.parametrize(
    ("mode", "corners", "expected"),
    [
        (4, [0, 1, 2, 2, 1, 3], [[0, 1, 2], [2, 1, 3]]),
        (5, [0, 1, 2, 3], [[0, 1, 2], [1, 3, 2]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_lists_strips_and_fans(dtype: str | None, mode: int, corners: list[int], expected: list[list[int]]) -> None:
    file = File()
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]])
    primitive: dict[str, Any] = {"mode": mode, "attributes": {"POSITION": file.add(points)}}
    if dtype is not None:
        primitive["indices"] = file.add(corners, dtype)
    elif mode == 4:
        primitive["attributes"]["POSITION"] = file.add(points[corners])
        expected = [[0, 1, 2], [3, 4, 5]]
    np.testing.assert_array_equal(file.mesh(primitive).read().triangles, expected)


@pytest.mark.parametrize("mode", [0, 1, 2, 3])
def test_points_and_lines_are_left_out(mode: int) -> None:
    file = File()
    primitive = {"mode": mode, "attributes": {"POSITION": file.add(CORNERS)}}
    with pytest.raises(MeshError, match="holds no triangles; export it as a triangle mesh"):
        file.mesh(primitive).read()
    file.document["meshes"][0]["primitives"].append({"attributes": {"POSITION": 0}})
    assert len(file.read().triangles) == 1


@pytest.mark.parametrize(("dtype", "most"), [("u1", 255), ("<u2", 65535), ("<f4", 1)])
@pytest.mark.parametrize("alpha", [True, False])
@pytest.mark.parametrize("painted", [True, False])
def test_colours_are_exact_and_linear(dtype: str, most: int, alpha: bool, painted: bool) -> None:
    file = File(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [0.001, 0.5, 1, 0.2]}}])
    colours = np.tile([0.2, 0.4, 0.6, 0.0][: 3 + alpha], (3, 1)) * most
    attributes = {"POSITION": file.add(CORNERS), "COLOR_0": file.add(colours, dtype, stride=16, normalized=most > 1)}
    primitive: dict[str, Any] = {"attributes": attributes}
    expected = np.array([0.2, 0.4, 0.6])
    if painted:
        primitive["material"] = 0
        expected = expected * [0.001, 0.5, 1]
    np.testing.assert_allclose(file.mesh(primitive).read().albedo[0], expected, rtol=1e-4 if most > 255 else 1e-6)


@pytest.mark.parametrize("where", ["view", "data", "webp"])
def test_pictures_by_another_set_of_coordinates_and_turned(where: str) -> None:
    """Four texels, one of which each corner takes by way of KHR_texture_transform."""
    texels = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]], np.uint8).repeat(8, 0).repeat(8, 1)
    stream = io.BytesIO()
    Image.fromarray(texels).save(stream, "WEBP" if where == "webp" else "PNG", lossless=True)
    file = File()
    uv = np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75]])
    # The transform puts u' = v, v' = 1 − u: a quarter turn about the origin and a move by one.
    turn = {"rotation": np.pi / 2, "offset": [0, 1], "texCoord": 1}
    file.document["materials"] = [
        {"pbrMetallicRoughness": {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": turn}}}}
    ]
    image = (
        {"uri": "data:image/png;base64," + base64.b64encode(stream.getvalue()).decode()}
        if where == "data"
        else {"bufferView": file.view(stream.getvalue())}
    )
    file.document["images"] = [image]
    file.document["textures"] = [
        {"extensions": {"EXT_texture_webp": {"source": 0}}} if where == "webp" else {"source": 0}
    ]
    attributes = {"POSITION": file.add(CORNERS), "TEXCOORD_0": file.add(uv * 0), "TEXCOORD_1": file.add(uv)}
    found = file.mesh({"attributes": attributes, "material": 0}).read()
    # (.25, .25) → (.25, .75): blue; (.75, .25) → (.25, .25): red; (.25, .75) → (.75, .75): white.
    np.testing.assert_allclose(found.albedo, [[0, 0, 1], [1, 0, 0], [1, 1, 1]], atol=1e-6)


def test_a_picture_is_decoded_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """However many objects wear it: an atlas is large."""
    stream = io.BytesIO()
    Image.new("RGB", (4, 4), (255, 0, 0)).save(stream, "PNG")
    file = File(textures=[{"source": 0}], materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}])
    file.document["images"] = [{"bufferView": file.view(stream.getvalue())}]
    attributes = {"POSITION": file.add(CORNERS), "TEXCOORD_0": file.add([[0, 0], [1, 0], [0, 1]])}
    file.mesh({"attributes": attributes, "material": 0})
    file.document["nodes"] = [{"mesh": 0} for _ in range(50)]
    file.document["scenes"] = [{"nodes": list(range(50))}]
    opened: list[Any] = []
    real = Image.open

    def open_and_count(body: Any) -> Image.Image:
        opened.append(body)
        return real(body)

    monkeypatch.setattr(Image, "open", open_and_count)
    found = read_meshes(file.glb(), "t.glb")
    assert (len(found), len(opened)) == (50, 1)
    np.testing.assert_array_equal(found[49].albedo, np.tile([1, 0, 0], (3, 1)))


def test_a_skin_is_where_its_joints_are() -> None:
    """The node of the mesh does not count; half of one joint and half of another is the mean of both."""
    file = File()
    file.document["nodes"] = [
        {"mesh": 0, "skin": 0, "translation": [100, 0, 0], "children": [1]},
        {"translation": [-100, 2, 0], "children": [2]},
        {"translation": [0, 2, 0], "rotation": [0, 0, 1, 0]},
    ]
    inverse = np.tile(np.eye(4).T.reshape(-1), (2, 1))
    file.document["skins"] = [{"joints": [1, 2], "inverseBindMatrices": file.add(inverse)}]
    attributes = {
        "POSITION": file.add(CORNERS),
        "NORMAL": file.add(np.tile([0, 0, 1.0], (3, 1))),
        "JOINTS_0": file.add([[0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], "u1"),
        "WEIGHTS_0": file.add(np.array([[1, 0, 0, 0], [1, 0, 0, 0], [0.5, 0.5, 0, 0]]) * 255, "u1", normalized=True),
    }
    found = file.mesh({"attributes": attributes}).read()
    # Joint 1 moves by (0, 2); joint 2 turns half round about z and moves by (0, 4).
    np.testing.assert_allclose(found.positions, [[0, 0, 2], [-1, 0, 4], [0, 0, 3]], atol=0.01)
    np.testing.assert_allclose(found.normals, np.tile([0, -1, 0], (3, 1)), atol=1e-6)
    file.binary = file.binary.replace(bytes([1, 0, 0, 0, 0, 1]), bytes([9, 0, 0, 0, 0, 1]))
    with pytest.raises(MeshError, match="names joint 9 of 2; export it again"):
        file.read()


def test_morph_targets_at_rest() -> None:
    file = File()
    target = {"POSITION": file.add(np.array(CORNERS) * 2)}
    primitive = {"attributes": {"POSITION": file.add(CORNERS)}, "targets": [target]}
    np.testing.assert_allclose(file.mesh(primitive).read().positions, WORLD)
    np.testing.assert_allclose(file.mesh(primitive, weights=[0.5]).read().positions, np.array(WORLD) * 2)


def test_only_the_scene_that_is_shown_is_read() -> None:
    file = triangle(
        scene=1, scenes=[{"nodes": [0]}, {"nodes": [1, 1]}], nodes=[{"mesh": 0}, {"mesh": 0, "scale": [2, 2, 2]}]
    )
    with pytest.raises(MeshError, match="have two parents or lie in a circle"):
        file.read()
    file.document["scenes"][1]["nodes"] = [1]
    np.testing.assert_allclose(file.read().positions, np.array(WORLD) * 2)
    del file.document["scenes"], file.document["scene"]
    assert len(read_meshes(file.glb(), "t.glb")) == 2


def remove_buffer(file: File) -> None:
    file.document["buffers"] = [{"byteLength": 36, "uri": "http://localhost/model.bin"}]


def out_of_the_folder(file: File) -> None:
    file.document["buffers"] = [{"byteLength": 36, "uri": "%2e%2e/%2e%2e/etc/passwd"}]


def not_base64(file: File) -> None:
    file.document["buffers"] = [{"byteLength": 36, "uri": "data:application/octet-stream;base64,A"}]


def short_buffer(file: File) -> None:
    file.binary = file.binary[:-4]


def circle(file: File) -> None:
    file.document["scenes"] = [{"nodes": [0]}]
    file.document["nodes"] = [{"mesh": 0, "children": [1]}, {"children": [0]}]


def many_vertices(file: File) -> None:
    """Three corners a mesh, and millions of vertices, without a byte of data."""
    index = file.add([0, 1, 2], "u1")
    file.document["accessors"].append({"componentType": 5126, "count": 10_000_000, "type": "VEC3"})
    file.mesh({"attributes": {"POSITION": index + 1}, "indices": index})
    file.document["nodes"] = [{"mesh": 0} for _ in range(1000)]
    file.document["scenes"] = [{"nodes": list(range(1000))}]


def many_objects(file: File) -> None:
    file.document["nodes"] = [{"mesh": 0} for _ in range(5000)]
    file.document["scenes"] = [{"nodes": list(range(5000))}]


def wrong_type(file: File) -> None:
    file.document["accessors"][0] |= {"type": "VEC2"}


def unknown_extension(file: File) -> None:
    file.document["extensionsRequired"] = ["EXT_tomorrow"]


def draco(file: File) -> None:
    file.document["extensionsRequired"] = ["KHR_draco_mesh_compression"]


def text_as_number(file: File) -> None:
    file.document["nodes"][0]["scale"] = "large"


def not_finite(file: File) -> None:
    file.document["nodes"][0]["translation"] = [1e300, 0, 0]


@pytest.mark.parametrize(
    ("harm", "words"),
    [
        (remove_buffer, r"names 'http://localhost/model\.bin', which is not read; export it as one GLB"),
        (out_of_the_folder, r"needs the file '\.\./\.\./etc/passwd' beside it"),
        (not_base64, "not base64"),
        (short_buffer, "cut short"),
        (circle, "in a circle"),
        (many_vertices, r"shows 10000000000 vertices; at most 15000000"),
        (many_objects, "has 5000 objects; at most 4096 are read: join them"),
        (wrong_type, "accessor 0 has 2 components where 3 are due"),
        (unknown_extension, "requires the extension 'EXT_tomorrow'"),
        (draco, "uses Draco compression"),
        (text_as_number, "cannot be read"),
        (not_finite, "3 of 3 vertices are not finite"),
    ],
)
def test_lies_are_told(harm: Callable[[File], None], words: str) -> None:
    file = triangle()
    harm(file)
    with pytest.raises(MeshError, match=words) as refused:
        file.read()
    assert str(refused.value).startswith("t.glb: ")


def test_files_beside_may_have_spaces_in_their_names(tmp_path: Path) -> None:
    file = triangle()
    file.document["buffers"] = [{"byteLength": 36, "uri": "my%20parts/a b.bin"}]
    (tmp_path / "my parts").mkdir()
    (tmp_path / "my parts" / "a b.bin").write_bytes(file.binary)
    (tmp_path / "t.gltf").write_text(json.dumps(file.document))
    np.testing.assert_allclose(load_meshes(tmp_path / "t.gltf")[0].positions, WORLD)


def test_random_damage_ends_in_a_refusal_or_a_mesh() -> None:
    data = bytearray(triangle().glb())
    random = np.random.default_rng(4)
    for _ in range(300):
        harmed = bytearray(data)
        for _ in range(random.integers(1, 4)):
            harmed[random.integers(len(harmed))] = random.integers(256)
        try:
            read_meshes(bytes(harmed), "t.glb", max_triangles=1000)
        except MeshError as refused:
            assert str(refused).startswith("t.glb: ")  # noqa: PT017
