"""Reading meshes: places, axes, colours, several objects, and files beside."""

from __future__ import annotations

import importlib
import io
import json
import struct
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.support.shapes import sphere

from lightwell.geometry.mesh import make_mesh
from lightwell.io.glb import encode_glb
from lightwell.io.meshes import MeshError, load_meshes, read_meshes

trimesh: Any = importlib.import_module("trimesh")  # whose types say little
CORNERS = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def glb(scene: Any) -> bytes:
    data = scene.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def test_a_glb_keeps_what_was_written() -> None:
    random = np.random.default_rng(2)
    ball = sphere(8, 12, name="ball")
    painted = make_mesh("painted", random.normal(size=(9, 3)), [[0, 1, 2], [3, 4, 5]], albedo=random.random((9, 3)))
    found = read_meshes(encode_glb([ball, painted]), "two.glb")
    assert [mesh.name for mesh in found] == ["ball", "painted"]
    for before, after in zip([ball, painted], found, strict=True):
        np.testing.assert_allclose(after.positions, before.positions, atol=1e-6)
        np.testing.assert_array_equal(after.triangles, before.triangles)
        np.testing.assert_allclose(after.normals, before.normals, atol=1e-6)
        np.testing.assert_allclose(after.albedo, before.albedo, atol=1 / 255)


@pytest.mark.parametrize("bands", [1, 5, 7])
def test_a_glb_keeps_the_rules_of_gltf(bands: int) -> None:
    """Alignment, strides, bounds and lengths of glTF 2.0 §3.6 and §4.4; another reader finds the attributes."""
    meshes = [sphere(6, 8, name="ball"), make_mesh("пункт/😀", np.eye(3), [[0, 1, 2]])]
    lanes = [np.random.default_rng(1).random((len(mesh.positions), bands**2)).astype(np.float32) for mesh in meshes]
    data = encode_glb(meshes, lanes)
    magic, version, length, text = struct.unpack_from("<4sIII", data)
    binary, kind = struct.unpack_from("<I4s", data, 20 + text)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"BIN\0")
    document = json.loads(data[20 : 20 + text])
    assert (text % 4, binary % 4) == (0, 0)
    assert document["buffers"] == [{"byteLength": binary}]
    for accessor in document["accessors"]:
        view = document["bufferViews"][accessor["bufferView"]]
        assert (view["byteOffset"] % 4, accessor.get("byteOffset", 0) % 4) == (0, 0)
        assert view["byteOffset"] + view["byteLength"] <= binary
        shared = sum(one["bufferView"] == accessor["bufferView"] for one in document["accessors"]) > 1
        assert not shared or 4 <= view["byteStride"] <= 252
    found = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False).geometry
    assert list(found) == ["ball", "пункт/😀"]
    for one, expected in zip(found.values(), lanes, strict=True):
        together = np.concatenate([one.vertex_attributes[f"_PRT{slot}"] for slot in range(-(-(bands**2) // 4))], axis=1)
        np.testing.assert_array_equal(together[:, : bands**2], expected)
    with pytest.raises(ValueError, match="64 coefficients a vertex cannot be baked; 60 can"):
        encode_glb(meshes[1:], [np.zeros((3, 64), np.float32)])


def test_nodes_place_turn_mirror_and_repeat_objects() -> None:
    scene = trimesh.Scene()
    triangle = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False)
    scene.add_geometry(triangle, geom_name="t", node_name="here")
    move = trimesh.transformations.translation_matrix([0, 5, 0]) @ np.diag([-2, 2, 2, 1])
    scene.graph.update(frame_to="there", frame_from="here", matrix=move, geometry="t")
    first, second = read_meshes(glb(scene), "t.glb")
    assert (first.name, second.name) == ("t", "t 2")
    np.testing.assert_allclose(first.positions, [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(second.positions, [[0, 0, 5], [-2, 0, 5], [0, 0, 7]])
    np.testing.assert_allclose(first.normals[0], [0, -1, 0], atol=1e-6)
    # A mirrored triangle still looks to where it did.
    np.testing.assert_allclose(second.normals[0], [0, -1, 0], atol=1e-6)


@pytest.mark.parametrize("kind", ["ply", "obj"])
def test_up_turns_the_axes(kind: str) -> None:
    data = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False).export(file_type=kind)
    body = data.encode() if isinstance(data, str) else data
    np.testing.assert_allclose(read_meshes(body, f"t.{kind}")[0].positions[2], [0, 0, 1])
    np.testing.assert_allclose(read_meshes(body, f"t.{kind}", up="z")[0].positions[2], [0, 1, 0])


def test_colours_are_linear_in_gltf_and_srgb_elsewhere() -> None:
    grey = np.full((3, 4), [188, 188, 188, 255], np.uint8)  # half of linear white in sRGB
    triangle = trimesh.Trimesh(CORNERS, [[0, 1, 2]], vertex_colors=grey, process=False)
    assert read_meshes(glb(triangle.scene()), "t.glb")[0].albedo == pytest.approx(188 / 255, abs=1e-3)
    ply = triangle.export(file_type="ply")
    assert read_meshes(ply, "t.ply")[0].albedo == pytest.approx(0.503, abs=0.01)
    plain = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False)
    assert read_meshes(plain.export(file_type="ply"), "t.ply")[0].albedo == pytest.approx(0.8)


def test_materials_and_their_pictures() -> None:
    picture = Image.fromarray(np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [188, 188, 188]]], np.uint8))
    uv = np.array([[0.25, 0.75], [0.75, 0.75], [0.75, 0.25]])
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=picture, baseColorFactor=[1.0, 1.0, 0.5, 1.0])
    triangle = trimesh.Trimesh(
        CORNERS, [[0, 1, 2]], visual=trimesh.visual.TextureVisuals(uv=uv, material=material), process=False
    )
    found = read_meshes(glb(triangle.scene()), "t.glb")[0]
    np.testing.assert_allclose(found.albedo, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.5, 0.5, 0.25]], atol=0.01)


