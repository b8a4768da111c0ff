"""Scenes from glTF: materials, textures, lamps and cameras of files that were put together by hand."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from tests.support.gltf_files import File

from lightwell.igi import DirectionalLight, IgiScene, PointLight
from lightwell.igi.surfaces import Surfaces
from lightwell.io.gltf_scene import GltfScene, load_gltf_scene, read_gltf_scene
from lightwell.io.meshes import MeshError

SQUARE = [[0, 0, 0], [1, 0, 0], [1, 0, -1], [0, 0, -1]]
"""A floor, +Y up in the file; (x, y) in the world's axes are (x, −z)."""
UV = [[0, 1], [1, 1], [1, 0], [0, 0]]
TRIANGLES = [0, 1, 2, 0, 2, 3]
QUARTER = [0, 0.70710678, 0, 0.70710678]
"""A quarter turn about the file's +Y, the world's +Z."""


def png(pixels: Any) -> bytes:
    body = io.BytesIO()
    Image.fromarray(np.asarray(pixels, np.uint8)).save(body, "PNG")
    return body.getvalue()


def floor(material: dict[str, Any] | None = None, pictures: tuple[Any, ...] = (), **attributes: Any) -> File:
    """A square with texture coordinates and textures by number."""
    file = File()
    found = {"POSITION": file.add(SQUARE), "TEXCOORD_0": file.add(UV)} | {
        name: file.add(rows) for name, rows in attributes.items()
    }
    primitive: dict[str, Any] = {"attributes": found, "indices": file.add(TRIANGLES, "<u2")}
    if material is not None:
        primitive["material"] = 0
        file.document["materials"] = [material]
    if pictures:
        file.document["images"] = [
            {"bufferView": file.view(png(one)), "mimeType": "image/png"} if not isinstance(one, dict) else one
            for one in pictures
        ]
        file.document["textures"] = [{"source": number} for number in range(len(pictures))]
    return file.mesh(primitive, name="floor")


def read(file: File) -> GltfScene:
    return read_gltf_scene(file.glb(), "t.glb")


def at(scene: GltfScene, x: float, y: float) -> Any:
    """What is seen from above at a place of the floor."""
    surfaces = Surfaces(IgiScene(scene.objects))
    eye, down = np.array([[x, y, 1]], np.float32), np.array([[0, 0, -1]], np.float32)
    hits = surfaces.rays.intersect(eye, down)
    assert hits.triangle[0] >= 0
    return surfaces.at(hits.triangle, hits.barycentric, down)


def test_metallic_roughness_with_textures() -> None:
    base = [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [188, 188, 188]]]
    both = np.full((1, 1, 3), [0, 128, 51], np.uint8)
    material = {
        "pbrMetallicRoughness": {
            "baseColorFactor": [0.5, 0.5, 0.5, 1],
            "baseColorTexture": {"index": 0},
            "metallicRoughnessTexture": {"index": 1},
            "roughnessFactor": 0.9,
        },
        "emissiveFactor": [0.1, 0.2, 0.4],
        "extensions": {"KHR_materials_emissive_strength": {"emissiveStrength": 10}},
        "doubleSided": True,
    }
    file = floor(material, (base, both), COLOR_0=[[1, 0.8, 0.6]] * 4)
    scene = read(file)
    (item,) = scene.objects
    assert (item.mesh.name, item.material.two_sided) == ("floor", True)
    assert item.material.emission == pytest.approx((1, 2, 4))
    # v runs down: the picture's first row is at the floor's far edge.
    for (x, y), colour in {(0.25, 0.75): (1, 0, 0), (0.75, 0.75): (0, 1, 0), (0.25, 0.25): (0, 0, 1)}.items():
        point = at(scene, x, y)
        expected = 0.5 * np.array([1, 0.8, 0.6]) * colour
        np.testing.assert_allclose(point.kd[0], expected * 0.8 * 0.96, atol=1e-5)  # a fifth is metal
        np.testing.assert_allclose(point.ks[0], 0.04 * 0.8 + 0.2 * expected, atol=1e-5)
    grey = at(scene, 0.75, 0.25).kd[0] / (0.5 * np.array([1, 0.8, 0.6]) * 0.8 * 0.96)
    np.testing.assert_allclose(grey, ((188 / 255 + 0.055) / 1.055) ** 2.4, rtol=1e-5)
    alpha = (0.9 * 128 / 255) ** 2
    np.testing.assert_allclose(at(scene, 0.5, 0.5).exponent, (1 / alpha**2 - 1) / 2, rtol=1e-4)
    np.testing.assert_allclose(at(scene, 0.5, 0.5).geometric[0], [0, 0, 1])


