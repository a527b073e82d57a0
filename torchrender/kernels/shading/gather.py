"""The covered pixels of a tile into scratch: what their triangles carry, where they lie, how they look at the eye."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import MIN_COSINE
from torchrender.kernels.shading.records import MATERIAL, SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, ONE, TINY, ZERO, f4, log2, weighed
from torchrender.kernels.shading.spread import kinds_of, spread

PX, PY, PZ, NX, NY, NZ = (SLOT[n] for n in ("PX", "PY", "PZ", "NX", "NY", "NZ"))
SX, SY, SZ, GX, GY, GZ = (SLOT[n] for n in ("SX", "SY", "SZ", "GX", "GY", "GZ"))
EX, EY, EZ, U, V, LV = (SLOT[n] for n in ("EX", "EY", "EZ", "U", "V", "LV"))
U1, V1, L1, TX, TY, TZ, TW, AM = (SLOT[n] for n in ("U1", "V1", "L1", "TX", "TY", "TZ", "TW", "AM"))
BR, BG, BB, DR, SH, VS = (SLOT[n] for n in ("BR", "BG", "BB", "DR", "SH", "VS"))
_NAMES = ("PX", "PY", "PZ", "SX", "SY", "DR", "DG", "GX", "GY", "GZ", "LV", "U", "V")
_PX, _PY, _PZ, _SX, _SY, _DR, _DG, _GX, _GY, _GZ, _LV, _U, _V = (np.uintp(SLOT[n]) for n in _NAMES)
_ONE = np.uintp(1)
_UNIT, _NOTHING = np.uint32(1), np.uint32(0)
_A, _B, _C = SPAN, 2 * SPAN, 3 * SPAN
"""Where the corners' numbers are in :attr:`Work.near`, after the triangles."""
SHININESS = MATERIAL["shininess"]
DIFFUSE = MATERIAL["diffuse"]
LEAST, LARGEST = f4(1e-12), f4(1e12)
LONG = 3
"""Pixels that runs have in the mean from which on they are taken as such."""


@kernel(counted=False)
def gather(box, samples, view, packed, looks, work):
    """Attributes of the covered pixels of a tile into ``s``; -> their count, that of empty ones, kinds as bits.

    ``box`` = first and one past last column, then row. Bits: 1 << kind, flags of :attr:`Looks.groups_of` << 3.
    Where triangles are small: short loops, one kind of look-up each, so that what they wait for comes from memory side
    by side; else triangle by triangle. All indices are unsigned: signed ones are tested for counting from the end,
    access by access.
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
        for i in range(n):
            s[BR + c * SPAN + i] *= s[VS + i]
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


@kernel(counted=False)
def many_triangles(work, packed, n):
    """All pixels, each by itself."""
    s, mat, near, planes, ids = work.s, work.mat, work.near, packed.planes, packed.ids
    for i in range(n):
        k = near[i]
        near[_A + i], near[_B + i], near[_C + i], mat[i] = ids[k, 0], ids[k, 1], ids[k, 2], ids[k, 3]
    for i in range(n):
        k = near[i]
        s[GX + i], s[GY + i], s[GZ + i], s[LV + i] = planes[k, 0], planes[k, 1], planes[k, 2], planes[k, 3]
    blend(s, n, packed.corners, near)


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
def blend(s, n, corners, near):
    """What the corners carry, at the weights in SX and SY."""
    for i in range(n):  # brings them near, many at a time
        s[VS + i] = corners[near[_A + i], 0] + corners[near[_B + i], 0] + corners[near[_C + i], 0]
    for i in range(n):
        a, b, c = near[_A + i], near[_B + i], near[_C + i]
        u, v = s[SX + i], s[SY + i]
        first, second, third = np.int64(a) * 8, np.int64(b) * 8, np.int64(c) * 8
        weights = ONE - u - v, u, v
        s[NX + i], s[NY + i], s[NZ + i], s[BR + i] = weighed(corners, (first, second, third), weights)
        s[BG + i], s[BB + i], _, _ = weighed(corners, (first + 4, second + 4, third + 4), weights)
        du, dv = np.float64(u), np.float64(v)  # large texture coordinates need it
        dw = 1.0 - du - dv
        s[U + i] = f4(dw * corners[a, 6] + du * corners[b, 6] + dv * corners[c, 6])
        s[V + i] = f4(dw * corners[a, 7] + du * corners[b, 7] + dv * corners[c, 7])


@kernel(counted=False)
def gather_further(samples, packed, s, n, pix):
    """Second texture coordinates and tangents, where the scene has some; after :func:`face`."""
    triangle, weights = samples.triangle, samples.weights
    width = np.int64(triangle.shape[1])
    second, tangents = packed.further.shape[0] > 0, packed.tangent_row.shape[0] > 0
    for i in range(n):
        y = np.int64(pix[i]) // width
        x = np.int64(pix[i]) - y * width
        t = triangle[y, x]
        a, b, c = packed.ids[t, 0], packed.ids[t, 1], packed.ids[t, 2]
        u, v = weights[y, x, 0], weights[y, x, 1]
        w = ONE - u - v
        if second:
            du, dv = np.float64(u), np.float64(v)
            dw = 1.0 - du - dv
            f = packed.further
            s[U1 + i] = f4(dw * f[a, 0] + du * f[b, 0] + dv * f[c, 0])
            s[V1 + i] = f4(dw * f[a, 1] + du * f[b, 1] + dv * f[c, 1])
            s[L1 + i] = log2(min(max(packed.density[t] * s[VS + i], LEAST), LARGEST))
        if tangents:
            row = packed.tangent_row[t]
            for k in range(4):
                s[TX + k * SPAN + i] = ZERO
            if row >= 0:
                at, turned = np.int64(row) * 12, s[AM + i]
                x, y, z, side = weighed(packed.tangents, (at, at + 4, at + 8), (w, u, v))
                s[TX + i], s[TY + i], s[TZ + i] = turned * x, turned * y, turned * z
                s[TW + i] = turned if side >= ZERO else -turned


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
        s[SX + i], s[SY + i], s[SZ + i] = nx, ny, nz
        s[LV + i] = log2(min(max(s[LV + i] * width, LEAST), LARGEST))
        s[VS + i] = width
        s[AM + i] = -ONE if (side < ZERO or (not own and facing < ZERO)) else ONE
