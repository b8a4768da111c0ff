"""Kernels of the analytic scene: radiance along a ray, and the integral of radiance times basis at a point."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from lightwell.sh.basis import basis_at

SQUARES = np.array([[4.0, 0.6, 0.4], [0.5, 3.0, 0.6], [0.5, 0.8, 4.0], [3.2, 2.8, 0.5]])
"""Colours of the projector's four squares."""
EDGE = 0.12
"""Width of the smooth edges of squares and cone, as a share of the picture's half-size."""


@njit(cache=True, nogil=True)
def _rise(x):  # type: ignore[no-untyped-def]
    """Smooth step: 0 below 0, 1 above 1, four times differentiable (its quadrature converges)."""
    if x <= 0.0:
        return 0.0
    if x >= 1.0:
        return 1.0
    return x * x * x * x * x * (126.0 + x * (-420.0 + x * (540.0 + x * (-315.0 + 70.0 * x))))


@njit(cache=True, nogil=True)
def _emitted(row, s, t, a, b, out):  # type: ignore[no-untyped-def]
    """Write the radiance that leaves an emitter at (s, t) ∈ [−1, 1]² towards the slopes (a, b) along u and v."""
    kind = int(row[0])
    if kind == 0:
        factor = 1.0 + row[13] * math.cos(math.pi * s) * math.cos(math.pi * t)
        out[0], out[1], out[2] = factor * row[10], factor * row[11], factor * row[12]
        return
    a, b = a / row[13], b / row[13]
    if kind == 1:
        # Each quarter of the picture holds a square from .1 to .9 of its side.
        x, y = abs(a), abs(b)
        inside = _rise((x - 0.1) / EDGE) * _rise((0.9 - x) / EDGE) * _rise((y - 0.1) / EDGE) * _rise((0.9 - y) / EDGE)
        square = (0 if a > 0 else 1) + (0 if b > 0 else 2)
        for channel in range(3):
            out[channel] = inside * SQUARES[square, channel] / 4.0 * row[10 + channel]
        return
    inside = _rise((1.0 - math.sqrt(a * a + b * b)) / EDGE)
    for channel in range(3):
        out[channel] = inside * row[10 + channel]


@njit(cache=True, nogil=True)
def _wall(position, wall, room, out):  # type: ignore[no-untyped-def]
    axis = wall // 2
    u = position[(axis + 1) % 3] / room[0, (axis + 1) % 3]
    v = position[(axis + 2) % 3] / room[0, (axis + 2) % 3]
    pattern = 1.0 + room[7, 0] * math.cos(2.0 * math.pi * u) * math.cos(math.pi * v)
    for channel in range(3):
        out[channel] = room[1 + wall, channel] * pattern


@njit(cache=True, nogil=True)
def _background(o, d, room, far, out):  # type: ignore[no-untyped-def]
    if room[0, 0] == 0.0:
        cosine = d[0] * far[2, 0] + d[1] * far[2, 1] + d[2] * far[2, 2]
        lobe = (0.5 + 0.5 * cosine) ** 4
        for channel in range(3):
            out[channel] = far[0, channel] + lobe * far[1, channel]
        return
    nearest, wall = np.inf, 0
    for axis in range(3):
        if d[axis] == 0.0:
            continue
        side = room[0, axis] if d[axis] > 0 else -room[0, axis]
        distance = (side - o[axis]) / d[axis]
        if distance < nearest:
            nearest, wall = distance, 2 * axis + (0 if d[axis] > 0 else 1)
    hit = np.empty(3)
    for axis in range(3):
        hit[axis] = o[axis] + nearest * d[axis]
    _wall(hit, wall, room, out)


@njit(cache=True, nogil=True)
def trace_one(o, d, emitters, room, far, out, light):  # type: ignore[no-untyped-def]
    """Write the radiance from direction ``d`` at ``o`` to ``out`` (3,); ``light`` (3,) is scratch."""
    _background(o, d, room, far, out)
    for e in range(emitters.shape[0]):
        row = emitters[e]
        ux, uy, uz, vx, vy, vz = row[4], row[5], row[6], row[7], row[8], row[9]
        nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        facing = nx * d[0] + ny * d[1] + nz * d[2]
        if facing >= 0.0:
            continue
        rx, ry, rz = row[1] - o[0], row[2] - o[1], row[3] - o[2]
        distance = (nx * rx + ny * ry + nz * rz) / facing
        if distance <= 0.0:
            continue
        x, y, z = distance * d[0] - rx, distance * d[1] - ry, distance * d[2] - rz
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        s, t = (x * ux + y * uy + z * uz) / uu, (x * vx + y * vy + z * vz) / vv
        if abs(s) > 1.0 or abs(t) > 1.0:
            continue
        size_u, size_v = math.sqrt(uu), math.sqrt(vv)
        depth = -facing / (size_u * size_v)
        a = -(d[0] * ux + d[1] * uy + d[2] * uz) / size_u / depth
        b = -(d[0] * vx + d[1] * vy + d[2] * vz) / size_v / depth
        if row[14] > 0.0 and s * size_u + a * row[14] < 0.0:
            continue  # the ray passes the screen's dark side
        _emitted(row, s, t, a, b, light)
        for channel in range(3):
            out[channel] += light[channel]


