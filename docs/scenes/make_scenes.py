"""The glTF scenes of this folder: python docs/scenes/make_scenes.py. Own work, CC0 1.0; the same bytes every time.

`room.glb` has emissive panels, a screen, a spot and textures; `floor.glb` a bump-mapped floor under a low lamp;
`ground.glb` a glossy, normal-mapped ground for an object that is lit by a map.
"""

from __future__ import annotations

import io
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from lightwell.geometry.mesh import Mesh, make_mesh
from lightwell.geometry.shapes import box, sphere

FOLDER = Path(__file__).parent
Floats = NDArray[np.float64]


class SceneFile:
    """A GLB file that grows. Takes world axes (+Z up) and writes glTF's (+Y up)."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0", "generator": "docs/scenes/make_scenes.py", "copyright": "CC0 1.0"},
            "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_emissive_strength"],
            "scene": 0,
            "samplers": [{}],
            "extensions": {"KHR_lights_punctual": {"lights": []}},
        }
        for name in ("nodes", "meshes", "materials", "accessors", "bufferViews", "images", "textures", "cameras"):
            self.document[name] = []
        self._binary = b""

    def _add(self, name: str, entry: dict[str, Any]) -> int:
        self.document[name].append(entry)
        return len(self.document[name]) - 1

    def _view(self, data: bytes) -> int:
        begin = len(self._binary)
        self._binary += data + b"\0" * (-len(data) % 4)
        return self._add("bufferViews", {"buffer": 0, "byteOffset": begin, "byteLength": len(data)})

    def _rows(self, rows: ArrayLike, kind: str, **more: list[float]) -> int:
        array = np.asarray(rows)
        array = array.astype("<u4" if array.dtype.kind in "iu" else "<f4")
        component = 5125 if array.dtype.kind == "u" else 5126
        view = self._view(array.tobytes())
        entry = {"bufferView": view, "componentType": component, "count": len(array), "type": kind}
        return self._add("accessors", entry | more)

    def texture(self, pixels: Floats) -> dict[str, Any]:
        """Add a picture of values 0 … 1, as they are to be stored; return what a material refers to."""
        body = io.BytesIO()
        Image.fromarray(np.rint(np.clip(pixels, 0, 1) * 255).astype(np.uint8)).save(body, "PNG", optimize=True)
        image = self._add("images", {"bufferView": self._view(body.getvalue()), "mimeType": "image/png"})
        return {"index": self._add("textures", {"source": image, "sampler": 0})}

    def material(
        self,
        name: str,
        base: ArrayLike = (0.8, 0.8, 0.8),
        roughness: float = 1.0,
        metallic: float = 0.0,
        emission: float = 0.0,
        colour: ArrayLike = (1.0, 1.0, 1.0),
        **more: dict[str, Any],
    ) -> int:
        """Add a material of linear colours; ``picture``, ``normal`` and ``glow`` are textures."""
        rough: dict[str, Any] = {
            "baseColorFactor": [*np.asarray(base, float).tolist(), 1.0],
            "metallicFactor": metallic,
            "roughnessFactor": roughness,
        }
        entry: dict[str, Any] = {"name": name, "pbrMetallicRoughness": rough}
        if "picture" in more:
            rough["baseColorTexture"] = more["picture"]
        if "normal" in more:
            entry["normalTexture"] = more["normal"]
        if emission:
            entry["emissiveFactor"] = np.asarray(colour, float).tolist()
            entry["extensions"] = {"KHR_materials_emissive_strength": {"emissiveStrength": emission}}
        if "glow" in more:
            entry["emissiveTexture"] = more["glow"]
        return self._add("materials", entry)

    def object(self, mesh: Mesh, material: int, uv: ArrayLike | None = None) -> int:
        """Add a mesh and a node that shows it; return the mesh."""
        positions = _y_up(mesh.positions)
        attributes = {
            "POSITION": self._rows(
                positions, "VEC3", min=positions.min(axis=0).tolist(), max=positions.max(axis=0).tolist()
            ),
            "NORMAL": self._rows(_y_up(mesh.normals), "VEC3"),
        }
        if uv is not None:
            attributes["TEXCOORD_0"] = self._rows(np.asarray(uv, np.float32), "VEC2")
        indices = self._rows(mesh.triangles.reshape(-1), "SCALAR")
        primitive = {"attributes": attributes, "indices": indices, "material": material}
        index = self._add("meshes", {"name": mesh.name, "primitives": [primitive]})
        self._add("nodes", {"name": mesh.name, "mesh": index})
        return index

    def instance(self, mesh: int, at: ArrayLike, scale: float = 1.0) -> None:
        """Show a mesh once more, elsewhere."""
        self._add("nodes", {"mesh": mesh, "translation": _y_up(np.array([at]))[0].tolist(), "scale": [scale] * 3})

    def looking(self, at: ArrayLike, target: ArrayLike, name: str, **more: object) -> None:
        """Add a node that looks from a place to another: for cameras and spots."""
        place, forward = np.asarray(at, float), np.subtract(target, at).astype(float)
        forward /= np.linalg.norm(forward)
        right = np.cross(forward, [0, 0, 1])
        right /= np.linalg.norm(right)
        columns = [*_y_up(np.stack([right, np.cross(right, forward), -forward, place])).round(6).tolist()]
        matrix = [value for column, last in zip(columns, (0, 0, 0, 1), strict=True) for value in (*column, last)]
        self._add("nodes", {"name": name, "matrix": matrix} | more)

    def camera(self, name: str, at: ArrayLike, target: ArrayLike, fov_degrees: float) -> None:
        """Add a camera."""
        lens = {"yfov": float(np.radians(fov_degrees)), "znear": 0.01}
        self.looking(at, target, name, camera=self._add("cameras", {"type": "perspective", "perspective": lens}))

    def spot(self, name: str, at: ArrayLike, target: ArrayLike, intensity: float, cone_degrees: float) -> None:
        """Add a spot."""
        lights = self.document["extensions"]["KHR_lights_punctual"]["lights"]
        outer = float(np.radians(cone_degrees) / 2)
        cone = {"innerConeAngle": 0.7 * outer, "outerConeAngle": outer}
        lights.append({"name": name, "type": "spot", "intensity": intensity, "color": [1, 0.85, 0.65], "spot": cone})
        self.looking(at, target, name, extensions={"KHR_lights_punctual": {"light": len(lights) - 1}})

    def write(self, path: Path) -> None:
        """Write the file."""
        document = {key: value for key, value in self.document.items() if value}
        document["scenes"] = [{"nodes": list(range(len(self.document["nodes"])))}]
        document["buffers"] = [{"byteLength": len(self._binary)}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self._binary), 0x004E4942) + self._binary
        path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def _y_up(vectors: ArrayLike) -> Floats:
    """Return (x, z, −y) of world vectors (x, y, z)."""
    x, y, z = np.asarray(vectors, np.float64).T
    return np.stack([x, z, -y], axis=1)


def moved(mesh: Mesh, scale: ArrayLike, at: ArrayLike, name: str, turn_degrees: float = 0.0) -> Mesh:
    """Return a mesh scaled, turned about +Z and moved."""
    angle, size = np.radians(turn_degrees), np.broadcast_to(np.asarray(scale, float), (3,))
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    positions = (mesh.positions * size) @ turn.T + np.asarray(at, float)
    return make_mesh(name, positions, mesh.triangles, (mesh.normals / size) @ turn.T)


def square(centre: ArrayLike, across: ArrayLike, up: ArrayLike, name: str) -> tuple[Mesh, Floats]:
    """Return a rectangle that faces ``across × up``, half-edges both, and its texture coordinates, v running down."""
    c, a, b = (np.asarray(vector, float) for vector in (centre, across, up))
    corners = np.stack([c - a - b, c + a - b, c + a + b, c - a + b])
    uv = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], float)
    return make_mesh(name, corners, [[0, 1, 2], [0, 2, 3]], np.tile(np.cross(a, b), (4, 1))), uv


def normals_of(heights: Floats, metres: float) -> Floats:
    """Return the normal map of a height map, in metres, that repeats every ``metres``; glTF's green points up."""
    texel = metres / len(heights)
    across = (np.roll(heights, -1, 1) - np.roll(heights, 1, 1)) / (2 * texel)
    down = (np.roll(heights, -1, 0) - np.roll(heights, 1, 0)) / (2 * texel)
    normal = np.stack([-across, down, np.ones_like(heights)], axis=-1)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True) / 2 + 0.5


