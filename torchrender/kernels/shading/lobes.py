"""How surfaces send the light on: Phong's lobe, or GGX with energy compensation over a coupled diffuse part."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import MATERIAL, METALLIC, PHONG, SLOT, SPAN, UNLIT
from torchrender.kernels.shading.simd import (
    HALF,
    INV_PI,
    ONE,
    PI,
    TINY,
    TWO,
    ZERO,
    dielectric,
    exp2,
    f4,
    fifth,
    log2,
    weighed,
)
from torchrender.kernels.shading.spread import spread

NX, NY, NZ, SX, SY, SZ = (SLOT[n] for n in ("NX", "NY", "NZ", "SX", "SY", "SZ"))
EX, EY, EZ, LX, LY, LZ = (SLOT[n] for n in ("EX", "EY", "EZ", "LX", "LY", "LZ"))
BR, BG, BB, OR, HR, HG, HB, HA = (SLOT[n] for n in ("BR", "BG", "BB", "OR", "HR", "HG", "HB", "HA"))
OC, RO, ME, CC, TM = (SLOT[n] for n in ("OC", "RO", "ME", "CC", "TM"))
DR, DG, DB, SR, SG, SB, AM, VS, SH = (SLOT[n] for n in ("DR", "DG", "DB", "SR", "SG", "SB", "AM", "VS", "SH"))
FR, FG, FB, FH, KR, KG, KB = (SLOT[n] for n in ("FR", "FG", "FB", "FH", "KR", "KG", "KB"))
WR, WG, WB, MR, MG, MB = (SLOT[n] for n in ("WR", "WG", "WB", "MR", "MG", "MB"))
LO, HI, HC, HD, IN, NV, MA, AB = (SLOT[n] for n in ("LO", "HI", "HC", "HD", "IN", "NV", "MA", "AB"))
SL, CL, TH, NE, YR, YG, YB = (SLOT[n] for n in ("SL", "CL", "TH", "NE", "YR", "YG", "YB"))
TA, TU, TV, FL = (SLOT[n] for n in ("TA", "TU", "TV", "FL"))
DIELECTRIC, WEIGHT, SHEEN, SHEEN_ROUGHNESS = (MATERIAL[n] for n in ("dielectric", "weight", "sheen", "sheen_roughness"))
DEGREE, LOBE = MATERIAL["degree"], MATERIAL["lobe"]
SLOWED, EXCESS = MATERIAL["slowed"], MATERIAL["excess"]
SMOOTHEST, LEAST_COSINE, COAT_F0, COAT_SLOWED = f4(0.045), f4(1e-3), f4(0.04), f4(1.25)


@kernel(counted=False)
def add_phong(s, n, light, shiny):
    """One light's diffuse and mirrored irradiance."""
    for c in range(3):
        t, color = s[c * SPAN :], light[7 + c] * INV_PI
        for i in range(n):
            t[DR + i] += color * s[AM + i]
    if shiny:
        for i in range(n):
            nx, ny, nz = s[NX + i], s[NY + i], s[NZ + i]
            lx, ly, lz, ex, ey, ez = s[LX + i], s[LY + i], s[LZ + i], s[EX + i], s[EY + i], s[EZ + i]
            d = TWO * (nx * ex + ny * ey + nz * ez)
            c = min(max((d * nx - ex) * lx + (d * ny - ey) * ly + (d * nz - ez) * lz, ZERO), ONE)
            s[VS + i] = s[AM + i] * exp2(s[SH + i] * log2(max(c, TINY)))
        for c in range(3):
            t, color = s[c * SPAN :], light[7 + c]
            for i in range(n):
                t[SR + i] += color * s[VS + i]


@kernel(inline=True, counted=False)
def corners_of(table, cosine, roughness):
    """Where a table over roots of cosines and roughness, both from 0 to 1, is read: rows, columns, and weights."""
    last = f4(table.shape[0] - 1)
    x, y = math.sqrt(cosine) * last, roughness * last
    i, j = min(np.int32(x), np.int32(table.shape[0] - 2)), min(np.int32(y), np.int32(table.shape[0] - 2))
    u, v = x - f4(i), y - f4(j)
    column, row, one = np.uint32(i), np.uint32(j), np.uint32(1)
    w11 = u * v
    w01, w10 = u - w11, v - w11
    w00 = ONE - u - w10
    return row, row + one, column, column + one, w00, w01, w10, w11