def test_an_obj_with_materials_takes_them_from_its_folder_only(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "t.mtl").write_text("newmtl red\nKd 0.8 0.1 0.1\n")
    (tmp_path / "out.mtl").write_text("newmtl red\nKd 0.1 0.8 0.1\n")
    text = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    (inner / "t.obj").write_text(text.format("t.mtl"))
    (inner / "out.obj").write_text(text.format("../out.mtl"))
    assert load_meshes(inner / "t.obj")[0].albedo[0] == pytest.approx([0.8, 0.1, 0.1], abs=0.01)
    assert load_meshes(inner / "out.obj")[0].albedo[0] == pytest.approx(0.8)
    assert read_meshes((inner / "t.obj").read_bytes(), "t.obj")[0].albedo[0] == pytest.approx(0.8)


def test_gltf_reads_its_buffers_from_its_folder_only(tmp_path: Path) -> None:
    files = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False).export(file_type="gltf")
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
    (found,) = load_meshes(tmp_path / "model.gltf")
    np.testing.assert_allclose(found.positions, [[0, 0, 0], [1, 0, 0], [0, 0, 1]])
    inner = tmp_path / "inner"
    inner.mkdir()
    text = (tmp_path / "model.gltf").read_text()
    (inner / "model.gltf").write_text(text.replace("gltf_buffer", "../gltf_buffer"))
    with pytest.raises(MeshError, match="lies outside its folder; put it beside"):
        load_meshes(inner / "model.gltf")
    (inner / "model.gltf").write_text(text)
    with pytest.raises(MeshError, match=r"missing or too large; put it beside"):
        load_meshes(inner / "model.gltf")


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\n"


