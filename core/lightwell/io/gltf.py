"""The objects of a glTF file (glTF 2.0), each where its nodes put it, with skins and morph targets at rest."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from lightwell.io.gltf_check import INSTANCES, MAX_OBJECTS, STRIP, TRIANGLES, VISIBILITY, GltfError, is_shown
from lightwell.io.gltf_colours import Pictures, base_colours
from lightwell.io.gltf_data import GltfData

PLACING = {"TRANSLATION": 3, "ROTATION": 4, "SCALE": 3}
"""Attributes of instances, and how many numbers each has."""


class GltfObject(NamedTuple):
    """One use of one primitive, +Y up as in the file."""

    name: str
    positions: NDArray[np.float64]
    """``(V, 3)`` metres."""
    triangles: NDArray[np.int64]
    """``(F, 3)``; front is where they run counter-clockwise."""
    normals: NDArray[np.float64] | None
    """``(V, 3)``, of any length; None where the file has none."""
    colours: NDArray[np.float64] | None
    """``(V, 3)`` linear, or None where the file says nothing."""
    primitive: Mapping[str, Any]
    """What the file says of it."""
    turn: NDArray[np.float64]
    """``(1, 3, 3)``, or ``(V, 3, 3)``: how directions along the surface have been turned."""
    mirrored: NDArray[np.bool_]
    """``(1,)`` or ``(V,)``: whether that was a mirror image."""
    copies: int
    """How often the vertices of the primitive come after each other (EXT_mesh_gpu_instancing)."""


def read_objects(document: Mapping[str, Any], data: GltfData, pictures: Pictures | None) -> Iterator[GltfObject]:
    """Yield the triangle meshes of the scene, mesh after mesh in the file's order and use after use in its nodes'.

    Without ``pictures``, colours are those of factors and vertices alone.

    Raises
    ------
    GltfError
        Where data are missing or contradict each other; other errors where the document does.
    """
    nodes = document.get("nodes", [])
    places = node_places(document)
    hidden = hidden_nodes(document)
    uses = [(nodes[index]["mesh"], index) for index in places if "mesh" in nodes[index] and index not in hidden]
    uses.sort(key=lambda use: use[0])
    count = sum(len(document["meshes"][mesh]["primitives"]) for mesh, _ in uses)
    if count > MAX_OBJECTS:
        raise GltfError(f"has {count} objects; at most {MAX_OBJECTS} are read: join them")
    for mesh_index, node_index in uses:
        mesh, node = document["meshes"][mesh_index], nodes[node_index]
        name = str(mesh.get("name") or node.get("name") or "object")
        skin = document["skins"][node["skin"]] if "skin" in node else None
        weights = node.get("weights", mesh.get("weights", ()))
        for primitive in mesh["primitives"]:
            if not is_shown(primitive):
                continue
            local = _local(document, data, primitive, weights, pictures)
            if skin is not None and {"JOINTS_0", "WEIGHTS_0"} <= primitive["attributes"].keys():
                yield _bent(local, name, primitive, _skinned(data, skin, primitive["attributes"], places))
            else:
                yield _placed(local, name, primitive, places[node_index] @ _instances(data, node))


class _Local(NamedTuple):
    """A primitive where it is before its node moves it; as `GltfObject`."""

    positions: NDArray[np.float64]
    triangles: NDArray[np.int64]
    normals: NDArray[np.float64] | None
    colours: NDArray[np.float64] | None


def _local(
    document: Mapping[str, Any],
    data: GltfData,
    primitive: Mapping[str, Any],
    weights: Any,  # noqa: ANN401
    pictures: Pictures | None,
) -> _Local:
    attributes = primitive["attributes"]
    positions = data.numbers(attributes["POSITION"], 3)
    normals = data.numbers(attributes["NORMAL"], 3) if "NORMAL" in attributes else None
    for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
        if weight and "POSITION" in target:
            positions = positions + weight * data.numbers(target["POSITION"], 3)
        if weight and "NORMAL" in target and normals is not None:
            normals = normals + weight * data.numbers(target["NORMAL"], 3)
    triangles = _triangles(data, primitive, len(positions))
    return _Local(positions, triangles, normals, base_colours(document, data, primitive, len(positions), pictures))


def _bent(local: _Local, name: str, primitive: Mapping[str, Any], matrices: NDArray[np.float64]) -> GltfObject:
    """Return a primitive as its joints put it: they alone say where it is, not its node (glTF 2.0 §3.7.3.3)."""
    turn = matrices[:, :3, :3]
    positions = np.einsum("vij,vj->vi", turn, local.positions) + matrices[:, :3, 3]
    # Mixtures of turns have no inverse to rely on: as renderers do, normals go like the surface.
    normals = None if local.normals is None else np.einsum("vij,vj->vi", turn, local.normals)
    mirrored = len(turn) > 0 and bool(np.median(np.linalg.det(turn)) < 0)
    triangles = local.triangles[:, ::-1] if mirrored else local.triangles
    return GltfObject(name, positions, triangles, normals, local.colours, primitive, turn, np.array([mirrored]), 1)


def _placed(local: _Local, name: str, primitive: Mapping[str, Any], places: NDArray[np.float64]) -> GltfObject:
    """Return a primitive at each of the places ``(copies, 4, 4)``, as one object."""
    count, copies = len(local.positions), len(places)
    positions, normals, triangles = [], [], []
    mirrored = np.linalg.det(places[:, :3, :3]) < 0
    for number, place in enumerate(places):
        turn = place[:3, :3]
        positions.append(local.positions @ turn.T + place[:3, 3])
        # A mirror image runs round the other way (§3.7.4).
        triangles.append((local.triangles[:, ::-1] if mirrored[number] else local.triangles) + number * count)
        if local.normals is not None:
            # Normals go by the cofactors (det · inverse transpose), which also serve where a scale is 0.
            cofactors = np.stack([np.cross(turn[(i + 1) % 3], turn[(i + 2) % 3]) for i in range(3)])
            normals.append(local.normals @ cofactors.T * (-1 if mirrored[number] else 1))
    return GltfObject(
        name,
        np.concatenate(positions),
        np.concatenate(triangles),
        np.concatenate(normals) if normals else None,
        None if local.colours is None else np.tile(local.colours, (copies, 1)),
        primitive,
        places[:, :3, :3] if copies == 1 else np.repeat(places[:, :3, :3], count, axis=0),
        mirrored if copies == 1 else np.repeat(mirrored, count),
        copies,
    )


def _triangles(data: GltfData, primitive: Mapping[str, Any], vertices: int) -> NDArray[np.int64]:
    """Return the corners of a list, a strip or a fan of triangles, ``(F, 3)``."""
    if "indices" in primitive:
        corners = data.accessor(primitive["indices"])[:, 0].astype(np.int64)
    else:
        corners = np.arange(vertices)
    mode = primitive.get("mode", TRIANGLES)
    if mode == TRIANGLES:
        return corners[: len(corners) // 3 * 3].reshape(-1, 3)
    count = max(0, len(corners) - 2)
    following = np.arange(count)
    if mode == STRIP:
        odd = following % 2
        return np.stack([corners[following], corners[following + 1 + odd], corners[following + 2 - odd]], axis=1)
    return np.stack([corners[following + 1], corners[following + 2], np.repeat(corners[:1], count)], axis=1)


def _skinned(
    data: GltfData, skin: Mapping[str, Any], attributes: Mapping[str, int], places: Mapping[int, NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return where each vertex is put by its joints, ``(V, 4, 4)``."""
    joints = skin["joints"]
    if any(joint not in places for joint in joints):
        raise GltfError("has a skin whose joints are not in the scene; export it without animation")
    matrices = np.stack([places[joint] for joint in joints])
    if "inverseBindMatrices" in skin:
        inverse = data.numbers(skin["inverseBindMatrices"], 16).reshape(-1, 4, 4).transpose(0, 2, 1)
        if len(inverse) < len(joints):
            raise GltfError(f"has {len(joints)} joints and {len(inverse)} inverse bind matrices; export it again")
        matrices = matrices @ inverse[: len(joints)]
    total: NDArray[np.float64] | None = None
    shares = 0.0
    for group in range(8):
        if f"JOINTS_{group}" not in attributes or f"WEIGHTS_{group}" not in attributes:
            break
        which = data.accessor(attributes[f"JOINTS_{group}"])
        weights = data.numbers(attributes[f"WEIGHTS_{group}"], 4)
        if len(which) and int(which.max()) >= len(joints):
            raise GltfError(f"names joint {which.max()} of {len(joints)}; export it again")
        for lane in range(4):
            part = weights[:, lane, None, None] * matrices[which[:, lane]]
            total = part if total is None else total + part
        shares = shares + weights.sum(axis=1)
    assert total is not None
    # Vertices that belong to no joint stay where they are; weights of bytes do not quite add up to one.
    free = np.asarray(shares) <= 0
    total[free] = np.eye(4)
    return np.asarray(total / np.where(free, 1.0, shares)[:, None, None])


