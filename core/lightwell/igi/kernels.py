"""Kernels of gathering (numba, one thread, without the GIL).

Shapes: P pixels of a block, J lights of a batch, M ≤ PJ rays. Rows of pixels are innermost, so that loops over
them become vector instructions. Each pixel's numbers depend on that pixel and the order of the lights alone: no flag
lets the compiler reorder or fuse anything, so that blocks may be cut in any way and give the same bits. (NumPy's error
model is Python's without the test of each divisor, which would keep loops from becoming vector instructions.)
"""

from __future__ import annotations

import numpy as np
from numba import njit

from lightwell.igi.lights import CAPTURED, DIRECTIONAL, POINT, SURFACE

_SURFACE, _POINT, _DIRECTIONAL, _CAPTURED = SURFACE, POINT, DIRECTIONAL, CAPTURED


@njit(cache=True, nogil=True, error_model="numpy")
def look_at_lights(pixels, kind, position, normal, least, falloff, first, last, sight, scratch):  # type: ignore[no-untyped-def]
    """Write what each pixel gets of each unit of flux, were there nothing between, and where it comes from.

    ``pixels`` (6, P): x, y, z of the lifted places and of the geometric normals; arrays of lights as in
    `lightwell.igi.lights.VirtualLights`, positions and normals (3, N), falloff (2, N). Out: ``sight`` (J, 5, ≥ P) for
    lights ``first`` … ``last − 1``: x, y and z of the unit vector towards the light; weight, 0 where the light is below
    the pixel's horizon or looks away; what the clamp takes off the weight. ``scratch`` (≥ 2, P). All of one dtype.

    MATHS §10 clamps r². What makes a bright spot is ``cosθ cosα / r²``, and in a corner, where lights are near, the
    cosines are small: bounding that takes less away for the same noise.

    Loops are short because the compiler tests at run time that the rows of a loop do not overlap, and gives vector
    instructions up where there are many.
    """
    count = pixels.shape[1]
    zero = pixels.dtype.type(0)
    one = pixels.dtype.type(1)
    inverse_pi = pixels.dtype.type(1 / np.pi)
    tiny = pixels.dtype.type(1e-30)
    nx, ny, nz = pixels[3], pixels[4], pixels[5]
    square, above = scratch[0], scratch[1]
    for j in range(first, last):
        seen = sight[j - first]
        x, y, z, w, excess = seen[0, :count], seen[1, :count], seen[2, :count], seen[3, :count], seen[4, :count]
        ax, ay, az = normal[0, j], normal[1, j], normal[2, j]
        if kind[j] == _DIRECTIONAL or kind[j] == _CAPTURED:
            x[:], y[:], z[:] = ax, ay, az
            excess[:] = zero
            for p in range(count):
                w[p] = one if nx[p] * ax + ny[p] * ay + nz[p] * az > zero else zero
            continue
        for axis in range(3):
            target, own, place = seen[axis, :count], pixels[axis], position[axis, j]
            for p in range(count):
                target[p] = place - own[p]
        for p in range(count):
            square[p] = x[p] * x[p] + y[p] * y[p] + z[p] * z[p]
        for p in range(count):
            square[p] = max(square[p], tiny)
        for p in range(count):
            w[p] = one / np.sqrt(square[p])
        for axis in range(3):
            target = seen[axis, :count]
            for p in range(count):
                target[p] *= w[p]
        for p in range(count):
            above[p] = nx[p] * x[p] + ny[p] * y[p] + nz[p] * z[p]
        for p in range(count):
            w[p] = -(ax * x[p] + ay * y[p] + az * z[p])
        if kind[j] == _POINT:
            a, b = falloff[0, j], falloff[1, j]
            for p in range(count):
                share = min(max(a * w[p] + b, zero), one)
                w[p] = share * share / square[p] if above[p] > zero else zero
            excess[:] = zero
            continue
        smallest = least[j]
        for p in range(count):
            w[p] = max(w[p], zero) * inverse_pi if above[p] > zero else zero
        # Where w is zero, what stands below the line does not matter.
        scale = smallest / inverse_pi
        for p in range(count):
            bound = scale * w[p] * above[p]
            kept = w[p] / max(square[p], bound)
            excess[p] = w[p] / square[p] - kept
            w[p] = kept


