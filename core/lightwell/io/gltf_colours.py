"""Base colours of a glTF file at vertices: factor, picture and colours of the vertices (glTF 2.0 §3.9.2)."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.io.gltf_data import GltfData

GLOSSY = "KHR_materials_pbrSpecularGlossiness"
TRANSFORM = "KHR_texture_transform"
PICTURE_EXTENSIONS = ("EXT_texture_webp", "EXT_texture_avif")

Sample = Callable[[Any, NDArray[np.float64]], NDArray[np.float64]]
"""Takes a picture of Pillow's and ``uv (V, 2)``, v pointing up; returns linear colours ``(V, 3)``."""


def base_colours(
    document: Mapping[str, Any], data: GltfData, primitive: Mapping[str, Any], count: int, sample: Sample
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
        found = None if texture is None else _picture(document, data, texture)
        if texture is not None and found is not None:
            turn = texture.get("extensions", {}).get(TRANSFORM, {})
            name = f"TEXCOORD_{turn.get('texCoord', texture.get('texCoord', 0))}"
            if name in attributes:
                uv = _moved(data.numbers(attributes[name], 2), turn)
                colours *= sample(found, np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1))
                known = True
    if "COLOR_0" in attributes:
        colours *= data.colours(attributes["COLOR_0"])
        known = True
    return colours if known else None


def _moved(uv: NDArray[np.float64], turn: Mapping[str, Any]) -> NDArray[np.float64]:
    """Return ``uv`` scaled, turned and moved as `KHR_texture_transform` says."""
    if not turn:
        return uv
    angle = float(turn.get("rotation", 0))
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    scaled = uv * np.asarray(turn.get("scale", (1, 1)), np.float64)
    return np.asarray(scaled @ rotation.T + np.asarray(turn.get("offset", (0, 0)), np.float64))


def _picture(document: Mapping[str, Any], data: GltfData, texture: Mapping[str, Any]) -> Any:  # noqa: ANN401
    """Return a picture of Pillow's, or None where it is of a type that is not read (KTX2)."""
    from PIL import Image, UnidentifiedImageError

    entry = document["textures"][texture["index"]]
    extensions = entry.get("extensions", {})
    sources = [extensions[name]["source"] for name in PICTURE_EXTENSIONS if name in extensions]
    sources += [entry["source"]] if "source" in entry else []
    for source in sources:
        image = document["images"][source]
        body = bytes(data.view(image["bufferView"])) if "bufferView" in image else data.bytes_of_uri(image["uri"])
        try:
            return Image.open(io.BytesIO(body))
        except UnidentifiedImageError:
            continue
    return None