def test_an_obj_without_its_materials_is_no_darker() -> None:
    """Pages send one file: the materials beside it are not there, the coordinates of their pictures are."""
    for text in ("f 1/1 2/1 3/1 4/1\n", "mtllib gone.mtl\nusemtl red\nf 1/1 2/1 3/1\n"):
        assert read_meshes((SQUARE + text).encode(), "t.obj")[0].albedo == pytest.approx(0.8)


def test_an_obj_keeps_its_objects_apart_and_in_order() -> None:
    text = SQUARE + "o tall one\nf 1/1 2/1 3/1\no b\nf -4/1 -2/1 -1/1\no a\nf 1/1 2/1 4/1\n"
    found = read_meshes(text.encode(), "t.obj")
    assert [(mesh.name, len(mesh.positions)) for mesh in found] == [("tall one", 3), ("b", 3), ("a", 3)]
    np.testing.assert_allclose(found[1].positions, [[0, 0, 0], [1, 0, 1], [0, 0, 1]])


def test_comments_need_not_be_utf8() -> None:
    obj = b"# cr\xe9\xe9 par 3ds Max\n" + SQUARE.encode() + b"o caf\xe9\nf 1/1 2/1 3/1\n"
    (found,) = read_meshes(obj, "t.obj")
    assert (found.name, len(found.triangles)) == ("caf\ufffd", 1)
    triangle = trimesh.Trimesh(CORNERS, [[0, 1, 2]], process=False).export(file_type="ply")
    assert isinstance(triangle, bytes)
    old = triangle.replace(b"element vertex", b"comment cr\xe9\xe9\nelement vertex")
    assert old != triangle
    np.testing.assert_allclose(read_meshes(old, "t.ply")[0].positions[2], [0, 0, 1])


def test_an_obj_with_too_many_objects_is_refused_at_once() -> None:
    text = SQUARE + "".join(f"usemtl m{number}\nf 1/1 2/1 3/1\n" for number in range(5000))
    with pytest.raises(MeshError, match=r"t\.obj: has more than 4096 objects and materials; join them"):
        read_meshes(text.encode(), "t.obj")


@pytest.mark.parametrize(("kind", "value"), [("uchar", 188), ("ushort", 48316), ("float", 0.7373)])
def test_a_ply_has_colours_of_any_width(kind: str, value: float) -> None:
    properties = "".join(f"property {kind} {channel}\n" for channel in ("red", "green", "blue"))
    head = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    faces = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    rows = "".join(f"{x} {y} 0 {value} {value} {value}\n" for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    (found,) = read_meshes((head + properties + faces + rows + "4 0 1 2 3\n").encode(), "wall.ply")
    assert (found.name, len(found.triangles)) == ("wall", 2)
    assert found.albedo == pytest.approx(0.503, abs=2e-3)


def test_mistakes_name_file_and_remedy(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"gone\.ply: cannot be read: No such file"):
        load_meshes(tmp_path / "gone.ply")
    with pytest.raises(
        MeshError, match=r"t\.stl: has the type \.stl; meshes are read from \.glb, \.gltf, \.ply, \.obj"
    ):
        read_meshes(b"solid", "t.stl")
    with pytest.raises(MeshError, match=r"shows 168 triangles; at most 100 are read: simplify it"):
        read_meshes(encode_glb([sphere(8, 12)]), "ball.glb", max_triangles=100)
    stream = io.BytesIO()
    trimesh.PointCloud(np.zeros((3, 3))).export(stream, file_type="ply")
    with pytest.raises(MeshError, match="holds no triangles"):
        read_meshes(stream.getvalue(), "points.ply")


def test_meshes_are_read_without_scipy(tmp_path: Path) -> None:
    """It is a tool of the tests; trimesh would use it."""
    path = tmp_path / "ball.glb"
    path.write_bytes(encode_glb([sphere()]))
    code = (
        "import sys; sys.modules['scipy'] = None\n"
        f"from lightwell.io.meshes import load_meshes; print(len(load_meshes({str(path)!r})[0].positions))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == str(len(sphere().positions))
