"""All objects of a scene as one surface: what rays meet, and what is there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from lightwell.conventions import LUMINANCE
from lightwell.geometry.mesh import Mesh, front_normals, make_mesh
from lightwell.geometry.rays import RayScene
from lightwell.igi.coverage import ABSENT, WHOLE, Coverage, by_material
from lightwell.igi.holes import HoledScene
from lightwell.igi.materials import IgiMaterial, phong_exponent
from lightwell.igi.scene import IgiObject, IgiScene
from lightwell.igi.textures import Texture
from lightwell.transfer.surface import LIFT_ULPS, merge

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Int32s = NDArray[np.int32]

_AXES = np.eye(3, dtype=np.float32)
LEAST_COSINE = np.float32(0.05)
"""Of a ray to a surface: it is taken for no more slanting where textures are averaged."""
MOST_CENTRES = 1 << 16
"""So many triangles are looked at for the mean reflectivity."""


class SurfacePoints(NamedTuple):
    """What is at n points that rays have met, float32; normals are on the side from which the rays came."""

    position: Singles
    """``(n, 3)`` metres."""
    geometric: Singles
    """``(n, 3)``: the triangle's unit normal."""
    shading: Singles
    """``(n, 3)``: the unit normal that the matte part and the lobe go by: interpolated, and turned by textures."""
    kd: Singles
    """``(n, 3)``: reflectivity of the matte part."""
    ks: Singles
    """``(n, 3)``: of the Phong lobe."""
    exponent: Singles
    """``(n,)``: of the lobe."""
    emission: Singles
    """``(n, 3)`` radiance; zero on the back of what is not two-sided."""
    reflects: NDArray[np.bool_]
    """``(n,)``: false on the back of what is not two-sided."""