@kernel(inline=True, counted=False)
def read_at(table, corners, c):
    """Bilinear value of channel ``c``; ``corners`` by :func:`corners_of`."""
    j, m, i, k, w00, w01, w10, w11 = corners
    return w00 * table[j, i, c] + w01 * table[j, k, c] + w10 * table[m, i, c] + w11 * table[m, k, c]


@kernel(counted=False)
def find(s, n, size, cosine, roughness):
    """Where tables of that size are read for numbers in two slots, both from 0 to 1, into TA, TU, TV."""
    last, facing, rough = f4(size - 1), s[cosine:], s[roughness:]
    for i in range(n):
        x, y = math.sqrt(facing[i]) * last, rough[i] * last
        column, row = min(np.floor(x), last - ONE), min(np.floor(y), last - ONE)
        s[TA + i], s[TU + i], s[TV + i] = row * f4(size) + column, x - column, y - row


@kernel(inline=True, counted=False)
def four_at(table, at, u, v, skip):
    """Four numbers of a table (S,S,C), from the one after ``skip`` on, between entry ``at`` and the next ones; after
    :func:`find`.
    """
    numbers = np.int64(table.shape[2])
    first, width = np.int64(at) * numbers + np.int64(skip), np.int64(table.shape[0]) * numbers
    w11 = u * v
    w01, w10 = u - w11, v - w11
    places = first, first + numbers, first + width, first + width + numbers
    return weighed(table, places, (ONE - u - w10, w01, w10, w11))


@kernel(inline=True, counted=False)
def open_share(eye, seen, roughness):
    """Share of mirrored light where a share ``seen`` of all directions is open (Lagarde and de Rousiers 2014)."""
    power = exp2(f4(-16) * roughness - ONE)
    share = exp2(power * log2(max(max(eye, ZERO) + seen, f4(1e-6)))) - ONE + seen
    return ONE if seen >= ONE else min(max(share, ZERO), ONE)


@kernel(counted=False)
def look_up(work, n, looks, sky, cloth):
    """What :func:`mix` needs from tables: albedos into KR, KG, HC, HD, their means into FR, FG, FB, MA, numbers of the
    materials into SL, FH, NE, WR, WG, LO.
    """
    s, mat, numbers, table, mean = work.s, work.mat, looks.numbers, sky.albedo, sky.mean
    last = f4(mean.shape[0] - 1)
    for i in range(n):
        nv = s[NX + i] * s[EX + i] + s[NY + i] * s[EY + i] + s[NZ + i] * s[EZ + i]
        s[NV + i] = min(max(nv, f4(1e-4)), ONE)
        s[CL + i] = ZERO
        s[LO + i] = ZERO
    find(s, n, table.shape[0], NV, RO)
    for i in range(n):
        s[KR + i], s[KG + i], s[HC + i], s[HD + i] = four_at(table, s[TA + i], s[TU + i], s[TV + i], 0)
    for i in range(n):
        v, j = s[TV + i], np.int64(4) * np.int64(s[RO + i] * last - s[TV + i] + HALF)
        s[FR + i], s[FG + i], s[FB + i], s[MA + i] = weighed(mean, (j, j + np.int64(4)), (ONE - v, v))
    spread(work, n, SL, numbers, DIELECTRIC)
    spread(work, n, FH, numbers, WEIGHT)
    spread(work, n, NE, numbers, SLOWED)
    spread(work, n, WR, numbers, EXCESS)
    spread(work, n, WG, numbers, EXCESS + 1)
    if cloth:
        for i in range(n):
            m = mat[i]
            at = corners_of(sky.sheen, s[NV + i], min(max(numbers[m, SHEEN_ROUGHNESS], ZERO), ONE))
            s[CL + i] = read_at(sky.sheen, at, 0)
            s[LO + i] = max(numbers[m, SHEEN], max(numbers[m, SHEEN + 1], numbers[m, SHEEN + 2]))


@kernel(inline=True, counted=False)
def added(along, a, b, even):
    """Share of mirrored light ``along a + even`` that is not that of facets which all mirror ``along``."""
    return min(max(ONE - along * (a + b) / max(along * a + even, f4(1e-6)), ZERO), ONE)


