"""The covered pixels of a tile into scratch: what their triangles carry, where they lie, how they look at the eye."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import MIN_COSINE
from torchrender.kernels.shading.records import MATERIAL, SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, ONE, TINY, ZERO, columns, f4, log2
from torchrender.kernels.shading.spread import kinds_of, spread

PX, PY, PZ, NX, NY, NZ = (SLOT[n] for n in ("PX", "PY", "PZ", "NX", "NY", "NZ"))
SX, SY, SZ, GX, GY, GZ = (SLOT[n] for n in ("SX", "SY", "SZ", "GX", "GY", "GZ"))
EX, EY, EZ, U, V, LV = (SLOT[n] for n in ("EX", "EY", "EZ", "U", "V", "LV"))
U1, V1, L1, TX, TY, TZ, TW, AM, TA = (SLOT[n] for n in "U1 V1 L1 TX TY TZ TW AM TA".split())
BR, BG, BB, DR, SH, VS = (SLOT[n] for n in ("BR", "BG", "BB", "DR", "SH", "VS"))
_NAMES = ("PX", "PY", "PZ", "SX", "SY", "DR", "DG", "GX", "GY", "GZ", "LV", "U", "V")
_PX, _PY, _PZ, _SX, _SY, _DR, _DG, _GX, _GY, _GZ, _LV, _U, _V = (np.uintp(SLOT[n]) for n in _NAMES)
_ONE = np.uintp(1)
_UNIT, _NOTHING = np.uint32(1), np.uint32(0)
_A, _B, _C, _D = SPAN, 2 * SPAN, 3 * SPAN, 4 * SPAN
"""Where the corners' numbers are in :attr:`Work.near`, after the triangles, and the materials."""
CORNERS = SLOT["FR"]
"""First of 24 slots, free before light comes, for what the corners of triangles carry."""
SHININESS = MATERIAL["shininess"]
DIFFUSE = MATERIAL["diffuse"]
LEAST, LARGEST = f4(1e-12), f4(1e12)
LONG = 12
"""Pixels that runs have in the mean from which on they are taken as such."""


@kernel(counted=False)
def gather(box, samples, view, packed, looks, work):
    """Attributes of the covered pixels of a tile into ``s``; -> their count, that of empty ones, kinds as bits.

    ``box`` = first and one past last column, then row. Bits: 1 << kind, flags of :attr:`Looks.groups_of` << 3.
    Where triangles are small pixel by pixel, else triangle by triangle. Where indices are signed, they are tested for
    counting from the end unless the compiler sees that they never do.
    """
    s, pix, numbers = work.s, work.pix, looks.numbers
    n, e = seen_pixels(box, samples, work)
    if changes(work.near, n) * LONG < n:
        for k in range(runs_of(work.near, n, work.runs)):
            one_triangle(work, packed, np.uintp(work.runs[k]), np.uintp(work.runs[k + 1]))
    else:
        many_triangles(work, packed, n)
    count = kinds_of(work.mat, n, work.kinds)
    work.found[3] = count
    bits = 0
    for k in range(n if count == 0 else count):
        m = work.mat[k] if count == 0 else work.kinds[k]
        bits |= (1 << looks.groups_of[m, 2]) | (looks.groups_of[m, 3] << 3)
    spread(work, n, SH, numbers, SHININESS)
    for c in range(3):
        spread(work, n, VS, numbers, DIFFUSE + c)
        t = s[c * SPAN :]
        for i in range(n):
            t[BR + i] *= s[VS + i]
    if samples.position.shape[0] > 0:
        for i in range(n):
            row = pix[i]
            for k in range(3):
                s[PX + k * SPAN + i] = f4(samples.position[row, k] - view.origin[k])
                s[EX + k * SPAN + i] = samples.to_eye[row, k]
            s[VS + i] = f4(samples.width[row])
    return n, e, bits


@kernel(counted=False)
def changes(values, n):
    """How often one of the first ``n`` values differs from the one before."""
    count = np.uint32(0)
    for i in range(1, n):
        count = np.uint32(count + (_UNIT if values[i] != values[i - 1] else _NOTHING))
    return np.int64(count)


@kernel(counted=False)
def runs_of(values, n, runs):
    """Where runs of equal values begin among the first ``n``, and the end; -> how many there are."""
    count, last = np.uintp(0), np.uint32(0xFFFFFFFF)
    for i in range(n):
        if values[i] != last:
            last = values[i]
            runs[count] = np.uint32(i)
            count = count + _ONE
    runs[count] = np.uint32(n)
    return np.int64(count)


