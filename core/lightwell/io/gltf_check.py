"""What a glTF file must fulfil before it is read: sizes that its data bears out, and nothing that would be lost.

A few bytes of JSON can ask for any amount of memory; this is checked before anything is made from it.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

COMPONENT_BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
TYPE_COMPONENTS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
UNREADABLE = {
    "KHR_draco_mesh_compression": "Draco compression",
    "EXT_meshopt_compression": "meshopt compression",
    "KHR_meshopt_compression": "meshopt compression",
}
INSTANCES = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
HARMLESS = (
    INSTANCES,
    VISIBILITY,
    "KHR_mesh_quantization",
    "KHR_materials_",
    "KHR_texture_",
    "EXT_texture_",
    "KHR_lights_",
    "KHR_xmp",
)
"""Beginnings of extensions that are read, or that change nothing of what is."""
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
TRIANGLES, STRIP, FAN = 4, 5, 6
TRIANGLE_MODES = (TRIANGLES, STRIP, FAN)
MAX_NODES = 100_000
MAX_OBJECTS = 4096
"""Uses of primitives: each becomes an object with files of its own."""


class GltfError(ValueError):
    """Says what is wrong, and what would help where something would."""


def split_glb(data: bytes) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON of a GLB file, and its binary chunk where it has one (glTF 2.0 §4.4). Raises `GltfError`."""
    if len(data) < 20:
        raise GltfError(f"is {len(data)} bytes long; a GLB file has at least 20")
    magic, version, length, chunk, kind = struct.unpack_from("<4sIIII", data)
    if magic != b"glTF":
        raise GltfError("is no GLB file: it does not begin with glTF")
    if version != 2:
        raise GltfError(f"is glTF version {version}; version 2 can be read: export it again")
    if length > len(data) or 20 + chunk > len(data) or kind != JSON_CHUNK:
        raise GltfError(f"is cut short or damaged: it says {length} bytes and has {len(data)}; export it again")
    document = parse_document(data[20 : 20 + chunk])
    place = 20 + chunk
    while place + 8 <= length:
        size, kind = struct.unpack_from("<II", data, place)
        if place + 8 + size > length:
            raise GltfError("is cut short or damaged: a chunk is longer than the file; export it again")
        if kind == BINARY_CHUNK:
            return document, data[place + 8 : place + 8 + size]
        place += 8 + size
    return document, None


def parse_document(text: bytes) -> dict[str, Any]:
    """Return the JSON of a glTF file. Raises `GltfError`."""
    try:
        # Some programs write whole numbers with a point, and mean indices by them.
        document = json.loads(text, parse_float=_number)
    except (ValueError, RecursionError) as error:
        raise GltfError(f"holds no JSON that can be read ({error}); export it again") from None
    if not isinstance(document, dict):
        raise GltfError("holds JSON that is no glTF document; export it again")
    return document


def _number(text: str) -> float | int:
    value = float(text)
    return int(value) if value.is_integer() and abs(value) < 1 << 53 else value


def check_document(document: Mapping[str, Any], max_triangles: int) -> None:
    """Raise `GltfError` where a document contradicts itself, is too large or needs what is not read here."""
    for name in document.get("extensionsRequired", ()):
        if name in UNREADABLE:
            raise GltfError(f"uses {UNREADABLE[name]} ({name}), which is not read; export it without")
        if not str(name).startswith(HARMLESS):
            raise GltfError(f"requires the extension {str(name)[:80]!r}, which is not read; export it without")
    try:
        _check_triangles(document, max_triangles)
        _check_accessors(document, 3 * max_triangles)
    except GltfError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, RecursionError) as error:
        raise GltfError(f"contradicts itself ({type(error).__name__}: {error}); export it again") from None


def _check_accessors(document: Mapping[str, Any], most: int) -> None:
    views = document.get("bufferViews", [])
    for index, accessor in enumerate(document.get("accessors", [])):
        count = accessor["count"]
        if not 0 <= count <= most:
            raise GltfError(f"accessor {index} has {count} items; at most {most} are read")
        item = COMPONENT_BYTES[accessor["componentType"]] * TYPE_COMPONENTS[accessor["type"]]
        sparse = accessor.get("sparse")
        if sparse is not None:
            if not 0 <= sparse["count"] <= count:
                raise GltfError(f"accessor {index} has {sparse['count']} sparse items of {count}; export it again")
            where = sparse["indices"]
            _check_reach(index, where, views, sparse["count"], COMPONENT_BYTES[where["componentType"]])
            _check_reach(index, sparse["values"], views, sparse["count"], item)
        if "bufferView" in accessor:
            _check_reach(index, accessor, views, count, item)


def _check_reach(index: int, part: Mapping[str, Any], views: list[Any], count: int, item: int) -> None:
    view = views[part["bufferView"]]
    stride = view.get("byteStride", item)
    offset = part.get("byteOffset", 0)
    end = offset + (count - 1) * stride + item if count else offset
    if offset < 0 or stride < item or end > view["byteLength"]:
        raise GltfError(f"accessor {index} reaches to byte {end} of a view of {view['byteLength']}; export it again")


def _check_triangles(document: Mapping[str, Any], most: int) -> None:
    """Count what the nodes of the scene show, each use of a mesh by itself: triangles, and vertices that have none."""
    accessors = document.get("accessors", [])
    per_mesh = []
    for mesh in document.get("meshes", []):
        shown = [one for one in mesh["primitives"] if is_shown(one)]
        per_mesh.append(
            (
                sum(_count_triangles(one, accessors) for one in shown),
                sum(int(accessors[one["attributes"]["POSITION"]]["count"]) for one in shown),
            )
        )
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise GltfError(f"has {len(nodes)} nodes; at most {MAX_NODES} are read")
    children = [child for node in nodes for child in node.get("children", ())]
    if len(set(children)) < len(children):
        raise GltfError("has nodes with two parents or in a circle; export it again")
    uses = [(_copies(node, accessors), per_mesh[node["mesh"]]) for node in nodes if "mesh" in node]
    instances = sum(copies for copies, _ in uses)
    if instances > MAX_NODES:
        raise GltfError(f"shows {instances} instances; at most {MAX_NODES} are read")
    triangles, vertices = (sum(copies * use[k] for copies, use in uses) for k in (0, 1))
    if triangles > most:
        raise GltfError(f"shows {triangles} triangles; at most {most} are read: simplify it")
    if vertices > 3 * most:
        raise GltfError(f"shows {vertices} vertices; at most {3 * most} are read: simplify it")


def is_shown(primitive: Mapping[str, Any]) -> bool:
    """Whether a primitive has triangles, and places for them."""
    return primitive.get("mode", TRIANGLES) in TRIANGLE_MODES and "POSITION" in primitive["attributes"]


def _copies(node: Mapping[str, Any], accessors: list[Any]) -> int:
    attributes = node.get("extensions", {}).get(INSTANCES, {}).get("attributes", {})
    return max((int(accessors[index]["count"]) for index in attributes.values()), default=1)


def _count_triangles(primitive: Mapping[str, Any], accessors: list[Any]) -> int:
    corners = int(accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"])
    return corners // 3 if primitive.get("mode", TRIANGLES) == TRIANGLES else max(0, corners - 2)
