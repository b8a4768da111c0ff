"""Meshes and light maps that were sent to a server: what is kept beside each, and what is looked at before it is.

A folder a file, named by the first digits of its SHA-256: the file under a name of ours, and ``upload.json``.
"""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath
from typing import Literal

import msgspec
import numpy as np

from lightwell.errors import FrameError, LightwellError
from lightwell.io.exr import write_rgb
from lightwell.io.meshes import MESH_SUFFIXES, MeshError, read_meshes
from lightwell.io.pictures import read_picture
from lightwell.probe.downsample import Downsampler
from lightwell.probe.latlong import LatLong

RECORD = "upload.json"
UPLOAD_ID = re.compile(r"^[0-9a-f]{20}$")
MAP_SUFFIXES = (".exr", ".hdr")
MAP_FILE = "map.exr"
MAX_MAP_WIDTH = 2048
"""Wider maps are made smaller: a stream looks at every pixel of every frame, and coefficients need few."""

UploadKind = Literal["mesh", "map"]


class UploadError(LightwellError):
    """A file cannot be used: names it, what is wrong and what would help."""


class Contents(msgspec.Struct, omit_defaults=True):
    """What was found in a file."""

    vertices: int | None = None
    triangles: int | None = None
    objects: list[str] | None = None
    """Names of the meshes, the first 256."""
    width: int | None = None
    height: int | None = None


class UploadRecord(msgspec.Struct, omit_defaults=True):
    """One file that was sent."""

    id: str
    kind: UploadKind
    name: str
    """As it was sent."""
    file: str
    """What is used, below the record's folder."""
    bytes: int
    sha256: str
    created: int
    """Nanoseconds since the Unix epoch."""
    contents: Contents

    def path_below(self, folder: Path) -> Path:
        """Return where the file lies."""
        return folder / self.file


def read_record(folder: Path) -> UploadRecord | None:
    """Return the record of a folder, or None where it has none that can be read."""
    try:
        return msgspec.json.decode((folder / RECORD).read_bytes(), type=UploadRecord)
    except (OSError, msgspec.MsgspecError):
        return None


def kind_of(name: str) -> tuple[UploadKind, str]:
    """Return what a file of this name is, and its suffix; raises `UploadError` where it is neither mesh nor map."""
    suffix = PurePosixPath(name).suffix.lower()
    if suffix in MESH_SUFFIXES:
        return "mesh", suffix
    if suffix in MAP_SUFFIXES:
        return "map", suffix
    raise UploadError(
        f"{name}: has the type {suffix or '(none)'}; meshes are taken as {', '.join(MESH_SUFFIXES)}, "
        f"light maps as {', '.join(MAP_SUFFIXES)}"
    )


def inspect_mesh(path: Path, name: str, max_triangles: int) -> Contents:
    """Return what a mesh file holds, which must hold everything itself; raises `MeshError`."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise MeshError(f"{name}: cannot be read: {error.strerror}") from None
    meshes = read_meshes(data, name, max_triangles=max_triangles)
    return Contents(
        vertices=sum(len(mesh.positions) for mesh in meshes),
        triangles=sum(len(mesh.triangles) for mesh in meshes),
        objects=[mesh.name[:200] for mesh in meshes[:256]],
    )


def inspect_map(path: Path, name: str) -> Contents:
    """Return the size of a lat-long map; write `MAP_FILE` beside it where it is not one itself or is very large.

    Raises
    ------
    UploadError
        Where it cannot be read, is not twice as wide as high, or holds no light.
    """
    try:
        pixels = read_picture(path).pixels
    except FrameError as error:
        raise UploadError(f"{name}: {error.reason}") from None
    height, width = pixels.shape[:2]
    if width != 2 * height:
        raise UploadError(f"{name}: is {width}×{height}; a lat-long map is twice as wide as high: unwrap or crop it")
    with np.errstate(over="ignore"):
        finite = np.isfinite(pixels)
    if not finite.any() or not (pixels[finite] > 0).any():
        raise UploadError(f"{name}: holds no light: all its samples are zero, negative or not numbers")
    if path.name != MAP_FILE or width > MAX_MAP_WIDTH:
        kept = pixels
        if width > MAX_MAP_WIDTH:
            kept = Downsampler(LatLong(height, width), MAX_MAP_WIDTH)(np.where(finite, pixels, 0).astype(np.float32))
        if kept.dtype == np.float16 and np.isinf(kept).any():
            kept = kept.astype(np.float32)
        write_rgb(path.with_name(MAP_FILE), kept)
    return Contents(width=width, height=height)