@kernel(counted=False)
def one_triangle(work, packed, begin, end):
    """The pixels from ``begin`` to ``end``, which see one triangle."""
    s, near, corners, planes = work.s, work.near, packed.corners, packed.planes
    t = near[begin]
    a, b, c, m = packed.ids[t, 0], packed.ids[t, 1], packed.ids[t, 2], packed.ids[t, 3]
    gx, gy, gz, density = planes[t, 0], planes[t, 1], planes[t, 2], planes[t, 3]
    for i in range(begin, end):
        work.mat[i] = m
    for i in range(begin, end):
        s[_GX + i], s[_GY + i], s[_GZ + i], s[_LV + i] = gx, gy, gz, density
    for k in range(3):
        normal, color = np.uintp(NX + k * SPAN), np.uintp(BR + k * SPAN)
        na, nb, nc = corners[a, k], corners[b, k], corners[c, k]
        ra, rb, rc = corners[a, k + 3], corners[b, k + 3], corners[c, k + 3]
        for i in range(begin, end):
            u, v = s[_SX + i], s[_SY + i]
            w = ONE - u - v
            s[normal + i] = w * na + u * nb + v * nc
            s[color + i] = w * ra + u * rb + v * rc
    ua, ub, uc = np.float64(corners[a, 6]), np.float64(corners[b, 6]), np.float64(corners[c, 6])
    va, vb, vc = np.float64(corners[a, 7]), np.float64(corners[b, 7]), np.float64(corners[c, 7])
    for i in range(begin, end):
        du, dv = np.float64(s[_SX + i]), np.float64(s[_SY + i])  # large texture coordinates need it
        dw = 1.0 - du - dv
        s[_U + i], s[_V + i] = f4(dw * ua + du * ub + dv * uc), f4(dw * va + du * vb + dv * vc)


@kernel(inline=True, counted=False)
def eight(near, k, size):
    """First numbers of the rows of ``size`` that eight numbers in ``near`` from ``k`` on count."""
    return (
        np.int64(near[k]) * size, np.int64(near[k + 1]) * size, np.int64(near[k + 2]) * size,
        np.int64(near[k + 3]) * size, np.int64(near[k + 4]) * size, np.int64(near[k + 5]) * size,
        np.int64(near[k + 6]) * size, np.int64(near[k + 7]) * size,
    )  # fmt: skip


@kernel(counted=False)
def many_triangles(work, packed, n):
    """All pixels, eight at a time: their loads wait for memory side by side, and columns come from vectors."""
    s, near, end = work.s, work.near, (n + 7) // 8 * 8
    for i in range(n, end):
        near[i] = near[n - 1]
    for k in range(0, end, 8):
        rows = eight(near, k, 4)
        columns(packed.ids, rows, near, (_A + k, _B + k, _C + k, _D + k))
        columns(packed.planes, rows, s, (GX + k, GY + k, GZ + k, LV + k))
    for corner in range(3):
        for k in range(0, end, 8):
            rows = eight(near, (corner + 1) * SPAN + k, 8)
            at = CORNERS + corner * 8 * SPAN + k
            below = at + SPAN, at + 2 * SPAN, at + 3 * SPAN, at + 4 * SPAN, at + 5 * SPAN, at + 6 * SPAN, at + 7 * SPAN
            columns(packed.corners, rows, s, (at, *below))
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            u, v = s[SX + i], s[SY + i]
            w = ONE - u - v
            t[NX + i] = w * t[CORNERS + i] + u * t[CORNERS + 8 * SPAN + i] + v * t[CORNERS + 16 * SPAN + i]
            t[BR + i] = w * t[CORNERS + 3 * SPAN + i] + u * t[CORNERS + 11 * SPAN + i] + v * t[CORNERS + 19 * SPAN + i]
    blend_wide(s, n, s[CORNERS + 6 * SPAN :], 8 * SPAN, s[U:])
    blend_wide(s, n, s[CORNERS + 7 * SPAN :], 8 * SPAN, s[V:])


@kernel(counted=False)
def blend_wide(s, n, corner, stride, to):
    """Numbers of three corners, ``stride`` apart, at the weights in SX and SY; large texture coordinates need
    float64.
    """
    second, third = corner[stride:], corner[2 * stride :]
    for i in range(n):
        u, v = np.float64(s[SX + i]), np.float64(s[SY + i])
        w = 1.0 - u - v
        to[i] = f4(w * corner[i] + u * second[i] + v * third[i])


