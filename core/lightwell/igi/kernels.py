"""Kernels of gathering (numba, one thread, without the GIL).

Shapes: P pixels of a block, J lights of a batch, M ≤ PJ rays. Rows of pixels are innermost, so that loops over them
become vector instructions. Each pixel's numbers depend on that pixel and the order of the lights alone: no flag lets
the compiler reorder or fuse anything, so that blocks may be cut in any way and give the same bits.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lightwell.igi.lights import BOUNDARY, DIRECTIONAL, POINT, SURFACE

_SURFACE, _POINT, _DIRECTIONAL, _BOUNDARY = SURFACE, POINT, DIRECTIONAL, BOUNDARY


@njit(cache=True, nogil=True)
def look_at_lights(pixels, kind, position, normal, least, falloff, first, last, units, weight, excess):  # type: ignore[no-untyped-def]
    """Write what each pixel gets of each unit of flux, were there nothing between, and where it comes from.

    ``pixels`` (6, P): x, y, z of the lifted places and of the geometric normals; arrays of lights as in
    `lightwell.igi.lights.VirtualLights`, positions and normals (3, N), falloff (2, N). Out: ``units`` (J, 3, P) unit
    vectors towards lights ``first`` … ``last − 1``, ``weight`` (J, P), 0 where the light is below the pixel's horizon
    or looks away; ``excess`` (J, P): what the clamp takes off it. All of the dtype of ``pixels``.

    MATHS §10 clamps r². What makes a bright spot is ``cosθ cosα / r²``, and in a corner, where lights are near, the
    cosines are small: bounding that takes less away for the same noise.
    """
    count = pixels.shape[1]
    zero = pixels.dtype.type(0)
    one = pixels.dtype.type(1)
    inverse_pi = pixels.dtype.type(1 / np.pi)
    tiny = pixels.dtype.type(1e-30)
    px, py, pz, nx, ny, nz = pixels[0], pixels[1], pixels[2], pixels[3], pixels[4], pixels[5]
    for j in range(first, last):
        ux, uy, uz = units[j - first, 0], units[j - first, 1], units[j - first, 2]
        w, more = weight[j - first], excess[j - first]
        ax, ay, az = normal[0, j], normal[1, j], normal[2, j]
        if kind[j] == _DIRECTIONAL:
            for p in range(count):
                ux[p], uy[p], uz[p] = ax, ay, az
                w[p] = one if nx[p] * ax + ny[p] * ay + nz[p] * az > zero else zero
                more[p] = zero
            continue
        lx, ly, lz, smallest = position[0, j], position[1, j], position[2, j], least[j]
        a, b = falloff[0, j], falloff[1, j]
        factor = inverse_pi if kind[j] == _SURFACE else one
        is_point = kind[j] == _POINT
        for p in range(count):
            dx, dy, dz = lx - px[p], ly - py[p], lz - pz[p]
            square = max(dx * dx + dy * dy + dz * dz, tiny)
            scale = one / np.sqrt(square)
            x, y, z = dx * scale, dy * scale, dz * scale
            ux[p], uy[p], uz[p] = x, y, z
            away = -(ax * x + ay * y + az * z)
            if is_point:
                shine = min(max(a * away + b, zero), one)
                shine *= shine
            else:
                shine = max(away, zero) * factor
            above = nx[p] * x + ny[p] * y + nz[p] * z
            if above <= zero:
                shine = zero
            full = shine / square
            w[p] = shine / max(square, smallest * shine * above / factor)
            more[p] = full - w[p]


@njit(cache=True, nogil=True)
def shadow_rays(pixels, kind, position, normal, first, last, weight, origins, directions, ends, index):  # type: ignore[no-untyped-def]
    """Write a ray for every weight that is not zero; return their number M.

    Out: ``origins, directions`` (≥ PJ, 3), ``ends`` (≥ PJ) float32; ``index`` (≥ PJ) int32: j P + p.
    """
    count = pixels.shape[1]
    used = 0
    for j in range(first, last):
        row = weight[j - first]
        far = kind[j] == _DIRECTIONAL
        for p in range(count):
            if row[p] > 0:
                x, y, z = pixels[0, p], pixels[1, p], pixels[2, p]
                origins[used, 0], origins[used, 1], origins[used, 2] = x, y, z
                if far:
                    directions[used, 0], directions[used, 1], directions[used, 2] = (
                        normal[0, j],
                        normal[1, j],
                        normal[2, j],
                    )
                    ends[used] = np.float32(1e30)
                else:
                    directions[used, 0] = position[0, j] - x
                    directions[used, 1] = position[1, j] - y
                    directions[used, 2] = position[2, j] - z
                    ends[used] = np.float32(1)
                index[used] = (j - first) * count + p
                used += 1
    return used


@njit(cache=True, nogil=True)
def darken(blocked, used, index, weight, excess):  # type: ignore[no-untyped-def]
    """Set the weights whose rays are ``blocked`` (M,) to zero; ``weight`` and ``excess`` (J P,) flat."""
    for r in range(used):
        if blocked[r]:
            weight[index[r]] = 0
            excess[index[r]] = 0


@njit(cache=True, nogil=True)
def basis_rows(x, y, z, bands, a, ab, diagonal, lowest, out, scratch):  # type: ignore[no-untyped-def]
    """Write the SH basis at P unit vectors to ``out`` (bands², P): the recurrence of `lightwell.sh.basis`.

    ``a, ab`` (bands, bands), ``diagonal`` (bands,) and ``lowest`` (1,) hold its constants in the dtype of the rows;
    ``scratch`` (4, P).
    """
    count = len(x)
    cosine, sine, before, now = scratch[0], scratch[1], scratch[2], scratch[3]
    zero, one = lowest.dtype.type(0), lowest.dtype.type(1)
    sectoral = lowest[0]
    for m in range(bands):
        if m == 0:
            for p in range(count):
                cosine[p] = one
                sine[p] = zero
        else:
            sectoral *= diagonal[m]
            for p in range(count):
                c = x[p] * cosine[p] - y[p] * sine[p]
                sine[p] = x[p] * sine[p] + y[p] * cosine[p]
                cosine[p] = c
        for p in range(count):
            before[p] = zero
            now[p] = sectoral
        for degree in range(m, bands):
            if degree > m:
                up, down = a[degree, m], ab[degree, m]
                for p in range(count):
                    following = up * z[p] * now[p] - down * before[p]
                    before[p] = now[p]
                    now[p] = following
            centre = degree * degree + degree
            if m == 0:
                row = out[centre]
                for p in range(count):
                    row[p] = now[p]
            else:
                right, left = out[centre + m], out[centre - m]
                for p in range(count):
                    right[p] = now[p] * cosine[p]
                    left[p] = now[p] * sine[p]


@njit(cache=True, nogil=True)
def add_lights(  # type: ignore[no-untyped-def]
    units,
    weight,
    excess,
    kind,
    flux,
    least,
    row,
    table,
    first,
    last,
    bands,
    a,
    ab,
    diagonal,
    lowest,
    basis,
    scratch,
    sums,
):
    """Add ``Φ Y(ω)`` of lights ``first`` … ``last − 1`` to ``sums`` (bands², 3, P); return what the clamp took.

    ``flux`` (3, N); ``table`` (K, bands'², 3) coefficients of boundary lights; ``basis`` (bands², P) and ``scratch``
    are room. What is returned is summed over pixels and channels.
    """
    count = weight.shape[1]
    zero = lowest.dtype.type(0)
    lost = 0.0
    shine = np.empty((3, count), weight.dtype)
    for j in range(last - first):
        w = weight[j]
        dark = True
        for p in range(count):
            if w[p] > zero:
                dark = False
                break
        if dark:
            continue
        basis_rows(units[j, 0], units[j, 1], units[j, 2], bands, a, ab, diagonal, lowest, basis, scratch)
        for channel in range(3):
            level = flux[channel, first + j]
            target = shine[channel]
            if kind[first + j] == _BOUNDARY:
                target[:] = zero
                for k in range(min(table.shape[1], bands * bands)):
                    value, values = table[row[first + j], k, channel], basis[k]
                    for p in range(count):
                        target[p] += value * values[p]
                for p in range(count):
                    target[p] = max(target[p], zero) * level
            else:
                target[:] = level
            if least[first + j] > zero:
                for p in range(count):
                    lost += target[p] * excess[j, p]
            for p in range(count):
                target[p] *= w[p]
        for k in range(bands * bands):
            values = basis[k]
            for channel in range(3):
                target, total = shine[channel], sums[k, channel]
                for p in range(count):
                    total[p] += target[p] * values[p]
    return lost