def test_defaults_are_those_of_the_format() -> None:
    plain, metal = read(floor()).objects[0], read(floor({})).objects[0]
    assert plain.material.metallic == 0
    np.testing.assert_allclose(plain.mesh.albedo, 0.8)
    assert (metal.material.metallic, metal.material.roughness, metal.material.emits) == (1, 1, False)
    np.testing.assert_allclose(metal.mesh.albedo, 1)
    glass = read(
        floor({"pbrMetallicRoughness": {"metallicFactor": 0}, "extensions": {"KHR_materials_ior": {"ior": 2}}})
    )
    assert glass.objects[0].material.specular == pytest.approx(1 / 9)


def test_samplers_and_transforms() -> None:
    picture = [[[255, 255, 255], [0, 0, 0]]]
    material: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "metallicFactor": 0,
            "baseColorTexture": {
                "index": 0,
                "extensions": {"KHR_texture_transform": {"scale": [2, 1], "rotation": np.pi / 2, "offset": [0, 0.5]}},
            },
        },
        "emissiveFactor": [1, 1, 1],
        "emissiveTexture": {"index": 1, "texCoord": 1},
    }
    file = floor(material, (picture, picture), TEXCOORD_1=np.array(UV) * 3 - 1)
    file.document["samplers"] = [{"wrapS": 33648, "wrapT": 33071}]
    file.document["textures"][1]["sampler"] = 0
    (item,) = read(file).objects
    base, emission = item.material.base_texture, item.material.emission_texture
    assert base is not None
    assert emission is not None
    assert (base.wrap, base.uv_set) == (("repeat", "repeat"), 0)
    assert (emission.wrap, emission.uv_set, len(item.uv)) == (("mirror", "clamp"), 1, 2)
    # As the specification's shader has it: translation · rotation · scale.
    c, s = np.cos(np.pi / 2), np.sin(np.pi / 2)
    matrix = np.array([[1, 0, 0], [0, 1, 0.5]]) @ [[c, s, 0], [-s, c, 0], [0, 0, 1]] @ np.diag([2, 1, 1])
    assert base.transform is not None
    np.testing.assert_allclose(base.transform, matrix, atol=1e-12)
    # (u, v) = (−1 … 2): mirrored, then as it is, then mirrored.
    light = [float(at(read(file), x, 0.5).emission[0, 0]) for x in (1 / 12, 3 / 12, 5 / 12, 7 / 12, 9 / 12, 11 / 12)]
    np.testing.assert_allclose(light, [0, 1, 1, 0, 0, 1], atol=1e-4)


def test_normal_maps_lean_along_tangents_also_in_mirror_images() -> None:
    leaning = np.full((1, 1, 3), [218, 128, 218], np.uint8)  # 45° along +u
    material = {"normalTexture": {"index": 0, "scale": 1.0}}
    tangent = [[1, 0, 0, 1]] * 4  # along u, which is the file's +x; v runs towards the viewer
    for extra in ({}, {"TANGENT": tangent}):
        file = floor(material, (leaning,), **extra)
        np.testing.assert_allclose(at(read(file), 0.5, 0.5).shading[0], [0.707, 0, 0.707], atol=6e-3)
        file.document["nodes"][0] |= {"rotation": QUARTER}
        np.testing.assert_allclose(at(read(file), -0.5, 0.5).shading[0], [0, 0.707, 0.707], atol=6e-3)
    up = np.full((1, 1, 3), [128, 218, 218], np.uint8)  # 45° along the picture's upwards
    for extra in ({}, {"TANGENT": tangent}):
        file = floor(material, (up,), **extra)
        np.testing.assert_allclose(at(read(file), 0.5, 0.5).shading[0], [0, 0.707, 0.707], atol=6e-3)
        file.document["nodes"][0] |= {"scale": [-1, 1, 1]}
        np.testing.assert_allclose(at(read(file), -0.5, 0.5).shading[0], [0, 0.707, 0.707], atol=6e-3)
    # Coordinates that are a mirror image: u runs against +x, what is up stays up.
    backwards = {"TEXCOORD_0": [[1, 1], [0, 1], [0, 0], [1, 0]]}
    for extra in (backwards, backwards | {"TANGENT": [[-1, 0, 0, -1]] * 4}):
        for picture, normal in ((leaning, [-0.707, 0, 0.707]), (up, [0, 0.707, 0.707])):
            found = at(read(floor(material, (picture,), **extra)), 0.5, 0.5)
            np.testing.assert_allclose(found.shading[0], normal, atol=6e-3)