class Surfaces:
    """All triangles of a scene; immutable, for any number of threads."""

    def __init__(self, scene: IgiScene) -> None:
        self.objects = tuple(item for item in scene.objects if len(item.mesh.triangles))
        meshes = [item.mesh for item in self.objects] or [make_mesh("nothing", [[0, 0, 0]], [])]
        self.mesh: Mesh = merge(meshes)
        fronts, areas = front_normals(self.mesh)
        self.fronts: Singles = fronts.astype(np.float32)
        """``(F, 3)`` unit normals of the triangles, zero where one is degenerate."""
        self.areas: Floats = areas
        """``(F,)`` m²."""
        counts = np.array([len(item.mesh.triangles) for item in self.objects], np.int64)
        self.owner: Int32s = np.repeat(np.arange(len(counts), dtype=np.int32), counts)
        """``(F,)``: which object."""
        lower, upper = (corner.astype(np.float64) for corner in self.mesh.bounds)
        self.centre: Floats = (lower + upper) / 2
        self.radius = float(np.linalg.norm(upper - lower)) / 2
        """Of a sphere round everything, metres."""
        largest = float(np.abs(self.mesh.positions).max())
        # Rays are precise to a few units in the last place; more would take small things' shadows off a wide ground.
        self.lift = LIFT_ULPS * float(np.spacing(np.float32(largest)))
        """How far rays start above a surface, metres."""
        self._table = _table(self.objects)
        self._uv = _merged_uv(self.objects)
        self._tangents = _merged_tangents(self.objects)
        self._materials, self._made_of = by_material(self.objects)
        self._textured = [number for number, material in enumerate(self._materials) if material.textures]
        made_of = self._made_of[self.owner]
        self._coverage = Coverage(self.objects, self._materials, self.mesh.triangles, made_of, self._uv)
        kind = self._coverage.kind
        self._has_holes = bool((kind != WHOLE).any())
        self.rays: RayScene = (
            HoledScene(self.mesh, kind, self._coverage.solid, self.lift) if self._has_holes else RayScene([self.mesh])
        )
        """What rays meet: nothing where there is a hole."""

    @property
    def area(self) -> float:
        """Of all triangles that are not all hole, m²."""
        return float(self.areas[self._coverage.kind != ABSENT].sum() if self._has_holes else self.areas.sum())

    def mean_reflectivity(self) -> float:
        """Return the mean of ``kd + ks`` over the area, by luminance: ρ̄ of Keller's termination."""
        if not self.area > 0:
            return 0.0
        step = -(-len(self.areas) // MOST_CENTRES)
        triangles = np.arange(0, len(self.areas), step)
        middles = np.full((len(triangles), 2), 1 / 3, np.float32)
        points = self.at(triangles, middles, -self.fronts[triangles])
        colour = (points.kd + points.ks).astype(np.float64) @ LUMINANCE
        areas = self.areas[triangles]
        if self._has_holes:
            areas = areas * self._coverage.solid(triangles, middles)
        return float(np.average(colour, weights=areas + 1e-300))

    def emission(self, triangles: NDArray[np.integer], barycentric: Floats) -> Floats:
        """Return the radiance ``(n, 3)`` of the fronts at points of triangles, which is zero in holes."""
        places = barycentric.astype(np.float32)
        emission = self.at(triangles, places, -self.fronts[triangles]).emission.astype(np.float64)
        if self._has_holes:
            emission[~self._coverage.solid(triangles, places)] = 0
        return emission

    def at(
        self,
        triangles: NDArray[np.integer],
        barycentric: Singles,
        directions: Singles,
        width: Singles | None = None,
    ) -> SurfacePoints:
        """Return what is at points of triangles ``(n,)``, at ``(n, 2)``, that rays meet along ``(n, 3)``.

        ``width (n,)``: metres that rays are wide there, over which textures are averaged; by default they are lines.
        """
        corners = self.mesh.triangles[triangles]
        weights = np.stack([1 - barycentric[:, 0] - barycentric[:, 1], barycentric[:, 0], barycentric[:, 1]], axis=1)
        owner = self.owner[triangles]
        fronts = self.fronts[triangles]
        behind = _dot(fronts, directions) > 0
        side = np.where(behind, np.float32(-1), np.float32(1))[:, None]
        table = self._table
        normals = _interpolated(self.mesh.normals, corners, weights)
        if table.is_flat.any():
            normals = np.where(table.is_flat[owner][:, None], fronts, normals)
        base = table.base[owner]
        own = table.by_vertex[owner]
        if own.any():
            base[own] = _interpolated(self.mesh.albedo, corners[own], weights[own])
        metallic, roughness, emission = table.metallic[owner], table.roughness[owner], table.emission[owner]
        made_of = self._made_of[owner] if self._textured else owner
        if width is not None:
            # A square as large as what a slanting ray covers, which is longer than it is wide.
            cosine = np.maximum(np.abs(_dot(fronts, directions)), LEAST_COSINE)
            width = np.asarray(width / np.sqrt(cosine), np.float32)
        for number in self._textured:
            here = np.flatnonzero(made_of == number)
            if not here.size:
                continue
            material = self._materials[number]
            spot = _Spot(
                self,
                triangles[here],
                corners[here],
                weights[here],
                normals[here],
                None if width is None else width[here],
            )
            if (texture := material.base_texture) is not None:
                base[here] *= np.clip(spot.value(texture), 0, 1)
            if (texture := material.metallic_roughness_texture) is not None:
                values = np.clip(spot.value(texture), 0, 1)
                roughness[here] *= values[:, 1]
                metallic[here] *= values[:, 2]
            if (texture := material.emission_texture) is not None:
                emission[here] *= np.maximum(spot.value(texture), 0)
            if material.normal_texture is not None or material.bump_texture is not None:
                normals[here] = spot.turned_normals(material)
        normals = _unit(normals, fronts)
        specular = table.specular[owner]
        rest = (1 - metallic)[:, None]
        visible = ~behind | table.two_sided[owner]
        emission[~visible] = 0
        return SurfacePoints(
            _interpolated(self.mesh.positions, corners, weights),
            fronts * side,
            normals * side,
            base * rest * (1 - specular)[:, None],
            specular[:, None] * rest + base * metallic[:, None],
            phong_exponent(roughness).astype(np.float32),
            emission,
            visible,
        )

    def two_sided(self, triangles: NDArray[np.integer]) -> NDArray[np.bool_]:
        """Say of triangles ``(n,)`` whether their backs are seen too, and shine and reflect as their fronts do."""
        return np.asarray(self._table.two_sided[self.owner[triangles]])

    def hidden(self, triangles: NDArray[np.integer], directions: Singles) -> NDArray[np.bool_]:
        """Say of hits ``(n,)`` of rays along ``(n, 3)`` whether they are on backs that are not seen."""
        behind = _dot(self.fronts[triangles], directions) > 0
        return np.asarray(behind & ~self.two_sided(triangles))

    def uv_of(self, number: int) -> Singles:
        """Return set ``number`` of texture coordinates of all vertices, ``(V, 2)``; zero where an object has none."""
        return self._uv[number]

    @property
    def tangents(self) -> Singles | None:
        """``(V, 4)``, zero where an object brings none; None where no object does."""
        return self._tangents


class _Spot:
    """Points of one object, and what its textures need to know of them."""

    def __init__(
        self,
        surfaces: Surfaces,
        triangles: NDArray[np.integer],
        corners: Int32s,
        weights: Singles,
        normals: Singles,
        width: Singles | None,
    ) -> None:
        self._surfaces, self._triangles, self._corners, self._weights = surfaces, triangles, corners, weights
        self._width = width
        self._normals = _unit(normals, surfaces.fronts[triangles])
        self._known: dict[int, Singles] = {}

    def uv(self, number: int) -> Singles:
        if number not in self._known:
            self._known[number] = _interpolated(self._surfaces.uv_of(number), self._corners, self._weights)
        return self._known[number]

    def value(self, texture: Texture) -> Singles:
        """Return what a texture says, ``(n, C)``."""
        return texture.at(self.uv(texture.uv_set), None if self._width is None else self._uv_width(texture.uv_set))

    def _uv_width(self, number: int) -> Singles:
        """Return how wide rays are in texture coordinates, ``(n,)``: the root of how areas are mapped."""
        assert self._width is not None
        uv = self._surfaces.uv_of(number)[self._corners]
        d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        mapped = np.abs(d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1]) / 2
        area = np.maximum(self._surfaces.areas[self._triangles].astype(np.float32), np.float32(1e-30))
        return np.asarray(self._width * np.sqrt(mapped / area), np.float32)

    def turned_normals(self, material: IgiMaterial) -> Singles:
        """Return the normals as the normal or the bump texture turns them, ``(n, 3)``, not of unit length."""
        n = self._normals
        if (texture := material.normal_texture) is not None:
            local = 2 * self.value(texture) - 1
            local[:, :2] *= np.float32(material.normal_scale)
            tangent, bitangent = self._frame(texture.uv_set)
            return np.asarray(local[:, :1] * tangent + local[:, 1:2] * bitangent + local[:, 2:] * n, np.float32)
        texture = material.bump_texture
        assert texture is not None
        # Heights h lift the surface by h n: its normal is n − ∇h, ∇h = h_u ∇u + h_v ∇v along the surface.
        slopes = texture.slopes_at(self.uv(texture.uv_set)) * np.float32(material.bump_metres)
        along_u, along_v = self._uv_gradients(texture.uv_set)
        lifted = slopes[:, :1] * along_u + slopes[:, 1:] * along_v
        lifted -= _dot(lifted, n)[:, None] * n
        return np.asarray(n - lifted, np.float32)

    def _frame(self, uv_set: int) -> tuple[Singles, Singles]:
        """Return unit tangents and bitangents, ``(n, 3)``; as glTF has it the bitangent runs against v."""
        n = self._normals
        given = self._surfaces.tangents
        along_u, along_v = self._edges_by_uv(uv_set)
        tangent, side = along_u, np.where(_dot(np.cross(n, along_u), along_v) > 0, np.float32(-1), np.float32(1))
        if given is not None:
            brought = _interpolated(given, self._corners, self._weights)
            has = np.abs(brought[:, :3]).sum(axis=1) > 1e-6
            tangent = np.where(has[:, None], brought[:, :3], tangent)
            side = np.where(has, np.sign(brought[:, 3]), side)
        tangent = tangent - _dot(tangent, n)[:, None] * n
        # Any direction along the surface will do where texture coordinates say nothing.
        other = np.cross(n, np.where(np.abs(n[:, :1]) < 0.6, _AXES[0], _AXES[1]))
        tangent = _unit(tangent, other.astype(np.float32))
        return tangent, np.asarray(np.cross(n, tangent) * side[:, None], np.float32)

    def _edges_by_uv(self, uv_set: int) -> tuple[Singles, Singles]:
        """Return ``∂p/∂u`` and ``∂p/∂v`` of the triangles, ``(n, 3)``; zero where the coordinates are degenerate."""
        p = self._surfaces.mesh.positions[self._corners]
        uv = self._surfaces.uv_of(uv_set)[self._corners]
        e1, e2 = p[:, 1] - p[:, 0], p[:, 2] - p[:, 0]
        d1, d2 = uv[:, 1] - uv[:, 0], uv[:, 2] - uv[:, 0]
        area = (d1[:, 0] * d2[:, 1] - d2[:, 0] * d1[:, 1])[:, None]
        safe = np.where(np.abs(area) > 1e-20, area, np.float32(np.inf))
        along_u = (e1 * d2[:, 1:] - e2 * d1[:, 1:]) / safe
        along_v = (e2 * d1[:, :1] - e1 * d2[:, :1]) / safe
        return np.asarray(along_u, np.float32), np.asarray(along_v, np.float32)

    def _uv_gradients(self, uv_set: int) -> tuple[Singles, Singles]:
        """Return the gradients of u and v along the triangles, per metre, ``(n, 3)``: dual to ``∂p/∂u, ∂p/∂v``."""
        along_u, along_v = self._edges_by_uv(uv_set)
        uu, vv, uv = _dot(along_u, along_u), _dot(along_v, along_v), _dot(along_u, along_v)
        area = uu * vv - uv * uv
        safe = np.where(area > 1e-30, area, np.float32(np.inf))[:, None]
        of_u = (vv[:, None] * along_u - uv[:, None] * along_v) / safe
        of_v = (uu[:, None] * along_v - uv[:, None] * along_u) / safe
        return np.asarray(of_u, np.float32), np.asarray(of_v, np.float32)


