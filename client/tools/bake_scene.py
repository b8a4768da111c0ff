"""Bake the page's objects with their diffuse transfer.

The still life (bunny, ball, round table) goes into ``public/scene.bin``, the bunny alone on the table into
``public/bunny.bin``.

Run from ``client/`` where the mesh changes::

    pip install fast-simplification
    python tools/bake_scene.py bunny.npz     # v (n, 3) float, f (m, 3) int, +Y up, closed
    python tools/bake_scene.py public/scene.bin bunny     # only bunny.bin, with the mesh of an earlier still life

Every vertex gets 25 transfer coefficients (Sloan, Kautz and Snyder 2002; unshadowed they are ``A_l Y_lm(n)``)::

    t_lm = ∫ V(ω) max(0, n·ω) Y_lm(ω) dω,      so the irradiance is  E = Σ t_lm c_lm

Visibility ``V`` comes from one orthographic depth buffer for each of ``DIRECTIONS`` Fibonacci directions.

File: gzip of a little-endian uint32 length, that many bytes of JSON, vertices as int16 ``(count, 36)``, triangles as
uint16. Lanes of a vertex, each normalised by 32767 and multiplied by its scale in the JSON: position x y z 0, normal
x y z 0, transfer 0 … 24, 0 0 0. World axes, +Z up.
"""

from __future__ import annotations

import gzip
import json
import sys
from pathlib import Path

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from lightwell.sh.basis import evaluate

Floats = NDArray[np.float64]
Surface = tuple[Floats, Floats, NDArray[np.int64]]

BANDS = 5
DIRECTIONS = 2048
DEPTH_PIXELS = 1024
LANES = 36
TRIANGLES_OF_BUNNY = 14_000
NORMAL_SMOOTHING = 3
TRANSFER_STEP = 16  # of 32767: finer than the bake is exact, and it compresses
BUNNY_HEIGHT = 1.5
BALL_RADIUS, BALL_CENTRE = 0.4, (0.92, -0.5, 0.4)
TABLE_RADIUS, TABLE_CENTRE, TABLE_THICKNESS, TABLE_FILLET = 1.7, (0.12, -0.08), 0.09, 0.035


def smooth_normals(positions: Floats, triangles: NDArray[np.int64]) -> Floats:
    """Return area-weighted vertex normals, averaged over neighbours to hide the scan's noise."""
    corners = positions[triangles]
    face = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.zeros_like(positions)
    for corner in range(3):
        np.add.at(normals, triangles[:, corner], face)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    for _ in range(NORMAL_SMOOTHING):
        total = normals.copy()
        for corner in range(3):
            np.add.at(total, triangles[:, corner], normals[triangles[:, (corner + 1) % 3]])
        normals = total / np.linalg.norm(total, axis=1, keepdims=True)
    return normals


def bunny(path: Path) -> Surface:
    """Return positions, normals (of the full mesh) and triangles of the simplified bunny, standing on z = 0."""
    if path.suffix == ".bin":
        return _baked(path, "bunny")
    import fast_simplification

    mesh = np.load(path)
    fine = mesh["v"].astype(np.float64)
    positions, triangles = fast_simplification.simplify(mesh["v"], mesh["f"], target_count=TRIANGLES_OF_BUNNY)
    nearest = cKDTree(fine).query(positions)[1]
    normals = smooth_normals(fine, mesh["f"])[nearest]
    positions, normals = (
        np.stack([rows[:, 0], -rows[:, 2], rows[:, 1]], axis=1) for rows in (positions.astype(np.float64), normals)
    )
    positions *= BUNNY_HEIGHT / np.ptp(positions[:, 2])
    positions -= [positions[:, 0].mean() + 0.3, positions[:, 1].mean() - 0.1, positions[:, 2].min() + 0.004]
    return positions, normals, triangles


def _baked(path: Path, name: str) -> Surface:
    """Return a part of an earlier scene file."""
    data = gzip.decompress(path.read_bytes())
    length = int(np.frombuffer(data, "<u4", 1)[0])
    header = json.loads(data[4 : 4 + length])
    lanes = np.frombuffer(data, "<i2", LANES * header["vertices"], 4 + length).reshape(-1, LANES) / 32767
    every = np.frombuffer(data, "<u2", offset=4 + length + 2 * LANES * header["vertices"]).astype(np.int64)
    part = next(item for item in header["parts"] if item["name"] == name)
    used, triangles = np.unique(every[part["start"] : part["start"] + part["count"]], return_inverse=True)
    return lanes[used, 0:3] * header["scales"]["position"], lanes[used, 4:7], triangles.reshape(-1, 3)