def test_instances_share_a_material_and_stand_where_their_nodes_put_them() -> None:
    file = floor({"name": "paint"})
    file.document["nodes"] = [{"mesh": 0}, {"mesh": 0, "translation": [0, 2, 0], "scale": [2, 1, 2]}]
    file.document["scenes"] = [{"nodes": [0, 1]}]
    one, other = read(file).objects
    assert one.material is other.material
    assert (one.mesh.name, other.mesh.name) == ("floor", "floor 2")
    np.testing.assert_allclose(other.mesh.positions, [[0, 0, 2], [2, 0, 2], [2, 2, 2], [0, 2, 2]], atol=1e-6)


def lit(*lights: dict[str, Any], nodes: list[dict[str, Any]] | None = None) -> File:
    file = floor()
    file.document["extensions"] = {"KHR_lights_punctual": {"lights": list(lights)}}
    for number in range(len(lights)):
        more = {} if nodes is None else nodes[number]
        file.document["nodes"].append({"extensions": {"KHR_lights_punctual": {"light": number}}} | more)
        file.document["scenes"][0]["nodes"].append(number + 1)
    return file


def test_lamps() -> None:
    down = [-0.70710678, 0, 0, 0.70710678]
    file = lit(
        {"type": "point", "intensity": 5, "color": [1, 0.5, 0.2], "range": 3},
        {"type": "spot", "spot": {"innerConeAngle": 0.2, "outerConeAngle": 1.5707964}},
        {"type": "directional", "intensity": 2},
        {"type": "spot", "spot": {"innerConeAngle": 0.3, "outerConeAngle": 0.3}},
        nodes=[{"translation": [1, 2, 3], "scale": [9, 9, 9]}, {"rotation": down}, {"rotation": QUARTER}, {}],
    )
    point, spot, sun, sharp = read(file).lamps
    assert isinstance(sharp, PointLight)
    assert 0.299 < sharp.inner_angle < sharp.outer_angle == 0.3
    assert isinstance(point, PointLight)
    assert (point.position, point.direction) == ((1, -3, 2), None)
    assert point.intensity == pytest.approx((5, 2.5, 1))
    assert isinstance(spot, PointLight)
    assert spot.direction == pytest.approx((0, 0, -1), abs=1e-6)
    assert (spot.inner_angle, spot.outer_angle, spot.intensity) == (0.2, np.pi / 2, (1, 1, 1))
    assert isinstance(sun, DirectionalLight)
    # −Z turned by a quarter about +Y is −X in the file: the light comes from +X.
    assert sun.towards == pytest.approx((1, 0, 0), abs=1e-6)
    assert sun.irradiance == (2, 2, 2)