@njit(cache=True, nogil=True)
def shadow_rays(pixels, kind, position, normal, first, last, sight, origins, directions, ends, index):  # type: ignore[no-untyped-def]
    """Write a ray for every weight that is not zero; return their number M.

    Out: ``origins, directions`` (≥ PJ, 3), ``ends`` (≥ PJ) float32; ``index`` (≥ PJ) int32: j P + p.
    """
    count = pixels.shape[1]
    used = 0
    for j in range(first, last):
        weight = sight[j - first, 3]
        far = kind[j] == _DIRECTIONAL or kind[j] == _CAPTURED
        for p in range(count):
            if weight[p] > 0:
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
def darken(blocked, used, index, count, sight):  # type: ignore[no-untyped-def]
    """Set the weights whose rays are ``blocked`` (M,) to zero, and what the clamp takes off them."""
    for r in range(used):
        if blocked[r]:
            j, p = index[r] // count, index[r] % count
            sight[j, 3, p] = 0
            sight[j, 4, p] = 0


@njit(cache=True, nogil=True, error_model="numpy")
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


@njit(cache=True, nogil=True, error_model="numpy")
def add_lights(  # type: ignore[no-untyped-def]
    sight,
    offset,
    count,
    kind,
    flux,
    least,
    harmonics,
    own,
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

    ``sight`` (J, 5, ≥ P) as `look_at_lights` writes it, light ``first`` at ``offset``; ``flux`` (3, N); ``harmonics``
    (N, bands'²) of captured lights, and ``own`` (bands'², 3, P): the field's coefficients at the pixels; ``basis``
    (bands², P) and ``scratch`` are room. What is returned is summed over pixels and channels.
    """
    zero = lowest.dtype.type(0)
    lost = np.zeros(count, sight.dtype)
    shine = np.empty((3, count), sight.dtype)
    for j in range(last - first):
        seen = sight[offset + j]
        x, y, z, w, excess = seen[0, :count], seen[1, :count], seen[2, :count], seen[3, :count], seen[4, :count]
        dark = True
        for p in range(count):
            if w[p] > zero:
                dark = False
                break
        if dark:
            continue
        basis_rows(x, y, z, bands, a, ab, diagonal, lowest, basis, scratch)
        for channel in range(3):
            level = flux[channel, first + j]
            target = shine[channel]
            if kind[first + j] == _CAPTURED:
                target[:] = zero
                for k in range(len(own)):
                    value, values = harmonics[first + j, k], own[k, channel]
                    for p in range(count):
                        target[p] += value * values[p]
                for p in range(count):
                    target[p] *= level
            else:
                target[:] = level
            if least[first + j] > zero:
                for p in range(count):
                    lost[p] += target[p] * excess[p]
            for p in range(count):
                target[p] *= w[p]
        for k in range(bands * bands):
            values = basis[k]
            for channel in range(3):
                target, total = shine[channel], sums[k, channel]
                for p in range(count):
                    total[p] += target[p] * values[p]
    total_lost = 0.0
    for p in range(count):
        total_lost += lost[p]
    return total_lost


@njit(cache=True, nogil=True)
def find(seen, top, left, down, across, rows, columns):  # type: ignore[no-untyped-def]
    """Write which pixels from ``top, left`` on, every ``down, across``, are ``seen`` (H, W); return their number."""
    used = 0
    for i in range(top, seen.shape[0], down):
        for j in range(left, seen.shape[1], across):
            if seen[i, j]:
                rows[used], columns[used] = i, j
                used += 1
    return used


@njit(cache=True, nogil=True)
def load(places, normals, rows, columns, pixels):  # type: ignore[no-untyped-def]
    """Write places and normals (H, W, 3) of pixels ``rows, columns`` (P,) to ``pixels`` (6, P)."""
    for p in range(len(rows)):
        for axis in range(3):
            pixels[axis, p] = places[rows[p], columns[p], axis]
            pixels[3 + axis, p] = normals[rows[p], columns[p], axis]


@njit(cache=True, nogil=True)
def store(sums, rows, columns, out):  # type: ignore[no-untyped-def]
    """Write sums (G, bands², 3, P) to ``out`` (H, W, G, bands², 3) at pixels ``rows, columns`` (P,)."""
    for p in range(len(rows)):
        pixel = out[rows[p], columns[p]]
        for group in range(sums.shape[0]):
            for k in range(sums.shape[1]):
                for channel in range(3):
                    pixel[group, k, channel] = sums[group, k, channel, p]