@kernel(counted=False)
def seen_pixels(box, samples, work):
    """Places, triangles and weights of the covered pixels of a tile, places of the empty ones; -> their counts.

    Rows that are covered throughout, or empty, go several pixels at a time.
    """
    x0, x1, y0, y1 = box
    triangle = samples.triangle
    n = e = np.uintp(0)
    for y in range(np.uintp(y0), np.uintp(y1)):
        least, most = triangle[y, x0], triangle[y, x0]
        for x in range(np.uintp(x0), np.uintp(x1)):
            least, most = min(least, triangle[y, x]), max(most, triangle[y, x])
        if least >= 0:
            n = covered_row(y, np.uintp(x0), np.uintp(x1), n, samples, work)
        elif most < 0:
            e = empty_row(y, np.uintp(x0), np.uintp(x1), e, samples, work)
        else:
            n, e = mixed_row(y, np.uintp(x0), np.uintp(x1), n, e, samples, work)
    return np.int64(n), np.int64(e)


@kernel(counted=False)
def covered_row(y, x0, x1, n, samples, work):
    """A part of a row without empty pixels; -> the count with its own."""
    s, pix, near, weights = work.s, work.pix, work.near, samples.weights
    first = y * np.uintp(samples.triangle.shape[1])
    for x in range(x0, x1):
        k = n + x - x0
        pix[k], near[k] = np.uint32(first + x), np.uint32(samples.triangle[y, x])
        s[_SX + k], s[_SY + k] = weights[y, x, 0], weights[y, x, 1]
    if samples.position.shape[0] == 0:
        for x in range(x0, x1):
            k = n + x - x0
            s[_PX + k], s[_PY + k] = f4(np.int32(x)) + HALF, f4(np.int32(y)) + HALF
            s[_PZ + k] = samples.depth[y, x]
    return n + x1 - x0


@kernel(counted=False)
def empty_row(y, x0, x1, e, samples, work):
    """A part of a row without covered pixels; -> the count of empty ones with its own."""
    s, empty = work.s, work.empty
    first = y * np.uintp(samples.triangle.shape[1])
    for x in range(x0, x1):
        k = e + x - x0
        s[_DR + k], s[_DG + k] = f4(np.int32(x)) + HALF, f4(np.int32(y)) + HALF
        empty[k] = np.uint32(first + x)
    return e + x1 - x0


@kernel(counted=False)
def mixed_row(y, x0, x1, n, e, samples, work):
    """A part of a row of both kinds; -> their counts with its own."""
    s, pix, empty, near = work.s, work.pix, work.empty, work.near
    triangle, weights, depth = samples.triangle, samples.weights, samples.depth
    of_image = samples.position.shape[0] == 0
    for x in range(x0, x1):
        t = triangle[y, x]
        row = np.uint32(y * np.uintp(triangle.shape[1]) + x)
        if t < 0:
            s[_DR + e], s[_DG + e], empty[e] = f4(x) + HALF, f4(y) + HALF, row
            e = e + _ONE
            continue
        pix[n], near[n] = row, np.uint32(t)
        s[_SX + n], s[_SY + n] = weights[y, x, 0], weights[y, x, 1]
        if of_image:
            s[_PX + n], s[_PY + n], s[_PZ + n] = f4(x) + HALF, f4(y) + HALF, depth[y, x]
        n = n + _ONE
    return n, e


