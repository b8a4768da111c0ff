"""Materials of a glTF file with their textures, as `lightwell.igi` has them (glTF 2.0 §3.9)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.materials import DIELECTRIC, IgiMaterial
from lightwell.igi.textures import Texture, Wrap, linear_from_srgb
from lightwell.io.gltf_check import GltfError
from lightwell.io.gltf_colours import GLOSSY, TRANSFORM, Pictures

STRENGTH = "KHR_materials_emissive_strength"
SPECULAR = "KHR_materials_specular"
INDEX = "KHR_materials_ior"
LEFT_OUT = {
    "KHR_materials_transmission": "it is drawn opaque",
    "KHR_materials_clearcoat": "the coat is left out",
    "KHR_materials_sheen": "the sheen is left out",
    "KHR_materials_unlit": "it is lit like the others",
}
"""What a picture would show otherwise, and how it shows it here."""

WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
MAX_TEXELS = 1 << 26
"""Of all pictures together; as float32 they take 12 bytes each."""


class Materials:
    """The materials of a document; each picture is decoded once, however many use it."""

    def __init__(self, document: Mapping[str, Any], pictures: Pictures) -> None:
        """Take a checked document and what decodes its pictures."""
        self._document = document
        self._pictures = pictures
        self._made: dict[int, IgiMaterial] = {}
        self._linear: dict[tuple[str, bool], NDArray[np.float32]] = {}
        self.remarks: list[str] = []
        """What a picture will not show."""

    def material(self, primitive: Mapping[str, Any]) -> IgiMaterial:
        """Return what a primitive is made of; its base colour is left to the vertices.

        Raises
        ------
        GltfError
            Where a picture cannot be had; other errors where the document contradicts itself.
        """
        index = primitive.get("material")
        if index is None:
            return IgiMaterial()
        if index not in self._made:
            self._made[index] = self._material(self._document["materials"][index], f"material {index}")
        return self._made[index]

    def _material(self, material: Mapping[str, Any], name: str) -> IgiMaterial:
        name = f"material {material['name']!r}" if "name" in material else name
        extensions = material.get("extensions", {})
        rough = material.get("pbrMetallicRoughness", {})
        glossy = None if rough else extensions.get(GLOSSY)
        if glossy is not None:
            metallic, roughness = 0.0, 1 - float(glossy.get("glossinessFactor", 1))
            specular = float(np.mean(glossy.get("specularFactor", (1, 1, 1))))
            base, both = glossy.get("diffuseTexture"), None
            if "specularGlossinessTexture" in glossy:
                self.remarks.append(f"{name}: its picture of gloss is left out; convert it to metallic-roughness")
        else:
            metallic, roughness = float(rough.get("metallicFactor", 1)), float(rough.get("roughnessFactor", 1))
            index = float(extensions.get(INDEX, {}).get("ior", 0))
            specular = ((index - 1) / (index + 1)) ** 2 if index > 0 else DIELECTRIC
            specular *= float(extensions.get(SPECULAR, {}).get("specularFactor", 1))
            base, both = rough.get("baseColorTexture"), rough.get("metallicRoughnessTexture")
        normal = material.get("normalTexture")
        strength = float(extensions.get(STRENGTH, {}).get("emissiveStrength", 1))
        red, green, blue = (strength * float(value) for value in material.get("emissiveFactor", (0, 0, 0)))
        if material.get("alphaMode", "OPAQUE") != "OPAQUE":
            self.remarks.append(f"{name}: has holes or is translucent ({material['alphaMode']}); it is drawn opaque")
        self.remarks += [f"{name}: has {key}; {how}" for key, how in LEFT_OUT.items() if key in extensions]
        return IgiMaterial(
            metallic=_fraction(metallic, name, "metallicFactor"),
            roughness=_fraction(roughness, name, "roughnessFactor"),
            specular=_fraction(specular, name, "specular reflectance"),
            emission=(red, green, blue),
            base_texture=self._texture(base, name, "colour"),
            metallic_roughness_texture=self._texture(both, name, "numbers"),
            # A lamp that is off needs no picture.
            emission_texture=self._texture(material.get("emissiveTexture"), name, "colour")
            if red or green or blue
            else None,
            normal_texture=self._texture(normal, name, "numbers"),
            normal_scale=1.0 if normal is None else float(normal.get("scale", 1)),
            two_sided=bool(material.get("doubleSided", False)),
        )

    def _texture(self, info: Mapping[str, Any] | None, material: str, kind: str) -> Texture | None:
        if info is None:
            return None
        entry = self._document["textures"][info["index"]]
        pixels = self._pixels(info, entry, material, kind == "colour")
        sampler = self._document["samplers"][entry["sampler"]] if "sampler" in entry else {}
        turn = info.get("extensions", {}).get(TRANSFORM, {})
        return Texture(
            pixels,
            (WRAPS[sampler.get("wrapS", 10497)], WRAPS[sampler.get("wrapT", 10497)]),
            int(turn.get("texCoord", info.get("texCoord", 0))),
            _affine(turn),
        )

    def _pixels(
        self, info: Mapping[str, Any], entry: Mapping[str, Any], material: str, colour: bool
    ) -> NDArray[np.float32]:
        """Return linear pixels ``(H, W, 3)``."""
        source = {key: value for key, value in entry.items() if key not in ("sampler", "name")}
        key = (json.dumps(source, sort_keys=True), colour)
        if key not in self._linear:
            found = self._pictures.pixels(info)
            if found is None:
                raise GltfError(f"{material} has a picture of a type that is not read; export it with PNG or JPEG")
            total = sum(one.shape[0] * one.shape[1] for one in self._linear.values()) + found.shape[0] * found.shape[1]
            if total > MAX_TEXELS:
                raise GltfError(f"has pictures of {total} pixels together; at most {MAX_TEXELS} are read: shrink them")
            levels = np.arange(256) / 255
            table = linear_from_srgb(levels) if colour else levels.astype(np.float32)
            self._linear[key] = table[found]
        return self._linear[key]


def _fraction(value: float, material: str, name: str) -> float:
    if not 0 <= value <= 1:
        raise GltfError(f"{material} has {name} {value:g}, which must lie between 0 and 1; export it again")
    return value


def _affine(turn: Mapping[str, Any]) -> NDArray[np.float64] | None:
    """Return ``(2, 3)`` of what `KHR_texture_transform` says: scale, then turn, then move."""
    if not turn:
        return None
    angle = float(turn.get("rotation", 0))
    across, down = (float(value) for value in turn.get("scale", (1, 1)))
    move = [float(value) for value in turn.get("offset", (0, 0))]
    cosine, sine = np.cos(angle), np.sin(angle)
    return np.array([[cosine * across, sine * down, move[0]], [-sine * across, cosine * down, move[1]]])
