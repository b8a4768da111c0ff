"""Reading triangle meshes: glTF and GLB, PLY, OBJ."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.errors import LightwellError
from lightwell.geometry.mesh import DEFAULT_ALBEDO, Mesh, make_mesh
from lightwell.io.files import require_file
from lightwell.io.gltf import read_objects
from lightwell.io.gltf_check import MAX_OBJECTS, GltfError, check_document, parse_document, split_glb
from lightwell.io.gltf_colours import Pictures
from lightwell.io.gltf_data import GltfData
from lightwell.io.texture_pixels import pixels_of

UpAxis = Literal["y", "z"]
MESH_SUFFIXES = (".glb", ".gltf", ".ply", ".obj")
MAX_FILE_BYTES = 1 << 30
MAX_TRIANGLES = 5_000_000

Z_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Turns (x, y, z) with +Y up into world axes: (x, −z, y)."""


class MeshError(LightwellError):
    """A mesh cannot be used: names the file, what is wrong and what would help."""


def load_meshes(path: str | Path, up: UpAxis = "y", max_triangles: int = MAX_TRIANGLES) -> list[Mesh]:
    """Read the objects of a file, in world axes (+Z up), each placed where its nodes put it.

    Files that a glTF or OBJ file names (buffers, materials, pictures) are read from its folder and those below it.

    Parameters
    ----------
    path
        ``.glb``, ``.gltf``, ``.ply`` or ``.obj``.
    up
        Which axis of the file points up. glTF says +Y, and so do most OBJ files and scans; ``z`` leaves the axes alone.
    max_triangles
        Of all objects together.

    Returns
    -------
    At least one mesh with triangles. Albedo is the material's base colour, times its picture, times the colours of the
    vertices, as far as the file has them (colours of vertices are linear in glTF, sRGB elsewhere).

    Raises
    ------
    MeshError
        Whatever is wrong: missing, no mesh file, damaged, no triangles, a position that is not finite, too large.
    """
    path = Path(path)
    data = read_mesh_file(path)
    return read_meshes(data, path.name, up, max_triangles, path.parent)


def read_mesh_file(path: Path) -> bytes:
    """Return the bytes of a file. Raises `MeshError` where it is missing or too large."""
    require_file(path)
    try:
        size = path.stat().st_size
        if size > MAX_FILE_BYTES:
            raise MeshError(f"{path.name}: has {size >> 20} MiB; at most {MAX_FILE_BYTES >> 20} are read: simplify it")
        return path.read_bytes()
    except OSError as error:
        raise MeshError(f"{path}: cannot be read: {error.strerror}") from None


def read_meshes(
    data: bytes, name: str, up: UpAxis = "y", max_triangles: int = MAX_TRIANGLES, folder: Path | None = None
) -> list[Mesh]:
    """Read the objects of a file's bytes; the type follows from ``name``. `load_meshes` says the rest.

    ``folder`` is where further files may be read from; without it the file must hold everything itself.
    """
    suffix = PurePosixPath(name).suffix.lower()
    if suffix not in MESH_SUFFIXES:
        raise MeshError(f"{name}: has the type {suffix or '(none)'}; meshes are read from {', '.join(MESH_SUFFIXES)}")
    if not data:
        raise MeshError(f"{name}: is empty")
    with mesh_errors(name):
        if suffix in (".glb", ".gltf"):
            meshes = _gltf(data, name, up, folder, max_triangles)
        else:
            meshes = _by_trimesh(data, name, up, folder, max_triangles)
    if not any(len(mesh.triangles) for mesh in meshes):
        raise MeshError(f"{name}: holds no triangles; export it as a triangle mesh, not as points or lines")
    return meshes


@contextmanager
def mesh_errors(name: str) -> Iterator[None]:
    """Turn whatever comes of a damaged file into a `MeshError` that names it."""
    try:
        # What is not finite, or too large for float32, is refused by the checks of meshes and cameras, and named.
        with np.errstate(invalid="ignore", over="ignore"):
            yield
    except (MeshError, MemoryError):
        raise
    except (GltfError, _MissingFileError) as error:
        raise MeshError(f"{name}: {error}") from None
    except Exception as error:
        # trimesh reports damage as whatever exception came of it.
        text = str(error).strip().splitlines()
        reason = text[0][:200] if text else "no reason given"
        raise MeshError(f"{name}: cannot be read ({type(error).__name__}: {reason}); export it again") from None


def open_gltf(
    data: bytes, name: str, folder: Path | None, max_triangles: int = MAX_TRIANGLES
) -> tuple[dict[str, Any], GltfData]:
    """Return the checked document of a glTF or GLB file and its data. Raises within `mesh_errors`."""
    binary: bytes | None = None
    if PurePosixPath(name).suffix.lower() == ".glb":
        document, binary = split_glb(data)
    else:
        document = parse_document(data)
    check_document(document, max_triangles)
    return document, GltfData(document, binary, _Beside(folder, name).get)


