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
LA, LB, LC, LD, LE = (SLOT[n] for n in ("LA", "LB", "LC", "LD", "LE"))


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
def map_corners(first, side, texel, u, v):
    """First numbers of the four texels about a place by :func:`map_place`, and their weights."""
    at, row = (first + np.int64(bits_of(texel))) * 3, (np.int64(side) + 2) * 3
    w11 = u * v
    return (at, at + 3, at + row, at + row + 3), (ONE - u - v + w11, u - w11, v - w11, w11)


@kernel(counted=False)
def diffuse(s, n, pix, sky, reach):
    """Irradiance over pi from all around into DR.., times what of it arrives; SR.. begin at zero."""
    ambient, texels = sky.ambient, sky.irradiance
    if reach.around.shape[0] > 0:
        for i in range(n):
            s[OC + i] *= reach.around[pix[i]]
    for c in range(3):
        even = ambient[c]
        for i in range(n):
            s[DR + c * SPAN + i] = even
            s[SR + c * SPAN + i] = ZERO
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
            s[TA + i], s[TU + i], s[TV + i] = map_place(f4(IRRADIANCE_SIDE), across, down)
        for i in range(n):
            places, weights = map_corners(np.int64(0), IRRADIANCE_SIDE, s[TA + i], s[TU + i], s[TV + i])
            red, green, blue, _ = weighed(texels, places, weights)
            s[DR + i] += red
            s[DG + i] += green
            s[DB + i] += blue
    for c in range(3):
        for i in range(n):
            s[DR + c * SPAN + i] *= s[OC + i]


@kernel(counted=False)
def lean(s, n, table, rough):
    """How two lobes lie that stand for what is mirrored, see :func:`torchrender.shading.sky.sky_lobe`.

    Part and roughness of the first into TU and TV, of the second into LB and LC, the share of the first into LA; the
    share in FL is added by Fresnel's term. After :func:`torchrender.kernels.shading.lobes.find`.
    """
    for i in range(n):
        at, u, v = s[TA + i], s[TU + i], s[TV + i]
        part, width, second, second_width = four_at(table, at, u, v, 0)
        part_other, width_other, second_other, second_width_other = four_at(table, at, u, v, 4)
        share, share_other, scale, _ = four_at(table, at, u, v, 8)
        more = min(s[FL + i] * scale, ONE)
        s[TU + i] = part + more * (part_other - part)
        s[TV + i] = (width + more * (width_other - width)) * s[rough + i]
        s[LB + i] = second + more * (second_other - second)
        s[LC + i] = (second_width + more * (second_width_other - second_width)) * s[rough + i]
        s[LA + i] = share + more * (share_other - share)


@kernel(inline=True, counted=False)
def filtered(texels, levels, roughness, across, down, factor):
    """Times ``factor``, what the maps of mirrored light show at a place."""
    level = min(max(roughness, ZERO), ONE) * f4(levels.shape[0] - 1)
    k = min(np.int64(level), np.int64(levels.shape[0] - 2))
    share = (level - f4(k)) * factor
    rest = factor - share
    texel, u, v = map_place(f4(levels[k, 1]), across, down)
    p, w = map_corners(levels[k, 0], levels[k, 1], texel, u, v)
    texel, u, v = map_place(f4(levels[k + 1, 1]), across, down)
    q, t = map_corners(levels[k + 1, 0], levels[k + 1, 1], texel, u, v)
    r, g, b, _ = weighed(texels, p, (w[0] * rest, w[1] * rest, w[2] * rest, w[3] * rest))
    x, y, z, _ = weighed(texels, q, (t[0] * share, t[1] * share, t[2] * share, t[3] * share))
    return r + x, g + y, b + z


@kernel(counted=False)
def mirrored(s, n, sky, normal):
    """Radiance about the directions that normals in slot ``normal`` mirror to the eye, into LX, LY, LZ; after
    :func:`lean`.
    """
    ambient, texels, levels = sky.ambient, sky.mirrored, sky.levels
    if texels.shape[0] == 0:
        for i in range(n):
            s[LX + i], s[LY + i], s[LZ + i] = ambient[0], ambient[1], ambient[2]
        return
    for i in range(n):
        nx, ny, nz = s[normal + i], s[normal + SPAN + i], s[normal + 2 * SPAN + i]
        ex, ey, ez = s[EX + i], s[EY + i], s[EZ + i]
        doubled = TWO * min(max(nx * ex + ny * ey + nz * ez, f4(1e-4)), ONE)
        part, second = s[TU + i], s[LB + i]
        d = ONE - part + part * doubled
        s[LX + i], s[LY + i] = octahedral(d * nx - part * ex, d * ny - part * ey, d * nz - part * ez)
        d = ONE - second + second * doubled
        s[LD + i], s[LE + i] = octahedral(d * nx - second * ex, d * ny - second * ey, d * nz - second * ez)
    for i in range(n):
        first = s[LA + i]
        r, g, b = filtered(texels, levels, s[TV + i], s[LX + i], s[LY + i], first)
        x, y, z = filtered(texels, levels, s[LC + i], s[LD + i], s[LE + i], ONE - first)
        s[LX + i], s[LY + i], s[LZ + i] = ambient[0] + r + x, ambient[1] + g + y, ambient[2] + b + z


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