@kernel(counted=False)
def mix(s, n):
    """Terms of metallic-roughness that do not depend on lights, from what the textures and tables told."""
    for i in range(n):
        a, b, mean_a, mean_b = s[KR + i], s[KG + i], s[FR + i], s[FG + i]
        first, second = s[WR + i], s[WG + i]
        excess, mean_excess = first * s[HC + i] + second * s[HD + i], first * s[FB + i] + second * s[MA + i]
        metal, weight, matte = s[ME + i], s[FH + i] * s[HA + i], (ONE - s[ME + i]) * (ONE - s[TM + i])
        high, pure = weight + metal * (ONE - weight), weight * (ONE - metal)
        lost = ONE / max(a + b, f4(1e-3)) - ONE
        se = s[SX + i] * s[EX + i] + s[SY + i] * s[EY + i] + s[SZ + i] * s[EZ + i]
        through = ONE - s[CC + i] * dielectric(COAT_SLOWED, min(max(se, f4(1e-4)), ONE))
        under = (ONE - s[LO + i] * s[CL + i]) * through  # what sheen and coat leave
        reflectance = s[SL + i]
        bare_r = min(reflectance * s[HR + i], ONE) * weight
        bare_g = min(reflectance * s[HG + i], ONE) * weight
        bare_b = min(reflectance * s[HB + i], ONE) * weight
        low = max(bare_r, max(bare_g, bare_b))
        red, green, blue = s[BR + i], s[BG + i], s[BB + i]
        f0, g0, b0 = (
            bare_r + metal * (red - bare_r),
            bare_g + metal * (green - bare_g),
            bare_b + metal * (blue - bare_b),
        )
        along = pure * reflectance  # comes with Fresnel's term
        s[FR + i], s[FG + i], s[FB + i] = f0 - along, g0 - along, b0 - along
        s[KR + i], s[KG + i], s[KB + i] = ONE + f0 * lost, ONE + g0 * lost, ONE + b0 * lost
        s[AB + i] = (a + b) * under
        even, most = high * b + pure * excess, max(f0, max(g0, b0))
        s[FL + i] = added(most, a, b, even)
        s[WR + i] = (f0 * a + even) * (ONE + f0 * lost) * under
        s[WG + i] = (g0 * a + even) * (ONE + g0 * lost) * under
        s[WB + i] = (b0 * a + even) * (ONE + b0 * lost) * under
        left = (ONE - (low * a + weight * (b + excess)) * (ONE + low * lost)) * matte * under
        s[MR + i], s[MG + i], s[MB + i] = red * left, green * left, blue * left
        s[FH + i], s[LO + i], s[HI + i], s[TH + i], s[SL + i] = pure, low, weight, through, under
        s[HC + i], s[HD + i] = weight * first, weight * second
        s[IN + i] = INV_PI / max(ONE - (low * mean_a + weight * (mean_b + mean_excess)), f4(1e-3))


@kernel(counted=False)
def begin_metallic(work, n, looks, cloth):
    """Emission, sheen and light from all around into YR..; what is mirrored is in LX.., and stays there
    as far as it arrives.
    """
    s, mat, numbers = work.s, work.mat, looks.numbers
    for i in range(n):
        s[VS + i] = open_share(s[NV + i], s[OC + i], s[RO + i])
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            mirrored = t[WR + i] * t[LX + i] * s[VS + i]
            t[LX + i] = mirrored  # what mirrors replace, for those who ask
            t[YR + i] = t[OR + i] + t[MR + i] * t[DR + i] + mirrored
        if cloth:
            for i in range(n):
                t[YR + i] += numbers[mat[i], SHEEN + c] * s[CL + i] * t[DR + i]


@kernel(inline=True, counted=False)
def ggx(square_sine, nl, nv, alpha):
    """``D G / (4 cos cos)``."""
    a2 = alpha * alpha
    spread = square_sine + a2 * (ONE - square_sine)
    nl, nv = max(nl, LEAST_COSINE), max(nv, LEAST_COSINE)
    masked = nl * math.sqrt(nv * nv * (ONE - a2) + a2) + nv * math.sqrt(nl * nl * (ONE - a2) + a2)
    return HALF * a2 / (PI * spread * spread * masked)


@kernel(inline=True, counted=False)
def half_terms(normal, eye, light):
    """Squared sine of the half vector to the normal, cosine to the eye."""
    nx, ny, nz = normal
    ex, ey, ez = eye
    lx, ly, lz = light
    hx, hy, hz = ex + lx, ey + ly, ez + lz
    inv = ONE / math.sqrt(max(hx * hx + hy * hy + hz * hz, TINY))
    hx, hy, hz = hx * inv, hy * inv, hz * inv
    cx, cy, cz = ny * hz - nz * hy, nz * hx - nx * hz, nx * hy - ny * hx
    return min(cx * cx + cy * cy + cz * cz, ONE), min(max(ex * hx + ey * hy + ez * hz, ZERO), ONE)


