"""Kernels of the transfer (numba, one thread, without the GIL). Shapes: B vertices of a block, N directions, M rays."""

from __future__ import annotations

import numpy as np
from numba import njit

from lightwell.sh.basis import basis_at_float32


@njit(cache=True, nogil=True)
def frame_at(x, y, z, out):  # type: ignore[no-untyped-def]
    """Write a right-handed frame whose third axis is the unit vector (x, y, z) into ``out`` (3, 3), by columns.

    Duff et al. 2017, "Building an orthonormal basis, revisited".
    """
    sign = np.float32(1.0) if z >= 0 else np.float32(-1.0)
    a = np.float32(-1.0) / (sign + z)
    b = x * y * a
    out[0, 0], out[1, 0], out[2, 0] = np.float32(1.0) + sign * x * x * a, sign * b, -sign * x
    out[0, 1], out[1, 1], out[2, 1] = b, sign + y * y * a, -y
    out[0, 2], out[1, 2], out[2, 2] = x, y, z


@njit(cache=True, nogil=True)
def start_rays(origins, normals, sides, vectors, turns, ray_origins, ray_directions, ray_index, starts):  # type: ignore[no-untyped-def]
    """Fill in the rays of B vertices towards a set of directions in world axes; return their number M.

    A ray is sent where the direction is above both the vertex normal and the geometric one.

    ``origins, normals, sides`` (B, 3), ``vectors`` (N, 3) float32; ``turns`` is not used. Out: ``ray_origins,
    ray_directions`` (≥ BN, 3) float32, ``ray_index`` (≥ BN) uint16 or int32: which direction, ``starts`` (B + 1) int64:
    where the rays of each vertex begin.
    """
    used = 0
    for v in range(len(origins)):
        starts[v] = used
        nx, ny, nz = normals[v, 0], normals[v, 1], normals[v, 2]
        gx, gy, gz = sides[v, 0], sides[v, 1], sides[v, 2]
        for k in range(len(vectors)):
            x, y, z = vectors[k, 0], vectors[k, 1], vectors[k, 2]
            if nx * x + ny * y + nz * z > 0 and gx * x + gy * y + gz * z > 0:
                ray_origins[used, 0], ray_origins[used, 1], ray_origins[used, 2] = (
                    origins[v, 0],
                    origins[v, 1],
                    origins[v, 2],
                )
                ray_directions[used, 0], ray_directions[used, 1], ray_directions[used, 2] = x, y, z
                ray_index[used] = k
                used += 1
    starts[len(origins)] = used
    return used


@njit(cache=True, nogil=True)
def start_rays_about_normals(origins, normals, sides, vectors, turns, ray_origins, ray_directions, ray_index, starts):  # type: ignore[no-untyped-def]
    """Fill in rays as `start_rays`, the directions about each vertex's normal, turned by ``turns`` (B,) radians."""
    used = 0
    frame = np.empty((3, 3), np.float32)
    for v in range(len(origins)):
        starts[v] = used
        frame_at(normals[v, 0], normals[v, 1], normals[v, 2], frame)
        cosine, sine = np.float32(np.cos(turns[v])), np.float32(np.sin(turns[v]))
        gx, gy, gz = sides[v, 0], sides[v, 1], sides[v, 2]
        for k in range(len(vectors)):
            a = cosine * vectors[k, 0] - sine * vectors[k, 1]
            b = sine * vectors[k, 0] + cosine * vectors[k, 1]
            c = vectors[k, 2]
            x = frame[0, 0] * a + frame[0, 1] * b + frame[0, 2] * c
            y = frame[1, 0] * a + frame[1, 1] * b + frame[1, 2] * c
            z = frame[2, 0] * a + frame[2, 1] * b + frame[2, 2] * c
            if gx * x + gy * y + gz * z > 0:
                ray_origins[used, 0], ray_origins[used, 1], ray_origins[used, 2] = (
                    origins[v, 0],
                    origins[v, 1],
                    origins[v, 2],
                )
                ray_directions[used, 0], ray_directions[used, 1], ray_directions[used, 2] = x, y, z
                ray_index[used] = k
                used += 1
    starts[len(origins)] = used
    return used


@njit(cache=True, nogil=True, fastmath={"contract"})
def add_free(starts, free, ray_directions, ray_index, normals, table, half, weight, bands, sums):  # type: ignore[no-untyped-def]
    """Add ``weight · cos · Y`` of every free ray to ``sums`` (B, 2, bands²) float64, each half by itself.

    ``table`` (N, bands²) float32 holds Y by direction; an empty one says that directions differ from vertex to vertex
    and are cosine-weighted: then Y is evaluated and the cosine left out. ``free`` (M,) bool.
    """
    shared = len(table) > 0
    values = np.empty(bands * bands, np.float32)
    for v in range(len(starts) - 1):
        for r in range(starts[v], starts[v + 1]):
            if not free[r]:
                continue
            x, y, z = ray_directions[r, 0], ray_directions[r, 1], ray_directions[r, 2]
            k = ray_index[r]
            row = sums[v, half[k]]
            if shared:
                scale = weight * (normals[v, 0] * x + normals[v, 1] * y + normals[v, 2] * z)
                for i in range(bands * bands):
                    row[i] += scale * table[k, i]
            else:
                basis_at_float32(x, y, z, bands, values)
                for i in range(bands * bands):
                    row[i] += weight * values[i]


