"""Light from all around: diffuse, mirrored, and as the background."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.lobes import four_at
from torchrender.kernels.shading.records import IRRADIANCE_SIDE, SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, INV_PI, ONE, TINY, TWO, ZERO, angle, bits_of, f4, float_of, weighed

NX, NY, NZ, EX, EY, EZ = (SLOT[n] for n in ("NX", "NY", "NZ", "EX", "EY", "EZ"))
SX, SY, SZ, TA, TU, TV, FL = (SLOT[n] for n in ("SX", "SY", "SZ", "TA", "TU", "TV", "FL"))
DR, DG, DB, SR, SG, SB, LX, LY, LZ, OC = (SLOT[n] for n in "DR DG DB SR SG SB LX LY LZ OC".split())
LA, LB, LC, LD, LE, MA = (SLOT[n] for n in ("LA", "LB", "LC", "LD", "LE", "MA"))
C0, C1, C2, C3, C4, C5, C6, C7, C8, C9 = (SLOT[n] for n in "U V LV U1 V1 L1 TX TY TZ TW".split())
QX, QY, QZ = (SLOT[n] for n in ("QX", "QY", "QZ"))
"""Scratch: after textures and normal maps nobody reads what was in these slots."""


@kernel(inline=True, counted=False)
def octahedral(x, y, z):
    """Place in [0, 1] of a direction in an octahedral map, across (x) and down (z)."""
    scale = ONE / max(abs(x) + abs(y) + abs(z), TINY)
    p, q = x * scale, z * scale
    fp, fq = (ONE - abs(q)) * (-ONE if p < ZERO else ONE), (ONE - abs(p)) * (-ONE if q < ZERO else ONE)
    p, q = (fp if y < ZERO else p), (fq if y < ZERO else q)
    return p * HALF + HALF, q * HALF + HALF


@kernel(inline=True, counted=False)
def map_place(side, across, down):
    """Where a map with an edge of one texel is read: texel, as bits, and shares of the next column and row."""
    x, y = across * side + HALF, down * side + HALF
    column, row = min(np.floor(x), side), min(np.floor(y), side)
    texel = np.int32(np.int32(row) * np.int32(side + TWO) + np.int32(column))
    return float_of(texel), x - column, y - row


@kernel(inline=True, counted=False)
def map_weights(u, v, factor):
    """Weights of the four texels about a place, times ``factor``."""
    w11 = u * v
    return (ONE - u - v + w11) * factor, (u - w11) * factor, (v - w11) * factor, w11 * factor


@kernel(inline=True, counted=False)
def map_corners(first, side, texel):
    """First numbers of the four texels about a place by :func:`map_place`."""
    at, row = (first + np.int64(bits_of(texel))) * 3, (np.int64(side) + 2) * 3
    return at, at + 3, at + row, at + row + 3


@kernel(counted=False)
def diffuse(s, n, pix, sky, reach):
    """Irradiance over pi from all around into DR.., times what of it arrives; SR.. begin at zero."""
    ambient, texels = sky.ambient, sky.irradiance
    if reach.around.shape[0] > 0:
        for i in range(n):
            s[OC + i] *= reach.around[pix[i]]
    for c in range(3):
        t, even = s[c * SPAN :], ambient[c]
        for i in range(n):
            t[DR + i] = even
            t[SR + i] = ZERO
    if texels.shape[0] > 0:
        bent = reach.bent.shape[0] > 0
        for i in range(n):
            s[LX + i], s[LY + i], s[LZ + i] = s[NX + i], s[NY + i], s[NZ + i]
        if bent:
            # The open sky's middle was found about the smooth normal: it turns with what a map makes of that.
            for i in range(n):
                s[LX + i] += reach.bent[pix[i], 0] - s[SX + i]
                s[LY + i] += reach.bent[pix[i], 1] - s[SY + i]
                s[LZ + i] += reach.bent[pix[i], 2] - s[SZ + i]
        for i in range(n):
            across, down = octahedral(s[LX + i], s[LY + i], s[LZ + i])
            s[C0 + i], u, v = map_place(f4(IRRADIANCE_SIDE), across, down)
            s[C1 + i], s[C2 + i], s[C3 + i], s[C4 + i] = map_weights(u, v, ONE)
        for i in range(n):
            places = map_corners(np.int64(0), IRRADIANCE_SIDE, s[C0 + i])
            weights = s[C1 + i], s[C2 + i], s[C3 + i], s[C4 + i]
            red, green, blue, _ = weighed(texels, places, weights)
            s[DR + i] += red
            s[DG + i] += green
            s[DB + i] += blue
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            t[DR + i] *= s[OC + i]


@kernel(counted=False)
def lean(s, n, table, rough):
    """How two lobes lie that stand for what is mirrored, see :func:`torchrender.shading.sky.sky_lobe`.

    Part and roughness of the first into TU and TV, of the second into LB and LC, the share of the first into LA; the
    share in FL is added by Fresnel's term. After :func:`torchrender.kernels.shading.lobes.find`.
    """
    for i in range(n):
        at, u, v = s[TA + i], s[TU + i], s[TV + i]
        s[C0 + i], s[C1 + i], s[C2 + i], s[C3 + i] = four_at(table, at, u, v, 0)
        s[C4 + i], s[C5 + i], s[C6 + i], s[C7 + i] = four_at(table, at, u, v, 4)
        s[C8 + i], s[C9 + i], s[LA + i], _ = four_at(table, at, u, v, 8)
    roughness = s[rough:]
    for i in range(n):
        more, width = min(s[FL + i] * s[LA + i], ONE), roughness[i]
        s[TU + i] = s[C0 + i] + more * (s[C4 + i] - s[C0 + i])
        s[TV + i] = (s[C1 + i] + more * (s[C5 + i] - s[C1 + i])) * width
        s[LB + i] = s[C2 + i] + more * (s[C6 + i] - s[C2 + i])
        s[LC + i] = (s[C3 + i] + more * (s[C7 + i] - s[C3 + i])) * width
        s[LA + i] = s[C8 + i] + more * (s[C9 + i] - s[C8 + i])


@kernel(counted=False)
def add_filtered(s, n, texels, levels, rough):
    """Add to QX, QY, QZ what the maps of mirrored light show at the places in LX and LY, times the factor in LZ; for
    roughness in slot ``rough``.
    """
    last, roughness = f4(levels.shape[0] - 1), s[rough:]
    for i in range(n):
        level = min(max(roughness[i], ZERO), ONE) * last
        k = min(np.floor(level), last - ONE)
        s[MA + i], s[FL + i] = k, level - k
    for i in range(n):
        k = np.uintp(s[MA + i])
        s[LD + i], s[LE + i] = f4(levels[k, 1]), f4(levels[k + np.uintp(1), 1])
    for i in range(n):
        across, down, share = s[LX + i], s[LY + i], s[FL + i] * s[LZ + i]
        s[C0 + i], u, v = map_place(s[LD + i], across, down)
        s[C1 + i], s[C2 + i], s[C3 + i], s[C4 + i] = map_weights(u, v, s[LZ + i] - share)
        s[C5 + i], u, v = map_place(s[LE + i], across, down)
        s[C6 + i], s[C7 + i], s[C8 + i], s[C9 + i] = map_weights(u, v, share)
    for i in range(n):
        k = np.uintp(s[MA + i])
        p = map_corners(levels[k, 0], levels[k, 1], s[C0 + i])
        k = k + np.uintp(1)
        q = map_corners(levels[k, 0], levels[k, 1], s[C5 + i])
        first = s[C1 + i], s[C2 + i], s[C3 + i], s[C4 + i]
        second = s[C6 + i], s[C7 + i], s[C8 + i], s[C9 + i]
        r, g, b, _ = weighed(texels, p + q, first + second)
        s[QX + i] += r
        s[QY + i] += g
        s[QZ + i] += b


@kernel(inline=True, counted=False)
def lobe_place(s, i, normal, part):
    """Place in maps of the direction that is a ``part`` of the way from the normal to the mirrored one."""
    nx, ny, nz = normal[i], normal[SPAN + i], normal[2 * SPAN + i]
    ex, ey, ez = s[EX + i], s[EY + i], s[EZ + i]
    d = ONE - part + part * TWO * min(max(nx * ex + ny * ey + nz * ez, f4(1e-4)), ONE)
    return octahedral(d * nx - part * ex, d * ny - part * ey, d * nz - part * ez)


@kernel(counted=False)
def mirrored(s, n, sky, normal):
    """Radiance about the directions that normals in slot ``normal`` mirror to the eye, into LX, LY, LZ; after
    :func:`lean`.
    """
    ambient, texels, levels = sky.ambient, sky.mirrored, sky.levels
    for c in range(3):
        t, even = s[c * SPAN :], ambient[c]
        for i in range(n):
            t[QX + i] = even
    if texels.shape[0] > 0:
        up = s[normal:]
        for i in range(n):
            s[LX + i], s[LY + i] = lobe_place(s, i, up, s[TU + i])
            s[LZ + i] = s[LA + i]
        add_filtered(s, n, texels, levels, TV)
        for i in range(n):
            s[LX + i], s[LY + i] = lobe_place(s, i, up, s[LB + i])
            s[LZ + i] = ONE - s[LA + i]
        add_filtered(s, n, texels, levels, LC)
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            t[LX + i] = t[QX + i]


@kernel(counted=False)
def background(s, e, empty, view, sky, out):
    """Latitude-longitude look-up for empty pixels."""
    radiance, view = sky.radiance, view.numbers
    height, width = radiance.shape[0], radiance.shape[1]
    strength, turn = sky.turn[1], sky.turn[0]
    r00, r01, r02, r10, r11, r12 = view[0], view[1], view[2], view[3], view[4], view[5]
    r20, r21, r22, fx, fy, fz, flat = view[6], view[7], view[8], view[12], view[13], view[14], view[16]
    for i in range(e):
        px, py = s[DR + i], s[DG + i]
        dx, dy, dz = r00 * px + r01 * py + r02, r10 * px + r11 * py + r12, r20 * px + r21 * py + r22
        dx, dy, dz = (ONE - flat) * dx + flat * fx, (ONE - flat) * dy + flat * fy, (ONE - flat) * dz + flat * fz
        azimuth = angle(abs(dx), -dz)
        azimuth = (-azimuth if dx < ZERO else azimuth) + turn
        around = azimuth * f4(0.5 / math.pi) + HALF
        x = (around - np.floor(around)) * f4(width) - HALF
        y = angle(math.sqrt(dx * dx + dz * dz), dy) * INV_PI * f4(height) - HALF
        left, top = np.floor(x), np.floor(y)
        s[SR + i], s[SG + i] = x - left, y - top
        i0, i1 = (left + f4(width) if left < ZERO else left), left + ONE
        i1 = ZERO if i1 >= f4(width) else i1
        s[LX + i], s[LY + i] = float_of(np.int32(i0)), float_of(np.int32(i1))
        j0, j1 = min(max(top, ZERO), f4(height - 1)), min(max(top + ONE, ZERO), f4(height - 1))
        s[LZ + i], s[SB + i] = float_of(np.int32(j0)), float_of(np.int32(j1))
    for i in range(e):
        a, b, p = s[SR + i], s[SG + i], empty[i]
        i0, i1 = np.uintp(bits_of(s[LX + i])), np.uintp(bits_of(s[LY + i]))
        j0, j1 = np.uintp(bits_of(s[LZ + i])), np.uintp(bits_of(s[SB + i]))
        for c in range(3):
            up = radiance[j0, i0, c] + a * (radiance[j0, i1, c] - radiance[j0, i0, c])
            low = radiance[j1, i0, c] + a * (radiance[j1, i1, c] - radiance[j1, i0, c])
            out[p, c] = (up + b * (low - up)) * strength
