"""Numbers of a glTF file (glTF 2.0 §3.6): buffers, views and accessors, quantised and sparse ones too."""

from __future__ import annotations

import base64
import binascii
from collections.abc import Callable, Mapping
from typing import Any
from urllib.parse import unquote, unquote_to_bytes

import numpy as np
from numpy.typing import NDArray

from lightwell.io.gltf_check import TYPE_COMPONENTS, GltfError

DTYPES = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}


class GltfData:
    """What a document's accessors and pictures hold; `lightwell.io.gltf_check.check_document` has looked at it."""

    def __init__(self, document: Mapping[str, Any], binary: bytes | None, fetch: Callable[[str], bytes]) -> None:
        """Take the document, the second chunk of a GLB file, and what returns the bytes of a file beside it."""
        self._document = document
        self._binary = binary
        self._fetch = fetch
        self._buffers: dict[int, bytes] = {}

    def bytes_of_uri(self, uri: str) -> bytes:
        """Return what a URI stands for: data that it holds itself, or a file. Raises `GltfError`."""
        scheme, colon, rest = uri.partition(":")
        if not colon or "/" in scheme or len(scheme) == 1:
            return self._fetch(unquote(uri))
        if scheme.lower() != "data":
            raise GltfError(f"names {uri[:80]!r}, which is not read; export it as one GLB file that holds everything")
        head, _, body = rest.partition(",")
        try:
            return base64.b64decode(unquote_to_bytes(body)) if head.endswith(";base64") else unquote_to_bytes(body)
        except binascii.Error:
            raise GltfError("holds data that are not base64; export it again") from None

    def _buffer(self, index: int) -> bytes:
        if index not in self._buffers:
            buffer = self._document["buffers"][index]
            if "uri" in buffer:
                self._buffers[index] = self.bytes_of_uri(buffer["uri"])
            elif index == 0 and self._binary is not None:
                self._buffers[index] = self._binary
            else:
                raise GltfError(f"holds no data for buffer {index}; export it again")
        return self._buffers[index]

    def view(self, index: int) -> memoryview:
        """Return the bytes of a buffer view; raises `GltfError` where the buffer is too short."""
        view = self._document["bufferViews"][index]
        begin, length = view.get("byteOffset", 0), view["byteLength"]
        buffer = self._buffer(view["buffer"])
        if begin < 0 or length < 0 or begin + length > len(buffer):
            raise GltfError(
                f"view {index} reaches to byte {begin + length} of {len(buffer)}: it is cut short; export it again"
            )
        return memoryview(buffer)[begin : begin + length]

    def accessor(self, index: int) -> NDArray[Any]:
        """Return ``(count, components)`` in the file's own type, sparse values put in."""
        accessor = self._document["accessors"][index]
        dtype, width, count = np.dtype(DTYPES[accessor["componentType"]]), _width(accessor), accessor["count"]
        if "bufferView" in accessor:
            values = self._array(accessor["bufferView"], accessor.get("byteOffset", 0), dtype, count, width)
        else:
            values = np.zeros((count, width), dtype)
        sparse = accessor.get("sparse")
        if sparse is None:
            return values
        number, where, what = sparse["count"], sparse["indices"], sparse["values"]
        rows = self._array(
            where["bufferView"], where.get("byteOffset", 0), np.dtype(DTYPES[where["componentType"]]), number, 1
        )[:, 0]
        if number and int(rows.max()) >= count:
            raise GltfError(f"accessor {index} has a sparse item {rows.max()} of {count}; export it again")
        values = values.copy()
        values[rows] = self._array(what["bufferView"], what.get("byteOffset", 0), dtype, number, width)
        return values

    def _array(self, view: int, offset: int, dtype: np.dtype[Any], count: int, width: int) -> NDArray[Any]:
        stride = self._document["bufferViews"][view].get("byteStride", dtype.itemsize * width)
        if count == 0:
            return np.zeros((0, width), dtype)
        return np.ndarray((count, width), dtype, self.view(view), offset, (stride, dtype.itemsize))

    def numbers(self, index: int, width: int) -> NDArray[np.float64]:
        """Return ``(count, width)`` numbers; normalised integers as −1 … 1 or 0 … 1. Raises `GltfError`."""
        accessor = self._document["accessors"][index]
        values = self.accessor(index)
        if values.shape[1] != width:
            raise GltfError(f"accessor {index} has {values.shape[1]} components where {width} are due; export it again")
        numbers = values.astype(np.float64)
        if accessor.get("normalized") and values.dtype.kind in "iu":
            numbers = np.maximum(numbers / np.iinfo(values.dtype).max, -1.0)
        return numbers

    def colours(self, index: int) -> NDArray[np.float64]:
        """Return linear colours, 0 … 1: ``(count, 3)``, or ``(count, 4)`` with alpha."""
        values = self.accessor(index)
        # The specification wants integers to be marked as normalised; files that forget it mean the same.
        most = float(np.iinfo(values.dtype).max) if values.dtype.kind in "iu" else 1.0
        return values.astype(np.float64) / most


def _width(accessor: Mapping[str, Any]) -> int:
    return TYPE_COMPONENTS[accessor["type"]]