def cobbles(size: int, stones: int, seed: int) -> tuple[Floats, Floats]:
    """Return heights 0 … 1 of rounded stones that repeat, ``(size, size)``, and a grey for each, 0 … 1."""
    random = np.random.default_rng(seed)
    cells = np.stack(np.meshgrid(np.arange(stones), np.arange(stones), indexing="ij"), axis=-1).reshape(-1, 2)
    seeds = (cells + 0.5 + random.uniform(-0.25, 0.25, cells.shape)) / stones
    place = (np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), axis=-1) + 0.5) / size
    first, second, which = np.full((size, size), 9.0), np.full((size, size), 9.0), np.zeros((size, size), int)
    for number, centre in enumerate(seeds):
        gap = np.abs(place - centre)
        distance = np.hypot(*np.moveaxis(np.minimum(gap, 1 - gap), -1, 0)) * stones
        nearer = distance < first
        second = np.where(nearer, first, np.minimum(second, distance))
        which, first = np.where(nearer, number, which), np.where(nearer, distance, first)
    edge = np.clip((second - first) / 0.5, 0, 1)
    return np.sqrt(1 - (1 - edge) ** 2), random.uniform(0, 1, len(seeds))[which]


def ripples(size: int, seed: int, waves: int = 24) -> Floats:
    """Return heights of about −1 … 1 that repeat, ``(size, size)``: a sum of waves in many directions."""
    random = np.random.default_rng(seed)
    y, x = np.meshgrid(np.arange(size) / size, np.arange(size) / size, indexing="ij")
    total = np.zeros((size, size))
    for _ in range(waves):
        across, down = random.integers(-9, 10, 2)
        total += np.sin(2 * np.pi * (across * x + down * y + random.uniform())) / (1 + np.hypot(across, down))
    return total / np.abs(total).max()


