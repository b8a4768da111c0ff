"""glTF documents that tests put together by hand."""

from __future__ import annotations

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from lightwell.geometry.mesh import Mesh
from lightwell.io.meshes import read_meshes

COMPONENTS = {"i1": 5120, "u1": 5121, "<i2": 5122, "<u2": 5123, "<u4": 5125, "<f4": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class File:
    """A glTF document that grows."""

    def __init__(self, **document: Any) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scenes": [{"nodes": [0]}],
            "nodes": [{"mesh": 0}],
            "accessors": [],
            "bufferViews": [],
        } | document
        self.binary = b""

    def view(self, data: bytes, **more: Any) -> int:
        self.document["bufferViews"].append(
            {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)} | more
        )
        self.binary += data + b"\0" * (-len(data) % 4)
        return len(self.document["bufferViews"]) - 1

    def add(self, rows: ArrayLike, dtype: str = "<f4", stride: int = 0, **more: Any) -> int:
        array = np.asarray(rows, dtype).reshape(len(np.asarray(rows)), -1)
        body = array.tobytes()
        extra: dict[str, Any] = {}
        if stride:
            padded = np.zeros((len(array), stride), np.uint8)
            padded[:, : array.itemsize * array.shape[1]] = array.view(np.uint8).reshape(len(array), -1)
            body, extra = padded.tobytes(), {"byteStride": stride}
        accessor = {"bufferView": self.view(body, **extra), "componentType": COMPONENTS[dtype], "count": len(array)}
        self.document["accessors"].append(accessor | {"type": TYPES[array.shape[1]]} | more)
        return len(self.document["accessors"]) - 1

    def mesh(self, primitive: dict[str, Any], **more: Any) -> File:
        self.document["meshes"] = [{"primitives": [primitive]} | more]
        return self

    def glb(self) -> bytes:
        self.document.setdefault("buffers", [{"byteLength": len(self.binary)}])
        text = json.dumps(self.document).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def read(self) -> Mesh:
        (mesh,) = read_meshes(self.glb(), "t.glb")
        return mesh