def _gltf(data: bytes, name: str, up: UpAxis, folder: Path | None, max_triangles: int) -> list[Mesh]:
    document, data_of = open_gltf(data, name, folder, max_triangles)
    turn = Z_UP if up == "y" else np.eye(3)
    meshes: list[Mesh] = []
    taken: set[str] = set()
    for one in read_objects(document, data_of, Pictures(document, data_of, _sampled)):
        if len(one.positions) == 0:
            continue
        normals = None if one.normals is None else one.normals @ turn.T
        albedo = DEFAULT_ALBEDO if one.colours is None else one.colours
        meshes.append(
            checked_mesh(name, unique_title(one.name, taken), one.positions @ turn.T, one.triangles, normals, albedo)
        )
    return meshes


def checked_mesh(
    file: str,
    title: str,
    positions: NDArray[np.float64],
    triangles: NDArray[np.int64],
    normals: NDArray[np.float64] | None,
    albedo: NDArray[np.float64] | float,
) -> Mesh:
    """Return a mesh; raises `MeshError` with the file and the object where it is none."""
    try:
        return make_mesh(title, positions, triangles, normals, albedo)
    except ValueError as error:
        raise MeshError(f"{file}: object {title!r}: {error}; repair it in a modelling program") from None


class _MissingFileError(Exception):
    """A file that is named cannot be had."""


class _Beside:
    """Finds the files that a mesh names in its own folder, and nothing outside it; a resolver of trimesh's."""

    def __init__(self, folder: Path | None, name: str) -> None:
        self._folder = folder
        self.file_name = PurePosixPath(name).stem

    def get(self, key: str) -> bytes:
        if self._folder is None:
            raise _MissingFileError(
                f"needs the file {key!r} beside it; export it as one GLB file that holds everything"
            )
        root = self._folder.resolve()
        place = (root / key).resolve()
        if not place.is_relative_to(root):
            raise _MissingFileError(f"names the file {key!r}, which lies outside its folder; put it beside")
        try:
            if not place.is_file() or place.stat().st_size > MAX_FILE_BYTES:
                raise _MissingFileError(f"names the file {key!r}, which is missing or too large; put it beside")
            return place.read_bytes()
        except OSError as error:
            raise _MissingFileError(f"names the file {key!r}, which cannot be read: {error.strerror}") from None

    def __getitem__(self, key: str) -> bytes:
        return self.get(key)

    def namespaced(self, namespace: str) -> _Beside:
        return _Beside(self._folder and self._folder / namespace, self.file_name)

    def keys(self) -> Sequence[str]:
        return ()


def _check_ply(data: bytes, max_triangles: int) -> None:
    """Raise `MeshError`-worthy text where a PLY header asks for more than its file can hold."""
    header, found, _ = data[:65536].partition(b"end_header")
    if not data.startswith(b"ply") or not found:
        raise GltfError("is no PLY file: it does not begin with ply … end_header")
    for line in header.split(b"\n"):
        words = line.split()
        if len(words) == 3 and words[0] == b"element":
            count = int(words[2])
            if not 0 <= count <= min(3 * max_triangles, len(data)):
                raise GltfError(f"says {count} of {words[1].decode(errors='replace')}; it is too large or cut short")
            if words[1] == b"face" and count > max_triangles:
                raise GltfError(f"has {count} triangles; at most {max_triangles} are read: simplify it")


def _by_trimesh(data: bytes, name: str, up: UpAxis, folder: Path | None, max_triangles: int) -> list[Mesh]:
    """Return the meshes of a PLY or OBJ file, in the order of the file."""
    import trimesh  # takes longer to import than all the rest

    suffix, stem = PurePosixPath(name).suffix.lower(), PurePosixPath(name).stem
    if suffix == ".ply":
        _check_ply(data, max_triangles)
        head, end, body = data.partition(b"end_header")
        data = head.decode("ascii", "replace").encode("ascii", "replace") + end + body
    else:
        # Comments and names of old programs are in whatever their machine wrote; trimesh wants UTF-8.
        data = data.decode("utf-8", "replace").encode()
        _check_obj(data)
    resolver: Any = _Beside(folder, name)
    options: dict[str, Any] = {"split_objects": True} if suffix == ".obj" else {}
    scene = trimesh.load_scene(io.BytesIO(data), file_type=suffix[1:], resolver=resolver, process=False, **options)
    found = {key: geometry for key, geometry in scene.geometry.items() if hasattr(geometry, "faces")}
    if suffix == ".obj":
        order = _obj_objects(data)
        found = dict(sorted(found.items(), key=lambda item: order.get(item[0], order.get(_plain(item[0]), len(order)))))
    elif len(found) == 1:
        found = {stem: next(iter(found.values()))}
    total = sum(len(geometry.faces) for geometry in found.values())
    if total > max_triangles:
        raise MeshError(f"{name}: has {total} triangles; at most {max_triangles} are read: simplify it")
    turn = Z_UP if up == "y" else np.eye(3)
    meshes: list[Mesh] = []
    taken: set[str] = set()
    for key, geometry in found.items():
        if len(geometry.vertices) == 0:
            continue
        # trimesh makes normals up when asked; those that came with the file are in its cache.
        own = np.asarray(geometry.vertex_normals, np.float64) if "vertex_normals" in geometry._cache else None
        positions = np.asarray(geometry.vertices, np.float64) @ turn.T
        normals = None if own is None else own @ turn.T
        triangles = np.asarray(geometry.faces, np.int64)
        meshes.append(
            checked_mesh(name, unique_title(str(key), taken), positions, triangles, normals, _albedo(geometry))
        )
    return meshes


