"""Materials of a glTF file with their textures, as `lightwell.igi` has them (glTF 2.0 §3.9)."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.materials import IgiMaterial
from lightwell.igi.textures import Texture, Wrap
from lightwell.io.gltf_check import GltfError
from lightwell.io.gltf_colours import GLOSSY, TRANSFORM, Pictures

STRENGTH = "KHR_materials_emissive_strength"
SPECULAR = "KHR_materials_specular"
INDEX = "KHR_materials_ior"
TRANSMISSION = "KHR_materials_transmission"
UNLIT = "KHR_materials_unlit"
LEFT_OUT = {
    "KHR_materials_clearcoat": "the coat is left out",
    "KHR_materials_sheen": "the sheen is left out",
    "KHR_materials_anisotropy": "the gloss is the same in all directions",
    "KHR_materials_iridescence": "the gloss has no colours of a thin film",
    "KHR_materials_diffuse_transmission": "no light shines through",
    UNLIT: "shown as matte paint, and lit",
}
"""What a picture would show otherwise, and how it shows it here."""
MOST_NAMES = 5
"""So many materials are named in a remark."""
HALF = 0.5
"""What lets more light through than this is a hole, and the rest is opaque: nearest to the truth."""

WRAPS: dict[int, Wrap] = {10497: "repeat", 33648: "mirror", 33071: "clamp"}
NEAREST = 9728
MAX_TEXELS = 1 << 28
"""Of all pictures together; they take 3 bytes each, or 4."""


class Materials:
    """The materials of a document; each picture is decoded once, however many use it."""

    def __init__(self, document: Mapping[str, Any], pictures: Pictures) -> None:
        """Take a checked document and what decodes its pictures."""
        self._document = document
        self._pictures = pictures
        self._made: dict[int, IgiMaterial] = {}
        self._texels: dict[str, NDArray[np.uint8]] = {}
        self._textures: dict[tuple[str, str], Texture | None] = {}
        self._said: dict[str, dict[str, None]] = {}

    @property
    def remarks(self) -> list[str]:
        """What a picture will not show, and of which materials; a line each."""
        return [f"{_listed(list(names))}: {what}" for what, names in self._said.items()]

    def _say(self, name: str, what: str) -> None:
        self._said.setdefault(what, {})[name] = None

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
            self._made[index] = self._material(self._document["materials"][index], self._name(index))
        made = self._made[index]
        if made.hole_below > 0 and self._document["materials"][index].get("alphaMode") != "MASK":
            coloured = primitive["attributes"].get("COLOR_0")
            varies = coloured is not None and self._document["accessors"][coloured]["type"] == "VEC4"
            said = _of_translucent(made, varies)
            if said is not None:
                self._say(self._name(index), said)
        return made

    def _name(self, index: int) -> str:
        return repr(self._document["materials"][index].get("name", index))

    def _material(self, material: Mapping[str, Any], name: str) -> IgiMaterial:
        extensions = material.get("extensions", {})
        rough = material.get("pbrMetallicRoughness", {})
        glossy = None if rough else extensions.get(GLOSSY)
        if glossy is not None:
            metallic, roughness = 0.0, 1 - float(glossy.get("glossinessFactor", 1))
            specular = float(np.mean(glossy.get("specularFactor", (1, 1, 1))))
            base, both = glossy.get("diffuseTexture"), None
            if "specularGlossinessTexture" in glossy:
                self._say(name, "the picture of gloss is left out; convert it to metallic-roughness")
        else:
            metallic, roughness = float(rough.get("metallicFactor", 1)), float(rough.get("roughnessFactor", 1))
            specular = self._specular(extensions, name)
            base, both = rough.get("baseColorTexture"), rough.get("metallicRoughnessTexture")
        factor = (glossy or {}).get("diffuseFactor") or rough.get("baseColorFactor", (1, 1, 1, 1))
        if UNLIT in extensions:
            metallic, roughness, specular, both = 0.0, 1.0, 0.0, None
        normal = None if UNLIT in extensions else material.get("normalTexture")
        strength = float(extensions.get(STRENGTH, {}).get("emissiveStrength", 1))
        emission = (0, 0, 0) if UNLIT in extensions else material.get("emissiveFactor", (0, 0, 0))
        red, green, blue = (strength * float(value) for value in emission)
        mode = material.get("alphaMode", "OPAQUE")
        through = extensions.get(TRANSMISSION, {})
        transmission = float(through.get("transmissionFactor", 0))
        for key, how in LEFT_OUT.items():
            if key in extensions:
                self._say(name, f"{key}: {how}")
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
            alpha=_fraction(1.0 if mode == "OPAQUE" else float(factor[3]), name, "alpha"),
            alpha_texture=None if mode == "OPAQUE" else self._texture(base, name, "alpha"),
            transmission=_fraction(transmission, name, "transmissionFactor"),
            transmission_texture=self._texture(through.get("transmissionTexture"), name, "numbers")
            if transmission > 0
            else None,
            hole_below=_hole_below(material, transmission),
            two_sided=bool(material.get("doubleSided", False)),
        )

    def _specular(self, extensions: Mapping[str, Any], name: str) -> float:
        """Return the reflectance, seen head-on, of what is not metal."""
        index = float(extensions[INDEX].get("ior", 1.5)) if INDEX in extensions else 1.5
        # An index of 0 stands for a mirror: what was made of specular-glossiness has it.
        head_on = 1.0 if index == 0 else ((index - 1) / (index + 1)) ** 2
        extra = extensions.get(SPECULAR, {})
        if "specularTexture" in extra or "specularColorTexture" in extra:
            self._say(name, f"the pictures of {SPECULAR} are left out; the gloss is even")
        tint = float(np.mean(extra.get("specularColorFactor", (1, 1, 1))))
        return min(head_on * tint, 1.0) * float(extra.get("specularFactor", 1))

    def _texture(self, info: Mapping[str, Any] | None, material: str, kind: str) -> Texture | None:
        """Return a texture, the same one for the same words: its smaller pictures are made once."""
        if info is None:
            return None
        said = (json.dumps(info, sort_keys=True), kind)
        if said not in self._textures:
            self._textures[said] = self._new_texture(info, material, kind)
        return self._textures[said]

    def _new_texture(self, info: Mapping[str, Any], material: str, kind: str) -> Texture | None:
        entry = self._document["textures"][info["index"]]
        pixels = self._pixels(info, entry, material)
        if kind == "alpha":
            if pixels.shape[2] < 4:
                return None
            pixels = pixels[:, :, 3:]
        sampler = self._document["samplers"][entry["sampler"]] if "sampler" in entry else {}
        turn = info.get("extensions", {}).get(TRANSFORM, {})
        return Texture(
            pixels[:, :, :3],
            (WRAPS[sampler.get("wrapS", 10497)], WRAPS[sampler.get("wrapT", 10497)]),
            int(turn.get("texCoord", info.get("texCoord", 0))),
            _affine(turn),
            "srgb" if kind == "colour" else "linear",
            sampler.get("magFilter") != NEAREST,
        )

    def _pixels(self, info: Mapping[str, Any], entry: Mapping[str, Any], material: str) -> NDArray[np.uint8]:
        """Return bytes ``(H, W, 3)``, or ``(H, W, 4)`` with alpha."""
        key = json.dumps(
            {name: value for name, value in entry.items() if name not in ("sampler", "name")}, sort_keys=True
        )
        if key not in self._texels:
            found = self._pictures.pixels(info)
            if found is None:
                raise GltfError(
                    f"material {material} has a picture of a type that is not read (KTX2?); export it with PNG or JPEG"
                )
            total = sum(one.shape[0] * one.shape[1] for one in (*self._texels.values(), found))
            if total > MAX_TEXELS:
                raise GltfError(f"has pictures of {total} pixels together; at most {MAX_TEXELS} are read: shrink them")
            self._texels[key] = found
        return self._texels[key]


def _of_translucent(made: IgiMaterial, varies: bool) -> str | None:
    """Return what is to be said of a material that is no cut-out; nothing where it turns out to be opaque."""
    through = 1 - made.alpha * (1 - made.transmission * (1 - made.metallic))
    if varies or made.alpha_texture is not None or made.transmission_texture is not None:
        return "translucent here and there: a hole where more than half of the light goes through, else opaque"
    if through > 1 - made.hole_below:
        return "most of the light goes through: left out"
    return "translucent, but most of the light is stopped: drawn opaque" if through > 0 else None


def _listed(names: list[str]) -> str:
    if len(names) == 1:
        return f"material {names[0]}"
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"materials {', '.join(names[:MOST_NAMES])}{more}"


def _hole_below(material: Mapping[str, Any], transmission: float) -> float:
    mode = material.get("alphaMode", "OPAQUE")
    if mode == "MASK":
        return float(material.get("alphaCutoff", HALF))
    return HALF if mode == "BLEND" or transmission > 0 else 0.0


def _fraction(value: float, material: str, name: str) -> float:
    if not 0 <= value <= 1:
        raise GltfError(f"material {material} has {name} {value:g}, which must lie between 0 and 1; export it again")
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