def lathe(profile: Floats, profile_normals: Floats, segments: int, centre: tuple[float, float]) -> Surface:
    """Return the surface that the profile ``(r, z)`` (from the bottom pole to the top pole) makes around z."""
    angles = 2 * np.pi * np.arange(segments) / segments
    around = np.stack([np.cos(angles), np.sin(angles)], axis=1)

    def turned(rows: Floats) -> Floats:
        radial = rows[:, None, :1] * around[None]
        return np.concatenate([radial, np.broadcast_to(rows[:, None, 1:], (*radial.shape[:2], 1))], axis=2)

    positions = turned(profile).reshape(-1, 3) + np.array([*centre, 0.0])
    normals = turned(profile_normals).reshape(-1, 3)
    row, column = np.meshgrid(np.arange(len(profile) - 1), np.arange(segments), indexing="ij")
    a, b = row * segments + column, row * segments + (column + 1) % segments
    quads = np.stack([a, b, b + segments, a + segments], axis=-1).reshape(-1, 4)
    return positions, normals, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def ball() -> Surface:
    """Return a sphere of latitude rings."""
    theta = np.linspace(np.pi, 0, 25)
    normals = np.stack([np.sin(theta), np.cos(theta)], axis=1)
    return lathe(normals * BALL_RADIUS + [0, BALL_CENTRE[2]], normals, 40, BALL_CENTRE[:2])


def table() -> Surface:
    """Return a round slab with filleted edges whose top is z = 0."""
    inner, depth = TABLE_RADIUS - TABLE_FILLET, TABLE_THICKNESS
    turn = np.linspace(0, np.pi / 2, 5)
    fillet = np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    below = np.stack([np.linspace(0, inner, 3), np.full(3, -depth)], axis=1)
    rim_below = fillet * TABLE_FILLET + [inner, TABLE_FILLET - depth]
    rim_above = fillet[::-1] * [1, -1] * TABLE_FILLET + [inner, -TABLE_FILLET]
    above = np.stack([np.linspace(inner, 0, 26), np.zeros(26)], axis=1)
    profile = np.concatenate([below, rim_below, rim_above, above])
    normals = np.concatenate([np.tile([0, -1], (3, 1)), fillet, fillet[::-1] * [1, -1], np.tile([0, 1], (26, 1))])
    return lathe(profile, normals, 72, TABLE_CENTRE)


@numba.njit
def accumulate_visible(
    positions: Floats,
    normals: Floats,
    triangles: NDArray[np.int64],
    radius: float,
    frames: Floats,
    basis: Floats,
    depth: Floats,
    transfer: Floats,
) -> None:
    """Add ``V max(0, n·ω) Y(ω)`` of every direction to ``transfer`` (count, 25)."""
    size = depth.shape[0]
    scale = 0.5 * size / radius
    projected = np.empty_like(positions)
    for index in range(len(frames)):
        frame = frames[index]  # rows: image x, image y, towards the light
        for vertex in range(len(positions)):
            for axis in range(3):
                projected[vertex, axis] = (
                    frame[axis, 0] * positions[vertex, 0]
                    + frame[axis, 1] * positions[vertex, 1]
                    + frame[axis, 2] * positions[vertex, 2]
                )
            projected[vertex, 0] = (projected[vertex, 0] + radius) * scale
            projected[vertex, 1] = (projected[vertex, 1] + radius) * scale
        depth[:] = -1e9
        for triangle in range(len(triangles)):
            a, b, c = (
                projected[triangles[triangle, 0]],
                projected[triangles[triangle, 1]],
                projected[triangles[triangle, 2]],
            )
            area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
            if abs(area) < 1e-12:
                continue
            for row in range(int(min(a[1], b[1], c[1])), int(max(a[1], b[1], c[1])) + 1):
                for column in range(int(min(a[0], b[0], c[0])), int(max(a[0], b[0], c[0])) + 1):
                    x, y = column + 0.5, row + 0.5
                    u = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                    v = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                    if u >= 0 and v >= 0 and u + v <= 1:
                        depth[row, column] = max(depth[row, column], u * a[2] + v * b[2] + (1 - u - v) * c[2])
        for vertex in range(len(positions)):
            cosine = (
                normals[vertex, 0] * frame[2, 0] + normals[vertex, 1] * frame[2, 1] + normals[vertex, 2] * frame[2, 2]
            )
            if cosine <= 0:
                continue
            # Lift the point off its own surface, then compare with the four nearest depths.
            lift = 0.012
            x = (
                projected[vertex, 0]
                - 0.5
                + lift
                * scale
                * (
                    normals[vertex, 0] * frame[0, 0]
                    + normals[vertex, 1] * frame[0, 1]
                    + normals[vertex, 2] * frame[0, 2]
                )
            )
            y = (
                projected[vertex, 1]
                - 0.5
                + lift
                * scale
                * (
                    normals[vertex, 0] * frame[1, 0]
                    + normals[vertex, 1] * frame[1, 1]
                    + normals[vertex, 2] * frame[1, 2]
                )
            )
            z = projected[vertex, 2] + lift * cosine + 0.008
            column, row = int(x), int(y)
            s, t = x - column, y - row
            visible = 0.0
            if depth[row, column] < z:
                visible += (1 - s) * (1 - t)
            if depth[row, column + 1] < z:
                visible += s * (1 - t)
            if depth[row + 1, column] < z:
                visible += (1 - s) * t
            if depth[row + 1, column + 1] < z:
                visible += s * t
            for coefficient in range(transfer.shape[1]):
                transfer[vertex, coefficient] += visible * cosine * basis[index, coefficient]