@njit(cache=True, nogil=True)
def trace(origins, directions, emitters, room, far, out):  # type: ignore[no-untyped-def]
    """Write the radiance of rays ``(n, 3)`` to ``out`` ``(n, 3)``."""
    light = np.empty(3)
    for i in range(out.shape[0]):
        trace_one(origins[i], directions[i], emitters, room, far, out[i], light)


@njit(cache=True, nogil=True)
def _add(solid_angle, light, basis, out):  # type: ignore[no-untyped-def]
    for k in range(basis.shape[0]):
        for channel in range(3):
            out[k, channel] += solid_angle * light[channel] * basis[k]


@njit(cache=True, nogil=True)
def integrate(  # type: ignore[no-untyped-def]
    points,
    emitters,
    room,
    far,
    bands,
    area_x,
    area_w,
    lens_x,
    lens_w,
    wall_x,
    wall_w,
    out,
):
    """Add the coefficients of all light at ``points`` ``(n, 3)`` to ``out`` ``(n, bands², 3)``."""
    basis, light, r, position = np.empty(bands * bands), np.empty(3), np.empty(3), np.empty(3)
    for i in range(points.shape[0]):
        x = points[i]
        for e in range(emitters.shape[0]):
            row = emitters[e]
            u, v = row[4:7], row[7:10]
            n = np.array([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])
            area = math.sqrt((n * n).sum())
            size_u, size_v = math.sqrt((u * u).sum()), math.sqrt((v * v).sum())
            depth = ((x - row[1:4]) * n).sum() / area
            if depth <= 0.0:
                continue
            along_u = ((x - row[1:4]) * u).sum() / size_u
            along_v = ((x - row[1:4]) * v).sum() / size_v
            first = -1.0
            if row[14] > 0.0:
                # The ray from s crosses the screen at s·size·(1 − screen/depth) + along·screen/depth: seen where ≥ 0.
                first = max(-1.0, -along_u * row[14] / depth / (size_u * (1.0 - row[14] / depth)))
                if first >= 1.0:
                    continue
            nodes, weights = (area_x, area_w) if row[0] == 0 else (lens_x, lens_w)
            for j in range(nodes.shape[0]):
                s = first + (1.0 - first) * 0.5 * (nodes[j] + 1.0)
                for k in range(nodes.shape[0]):
                    t = nodes[k]
                    squared = 0.0
                    for axis in range(3):
                        r[axis] = row[1 + axis] + s * u[axis] + t * v[axis] - x[axis]
                        squared += r[axis] * r[axis]
                    length = math.sqrt(squared)
                    measure = weights[j] * 0.5 * (1.0 - first) * weights[k] * area * depth / (squared * length)
                    _emitted(row, s, t, (along_u - s * size_u) / depth, (along_v - t * size_v) / depth, light)
                    basis_at(r[0] / length, r[1] / length, r[2] / length, bands, basis)
                    _add(measure, light, basis, out[i])
        if room[0, 0] == 0.0:
            _integrate_far(far, bands, wall_x, wall_w, basis, light, out[i])
            continue
        for wall in range(6):
            axis, side = wall // 2, 1.0 if wall % 2 == 0 else -1.0
            one, two = (axis + 1) % 3, (axis + 2) % 3
            for j in range(wall_x.shape[0]):
                for k in range(wall_x.shape[0]):
                    position[axis] = side * room[0, axis]
                    position[one] = wall_x[j] * room[0, one]
                    position[two] = wall_x[k] * room[0, two]
                    squared = 0.0
                    for component in range(3):
                        r[component] = position[component] - x[component]
                        squared += r[component] * r[component]
                    length = math.sqrt(squared)
                    measure = wall_w[j] * wall_w[k] * room[0, one] * room[0, two] * abs(r[axis]) / (squared * length)
                    _wall(position, wall, room, light)
                    basis_at(r[0] / length, r[1] / length, r[2] / length, bands, basis)
                    _add(measure, light, basis, out[i])


@njit(cache=True, nogil=True)
def _integrate_far(far, bands, nodes, weights, basis, light, out):  # type: ignore[no-untyped-def]
    """Project the far environment, a polynomial of degree 4: a product rule is exact."""
    columns = 2 * nodes.shape[0]
    o, d = np.zeros(3), np.empty(3)
    room = np.zeros((8, 3))
    for j in range(nodes.shape[0]):
        sine = math.sqrt(1.0 - nodes[j] * nodes[j])
        for k in range(columns):
            phi = 2.0 * math.pi * k / columns
            d[0], d[1], d[2] = sine * math.cos(phi), sine * math.sin(phi), nodes[j]
            _background(o, d, room, far, light)
            basis_at(d[0], d[1], d[2], bands, basis)
            _add(weights[j] * 2.0 * math.pi / columns, light, basis, out)
