"""Base colours of a glTF file at vertices: factor, picture and colours of the vertices (glTF 2.0 §3.9.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.io.gltf_data import GltfData
from lightwell.io.texture_pixels import decoded

GLOSSY = "KHR_materials_pbrSpecularGlossiness"
TRANSFORM = "KHR_texture_transform"
PICTURE_EXTENSIONS = ("EXT_texture_webp", "EXT_texture_avif")

MAX_KEPT_PIXELS = 1 << 27
"""Of all pictures that are kept for the next object, which is likely to use the same."""

Sample = Callable[[NDArray[np.uint8], NDArray[np.float64]], NDArray[np.float64]]
"""Takes sRGB pixels ``(H, W, 3)`` and ``uv (V, 2)``, v pointing up; returns linear colours ``(V, 3)``."""


class Pictures:
    """The pictures of a document; each is decoded once, however many objects wear it."""

    def __init__(self, document: Mapping[str, Any], data: GltfData, sample: Sample) -> None:
        """Take a checked document, its data, and what looks colours up in pixels."""
        self._document = document
        self._data = data
        self.sample = sample
        self._kept: dict[int, NDArray[np.uint8] | None] = {}

    def pixels(self, texture: Mapping[str, Any]) -> NDArray[np.uint8] | None:
        """Return bytes ``(H, W, 3)``, with alpha ``(H, W, 4)``, or None where the type is not read (KTX2)."""
        entry = self._document["textures"][texture["index"]]
        extensions = entry.get("extensions", {})
        sources = [extensions[name]["source"] for name in PICTURE_EXTENSIONS if name in extensions]
        sources += [entry["source"]] if "source" in entry else []
        for source in sources:
            if source not in self._kept:
                found = self._read(source)
                total = sum(one.shape[0] * one.shape[1] for one in self._kept.values() if one is not None)
                if found is not None and total + found.shape[0] * found.shape[1] > MAX_KEPT_PIXELS:
                    self._kept.clear()
                self._kept[source] = found
            if self._kept[source] is not None:
                return self._kept[source]
        return None

    def _read(self, source: int) -> NDArray[np.uint8] | None:
        image = self._document["images"][source]
        if "bufferView" in image:
            body = bytes(self._data.view(image["bufferView"]))
        else:
            body = self._data.bytes_of_uri(image["uri"])
        uri = str(image.get("uri", ""))
        name = image.get("name") or (uri[:80] if uri and not uri.startswith("data:") else source)
        return decoded(body, f"picture {name!r}")


def base_colours(
    document: Mapping[str, Any], data: GltfData, primitive: Mapping[str, Any], count: int, pictures: Pictures | None
) -> NDArray[np.float64] | None:
    """Return the linear colour of each vertex, ``(count, 3)``, or None where the file says nothing of it."""
    attributes = primitive["attributes"]
    colours = np.ones((count, 3))
    known = False
    if "material" in primitive:
        material = document["materials"][primitive["material"]]
        rough, glossy = material.get("pbrMetallicRoughness", {}), material.get("extensions", {}).get(GLOSSY, {})
        factor = rough.get("baseColorFactor", glossy.get("diffuseFactor"))
        if factor is not None:
            colours *= np.asarray(factor, np.float64)[:3]
            known = True
        texture = rough.get("baseColorTexture", glossy.get("diffuseTexture"))
        found = None if texture is None or pictures is None else pictures.pixels(texture)
        if pictures is not None and found is not None:
            turn = texture.get("extensions", {}).get(TRANSFORM, {})
            name = f"TEXCOORD_{turn.get('texCoord', texture.get('texCoord', 0))}"
            if name in attributes:
                uv = _moved(data.numbers(attributes[name], 2), turn)
                colours *= pictures.sample(found[:, :, :3], np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1))
                known = True
    if "COLOR_0" in attributes:
        colours *= data.colours(attributes["COLOR_0"])[:, :3]
        known = True
    return colours if known else None


def vertex_alpha(data: GltfData, primitive: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Return the alpha of the colours of vertices, ``(V,)``, or None where they have none."""
    index = primitive["attributes"].get("COLOR_0")
    colours = None if index is None else data.colours(index)
    return None if colours is None or colours.shape[1] < 4 else colours[:, 3]


def _moved(uv: NDArray[np.float64], turn: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return ``uv`` scaled, turned and moved as `KHR_texture_transform` says."""
    if not turn:
        return uv
    angle = float(turn.get("rotation", 0))
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    scaled = uv * np.asarray(turn.get("scale", (1, 1)), np.float64)
    return np.asarray(scaled @ rotation.T + np.asarray(turn.get("offset", (0, 0)), np.float64))
