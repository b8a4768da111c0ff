"""Writing GLB files (glTF 2.0): meshes with their normals, albedo and, where there is one, their transfer."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell._version import __version__
from lightwell.geometry.mesh import Float32s, Mesh

FLOAT, UNSIGNED_INT = 5126, 5125
VERTICES, INDICES = 34962, 34963
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942
MAX_BYTES = (1 << 32) - 1
MAX_STRIDE = 252
"""Bytes from vertex to vertex (glTF 2.0 §5.11.4)."""
LANES = 4


def encode_glb(meshes: Sequence[Mesh], transfers: Sequence[Float32s] | None = None) -> bytes:
    """Return a GLB file with one node and one mesh for each of ``meshes``, in their order and with their vertices.

    Positions and normals are turned to +Y up, as glTF wants; ``COLOR_0`` is the albedo. ``transfers`` holds
    ``(V, bands²)`` for each mesh, which become ``_PRT0, _PRT1 …``: VEC4 of float, interleaved, zeros after the last
    coefficient. They stay in Lightwell's basis and world axes (+Z up), like the coefficients of the light.

    Raises
    ------
    ValueError
        Where the file would be larger than GLB can say (4 GiB), or a transfer has more than 60 coefficients, which
        are more than interleaved attributes may hold.
    """
    file = _File()
    for index, mesh in enumerate(meshes):
        attributes = {
            "POSITION": file.add(_y_up(mesh.positions), "VEC3", bounds=True),
            "NORMAL": file.add(_y_up(mesh.normals), "VEC3"),
            "COLOR_0": file.add(mesh.albedo, "VEC3"),
        }
        if transfers is not None:
            attributes |= file.add_interleaved(transfers[index])
        primitive: dict[str, Any] = {"attributes": attributes}
        if len(mesh.triangles):
            indices = mesh.triangles.astype(np.uint32).reshape(-1)
            primitive["indices"] = file.add(indices, "SCALAR", component=UNSIGNED_INT, target=INDICES)
            primitive["material"] = 0
        else:
            primitive["mode"] = 0  # points
        file.meshes.append({"name": mesh.name, "primitives": [primitive]})
    return file.encode()


def _y_up(vectors: Float32s) -> Float32s:
    """Return (x, z, −y) of world vectors (x, y, z)."""
    return np.ascontiguousarray(np.stack([vectors[:, 0], vectors[:, 2], -vectors[:, 1]], axis=1) + np.float32(0))


class _File:
    """Collects buffer views and accessors."""

    def __init__(self) -> None:
        self.meshes: list[dict[str, Any]] = []
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._parts: list[bytes] = []
        self._length = 0

    def _view(self, data: bytes, target: int, stride: int | None = None) -> int:
        view = {"buffer": 0, "byteOffset": self._length, "byteLength": len(data), "target": target}
        self._views.append(view if stride is None else view | {"byteStride": stride})
        self._parts += [data, b"\0" * (-len(data) % 4)]
        self._length += len(data) + (-len(data) % 4)
        return len(self._views) - 1

    def add(
        self, rows: NDArray[Any], kind: str, *, component: int = FLOAT, target: int = VERTICES, bounds: bool = False
    ) -> int:
        """Add an accessor with a view of its own; return its index."""
        accessor: dict[str, Any] = {
            "bufferView": self._view(rows.astype(rows.dtype.newbyteorder("<")).tobytes(), target),
            "componentType": component,
            "count": len(rows),
            "type": kind,
        }
        if bounds:
            accessor |= {"min": rows.min(axis=0).tolist(), "max": rows.max(axis=0).tolist()}
        self._accessors.append(accessor)
        return len(self._accessors) - 1

    def add_interleaved(self, transfer: Float32s) -> dict[str, int]:
        """Add the lanes of a transfer ``(V, n)``; return accessors by attribute."""
        count, width = transfer.shape
        slots = -(-width // LANES)
        if 4 * LANES * slots > MAX_STRIDE:
            raise ValueError(f"{width} coefficients a vertex cannot be baked; {MAX_STRIDE // 16 * 4} can (7 bands)")
        padded = np.zeros((count, slots * LANES), "<f4")
        padded[:, :width] = transfer
        stride = 4 * LANES * slots
        view = self._view(padded.tobytes(), VERTICES, stride)
        found = {}
        for slot in range(slots):
            offset = 4 * LANES * slot
            self._accessors.append(
                {"bufferView": view, "byteOffset": offset, "componentType": FLOAT, "count": count, "type": "VEC4"}
            )
            found[f"_PRT{slot}"] = len(self._accessors) - 1
        return found

    def encode(self) -> bytes:
        """Return the file."""
        document = {
            "asset": {"version": "2.0", "generator": f"Lightwell {__version__}"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self.meshes)))}],
            "nodes": [{"name": mesh["name"], "mesh": index} for index, mesh in enumerate(self.meshes)],
            "meshes": self.meshes,
            # Albedo is in the vertices; a white diffuse material leaves it as it is.
            "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": 1}}],
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._length}],
        }
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        total = 12 + 8 + len(text) + 8 + self._length
        if total > MAX_BYTES:
            raise ValueError(f"the GLB file would have {total} bytes; it can have {MAX_BYTES}: set bake to false")
        head = struct.pack("<4sII", b"glTF", 2, total) + struct.pack("<II", len(text), JSON_CHUNK)
        return b"".join([head, text, struct.pack("<II", self._length, BINARY_CHUNK), *self._parts])