@kernel(counted=False)
def gather_further(packed, work, n):
    """Second texture coordinates and tangents, where the scene has some; while SX and SY are weights still."""
    s, near, rows, end = work.s, work.near, work.runs, (n + 7) // 8 * 8
    if packed.further.shape[0] > 0:
        for i in range(n):
            t = near[i]
            for corner in range(3):
                v = packed.ids[t, corner]
                s[CORNERS + 2 * corner * SPAN + i] = packed.further[v, 0]
                s[CORNERS + (2 * corner + 1) * SPAN + i] = packed.further[v, 1]
            s[L1 + i] = packed.density[t]
        blend_wide(s, n, s[CORNERS:], 2 * SPAN, s[U1:])
        blend_wide(s, n, s[CORNERS + SPAN :], 2 * SPAN, s[V1:])
        for i in range(n):
            s[L1 + i] = log2(min(max(s[L1 + i] * s[VS + i], LEAST), LARGEST))
    if packed.tangent_row.shape[0] == 0:
        return
    for i in range(end):
        row = packed.tangent_row[near[min(i, n - 1)]]
        s[TA + i], rows[i] = (ONE if row >= 0 else ZERO), np.uint32(max(row, np.int32(0)))
    if packed.tangents.shape[0] == 0:
        for i in range(n):
            s[TX + i], s[TY + i], s[TZ + i], s[TW + i] = ZERO, ZERO, ZERO, ZERO
        return
    for k in range(0, end, 8):
        a, b, c, d, e, f, g, h = eight(rows, k, 12)
        for corner in range(3):
            at, skip = CORNERS + corner * 4 * SPAN + k, 4 * corner
            places = a + skip, b + skip, c + skip, d + skip, e + skip, f + skip, g + skip, h + skip
            columns(packed.tangents, places, s, (at, at + SPAN, at + 2 * SPAN, at + 3 * SPAN))
    for c in range(4):
        t = s[c * SPAN :]
        for i in range(n):
            u, v = s[SX + i], s[SY + i]
            found = (ONE - u - v) * t[CORNERS + i] + u * t[CORNERS + 4 * SPAN + i] + v * t[CORNERS + 8 * SPAN + i]
            found = (ONE if found >= ZERO else -ONE) if c == 3 else found
            t[TX + i] = found * s[AM + i] if s[TA + i] > ZERO else ZERO


@kernel(counted=False)
def place(s, n, view):
    """Position, direction to the eye and width of a pixel there, of pixels of an image."""
    view = view.numbers
    r00, r01, r02, r10, r11, r12 = view[0], view[1], view[2], view[3], view[4], view[5]
    r20, r21, r22, ox, oy, oz = view[6], view[7], view[8], view[9], view[10], view[11]
    fx, fy, fz, size, flat = view[12], view[13], view[14], view[15], view[16]
    for i in range(n):
        x, y, z = s[PX + i], s[PY + i], s[PZ + i]
        dx, dy, dz = r00 * x + r01 * y + r02, r10 * x + r11 * y + r12, r20 * x + r21 * y + r22
        k = flat + (ONE - flat) * z  # orthographic (flat = 1): the ray matrix goes across the image
        s[PX + i] = ox + k * dx + flat * z * fx
        s[PY + i] = oy + k * dy + flat * z * fy
        s[PZ + i] = oz + k * dz + flat * z * fz
        dx, dy, dz = (ONE - flat) * dx + flat * fx, (ONE - flat) * dy + flat * fy, (ONE - flat) * dz + flat * fz
        inv = ONE / math.sqrt(max(dx * dx + dy * dy + dz * dz, TINY))
        s[EX + i], s[EY + i], s[EZ + i] = -dx * inv, -dy * inv, -dz * inv
        s[VS + i] = size * k


@kernel(counted=False)
def face(s, n):
    """Normals that face the eye; the footprint of a pixel there (VS) and in texture coordinates, as a logarithm; which
    side is seen (AM: -1 where tangents turn).
    """
    for i in range(n):
        dx, dy, dz = s[EX + i], s[EY + i], s[EZ + i]
        gx, gy, gz = s[GX + i], s[GY + i], s[GZ + i]
        facing = gx * dx + gy * dy + gz * dz
        sign = -ONE if facing < ZERO else ONE
        gx, gy, gz = gx * sign, gy * sign, gz * sign
        nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
        square = nx * nx + ny * ny + nz * nz
        inv = ONE / math.sqrt(max(square, TINY))
        side = nx * gx + ny * gy + nz * gz
        inv = -inv if side < ZERO else inv
        own = square > TINY and side != ZERO
        nx, ny, nz = (nx * inv if own else gx), (ny * inv if own else gy), (nz * inv if own else gz)
        width = s[VS + i] / math.sqrt(max(abs(facing), f4(MIN_COSINE)))
        s[GX + i], s[GY + i], s[GZ + i] = gx, gy, gz
        s[NX + i], s[NY + i], s[NZ + i] = nx, ny, nz
        s[LV + i] = log2(min(max(s[LV + i] * width, LEAST), LARGEST))
        s[VS + i] = width
        s[AM + i] = -ONE if (side < ZERO or (not own and facing < ZERO)) else ONE