def node_places(document: Mapping[str, Any]) -> dict[int, NDArray[np.float64]]:
    """Return where each node of the scene is, ``(4, 4)``, in the order in which it is come by from the roots."""
    nodes = document.get("nodes", [])
    scenes = document.get("scenes", [])
    if scenes:
        roots = scenes[document.get("scene", 0)].get("nodes", [])
    else:
        below = {child for node in nodes for child in node.get("children", ())}
        roots = [index for index in range(len(nodes)) if index not in below]
    found: dict[int, NDArray[np.float64]] = {}
    waiting = [(root, np.eye(4)) for root in reversed(roots)]
    while waiting:
        index, above = waiting.pop()
        if index in found or not 0 <= index < len(nodes):
            raise GltfError("has nodes that are missing, have two parents or lie in a circle; export it again")
        found[index] = above @ _own_place(nodes[index])
        waiting += [(child, found[index]) for child in reversed(nodes[index].get("children", []))]
    return found


def hidden_nodes(document: Mapping[str, Any]) -> set[int]:
    """Return the nodes that are not to be seen, with all below them (KHR_node_visibility)."""
    nodes = document.get("nodes", [])
    waiting = [
        index
        for index, node in enumerate(nodes)
        if not node.get("extensions", {}).get(VISIBILITY, {}).get("visible", True)
    ]
    hidden: set[int] = set()
    while waiting:
        index = waiting.pop()
        if index not in hidden:
            hidden.add(index)
            waiting += nodes[index].get("children", [])
    return hidden


