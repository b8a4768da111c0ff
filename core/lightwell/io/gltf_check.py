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
    "KHR_mesh_quantization": "quantised vertices",
}
JSON_CHUNK = 0x4E4F534A
MAX_NODES = 100_000


class GltfError(ValueError):
    """Says what is wrong, and what would help where something would."""


def document_of_glb(data: bytes) -> dict[str, Any]:
    """Return the JSON of a GLB file (glTF 2.0 §4.4). Raises `GltfError`."""
    if len(data) < 20:
        raise GltfError(f"is {len(data)} bytes long; a GLB file has at least 20")
    magic, version, length, chunk, kind = struct.unpack_from("<4sIIII", data)
    if magic != b"glTF":
        raise GltfError("is no GLB file: it does not begin with glTF")
    if version != 2:
        raise GltfError(f"is glTF version {version}; version 2 can be read: export it again")
    if length > len(data) or 20 + chunk > len(data) or kind != JSON_CHUNK:
        raise GltfError(f"is cut short or damaged: it says {length} bytes and has {len(data)}; export it again")
    return parse_document(data[20 : 20 + chunk])


def parse_document(text: bytes) -> dict[str, Any]:
    """Return the JSON of a glTF file. Raises `GltfError`."""
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise GltfError(f"holds no JSON that can be read ({error}); export it again") from None
    if not isinstance(document, dict):
        raise GltfError("holds JSON that is no glTF document; export it again")
    return document


def check_document(document: Mapping[str, Any], max_triangles: int) -> None:
    """Raise `GltfError` where a document contradicts itself, is too large or needs what is not read here."""
    for name in document.get("extensionsRequired", ()):
        if name in UNREADABLE:
            raise GltfError(f"uses {UNREADABLE[name]} ({name}), which is not read; export it without")
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
        if "sparse" in accessor:
            raise GltfError(f"accessor {index} is sparse, which is not read; export without sparse accessors")
        if "bufferView" not in accessor:
            continue
        view = views[accessor["bufferView"]]
        item = COMPONENT_BYTES[accessor["componentType"]] * TYPE_COMPONENTS[accessor["type"]]
        stride = view.get("byteStride", item)
        offset = accessor.get("byteOffset", 0)
        end = offset + (count - 1) * stride + item if count else offset
        if offset < 0 or stride < item or end > view["byteLength"]:
            raise GltfError(
                f"accessor {index} reaches to byte {end} of a view of {view['byteLength']}; export it again"
            )


def _check_triangles(document: Mapping[str, Any], most: int) -> None:
    """Count the triangles that the nodes of the scene show, each use of a mesh by itself."""
    accessors = document.get("accessors", [])
    per_mesh = [
        sum(_corners(primitive, accessors) for primitive in mesh["primitives"]) // 3
        for mesh in document.get("meshes", [])
    ]
    nodes = document.get("nodes", [])
    if len(nodes) > MAX_NODES:
        raise GltfError(f"has {len(nodes)} nodes; at most {MAX_NODES} are read")
    children = [child for node in nodes for child in node.get("children", ())]
    if len(set(children)) < len(children):
        raise GltfError("has nodes with two parents or in a circle; export it again")
    total = sum(per_mesh[node["mesh"]] for node in nodes if "mesh" in node)
    if total > most:
        raise GltfError(f"shows {total} triangles; at most {most} are read: simplify it")


def _corners(primitive: Mapping[str, Any], accessors: list[Any]) -> int:
    return int(accessors[primitive.get("indices", primitive["attributes"]["POSITION"])]["count"])