@kernel(counted=False)
def diffuse_share(s, n, table):
    """What of the light in AM meets the diffuse part, into MA."""
    for i in range(n):
        nl = s[NX + i] * s[LX + i] + s[NY + i] * s[LY + i] + s[NZ + i] * s[LZ + i]
        s[MA + i] = min(max(nl, ZERO), ONE)
    find(s, n, table.shape[0], MA, RO)
    for i in range(n):
        a, b, c, d = four_at(table, s[TA + i], s[TU + i], s[TV + i], 0)
        kept = s[LO + i] * a + s[HI + i] * b + s[HC + i] * c + s[HD + i] * d
        s[MA + i] = s[AM + i] * (ONE - kept) * s[IN + i]


@kernel(inline=True, counted=False)
def fresnel(s, i, half):
    """Fresnel's term at a cosine to facets: what is the same for all colours, and what multiplies FR, FG and FB."""
    grazing = fifth(half)
    return s[FH + i] * dielectric(s[NE + i], half) + s[ME + i] * grazing, ONE - grazing


@kernel(counted=False)
def add_metallic(s, n, sky, light):
    """One light, through all lobes under the coat but sheen."""
    red, green, blue = light[7], light[8], light[9]
    diffuse_share(s, n, sky.albedo)
    for i in range(n):
        amount, matte = s[AM + i], s[MA + i]
        nx, ny, nz, lx, ly, lz = s[NX + i], s[NY + i], s[NZ + i], s[LX + i], s[LY + i], s[LZ + i]
        sine, half = half_terms((nx, ny, nz), (s[EX + i], s[EY + i], s[EZ + i]), (lx, ly, lz))
        rough = max(s[RO + i], SMOOTHEST)
        lobe = amount * ggx(sine, nx * lx + ny * ly + nz * lz, s[NV + i], rough * rough) * s[SL + i]
        even, rest = fresnel(s, i, half)
        s[YR + i] += red * (s[MR + i] * matte + (even + s[FR + i] * rest) * s[KR + i] * lobe)
        s[YG + i] += green * (s[MG + i] * matte + (even + s[FG + i] * rest) * s[KG + i] * lobe)
        s[YB + i] += blue * (s[MB + i] * matte + (even + s[FB + i] * rest) * s[KB + i] * lobe)


@kernel(counted=False)
def write(work, n, bits, looks, out):
    """Radiance of each pixel by the kind of its material."""
    s, pix, numbers, radiance = work.s, work.pix, looks.numbers, out.radiance
    if bits & 16 > 0:
        spread(work, n, AM, numbers, DEGREE)
        spread(work, n, VS, numbers, LOBE)
        for c in range(3):
            t = s[c * SPAN :]
            for i in range(n):
                t[OR + i] += s[AM + i] * s[VS + i] * s[HA + i] * t[HR + i] * t[SR + i]
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            t[DR + i] = t[BR + i] * t[DR + i] + t[OR + i]
    if bits & 7 != 1 << PHONG:
        spread(work, n, AM, looks.groups_of, 2)
        for c in range(3):
            t = s[c * SPAN :]
            for i in range(n):
                value = t[YR + i] if s[AM + i] == f4(METALLIC) else t[DR + i]
                t[DR + i] = t[BR + i] if s[AM + i] == f4(UNLIT) else value
    for i in range(n):
        p = pix[i]
        for c in range(3):
            radiance[p, c] = s[DR + c * SPAN + i]


@kernel(counted=False)
def write_mirrors(s, n, pix, mat, looks, out):
    """What mirrors replace, and the share and tint of what they show."""
    numbers, kinds = looks.numbers, looks.groups_of
    for i in range(n):
        m, p = mat[i], pix[i]
        degree = numbers[m, DEGREE] * s[HA + i]
        nv = abs(s[NX + i] * s[EX + i] + s[NY + i] * s[EY + i] + s[NZ + i] * s[EZ + i])
        share = degree + (ONE - degree) * fifth(nv) if degree > ZERO else ZERO
        for c in range(3):
            replaced = share * s[BR + c * SPAN + i] * s[DR + c * SPAN + i]
            mirrored = share * s[HR + c * SPAN + i]
            if kinds[m, 2] == METALLIC:
                replaced, mirrored = out.replaced[p, c], s[WR + c * SPAN + i]
            if kinds[m, 2] == UNLIT:
                replaced, mirrored = ZERO, ZERO
            out.replaced[p, c], out.mirrored[p, c] = replaced, mirrored