def test_cameras_by_name() -> None:
    file = floor()
    file.document["cameras"] = [
        {"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}},
        {"type": "orthographic", "orthographic": {"xmag": 1, "ymag": 1, "znear": 0.1, "zfar": 9}},
    ]
    file.document["nodes"] += [
        {"camera": 0, "name": "door", "translation": [0, 1, 5]},
        {"camera": 1, "name": "plan"},
        {"camera": 0, "name": "side", "rotation": QUARTER},
    ]
    file.document["scenes"][0]["nodes"] += [1, 2, 3]
    scene = read(file)
    camera = scene.camera("door")
    assert scene.first_camera == camera
    assert camera.position == pytest.approx((0, -5, 1))
    assert camera.target == pytest.approx((0, -4, 1))
    assert camera.up == pytest.approx((0, 0, 1))
    assert camera.fov_degrees == pytest.approx(np.degrees(1))
    file.document["nodes"][1]["camera"] = 1
    assert read(file).first_camera == scene.camera("side")
    assert scene.camera("side").target == pytest.approx((-1, 0, 0), abs=1e-6)
    with pytest.raises(MeshError, match=r"t\.glb: camera 'plan' has no perspective; name another"):
        scene.camera("plan")
    with pytest.raises(MeshError, match=r"has no camera 'roof'; it has 'door', 'plan', 'side'"):
        scene.camera("roof")
    assert read(floor()).first_camera is None
    with pytest.raises(MeshError, match=r"t\.glb: has no camera 'door'; it has none"):
        read(floor()).camera("door")


def test_files_beside_are_read_and_missing_ones_are_named(tmp_path: Path) -> None:
    file = floor({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, ({"uri": "pictures/my%20wood.png"},))
    (tmp_path / "scene.glb").write_bytes(file.glb())
    message = r"scene\.glb: names the file 'pictures/my wood\.png', which is missing or too large; put it beside"
    with pytest.raises(MeshError, match=message):
        load_gltf_scene(tmp_path / "scene.glb")
    (tmp_path / "pictures").mkdir()
    place = tmp_path / "pictures" / "my wood.png"
    place.write_bytes(b"\xabKTX 20\xbb")
    with pytest.raises(
        MeshError, match=r"material 0 has a picture of a type that is not read .KTX2..; export it with PNG"
    ):
        load_gltf_scene(tmp_path / "scene.glb")
    place.write_bytes(png(np.zeros((2, 2, 3))))
    assert load_gltf_scene(tmp_path / "scene.glb").objects[0].material.base_texture is not None
    place.write_bytes(png(np.zeros((64, 64, 3)))[:60])
    with pytest.raises(MeshError, match=r"scene\.glb: "):
        load_gltf_scene(tmp_path / "scene.glb")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d["materials"].clear(), "cannot be read .IndexError"),
        (lambda d: d["materials"][0].update(pbrMetallicRoughness={"roughnessFactor": 3}), "roughnessFactor 3, which"),
        (lambda d: d["materials"][0].update(emissiveFactor=[-1, 0, 0]), "emission = .*must be finite and not neg"),
        (
            lambda d: d["meshes"][0]["primitives"][0]["attributes"].pop("TEXCOORD_0"),
            "object 'floor' has a texture but no texture coordinates 0; unwrap it",
        ),
        (lambda d: d["textures"][0].update(sampler=0), "cannot be read .*export it again"),
        (lambda d: d["extensions"]["KHR_lights_punctual"]["lights"][0].update(type="laser"), "lamp 0 has the type"),
        (
            lambda d: d["extensions"]["KHR_lights_punctual"]["lights"][0].update(
                type="spot", spot={"innerConeAngle": 1, "outerConeAngle": 0.5}
            ),
            "lamp 0: the spot's angles 1 and 0.5 must rise",
        ),
        (lambda d: d["nodes"][1].update(scale=[1, 1, 0]), "points nowhere"),
        (lambda d: d.update(extensionsRequired=["KHR_draco_mesh_compression"]), "Draco compression"),
    ],
)
def test_mistakes(change: Any, message: str) -> None:
    file = lit({"type": "directional"})
    file.document |= {
        k: v
        for k, v in floor({"normalTexture": {"index": 0}}, (np.zeros((1, 1, 3)),)).document.items()
        if k in ("textures", "materials")
    }
    file.document["images"] = [{"bufferView": file.view(png(np.zeros((1, 1, 3))))}]
    file.document["meshes"][0]["primitives"][0]["material"] = 0
    assert len(read(file).objects) == 1
    file.document = json.loads(json.dumps(file.document))
    change(file.document)
    with pytest.raises(MeshError, match=rf"t\.glb: .*{message}"):
        read(file)


def remarks(material: dict[str, Any], *pictures: Any, **attributes: Any) -> tuple[str, ...]:
    return read(floor({"name": "glass"} | material, pictures, **attributes)).remarks


