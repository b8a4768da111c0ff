"""Scenes for `lightwell.igi` from glTF and GLB files: objects with materials and textures, lamps, cameras."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.geometry.mesh import DEFAULT_ALBEDO
from lightwell.igi.scene import DirectionalLight, IgiObject, PointLight
from lightwell.io.gltf import GltfObject, hidden_nodes, node_places, read_objects
from lightwell.io.gltf_check import GltfError, is_shown
from lightwell.io.gltf_colours import Pictures, vertex_alpha
from lightwell.io.gltf_data import GltfData
from lightwell.io.gltf_lamps import GltfCamera, read_cameras, read_lamps
from lightwell.io.gltf_materials import Materials
from lightwell.io.meshes import (
    MAX_TRIANGLES,
    Z_UP,
    MeshError,
    checked_mesh,
    mesh_errors,
    open_gltf,
    read_mesh_file,
    unique_title,
)
from lightwell.render.camera import Camera

SCENE_SUFFIXES = (".glb", ".gltf")
Singles = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class GltfScene:
    """What a file shows, in world axes (+Z up), metres."""

    name: str
    """Of the file."""
    objects: tuple[IgiObject, ...]
    """One for each use of a primitive."""
    lamps: tuple[PointLight | DirectionalLight, ...]
    """Punctual lights; emissive surfaces are among the objects."""
    cameras: tuple[GltfCamera, ...]
    """In the order of the file's nodes."""
    remarks: tuple[str, ...]
    """What of the file a picture will not show."""

    @property
    def first_camera(self) -> Camera | None:
        """The first camera with a perspective."""
        return next((one.camera for one in self.cameras if one.camera is not None), None)

    def camera(self, name: str) -> Camera:
        """Return the camera of a name; raises `MeshError` where there is none, or it has no perspective."""
        found = next((one for one in self.cameras if one.name == name), None)
        if found is None:
            names = ", ".join(repr(one.name) for one in self.cameras[:20]) or "none"
            raise MeshError(f"{self.name}: has no camera {name!r}; it has {names}")
        if found.camera is None:
            raise MeshError(f"{self.name}: camera {found.name!r} has no perspective; name another, or give its place")
        return found.camera


def load_gltf_scene(path: str | Path, max_triangles: int = MAX_TRIANGLES, *, keep_uv: bool = False) -> GltfScene:
    """Read a scene; files that it names are read from its folder and those below it.

    Textures are sampled where surfaces are seen, with the wrap modes of their samplers; colours of vertices multiply
    the base colour. Metallic-roughness becomes `IgiMaterial`'s matte part and Phong lobe. There are holes where MASK
    says so, and where BLEND or transmission let more than half of the light through. A light without end is not
    cut off at its ``range``, and occlusion maps are left out, since occlusion is computed. Skins and morph targets are
    taken at rest; tangents are those of the file, or follow from texture coordinates. Texture coordinates that no
    texture goes by are left out, but with ``keep_uv`` not the first ones.

    Raises
    ------
    MeshError
        Whatever is wrong: names the file, what it is, and what would help.
    """
    path = Path(path)
    return read_gltf_scene(read_mesh_file(path), path.name, path.parent, max_triangles, keep_uv=keep_uv)


def read_gltf_scene(
    data: bytes, name: str, folder: Path | None = None, max_triangles: int = MAX_TRIANGLES, *, keep_uv: bool = False
) -> GltfScene:
    """Read a scene of a file's bytes; without ``folder`` it must hold everything itself. Raises `MeshError`."""
    suffix = PurePosixPath(name).suffix.lower()
    if suffix not in SCENE_SUFFIXES:
        raise MeshError(f"{name}: has the type {suffix or '(none)'}; scenes are read from {', '.join(SCENE_SUFFIXES)}")
    if not data:
        raise MeshError(f"{name}: is empty")
    with mesh_errors(name):
        document, data_of = open_gltf(data, name, folder, max_triangles)
        places = node_places(document)
        materials = Materials(document, Pictures(document, data_of, _unused))
        taken: set[str] = set()
        objects = tuple(
            _object(name, one, unique_title(one.name, taken), materials, data_of, keep_uv)
            for one in read_objects(document, data_of, None)
            if len(one.triangles)
        )
        hidden = hidden_nodes(document)
        shown = {index: place for index, place in places.items() if index not in hidden}
        remarks = (*materials.remarks, *_skipped(document, shown))
        lamps = tuple(read_lamps(document, shown, Z_UP))
        cameras = tuple(read_cameras(document, places, Z_UP))
    if not (objects or lamps or cameras):
        raise MeshError(f"{name}: holds no triangles, lamps or cameras; export the scene, not points or lines")
    return GltfScene(name, objects, lamps, cameras, remarks)