class _Table(NamedTuple):
    """Materials by object, float32."""

    base: Singles
    by_vertex: NDArray[np.bool_]
    metallic: Singles
    roughness: Singles
    specular: Singles
    emission: Singles
    two_sided: NDArray[np.bool_]
    is_flat: NDArray[np.bool_]


def _table(objects: tuple[IgiObject, ...]) -> _Table:
    materials = [item.material for item in objects]

    def column(values: list[object], width: tuple[int, ...] = ()) -> Singles:
        return np.array(values, np.float32).reshape(len(materials), *width)

    return _Table(
        column([material.base or (0, 0, 0) for material in materials], (3,)),
        np.array([material.base is None for material in materials], np.bool_),
        column([material.metallic for material in materials]),
        column([material.roughness for material in materials]),
        column([material.specular for material in materials]),
        column([material.emission for material in materials], (3,)),
        np.array([material.two_sided for material in materials], np.bool_),
        np.array([item.is_flat for item in objects], np.bool_),
    )


def _merged_uv(objects: tuple[IgiObject, ...]) -> list[Singles]:
    return [
        np.concatenate(
            [item.uv[number] if number < len(item.uv) else np.zeros((len(item.mesh.positions), 2)) for item in objects]
        ).astype(np.float32)
        for number in range(max((len(item.uv) for item in objects), default=0))
    ]


