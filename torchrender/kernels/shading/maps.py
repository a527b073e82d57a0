"""Textures: groups of them that lie alike are interleaved, so that one address serves all their channels."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.gather import spread
from torchrender.kernels.shading.records import LEVELS, MATERIAL, SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, ONE, TINY, TWO, ZERO, f4, weighed

U, V, LV, U1, V1, L1, VS = (SLOT[n] for n in ("U", "V", "LV", "U1", "V1", "L1", "VS"))
OC, RO, ME, QX, QY, QZ = (SLOT[n] for n in ("OC", "RO", "ME", "QX", "QY", "QZ"))
CC, CK, HR, HA, OR = (SLOT[n] for n in ("CC", "CK", "HR", "HA", "OR"))
NX, NY, NZ, GX, GY, GZ = (SLOT[n] for n in ("NX", "NY", "NZ", "GX", "GY", "GZ"))
EX, EY, EZ, TX, TY, TZ, TW = (SLOT[n] for n in ("EX", "EY", "EZ", "TX", "TY", "TZ", "TW"))
NORMAL_SCALE, OCCLUSION, EMISSION, TINT = (MATERIAL[n] for n in ("normal_scale", "occlusion", "emission", "tint"))
METALLIC, ROUGHNESS, COAT = MATERIAL["metallic"], MATERIAL["roughness"], MATERIAL["coat"]
DEGREE, WEIGHT = MATERIAL["degree"], MATERIAL["weight"]
LEAST_TILT = f4(1e-4)
REPEAT, MIRROR, CLAMP = 0, 1, 2
TRILINEAR, BILINEAR, NEAREST = 0, 1, 2


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
    for slot in (OC, HA, QX, QY, QZ):
        for i in range(n):
            s[slot + i] = ONE


@kernel(inline=True, counted=False)
def placed(x, wrap):
    """A coordinate moved into [0, 1]; float64: what is far from the unit square keeps its fraction."""
    if wrap == REPEAT:
        return f4(x - np.floor(x))
    if wrap == CLAMP:
        return f4(min(max(x, 0.0), 1.0))
    half = x * 0.5
    return f4(1.0 - abs(1.0 - 2.0 * (half - np.floor(half))))


@kernel(inline=True, counted=False)
def neighbours(place, size, wrap):
    """The two texels about a place in [0, 1] along one axis, and the share of the second."""
    x = place * f4(size) - HALF
    low = np.floor(x)
    i = np.int32(low)
    j = i + np.int32(1)
    if wrap == REPEAT:
        i = i + size if i < 0 else (i - size if i >= size else i)
        j = i + np.int32(1) if i + np.int32(1) < size else np.int32(0)
    else:
        i, j = min(max(i, np.int32(0)), size - np.int32(1)), min(max(j, np.int32(0)), size - np.int32(1))
    return i, j, x - low


@kernel(inline=True, counted=False)
def corners(groups, g, level, across, down, channels):
    """First numbers of the four texels about a place, and their weights."""
    k = LEVELS + 3 * level
    width, height = np.int32(groups[g, k + 1]), np.int32(groups[g, k + 2])
    i0, i1, a = neighbours(across, width, groups[g, 1])
    j0, j1, b = neighbours(down, height, groups[g, 2])
    first = groups[g, k]
    upper, lower = np.int64(j0) * width, np.int64(j1) * width
    w11, w10 = a * b, b - a * b
    w01 = a - w11
    return (
        first + (upper + i0) * channels, first + (upper + i1) * channels,
        first + (lower + i0) * channels, first + (lower + i1) * channels,
        ONE - a - w10, w01, w10, w11,
    )  # fmt: skip


@kernel(inline=True, counted=False)
def sample(s, i, g, groups, transforms, texels):
    """Multiply the numbers of pixel ``i`` by the textures of group ``g``."""
    second = groups[g, 4] == 1
    u, v = np.float64(s[U1 + i] if second else s[U + i]), np.float64(s[V1 + i] if second else s[V + i])
    if groups[g, 6] == 0:
        t = transforms[g]
        u, v = (
            np.float64(t[0]) * u + np.float64(t[1]) * v + np.float64(t[2]),
            np.float64(t[3]) * u + np.float64(t[4]) * v + np.float64(t[5]),
        )
    if not (math.isfinite(u) and math.isfinite(v)):
        u, v = np.float64(0.0), np.float64(0.0)
    across = placed(u, groups[g, 1])
    down = f4(np.ceil(v) - v) if groups[g, 2] == REPEAT else ONE - placed(v, groups[g, 2])
    channels = groups[g, 5]
    if groups[g, 3] == NEAREST:
        width, height = groups[g, LEVELS + 1], groups[g, LEVELS + 2]
        column = min(np.int64(across * f4(width)), width - 1)
        line = min(np.int64(down * f4(height)), height - 1)
        at = groups[g, LEVELS] + (line * width + column) * channels
        for c in range(channels):
            s[groups[g, 8 + c] + i] *= texels[at + c]
        return
    level = min(max((s[L1 + i] if second else s[LV + i]) + transforms[g, 6], ZERO), f4(groups[g, 0] - 1))
    level = ZERO if groups[g, 3] == BILINEAR else level
    k = np.int64(level)
    share = level - f4(k)
    rest = ONE - share
    p0, p1, p2, p3, a0, a1, a2, a3 = corners(groups, g, k, across, down, channels)
    if share > ZERO:
        q0, q1, q2, q3, b0, b1, b2, b3 = corners(groups, g, k + np.int64(1), across, down, channels)
        weights = a0 * rest, a1 * rest, a2 * rest, a3 * rest, b0 * share, b1 * share, b2 * share, b3 * share
        for c in range(0, channels, 4):
            places = p0 + c, p1 + c, p2 + c, p3 + c, q0 + c, q1 + c, q2 + c, q3 + c
            multiply(s, i, g, groups, c, weighed(texels, places, weights))
    else:
        for c in range(0, channels, 4):
            found = weighed(texels, (p0 + c, p1 + c, p2 + c, p3 + c), (a0, a1, a2, a3))
            multiply(s, i, g, groups, c, found)


@kernel(inline=True, counted=False)
def multiply(s, i, g, groups, c, found):
    """Numbers of pixel ``i`` times those of up to four channels of group ``g``, from channel ``c`` on."""
    left = groups[g, 5] - c
    s[groups[g, 8 + c] + i] *= found[0]
    if left > 1:
        s[groups[g, 9 + c] + i] *= found[1]
    if left > 2:
        s[groups[g, 10 + c] + i] *= found[2]
    if left > 3:
        s[groups[g, 11 + c] + i] *= found[3]


@kernel(counted=False)
def textures(work, n, looks):
    """All textures of all pixels."""
    s, mat = work.s, work.mat
    groups_of, groups, transforms, texels = looks.groups_of, looks.groups, looks.transforms, looks.texels
    for i in range(n):
        m = mat[i]
        for g in range(groups_of[m, 0], groups_of[m, 1]):
            sample(s, i, np.int64(g), groups, transforms, texels)


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
