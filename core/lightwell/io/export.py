"""Grids for other programs: NumPy, three.js, and textures for engines (KTX2)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from lightwell.field.adaptive import AdaptiveGrid, AnyGrid
from lightwell.field.grid import Grid
from lightwell.field.tiles import pack_tiles
from lightwell.io.files import write_atomically
from lightwell.io.grids import GridError
from lightwell.sh.engines import convert

VK_FORMAT_R16G16B16A16_SFLOAT = 97
KTX2_IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
THREE_COEFFICIENTS = 9


def export_grid(grid: AnyGrid, kind: Literal["npz", "three", "ktx2"], out: Path) -> list[Path]:
    """Write a grid for other programs; return the files that were written.

    ``npz``
        ``coefficients`` (z, y, x, bands², 3), ``coverage``, ``lower_m``, ``upper_m`` and, where there are any,
        ``gradients``. Of an adaptive grid its own arrays (`lightwell.field.adaptive`), ``resolution`` and bounds.
    ``three``
        ``OUT.bin``: the 3D texture atlas of three.js's ``LightProbeGridWebGL``, with nine coefficients; ``OUT.json``
        describes it. Axes are three.js's (y up), and the grid is laid out along them.
    ``ktx2``
        One 3D texture of RGBA halves, the tiles of `lightwell.field.tiles` one above the other along z.

    The latter two know regular grids only: an adaptive one is written as the regular grid that it stands for.

    Raises
    ------
    GridError
        Where a file cannot be written.
    """
    try:
        if kind == "npz":
            return [write_atomically(out, _npz(grid))]
        if kind == "ktx2":
            return [write_atomically(out, ktx2(grid.to_regular()))]
        data, document = three(grid.to_regular())
        document["data"] = out.with_suffix(".bin").name
        text = (json.dumps(document, indent=1) + "\n").encode()
        return [write_atomically(out.with_suffix(".bin"), data), write_atomically(out.with_suffix(".json"), text)]
    except OSError as error:
        raise GridError(f"{out}: cannot be written: {error.strerror}") from None


def _npz(grid: AnyGrid) -> bytes:
    import io

    arrays: dict[str, NDArray[np.generic]] = {
        "coefficients": grid.coefficients,
        "coverage": grid.coverage,
        "lower_m": np.array(grid.spec.lower),
        "upper_m": np.array(grid.spec.upper),
    }
    if isinstance(grid, AdaptiveGrid):
        arrays |= {"pages": grid.pages, "levels": grid.levels, "nodes": grid.nodes}
        arrays["resolution"] = np.array(grid.spec.resolution)
    elif grid.gradients is not None:
        arrays["gradients"] = grid.gradients
    out = io.BytesIO()
    np.savez(out, **arrays)  # type: ignore[arg-type]
    return out.getvalue()


def three(grid: Grid) -> tuple[bytes, dict[str, object]]:
    """Return the atlas of three.js's ``LightProbeGridWebGL`` as bytes, and its description.

    World x, y, z of Lightwell are three's x, −z, y. The 27 floats of a cell (nine coefficients of r, g, b, row by row)
    fill seven RGBA texels, the last value is 0. The seven volumes lie one behind the other along z, each between copies
    of its first and last slice.
    """
    coefficients = grid.coefficients[..., :THREE_COEFFICIENTS, :]
    if coefficients.shape[3] < THREE_COEFFICIENTS:
        missing = THREE_COEFFICIENTS - coefficients.shape[3]
        coefficients = np.pad(coefficients, [(0, 0)] * 3 + [(0, missing), (0, 0)])
    # (z, y, x) of the world becomes (z', y', x') with x' = x, y' = z, z' = −y.
    moved = coefficients.transpose(1, 0, 2, 3, 4)[::-1]
    turned = np.moveaxis(convert(np.moveaxis(moved, 3, 0), "three"), 0, 3)
    cells = np.concatenate([turned.reshape(*moved.shape[:3], 27), np.zeros((*moved.shape[:3], 1))], axis=-1)
    scale = max(1.0, float(2.0 ** np.ceil(np.log2(max(np.abs(cells).max(), 1e-30) / 65504.0))))
    textures = np.moveaxis((cells / scale).astype("<f2").reshape(*moved.shape[:3], 7, 4), 3, 0)
    padded = np.pad(textures, [(0, 0), (1, 1), (0, 0), (0, 0), (0, 0)], mode="edge")
    (x0, y0, z0), (x1, y1, z1) = grid.spec.lower, grid.spec.upper
    nx, ny, nz = grid.spec.resolution
    document: dict[str, object] = {
        "format": "lightwell.three-light-probe-grid.v1",
        "resolution": [nx, nz, ny],
        "min": [x0, z0, -y1],
        "max": [x1, z1, -y0],
        "size": [nx, nz, 7 * (ny + 2)],
        "texel": "RGBA16F little-endian, x fastest, then y, then z",
        "coefficients": "c0.r c0.g c0.b c1.r …, nine of radiance, three.js convention",
        "scale": scale,
    }
    return np.ascontiguousarray(padded).tobytes(), document


def ktx2(grid: Grid) -> bytes:
    """Return a KTX2 file (Khronos, KTX File Format 2.0) with one level of a 3D texture and no supercompression."""
    tiles, scale = pack_tiles(grid.coefficients)
    data = tiles.astype("<f2").tobytes()
    count, depth, height, width = tiles.shape[:4]
    descriptor = _half_descriptor()
    meta = _metadata(
        {
            "KTXwriter": "Lightwell",
            "LightwellBands": str(grid.bands),
            "LightwellLower": " ".join(map(repr, grid.spec.lower)),
            "LightwellResolution": " ".join(map(str, grid.spec.resolution)),
            "LightwellScale": repr(scale),
            "LightwellUpper": " ".join(map(repr, grid.spec.upper)),
        }
    )
    index_size = 80 + 24
    dfd_at, meta_at = index_size, index_size + len(descriptor)
    data_at = -(-(meta_at + len(meta)) // 8) * 8
    header = struct.pack(
        "<12s9I", KTX2_IDENTIFIER, VK_FORMAT_R16G16B16A16_SFLOAT, 2, width, height, depth * count, 0, 1, 1, 0
    )
    index = struct.pack("<4I2Q", dfd_at, len(descriptor), meta_at, len(meta), 0, 0)
    level = struct.pack("<3Q", data_at, len(data), len(data))
    head = header + index + level + descriptor + meta
    return head + bytes(data_at - len(head)) + data


def _half_descriptor() -> bytes:
    """Return the data format descriptor of four halves (Khronos Data Format 1.3, §5)."""
    signed_float = 0xC0
    samples = b"".join(
        struct.pack("<HBB4BII", 16 * lane, 15, channel | signed_float, 0, 0, 0, 0, 0xBF800000, 0x3F800000)
        for lane, channel in enumerate((0, 1, 2, 15))
    )
    # Model RGBSDA, primaries BT.709, linear transfer, straight alpha; one texel of eight bytes.
    block = struct.pack("<IHH4B4B8B", 0, 2, 24 + len(samples), 1, 1, 1, 0, 0, 0, 0, 0, 8, 0, 0, 0, 0, 0, 0, 0)
    return struct.pack("<I", 4 + len(block) + len(samples)) + block + samples


def _metadata(entries: dict[str, str]) -> bytes:
    out = b""
    for key, value in sorted(entries.items()):
        entry = key.encode() + b"\0" + value.encode() + b"\0"
        out += struct.pack("<I", len(entry)) + entry + bytes(-len(entry) % 4)
    return out