def _merged_tangents(objects: tuple[IgiObject, ...]) -> Singles | None:
    if all(item.tangents is None for item in objects):
        return None
    zeros = [np.zeros((len(item.mesh.positions), 4)) for item in objects]
    parts = [none if item.tangents is None else item.tangents for item, none in zip(objects, zeros, strict=True)]
    return np.concatenate(parts).astype(np.float32)


def _interpolated(values: Singles, corners: Int32s, weights: Singles) -> Singles:
    """Return values ``(V, C)`` at points of triangles, ``(n, C)``; each point by itself, to the last bit."""
    return np.asarray(
        weights[:, :1] * values[corners[:, 0]]
        + weights[:, 1:2] * values[corners[:, 1]]
        + weights[:, 2:] * values[corners[:, 2]]
    )


def _dot(a: Singles, b: Singles) -> Singles:
    return np.asarray(a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2])


def _unit(vectors: Singles, otherwise: Singles) -> Singles:
    """Return unit vectors; where one has no length, that of ``otherwise``, and +Z where that has none either."""
    length = np.sqrt(_dot(vectors, vectors))[:, None]
    unit = vectors / np.maximum(length, np.float32(1e-20))
    if (length < 1e-12).any():
        second = np.sqrt(_dot(otherwise, otherwise))[:, None]
        spare = np.where(second > 1e-12, otherwise / np.maximum(second, np.float32(1e-20)), _AXES[2])
        unit = np.where(length < 1e-12, spare, unit)
    return np.asarray(unit, np.float32)
