"""Where surfaces have holes: cut-outs, and panes that let most of the light through.

Visibility is yes or no here (paper 004 §3.2), and the same for rays of the camera, of paths and of shadows. So a point
of a surface is there or it is not: it is a hole where ``alpha (1 − transmission (1 − metallic))`` is less than the
material's `hole_below`. For glTF that is the cut-off of ``MASK``, and one half for what is translucent, since nearest
to the truth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from lightwell.igi.materials import IgiMaterial
from lightwell.igi.scene import IgiObject
from lightwell.igi.textures import Singles, Texture

Bools = NDArray[np.bool_]
Int32s = NDArray[np.int32]

WHOLE, CUT, ABSENT = 0, 1, 2
"""Of triangles: there everywhere, with holes perhaps, nowhere."""


class Coverage:
    """Says which points of triangles are there; immutable, for any number of threads."""

    def __init__(
        self,
        objects: Sequence[IgiObject],
        materials: Sequence[IgiMaterial],
        triangles: Int32s,
        material_of: Int32s,
        uv: Sequence[Singles],
    ) -> None:
        """Take the objects and their materials, and of all together the triangles and texture coordinates.

        ``triangles (F, 3)``; ``material_of (F,)``: which of the materials each has.
        """
        self._triangles, self._uv = triangles, uv
        self._alpha = _merged_alpha(objects)
        self._materials, self._material_of = materials, material_of
        cut = [number for number, material in enumerate(self._materials) if material.hole_below > 0]
        self.kind: NDArray[np.int8] = np.full(len(triangles), WHOLE, np.int8)
        """``(F,)``: `WHOLE`, `CUT` or `ABSENT`."""
        for number in cut:
            here = np.flatnonzero(self._material_of == number)
            lowest, highest = self._bounds(self._materials[number], here)
            least = self._materials[number].hole_below
            self.kind[here] = np.where(lowest >= least, WHOLE, np.where(highest < least, ABSENT, CUT))

    def solid(self, triangles: NDArray[np.integer], barycentric: Singles) -> Bools:
        """Return ``(n,)``: whether there is a surface at points of triangles ``(n,)``, ``(n, 2)``."""
        kind = self.kind[triangles]
        there = np.asarray(kind != ABSENT)
        unsure = np.flatnonzero(kind == CUT)
        made_of = self._material_of[triangles[unsure]]
        for number in np.unique(made_of):
            here = unsure[made_of == number]
            there[here] = self._there(self._materials[number], triangles[here], barycentric[here])
        return there

    def _there(self, material: IgiMaterial, triangles: NDArray[np.integer], barycentric: Singles) -> Bools:
        corners = self._triangles[triangles]
        u, v = barycentric[:, 0], barycentric[:, 1]
        weights = (1 - u - v, u, v)

        def first(texture: Texture | None, channel: int = 0) -> Singles | float:
            if texture is None:
                return 1.0
            uv = self._uv[texture.uv_set]
            place = sum(weight[:, None] * uv[corners[:, k]] for k, weight in enumerate(weights))
            return np.clip(texture.at(np.asarray(place, np.float32))[:, channel], 0, 1)

        covered = np.full(len(triangles), np.float32(material.alpha)) * first(material.alpha_texture)
        if self._alpha is not None:
            covered = covered * sum(weight * self._alpha[corners[:, k]] for k, weight in enumerate(weights))
        if material.transmission > 0:
            through = np.float32(material.transmission) * first(material.transmission_texture)
            metallic = np.float32(material.metallic) * first(material.metallic_roughness_texture, 2)
            covered = covered * (1 - through * (1 - metallic))
        return np.asarray(covered >= np.float32(material.hole_below))

    def _bounds(self, material: IgiMaterial, triangles: NDArray[np.integer]) -> tuple[Singles, Singles]:
        """Return the least and the greatest that is covered, ``(n,)`` or one for all."""
        lowest = highest = np.float32(material.alpha) * np.ones(len(triangles), np.float32)
        if self._alpha is not None:
            corners = self._alpha[self._triangles[triangles]]
            lowest, highest = lowest * corners.min(axis=1), highest * corners.max(axis=1)
        least, most = _range(material.alpha_texture)
        lowest, highest = lowest * least, highest * most
        if material.transmission > 0:
            thin, thick = _range(material.transmission_texture)
            other, metal = _range(material.metallic_roughness_texture, 2)
            lowest = lowest * np.float32(1 - material.transmission * thick * (1 - material.metallic * other))
            highest = highest * np.float32(1 - material.transmission * thin * (1 - material.metallic * metal))
        return lowest, highest


def by_material(objects: Sequence[IgiObject]) -> tuple[list[IgiMaterial], Int32s]:
    """Return the materials of objects, each once, and which of them each object has, ``(O,)``."""
    materials = list(dict.fromkeys(item.material for item in objects))
    number = {material: index for index, material in enumerate(materials)}
    return materials, np.array([number[item.material] for item in objects], np.int32)


def _range(texture: Texture | None, channel: int = 0) -> tuple[float, float]:
    if texture is None:
        return 1.0, 1.0
    lowest, highest = texture.bounds
    return float(np.clip(lowest[channel], 0, 1)), float(np.clip(highest[channel], 0, 1))


def _merged_alpha(objects: Sequence[IgiObject]) -> Singles | None:
    if all(item.alpha is None for item in objects):
        return None
    parts = [np.ones(len(item.mesh.positions)) if item.alpha is None else item.alpha for item in objects]
    return np.concatenate(parts).astype(np.float32)