def _own_place(node: Mapping[str, Any]) -> NDArray[np.float64]:
    if "matrix" in node:
        return np.asarray(node["matrix"], np.float64).reshape(4, 4).T  # columns after each other
    return _place(node.get("translation", (0, 0, 0)), node.get("rotation", (0, 0, 0, 1)), node.get("scale", (1, 1, 1)))


def _instances(data: GltfData, node: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return where a node's mesh is put, ``(copies, 4, 4)``, in the node's own axes: once, unless it says otherwise."""
    attributes = node.get("extensions", {}).get(INSTANCES, {}).get("attributes", {})
    given = {key: data.numbers(attributes[key], width) for key, width in PLACING.items() if key in attributes}
    counts = {len(rows) for rows in given.values()}
    if not given:
        return np.eye(4)[None]
    if len(counts) > 1:
        raise GltfError("has instances with unlike numbers of places, turns and sizes; export it again")
    move, turn, size = ("TRANSLATION", (0, 0, 0)), ("ROTATION", (0, 0, 0, 1)), ("SCALE", (1, 1, 1))
    rows = [given.get(key, np.tile(other, (max(counts), 1))) for key, other in (move, turn, size)]
    return np.array([_place(*row) for row in zip(*rows, strict=True)]).reshape(-1, 4, 4)


def _place(translation: ArrayLike, rotation: ArrayLike, scale: ArrayLike) -> NDArray[np.float64]:
    """Return ``(4, 4)``: scaled, then turned by a quaternion (x, y, z, w) of any length, then moved."""
    place = np.eye(4)
    x, y, z, w = np.asarray(rotation, np.float64)
    length = x * x + y * y + z * z + w * w
    if length > 0:
        s = 2 / length
        place[:3, :3] = [
            [1 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)],
            [s * (x * y + z * w), 1 - s * (x * x + z * z), s * (y * z - x * w)],
            [s * (x * z - y * w), s * (y * z + x * w), 1 - s * (x * x + y * y)],
        ]
    place[:3, :3] *= np.asarray(scale, np.float64)
    place[:3, 3] = np.asarray(translation, np.float64)
    return place