def _check_obj(data: bytes) -> None:
    """Raise `GltfError` where an OBJ file has so many objects and materials that reading it would take for ever."""
    pairs: set[tuple[bytes, bytes]] = set()
    title = material = b""
    for line in data.splitlines():
        if line.startswith(b"o "):
            title = line
        elif line.startswith(b"usemtl "):
            material = line
        else:
            continue
        pairs.add((title, material))
        if len(pairs) > MAX_OBJECTS:
            raise GltfError(f"has more than {MAX_OBJECTS} objects and materials; join them")


def _obj_objects(data: bytes) -> dict[str, int]:
    """Return the objects of an OBJ file by name, numbered as they come."""
    names = [line[2:].decode(errors="replace").strip() for line in data.splitlines() if line.startswith(b"o ")]
    return {name: number for number, name in enumerate(dict.fromkeys(names))}


def _plain(key: str) -> str:
    """Return an object's name; trimesh numbers those that have several materials."""
    return key.rpartition("_")[0]


def unique_title(wanted: str, taken: set[str]) -> str:
    """Return a name that nothing has yet, and take it."""
    title, number = wanted, 1
    while title in taken:
        number += 1
        title = f"{wanted} {number}"
    taken.add(title)
    return title


def _albedo(geometry: Any) -> NDArray[np.float64]:  # noqa: ANN401
    """Return the albedo of each vertex, ``(V, 3)`` linear."""
    count, visual = len(geometry.vertices), geometry.visual
    albedo = np.ones((count, 3))
    known = False
    material = getattr(visual, "material", None)
    # Where a file names no material that can be had, trimesh makes a dark one up, with nothing of a file's in it.
    if material is not None and getattr(material, "kwargs", None) != {}:
        if material.diffuse is not None:
            albedo *= _fractions(material.diffuse)[:3]
            known = True
        if material.image is not None and visual.uv is not None and len(visual.uv) == count:
            albedo *= _sampled(pixels_of(material.image), np.asarray(visual.uv, np.float64))
            known = True
    colours = _vertex_colours(geometry)
    if colours is not None and len(colours) == count:
        albedo *= _linear(_fractions(colours)[:, :3])
        known = True
    return albedo if known else np.full((count, 3), DEFAULT_ALBEDO)


def _vertex_colours(geometry: Any) -> NDArray[Any] | None:  # noqa: ANN401
    # trimesh would make bytes of them, and zeros of 16 bits.
    raw = geometry.metadata.get("_ply_raw", {}).get("vertex", {}).get("data")
    if raw is not None and not isinstance(raw, dict) and {"red", "green", "blue"} <= set(raw.dtype.names or ()):
        return np.stack([raw[channel] for channel in ("red", "green", "blue")], axis=1).reshape(-1, 3)
    if isinstance(raw, dict) and {"red", "green", "blue"} <= set(raw):
        return np.stack([np.ravel(raw[channel]) for channel in ("red", "green", "blue")], axis=1)
    visual = geometry.visual
    if getattr(visual, "kind", None) in ("vertex", "face"):
        return np.asarray(visual.vertex_colors)
    extra = getattr(visual, "vertex_attributes", {}).get("color")
    return None if extra is None else np.asarray(extra)


def _fractions(values: Any) -> NDArray[np.float64]:  # noqa: ANN401
    """Return colours 0 … 1 from integers of any width or from fractions."""
    array = np.asarray(values)
    most = float(np.iinfo(array.dtype).max) if array.dtype.kind in "iu" else 1.0
    return array.astype(np.float64) / most


def _linear(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return linear values of sRGB ones (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def _sampled(pixels: NDArray[np.uint8], uv: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a picture's linear colour at each vertex, ``(V, 3)``; it repeats outside 0 … 1, v points up."""
    height, width = pixels.shape[:2]
    wrapped = np.nan_to_num(uv, posinf=0, neginf=0) % 1.0
    columns = np.minimum((wrapped[:, 0] * width).astype(np.int64), width - 1)
    rows = np.minimum(((1 - wrapped[:, 1]) % 1.0 * height).astype(np.int64), height - 1)
    return _linear(pixels[rows, columns] / 255.0)