def srgb(linear: Floats) -> Floats:
    """Return linear values encoded, 0 … 1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)


def room() -> SceneFile:
    """Return a room of 4 × 4 × 3 m with a tiled floor, two panels, a screen and a spot."""
    file = SceneFile()
    heights, grey = cobbles(256, 8, 1)
    stone = srgb((0.25 + 0.25 * grey)[..., None] * np.array([1.0, 0.9, 0.75]) * (0.5 + 0.5 * heights)[..., None])
    stones = file.texture(normals_of(0.012 * heights, 1.0))
    floor, uv = square((0, 0, 0), (2, 0, 0), (0, 2, 0), "floor")
    file.object(floor, file.material("stones", (1, 1, 1), picture=file.texture(stone), normal=stones), 4 * uv)
    plaster = file.material("plaster", (0.75, 0.73, 0.7))
    for name, centre, across, up, material in (
        ("ceiling", (0, 0, 3), (2, 0, 0), (0, -2, 0), plaster),
        ("left", (-2, 0, 1.5), (0, 2, 0), (0, 0, 1.5), file.material("red", (0.6, 0.16, 0.12))),
        ("right", (2, 0, 1.5), (0, -2, 0), (0, 0, 1.5), file.material("green", (0.16, 0.45, 0.2))),
        ("back", (0, 2, 1.5), (2, 0, 0), (0, 0, 1.5), plaster),
        ("front", (0, -2, 1.5), (-2, 0, 0), (0, 0, 1.5), plaster),
    ):
        file.object(square(centre, across, up, name)[0], material)
    panel, _ = square((-0.9, 0.4, 2.98), (0.5, 0, 0), (0, -0.3, 0), "panel")
    lamp = file.object(panel, file.material("panel", (0, 0, 0), emission=14, colour=(1, 0.93, 0.8)))
    file.instance(lamp, (1.8, -0.8, 0))
    glow = np.kron(np.random.default_rng(4).uniform(0.05, 1, (5, 8, 3)), np.ones((8, 8, 1)))
    screen, uv = square((0.5, 1.97, 1.5), (0.64, 0, 0), (0, 0, 0.4), "screen")
    file.object(screen, file.material("screen", (0, 0, 0), emission=4, glow=file.texture(glow)), uv)
    file.object(
        moved(sphere(48, 96), 0.45, (-0.7, 0.5, 0.45), "ball"), file.material("brass", (0.9, 0.7, 0.3), 0.45, 0.9)
    )
    file.object(moved(box(), (0.35, 0.35, 0.6), (0.75, 0.75, 0.6), "block", 25), plaster)
    file.object(moved(sphere(32, 64), 0.25, (0.3, -0.4, 0.25), "small ball"), file.material("clay", (0.7, 0.35, 0.25)))
    file.spot("spot", (-1.7, -1.7, 2.7), (0.3, -0.2, 0.2), 12, 40)
    file.camera("door", (1.3, -1.9, 1.75), (-0.15, 0.6, 0.72), 60)
    file.camera("corner", (-1.8, -1.7, 2.4), (0.5, 0.7, 0.5), 62)
    return file


def bumpy_floor() -> SceneFile:
    """Return cobbles under a low lamp: what the filters of paper 004 are compared on."""
    file = SceneFile()
    heights, grey = cobbles(256, 6, 2)
    stone = srgb((0.3 + 0.2 * grey)[..., None] * np.array([0.95, 0.95, 1.0]))
    stones = file.texture(normals_of(0.035 * heights, 1.0))
    floor, uv = square((0, 0, 0), (2, 0, 0), (0, 2, 0), "floor")
    file.object(floor, file.material("cobbles", (1, 1, 1), picture=file.texture(stone), normal=stones), 4 * uv)
    file.object(square((0, 2, 1), (2, 0, 0), (0, 0, 1), "wall")[0], file.material("wall", (0.65, 0.35, 0.25)))
    # The front of the lamp faces the middle of the floor.
    lamp, _ = square((-1.9, 0.2, 0.9), (0, 0.8, 0), (0.18, 0, 0.35), "lamp")
    file.object(lamp, file.material("lamp", (0, 0, 0), emission=18, colour=(1, 0.85, 0.65)))
    file.object(moved(sphere(48, 96), 0.4, (0.5, 0.5, 0.4), "ball"), file.material("ball", (0.7, 0.7, 0.72)))
    file.camera("low", (1.1, -2.6, 1.3), (0.0, 0.2, 0.2), 45)
    return file


def ground() -> SceneFile:
    """Return a glossy ground with ripples, 3 m across."""
    file = SceneFile()
    normal = file.texture(normals_of(0.012 * ripples(256, 3), 1.0))
    disc, uv = square((0, 0, 0), (1.5, 0, 0), (0, 1.5, 0), "ground")
    file.object(disc, file.material("lacquer", (0.12, 0.1, 0.09), 0.42, 0.35, normal=normal), 3 * uv)
    file.camera("front", (0.9, -3.4, 1.5), (0.0, 0.0, 0.42), 30)
    return file


if __name__ == "__main__":
    room().write(FOLDER / "room.glb")
    bumpy_floor().write(FOLDER / "floor.glb")
    ground().write(FOLDER / "ground.glb")
