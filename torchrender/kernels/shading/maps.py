"""Textures: groups of them that lie alike are interleaved, so that one address serves all their channels."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import LEVELS, MATERIAL, SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, ONE, TINY, TWO, ZERO, bits_of, f4, float_of, weighed
from torchrender.kernels.shading.spread import spread

U, V, LV, U1, V1, L1, VS = (SLOT[n] for n in ("U", "V", "LV", "U1", "V1", "L1", "VS"))
OC, RO, ME, QX, QY, QZ = (SLOT[n] for n in ("OC", "RO", "ME", "QX", "QY", "QZ"))
CC, CK, TM, HR, HA, OR = (SLOT[n] for n in ("CC", "CK", "TM", "HR", "HA", "OR"))
NX, NY, NZ, GX, GY, GZ = (SLOT[n] for n in ("NX", "NY", "NZ", "GX", "GY", "GZ"))
EX, EY, EZ, TX, TY, TZ, TW = (SLOT[n] for n in ("EX", "EY", "EZ", "TX", "TY", "TZ", "TW"))
NORMAL_SCALE, OCCLUSION, EMISSION, TINT = (MATERIAL[n] for n in ("normal_scale", "occlusion", "emission", "tint"))
METALLIC, ROUGHNESS, COAT = MATERIAL["metallic"], MATERIAL["roughness"], MATERIAL["coat"]
DEGREE, WEIGHT, TRANSMISSION = MATERIAL["degree"], MATERIAL["weight"], MATERIAL["transmission"]
TA, TU, TV = (SLOT[n] for n in ("TA", "TU", "TV"))
FINER, COARSER, ACROSS, DOWN = (SLOT[n] for n in ("FR", "WR", "HC", "HD"))
SHARE, LEVEL, FOUND = (SLOT[n] for n in ("IN", "NV", "LA"))
"""Scratch of light, which is not there yet: places in textures, eight slots for each of two levels."""
LEAST_TILT = f4(1e-4)
REPEAT, MIRROR, CLAMP = 0, 1, 2
TRILINEAR, BILINEAR, NEAREST = 0, 1, 2
CODES = np.uintp(256)
STEP = f4(1.0 / 65535.0)


@kernel(counted=False)
def constants(work, n, looks, physical):
    """What textures multiply, as the materials have it; base colours are there already."""
    s, numbers = work.s, looks.numbers
    for c in range(3):
        spread(work, n, OR + c * SPAN, numbers, EMISSION + c)
        spread(work, n, HR + c * SPAN, numbers, TINT + c)
    if physical:
        spread(work, n, RO, numbers, ROUGHNESS)
        spread(work, n, ME, numbers, METALLIC)
        spread(work, n, CC, numbers, COAT)
        spread(work, n, CK, numbers, COAT + 1)
        spread(work, n, TM, numbers, TRANSMISSION)
    for slot in (OC, HA, QX, QY, QZ):
        for i in range(n):
            s[slot + i] = ONE


@kernel(inline=True, counted=False)
def placed(x, wrap):
    """A coordinate moved into [0, 1]; float64: what is far from the unit square keeps its fraction."""
    if wrap == REPEAT:
        return x - np.floor(x)
    if wrap == CLAMP:
        return min(max(x, 0.0), 1.0)
    half = x * 0.5
    return 1.0 - abs(1.0 - 2.0 * (half - np.floor(half)))


@kernel(inline=True, counted=False)
def neighbours(place, size, wrap):
    """The two texels about a place in [0, 1] along one axis, and the share of the second; whole numbers as float32."""
    x = place * size - HALF
    low = np.floor(x)
    if wrap == REPEAT:
        i = low + size if low < ZERO else (low - size if low >= size else low)
        j = i + ONE if i + ONE < size else ZERO
    else:
        i, j = min(max(low, ZERO), size - ONE), min(max(low + ONE, ZERO), size - ONE)
    return i, j, x - low


@kernel(counted=False)
def lay(s, n, g, looks, given):
    """Places of ``n`` pixels in the textures of group ``g`` into ACROSS and DOWN, number of the finer level into LEVEL
    and the share of the coarser one into SHARE; ``given`` = slots of texture coordinates and footprints.
    """
    t, row = looks.transforms[g], looks.groups[g]
    a, b, c = np.float64(t[0]), np.float64(t[1]), np.float64(t[2])
    d, e, f = np.float64(t[3]), np.float64(t[4]), np.float64(t[5])
    wrap_u, wrap_v = row[1], row[2]
    bias, most = t[6], ZERO if row[3] == BILINEAR else f4(row[0] - 1)
    first, second, footprint = s[given[0] :], s[given[1] :], s[given[2] :]
    for k in range(n):
        u, v = np.float64(first[k]), np.float64(second[k])
        u, v = a * u + b * v + c, d * u + e * v + f
        finite = abs(u) + abs(v) < np.inf
        u, v = u if finite else np.float64(0.0), v if finite else np.float64(0.0)
        s[ACROSS + k] = f4(placed(u, wrap_u))
        s[DOWN + k] = f4(placed(-v, wrap_v) if wrap_v == REPEAT else 1.0 - placed(v, wrap_v))
    for k in range(n):
        level = min(max(footprint[k] + bias, ZERO), most)
        s[LEVEL + k] = np.floor(level)
        s[SHARE + k] = level - np.floor(level)


@kernel(counted=False)
def corners(s, n, row, coarser, to):
    """Four texels of the finer (0) or coarser (1) level about the places by :func:`lay`: rows and columns of numbers as
    bits into two slots each from ``to`` on, then four weights.
    """
    width, height, channels = f4(row[LEVELS + 1]), f4(row[LEVELS + 2]), np.int32(row[5])
    wrap_u, wrap_v, made = row[1], row[2], s[to:]
    for k in range(n):
        number = np.int32(s[LEVEL + k]) + np.int32(coarser)
        halved = float_of(np.int32((np.int32(127) - np.int32(number)) << np.int32(23)))
        wide, high = max(np.floor(width * halved), ONE), max(np.floor(height * halved), ONE)
        i0, i1, a = neighbours(s[ACROSS + k], wide, wrap_u)
        j0, j1, b = neighbours(s[DOWN + k], high, wrap_v)
        made[k] = float_of(np.int32(np.int32(j0) * np.int32(wide)))
        made[SPAN + k] = float_of(np.int32(np.int32(j1) * np.int32(wide)))
        made[2 * SPAN + k] = float_of(np.int32(np.int32(i0) * channels))
        made[3 * SPAN + k] = float_of(np.int32(np.int32(i1) * channels))
        factor = s[SHARE + k] if coarser else ONE - s[SHARE + k]
        w11 = a * b
        w01, w10 = a - w11, b - w11
        made[4 * SPAN + k], made[5 * SPAN + k] = (ONE - a - w10) * factor, w01 * factor
        made[6 * SPAN + k], made[7 * SPAN + k] = w10 * factor, w11 * factor


@kernel(inline=True, counted=False)
def places(s, k, at, first, channels):
    """First numbers of the four texels of pixel ``k`` by :func:`corners`, and their weights."""
    upper = first + np.int64(bits_of(s[at + k])) * channels
    lower = first + np.int64(bits_of(s[at + SPAN + k])) * channels
    i0, i1 = np.int64(bits_of(s[at + 2 * SPAN + k])), np.int64(bits_of(s[at + 3 * SPAN + k]))
    weights = s[at + 4 * SPAN + k], s[at + 5 * SPAN + k], s[at + 6 * SPAN + k], s[at + 7 * SPAN + k]
    return (upper + i0, upper + i1, lower + i0, lower + i1), weights


@kernel(counted=False)
def blend_texels(s, n, row, texels, skip):
    """Four channels of all textures of a group, those after ``skip``, into FOUND and the next slots."""
    channels = row[5]
    for k in range(n):
        level = np.uintp(LEVELS) + np.uintp(3) * np.uintp(s[LEVEL + k])
        p, a = places(s, k, FINER, row[level] + skip, channels)
        if s[SHARE + k] > ZERO:
            q, b = places(s, k, COARSER, row[level + np.uintp(3)] + skip, channels)
            found = weighed(texels, p + q, a + b)
        else:
            found = weighed(texels, p, a)
        s[FOUND + k], s[FOUND + SPAN + k], s[FOUND + 2 * SPAN + k], s[FOUND + 3 * SPAN + k] = found


@kernel(inline=True, counted=False)
def weighed_codes(codes, tables, places, weights, kinds):
    """Sum of what ``codes[place : place + 4]`` are by tables from ``kinds`` (4,) on, times the weights."""
    r = g = b = a = ZERO
    for corner in range(4):
        at, weight = np.uintp(places[corner]), weights[corner]
        r += weight * tables[kinds[0] + np.uintp(codes[at])]
        g += weight * tables[kinds[1] + np.uintp(codes[at + np.uintp(1)])]
        b += weight * tables[kinds[2] + np.uintp(codes[at + np.uintp(2)])]
        a += weight * tables[kinds[3] + np.uintp(codes[at + np.uintp(3)])]
    return r, g, b, a


@kernel(inline=True, counted=False)
def kinds_of_codes(row, skip):
    """Where the tables of four channels after ``skip`` begin."""
    bits = row[7] >> (skip + 1)
    first, second = np.uintp(bits & 1) * CODES, np.uintp((bits >> 1) & 1) * CODES
    return first, second, np.uintp((bits >> 2) & 1) * CODES, np.uintp((bits >> 3) & 1) * CODES


@kernel(counted=False)
def blend_codes(s, n, row, looks, skip):
    """The same of textures that are kept as codes: the finest level through tables, others in units of STEP."""
    channels, kinds = row[5], kinds_of_codes(row, skip)
    for k in range(n):
        level = np.uintp(LEVELS) + np.uintp(3) * np.uintp(s[LEVEL + k])
        p, a = places(s, k, FINER, row[level] + skip, channels)
        if s[LEVEL + k] == ZERO:
            x, y, z, w = weighed_codes(looks.codes, looks.tables, p, a, kinds)
        else:
            x, y, z, w = weighed(looks.coarser, p, a)
            x, y, z, w = x * STEP, y * STEP, z * STEP, w * STEP
        if s[SHARE + k] > ZERO:
            q, b = places(s, k, COARSER, row[level + np.uintp(3)] + skip, channels)
            more = weighed(looks.coarser, q, b)
            x, y, z, w = x + STEP * more[0], y + STEP * more[1], z + STEP * more[2], w + STEP * more[3]
        s[FOUND + k], s[FOUND + SPAN + k], s[FOUND + 2 * SPAN + k], s[FOUND + 3 * SPAN + k] = x, y, z, w


@kernel(counted=False)
def nearest_texels(s, n, row, looks, skip):
    """The same of the finest level without a blend."""
    width, height, channels = row[LEVELS + 1], row[LEVELS + 2], row[5]
    kinds, coded = kinds_of_codes(row, skip), row[7] > 0
    for k in range(n):
        column = min(np.int64(s[ACROSS + k] * f4(width)), width - 1)
        line = min(np.int64(s[DOWN + k] * f4(height)), height - 1)
        at = row[LEVELS] + (line * width + column) * channels + skip
        for c in range(min(channels - skip, 4)):
            if coded:
                s[FOUND + c * SPAN + k] = looks.tables[kinds[c] + np.uintp(looks.codes[at + c])]
            else:
                s[FOUND + c * SPAN + k] = looks.texels[at + c]


@kernel(counted=False)
def multiply(s, n, rows, every, slot, found):
    """Numbers of the pixels in ``rows`` times those found for them; ``every``: these are all pixels, in order."""
    to, factor = s[slot:], s[found:]
    if every:
        for k in range(n):
            to[k] *= factor[k]
    else:
        for k in range(n):
            to[rows[k]] *= factor[k]


@kernel(counted=False)
def sample(work, n, every, g, looks):
    """Multiply the numbers of ``n`` pixels, see :func:`multiply`, by the textures of group ``g``."""
    s, rows, row = work.s, work.runs, looks.groups[g]
    given = (U1, V1, L1) if row[4] == 1 else (U, V, LV)
    if not every:
        first, second, footprint = s[given[0] :], s[given[1] :], s[given[2] :]
        for k in range(n):
            i = rows[k]
            s[TA + k], s[TU + k], s[TV + k] = first[i], second[i], footprint[i]
        given = (TA, TU, TV)
    lay(s, n, g, looks, given)
    if row[3] != NEAREST:
        corners(s, n, row, 0, FINER)
        corners(s, n, row, 1, COARSER)
    channels = row[5]
    for skip in range(0, channels, 4):
        if row[3] == NEAREST:
            nearest_texels(s, n, row, looks, skip)
        elif row[7] > 0:
            blend_codes(s, n, row, looks, skip)
        else:
            blend_texels(s, n, row, looks.texels, skip)
        for c in range(min(channels - skip, 4)):
            multiply(s, n, rows, every, row[8 + skip + c], FOUND + c * SPAN)


@kernel(counted=False)
def textures(work, n, looks):
    """All textures of all pixels, material by material: what does not depend on the pixel stays out of the loops."""
    mat, rows, count = work.mat, work.runs, work.found[3]
    for k in range(n if count == 0 else count):
        m = mat[k] if count == 0 else work.kinds[k]
        begin, end = looks.groups_of[m, 0], looks.groups_of[m, 1]
        if begin == end:
            continue
        chosen = np.uintp(0)
        if count == 0:
            rows[0], chosen = np.uint32(k), np.uintp(1)
        elif count == 1:
            chosen = np.uintp(n)
        else:
            for i in range(n):
                rows[chosen] = np.uint32(i)
                chosen = chosen + np.uintp(1 if mat[i] == m else 0)
        for g in range(begin, end):
            sample(work, np.int64(chosen), count == 1, np.int64(g), looks)


@kernel(counted=False)
def finish(work, n, looks, physical):
    """Occlusion by its strength, degrees and weights; numbers of metallic-roughness into their range."""
    s = work.s
    spread(work, n, VS, looks.numbers, OCCLUSION)
    for i in range(n):
        s[OC + i] = min(max(ONE + s[VS + i] * (s[OC + i] - ONE), ZERO), ONE)
    if physical:
        for i in range(n):
            s[RO + i] = min(max(s[RO + i], ZERO), ONE)
            s[ME + i] = min(max(s[ME + i], ZERO), ONE)
            s[CK + i] = min(max(s[CK + i], ZERO), ONE)


@kernel(inline=True, counted=False)
def raised(nx, ny, nz, ax, ay, az):
    """A unit normal, lifted to where it just looks along a unit axis."""
    more = max(LEAST_TILT - (nx * ax + ny * ay + nz * az), ZERO)
    nx, ny, nz = nx + more * ax, ny + more * ay, nz + more * az
    inv = ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, TINY))
    return nx * inv, ny * inv, nz * inv


@kernel(counted=False)
def bend(work, n, looks):
    """Normals as their maps bend them; never below the triangle, nor turned from the eye."""
    s = work.s
    spread(work, n, VS, looks.numbers, NORMAL_SCALE)
    for i in range(n):
        scale = s[VS + i]
        x, y, z = (TWO * s[QX + i] - ONE) * scale, (TWO * s[QY + i] - ONE) * scale, TWO * s[QZ + i] - ONE
        nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
        tx, ty, tz, w = s[TX + i], s[TY + i], s[TZ + i], s[TW + i]
        bx, by, bz = (ny * tz - nz * ty) * w, (nz * tx - nx * tz) * w, (nx * ty - ny * tx) * w
        mx, my, mz = x * tx + y * bx + z * nx, x * ty + y * by + z * ny, x * tz + y * bz + z * nz
        square = mx * mx + my * my + mz * mz
        inv = ONE / math.sqrt(max(square, TINY))
        mx, my, mz = mx * inv, my * inv, mz * inv
        usable = tx * tx + ty * ty + tz * tz > ZERO and square > TINY  # no tangent without a map
        mx, my, mz = raised(mx, my, mz, s[GX + i], s[GY + i], s[GZ + i])
        mx, my, mz = raised(mx, my, mz, s[EX + i], s[EY + i], s[EZ + i])
        s[NX + i], s[NY + i], s[NZ + i] = (mx if usable else nx), (my if usable else ny), (mz if usable else nz)