def test_what_will_not_be_seen_is_said() -> None:
    def transmission(share: float) -> dict[str, Any]:
        return {"extensions": {"KHR_materials_transmission": {"transmissionFactor": share}}}

    def faint(alpha: float) -> dict[str, Any]:
        return {"alphaMode": "BLEND", "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, alpha]}}

    assert remarks(faint(0.25)) == ("material 'glass': most of the light goes through: left out",)
    (said,) = remarks(faint(0.75))
    assert said == "material 'glass': translucent, but most of the light is stopped: drawn opaque"
    assert remarks(faint(1)) == ()
    (said,) = remarks(faint(1), COLOR_0=[[1, 1, 1, 0.5]] * 4)
    assert said.startswith("material 'glass': translucent here and there: a hole where more than half of the light")
    # Nothing goes through metal.
    dielectric = transmission(0.9) | {"pbrMetallicRoughness": {"metallicFactor": 0}}
    assert remarks(dielectric) == ("material 'glass': most of the light goes through: left out",)
    assert remarks(transmission(0.9)) == ()
    coat: dict[str, Any] = {"extensions": {"KHR_materials_clearcoat": {}, "KHR_materials_unlit": {}}}
    file = floor(coat)
    file.document["materials"] += [coat | {"name": f"paint {number}"} for number in range(6)]
    (primitive,) = file.document["meshes"][0]["primitives"]
    file.document["meshes"][0]["primitives"] = [primitive | {"material": number} for number in range(7)]
    names = "materials 0, 'paint 0', 'paint 1', 'paint 2', 'paint 3' and 2 more"
    assert read(file).remarks == (
        f"{names}: KHR_materials_clearcoat: the coat is left out",
        f"{names}: KHR_materials_unlit: shown as matte paint, and lit",
    )


def test_files_that_are_no_scenes(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"a\.ply: has the type \.ply; scenes are read from \.glb, \.gltf"):
        read_gltf_scene(b"ply", "a.ply")
    with pytest.raises(MeshError, match=r"a\.glb: is empty"):
        read_gltf_scene(b"", "a.glb")
    with pytest.raises(MeshError, match=r"holds no triangles, lamps or cameras"):
        read_gltf_scene(b'{"asset": {"version": "2.0"}}', "a.gltf")
    with pytest.raises(MeshError, match=r"none\.glb: cannot be read: No such file"):
        load_gltf_scene(tmp_path / "none.glb")
    whole = floor({}).glb()
    with pytest.raises(MeshError, match=r"t\.glb: .*cut short"):
        read_gltf_scene(whole[: len(whole) // 2], "t.glb")


def test_a_file_without_normals_is_flat() -> None:
    """A roof of two squares that share an edge: rounded where vertices have normals, else not (§3.7.2.1)."""
    file = File()
    places = [[0, 0, 0], [1, 1, 0], [2, 0, 0], [0, 0, -1], [1, 1, -1], [2, 0, -1]]
    attributes = {"POSITION": file.add(places)}
    corners = [0, 1, 4, 0, 4, 3, 1, 2, 5, 1, 5, 4]
    file.mesh({"attributes": attributes, "indices": file.add(corners, "<u2")})
    left = at(read(file), 0.9, 0.5).shading[0]
    np.testing.assert_allclose(left, np.array([-1, 0, 1]) / 2**0.5, atol=1e-6)
    attributes["NORMAL"] = file.add([[-1, 1, 0], [0, 1, 0], [1, 1, 0]] * 2)
    rounded = at(read(file), 0.9, 0.5).shading[0]
    assert rounded[2] > 0.95


def test_hidden_nodes_are_not_read() -> None:
    file = lit({"type": "point"}, nodes=[{"mesh": 0, "translation": [0, 1, 0]}])
    file.document["nodes"].append({"children": [1], "extensions": {"KHR_node_visibility": {"visible": False}}})
    file.document["scenes"][0]["nodes"] = [0, 2]
    file.document["extensionsRequired"] = ["KHR_node_visibility"]
    scene = read(file)
    assert (len(scene.objects), scene.lamps) == (1, ())
    file.document["nodes"][2]["extensions"]["KHR_node_visibility"]["visible"] = True
    scene = read(file)
    assert (len(scene.objects), len(scene.lamps)) == (2, 1)


def test_what_has_no_surface_is_left_out_and_said() -> None:
    file = floor()
    (primitive,) = file.document["meshes"][0]["primitives"]
    lines = {"attributes": {"POSITION": primitive["attributes"]["POSITION"]}, "mode": 1}
    file.document["meshes"][0]["primitives"] += [lines, {"attributes": {}}]
    file.document["animations"] = [{"channels": [], "samplers": []}]
    scene = read(file)
    assert len(scene.objects) == 1
    assert scene.remarks == (
        "2 primitives of points or lines are left out",
        "animations are left out: things are where they are at rest",
    )


def test_cut_outs_and_panes() -> None:
    """Base colour's alpha × factor × that of the vertices below the cut-off is a hole; transmission lets through."""
    picture = np.full((1, 2, 4), [255, 255, 255, 204], np.uint8)
    picture[0, 1, 3] = 102
    rough = {"baseColorTexture": {"index": 0}, "baseColorFactor": [1, 1, 1, 0.75], "metallicFactor": 0}
    ramp = [[1, 1, 1, 1], [1, 1, 1, 1], [1, 1, 1, 0], [1, 1, 1, 0]]

    def holes(more: dict[str, Any], **attributes: Any) -> list[bool]:
        file = floor({"pbrMetallicRoughness": rough} | more, (picture,), **attributes)
        file.document["samplers"] = [{"magFilter": 9728}]
        file.document["textures"][0]["sampler"] = 0
        surfaces = Surfaces(IgiScene(read(file).objects))
        eyes = np.array([[x, y, 1] for y in (0.1, 0.9) for x in (0.25, 0.75)], np.float32)
        return [bool(one) for one in surfaces.rays.intersect(eyes, np.array([[0, 0, -1]] * 4, np.float32)).triangle < 0]

    # Alpha is 0.6 and 0.3.
    assert holes({}) == [False] * 4
    assert holes({"alphaMode": "MASK"}) == [False, True] * 2
    assert holes({"alphaMode": "BLEND"}) == [False, True] * 2
    assert holes({"alphaMode": "MASK", "alphaCutoff": 0.61}) == [True] * 4
    assert holes({"alphaMode": "MASK", "alphaCutoff": 0.29}) == [False] * 4
    assert holes({"alphaMode": "MASK"}, COLOR_0=ramp) == [False, True, True, True]
    through = {"extensions": {"KHR_materials_transmission": {"transmissionFactor": 0.8}}}
    assert holes(through) == [True] * 4
    assert holes(through | {"pbrMetallicRoughness": rough | {"metallicFactor": 0.9}}) == [False] * 4


def test_instances_on_the_gpu() -> None:
    file = floor({"name": "grass", "normalTexture": {"index": 0}}, (np.full((1, 1, 3), [218, 128, 218]),))
    file.document["extensionsRequired"] = ["EXT_mesh_gpu_instancing"]
    attributes = {
        "TRANSLATION": file.add([[0, 0, 0], [3, 1, 0], [6, 0, 0]]),
        "ROTATION": file.add(np.array([[0, 0, 0, 1], QUARTER, [0, 0, 0, 1]])),
        "SCALE": file.add([[1, 1, 1], [1, 1, 1], [-2, 1, 1]]),
    }
    file.document["nodes"][0] |= {"translation": [0, 5, 0]}
    file.document["nodes"][0]["extensions"] = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    scene = read(file)
    (item,) = scene.objects
    assert (len(item.mesh.triangles), len(item.uv[0])) == (6, 12)
    np.testing.assert_allclose(item.mesh.positions[[0, 5, 9]], [[0, 0, 5], [3, 1, 6], [4, 0, 5]], atol=1e-6)
    surfaces = Surfaces(IgiScene(scene.objects))
    eyes = np.array([[0.5, 0.5, 9], [2.5, 0.5, 9], [5, 0.5, 9]], np.float32)
    hits = surfaces.rays.intersect(eyes, np.array([[0, 0, -1]] * 3, np.float32))
    np.testing.assert_allclose(hits.distance, [4, 3, 4], rtol=1e-6)
    # The picture leans along u, which each instance has turned; its fronts look up in mirror images too.
    leaning = surfaces.at(hits.triangle, hits.barycentric, np.array([[0, 0, -1]] * 3, np.float32))
    np.testing.assert_allclose(leaning.geometric, [[0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(leaning.shading[:, :2], [[0.707, 0], [0, 0.707], [-0.707, 0]], atol=6e-3)
    file.document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = file.add([[1, 1, 1]])
    with pytest.raises(MeshError, match="instances with unlike numbers"):
        read(file)
    file.document["accessors"].append({"componentType": 5126, "count": 200_000, "type": "VEC3"})
    placing = {"TRANSLATION": len(file.document["accessors"]) - 1}
    file.document["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = placing
    with pytest.raises(MeshError, match="shows 200000 instances; at most 100000 are read"):
        read(file)


def picture_of(image: Image.Image, kind: str, **options: Any) -> Any:
    """Pixels that a texture has of a file of some kind."""
    body = io.BytesIO()
    image.save(body, kind, **options)
    file = floor({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}, "alphaMode": "MASK"}, ({},))
    file.document["images"][0] |= {"bufferView": file.view(body.getvalue()), "name": "bark"}
    material = read(file).objects[0].material
    assert material.base_texture is not None
    return material.base_texture.pixels[0, 0].tolist(), material.alpha_texture is not None


def test_pictures_of_all_kinds() -> None:
    deep = Image.fromarray(np.full((2, 2), 0x8000, np.uint16))
    assert picture_of(deep, "PNG") == ([128] * 3, False)
    assert picture_of(Image.new("L", (2, 2), 77), "PNG") == ([77] * 3, False)
    assert picture_of(Image.new("LA", (2, 2), (77, 10)), "PNG") == ([77] * 3, True)
    table = Image.new("P", (2, 2), 1)
    table.putpalette([0, 0, 0, 10, 20, 30])
    assert picture_of(table, "PNG") == ([10, 20, 30], False)
    assert picture_of(table, "PNG", transparency=0) == ([10, 20, 30], True)
    red, clear = picture_of(Image.new("CMYK", (8, 8), (0, 255, 255, 0)), "JPEG", quality=95)
    assert (red[0] > 240, max(red[1:]) < 15, clear) == (True, True, False)
    grey, _ = picture_of(Image.new("RGB", (16, 16), (90, 90, 90)), "JPEG", progressive=True)
    assert abs(grey[0] - 90) < 3
    assert picture_of(Image.new("RGBA", (2, 2), (9, 8, 7, 6)), "WEBP", lossless=True)[1]
    with pytest.raises(MeshError, match=r"t\.glb: picture 'bark' has 9000×8000 pixels; at most 67108864 are read"):
        picture_of(Image.new("1", (9000, 8000)), "PNG")
    with pytest.raises(MeshError, match=r"t\.glb: picture 'bark' is too large; at most 67108864 pixels are read"):
        picture_of(Image.new("1", (16000, 8000)), "PNG")


def test_names_and_numbers_as_programs_write_them(tmp_path: Path) -> None:
    """Folders above are not read; whole numbers with a point are indices; spaces and signs of any script are names."""
    file = floor({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}, ({"uri": "a/%C3%B6%20❤.png"},))
    (tmp_path / "x" / "a").mkdir(parents=True)
    (tmp_path / "x" / "a" / "ö ❤.png").write_bytes(png(np.zeros((2, 2, 3))))
    (tmp_path / "x" / "geo").mkdir()
    (tmp_path / "x" / "geo" / "all data.bin").write_bytes(file.binary)
    file.document["buffers"] = [{"byteLength": len(file.binary), "uri": "geo/all%20data.bin"}]
    text = json.dumps(file.document).replace('"mesh": 0', '"mesh": 0.0')
    (tmp_path / "x" / "szene ö.gltf").write_text(text, encoding="utf-8")
    assert len(load_gltf_scene(tmp_path / "x" / "szene ö.gltf").objects) == 1
    (tmp_path / "secret.png").write_bytes(png(np.zeros((2, 2, 3))))
    for away in ("../secret.png", "a/../../secret.png", "%2e%2e/secret.png", str(tmp_path / "secret.png")):
        file.document["images"][0]["uri"] = away
        (tmp_path / "x" / "t.gltf").write_text(json.dumps(file.document))
        with pytest.raises(MeshError, match=r"t\.gltf: names the file .* which lies outside its folder; put it beside"):
            load_gltf_scene(tmp_path / "x" / "t.gltf")