def fibonacci_directions(count: int) -> tuple[Floats, Floats]:
    """Return ``count`` nearly even directions and a frame (image x, image y, direction) for each."""
    z = 1 - (2 * np.arange(count) + 1) / count
    azimuth = np.pi * (1 + 5**0.5) * np.arange(count)
    directions = np.stack([np.cos(azimuth) * np.sqrt(1 - z * z), np.sin(azimuth) * np.sqrt(1 - z * z), z], axis=1)
    helper = np.where(np.abs(z)[:, None] < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    across = np.cross(helper, directions)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    return directions, np.stack([across, np.cross(directions, across), directions], axis=1)


def bake(surfaces: dict[str, Surface], output_path: Path) -> None:
    """Bake surfaces that shade each other, and write the file."""
    parts, positions, normals, triangles = [], [], [], []
    first_vertex = first_index = 0
    for name, (p, n, t) in surfaces.items():
        parts.append({"name": name, "start": first_index, "count": t.size})
        positions.append(p)
        normals.append(n)
        triangles.append(t + first_vertex)
        first_vertex += len(p)
        first_index += t.size
    positions, normals, triangles = np.concatenate(positions), np.concatenate(normals), np.concatenate(triangles)

    directions, frames = fibonacci_directions(DIRECTIONS)
    transfer = np.zeros((len(positions), BANDS * BANDS))
    radius = 1.05 * np.linalg.norm(positions, axis=1).max()
    depth = np.empty((DEPTH_PIXELS, DEPTH_PIXELS))
    accumulate_visible(positions, normals, triangles, radius, frames, evaluate(directions, BANDS), depth, transfer)
    transfer *= 4 * np.pi / DIRECTIONS

    lanes = np.zeros((len(positions), LANES))
    scales = {"position": np.abs(positions).max(), "normal": 1.0, "transfer": np.abs(transfer).max()}
    lanes[:, 0:3] = positions / scales["position"]
    lanes[:, 4:7] = normals
    lanes[:, 8:33] = transfer / scales["transfer"]
    header = json.dumps({"vertices": len(positions), "bands": BANDS, "scales": scales, "parts": parts}).encode()
    header += b" " * (-len(header) % 4)
    samples = np.rint(lanes * 32767)
    samples[:, 8:33] = np.rint(samples[:, 8:33] / TRANSFER_STEP) * TRANSFER_STEP
    body = samples.astype("<i2").tobytes() + triangles.astype("<u2").tobytes()
    data = gzip.compress(len(header).to_bytes(4, "little") + header + body, 9, mtime=0)
    output_path.write_bytes(data)
    sys.stderr.write(f"{output_path}: {len(data)} bytes, {len(positions)} vertices, {len(triangles)} triangles\n")


if __name__ == "__main__":
    figure = bunny(Path(sys.argv[1]))
    if sys.argv[2:] != ["bunny"]:
        bake({"bunny": figure, "ball": ball(), "table": table()}, Path("public/scene.bin"))
    bake({"bunny": figure, "table": table()}, Path("public/bunny.bin"))