def _skipped(document: Mapping[str, Any], places: Mapping[int, NDArray[np.float64]]) -> list[str]:
    """Return remarks on what of the nodes' meshes has no surface, and on what moves."""
    nodes, found = document.get("nodes", []), []
    meshes = [document["meshes"][nodes[index]["mesh"]] for index in places if "mesh" in nodes[index]]
    count = sum(not is_shown(primitive) for mesh in meshes for primitive in mesh["primitives"])
    if count:
        found.append(f"{count} primitives of points or lines are left out")
    if document.get("animations"):
        found.append("animations are left out: things are where they are at rest")
    return found


def _unused(pixels: NDArray[np.uint8], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    raise AssertionError("textures are sampled where surfaces are seen")


def _object(file: str, one: GltfObject, title: str, materials: Materials, data: GltfData, keep_uv: bool) -> IgiObject:
    normals = None if one.normals is None else one.normals @ Z_UP.T
    # White is glTF's default; that of a surface without any material is a light paint, as everywhere in Lightwell.
    default = 1.0 if "material" in one.primitive else DEFAULT_ALBEDO
    albedo = default if one.colours is None else one.colours
    mesh = checked_mesh(file, title, one.positions @ Z_UP.T, one.triangles, normals, albedo)
    material = materials.material(one.primitive)
    attributes = one.primitive["attributes"]
    count = len(mesh.positions) // one.copies
    used = {texture.uv_set for texture in material.textures}
    if keep_uv and "TEXCOORD_0" in attributes:
        used.add(0)
    try:
        uv = tuple(np.tile(one_set, (one.copies, 1)) for one_set in _uv(used, attributes, count, data, title))
        alpha = vertex_alpha(data, one.primitive) if material.hole_below > 0 else None
        return IgiObject(
            mesh,
            material,
            uv,
            _tangents(one, count, data),
            None if alpha is None else np.tile(alpha, one.copies).astype(np.float32),
            is_flat=one.normals is None,  # §3.7.2.1
        )
    except GltfError:
        raise
    except ValueError as error:
        raise GltfError(f"{error}; export it again") from None


def _uv(used: set[int], attributes: Mapping[str, Any], count: int, data: GltfData, title: str) -> tuple[Singles, ...]:
    """Return the sets of texture coordinates that are used; the others are zero."""
    sets: list[Singles] = []
    for number in range(max(used, default=-1) + 1):
        name = f"TEXCOORD_{number}"
        if number not in used:
            sets.append(np.zeros((count, 2), np.float32))
        elif name in attributes:
            sets.append(data.numbers(attributes[name], 2).astype(np.float32))
        else:
            raise GltfError(
                f"object {title!r} has a texture but no texture coordinates {number}; unwrap it and export it again"
            )
    return tuple(sets)


def _tangents(one: GltfObject, count: int, data: GltfData) -> Singles | None:
    """Return the file's tangents, turned as the surface is, ``(V, 4)``; None where it has none."""
    index = one.primitive["attributes"].get("TANGENT")
    if index is None:
        return None
    given = data.numbers(index, 4)
    if len(given) != count:
        raise GltfError(f"has {count} vertices and {len(given)} tangents; export it again")
    given = np.tile(given, (one.copies, 1))
    turned = np.einsum("vij,vj->vi", np.broadcast_to(one.turn, (len(given), 3, 3)), given[:, :3])
    side = np.where(given[:, 3:] < 0, -1.0, 1.0) * np.where(one.mirrored, -1, 1)[:, None]
    turned = np.nan_to_num(turned @ Z_UP.T, nan=0.0, posinf=0.0, neginf=0.0)
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.concatenate([turned / np.where(length > 0, length, 1.0), side], axis=1).astype(np.float32)