@njit(cache=True, nogil=True)
def keep_hits(  # type: ignore[no-untyped-def]
    starts, hit_triangle, hit_uv, ray_directions, normals, triangles, all_normals, weight, cosine_weighted, out, counts
):
    """Keep the hits on the front of surfaces for the bounces; return their number.

    ``hit_triangle`` (M,), −1 free; ``hit_uv`` (M, 2); ``triangles`` (F, 3), ``all_normals`` (V, 3) of the whole scene.
    Out: ``out`` (≥ M) of the dtype `HIT`; ``counts`` (B,): hits of each vertex; hits lie vertex after vertex.
    """
    kept = 0
    for v in range(len(starts) - 1):
        before = kept
        for r in range(starts[v], starts[v + 1]):
            t = hit_triangle[r]
            if t < 0:
                continue
            x, y, z = ray_directions[r, 0], ray_directions[r, 1], ray_directions[r, 2]
            u, w = hit_uv[r, 0], hit_uv[r, 1]
            if facing(triangles, all_normals, t, u, w, x, y, z) >= 0:
                continue
            scale = weight
            if not cosine_weighted:
                scale *= normals[v, 0] * x + normals[v, 1] * y + normals[v, 2] * z
            out[kept].triangle = t
            out[kept].u = np.uint16(min(max(u, np.float32(0)), np.float32(1)) * 65535 + 0.5)
            out[kept].v = np.uint16(min(max(w, np.float32(0)), np.float32(1)) * 65535 + 0.5)
            out[kept].weight = scale
            kept += 1
        counts[v] = kept - before
    return kept


@njit(cache=True, nogil=True)
def facing(triangles, normals, t, u, v, x, y, z):  # type: ignore[no-untyped-def]
    """Return the cosine (times a length) of a direction to the normal where it meets triangle ``t`` at (u, v)."""
    total = np.float32(0)
    for corner in range(3):
        share = (1 - u - v) if corner == 0 else (u if corner == 1 else v)
        n = triangles[t, corner]
        total += share * (normals[n, 0] * x + normals[n, 1] * y + normals[n, 2] * z)
    return total


@njit(cache=True, nogil=True, fastmath={"contract"})
def gather_bounce(hits, counts, triangles, reflected, out):  # type: ignore[no-untyped-def]
    """Write what B vertices get from the surfaces that they see to ``out`` (B, C) float32.

    ``hits``: of the dtype `HIT`, those of vertex 0 first; ``reflected`` (V, C) float32: albedo times transfer at the
    vertices of the scene, linear on triangles.
    """
    width = reflected.shape[1]
    total = np.empty(width, np.float64)
    h = 0
    for row in range(len(counts)):
        total[:] = 0
        for _ in range(counts[row]):
            u, v = hits[h].u / 65535, hits[h].v / 65535
            a, b, c = triangles[hits[h].triangle, 0], triangles[hits[h].triangle, 1], triangles[hits[h].triangle, 2]
            weight = hits[h].weight / np.pi
            wa, wb, wc = np.float32(weight * (1 - u - v)), np.float32(weight * u), np.float32(weight * v)
            for i in range(width):
                total[i] += wa * reflected[a, i] + wb * reflected[b, i] + wc * reflected[c, i]
            h += 1
        for i in range(width):
            out[row, i] = total[i]


@njit(cache=True, nogil=True)
def count_backs(starts, hit_triangle, hit_uv, ray_directions, triangles, all_normals, hit, back):  # type: ignore[no-untyped-def]
    """Count the hits of each vertex, and those on the back of surfaces, in ``hit`` and ``back`` (B,) int64."""
    for v in range(len(starts) - 1):
        for r in range(starts[v], starts[v + 1]):
            t = hit_triangle[r]
            if t >= 0:
                hit[v] += 1
                x, y, z = ray_directions[r, 0], ray_directions[r, 1], ray_directions[r, 2]
                if facing(triangles, all_normals, t, hit_uv[r, 0], hit_uv[r, 1], x, y, z) > 0:
                    back[v] += 1


@njit(cache=True, nogil=True)
def spread(triangles, hidden, values, total, number):  # type: ignore[no-untyped-def]
    """Add the values (V, C) of seen vertices to ``total`` (V, C) and ``number`` (V,) of their hidden neighbours."""
    for t in range(len(triangles)):
        for corner in range(3):
            a, b = triangles[t, corner], triangles[t, (corner + 1) % 3]
            if hidden[a] != hidden[b]:
                if hidden[b]:
                    a, b = b, a
                number[a] += 1
                for i in range(values.shape[1]):
                    total[a, i] += values[b, i]
