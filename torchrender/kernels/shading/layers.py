"""What lies on top of metallic-roughness: sheen, and a clear coat."""

from __future__ import annotations

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.lobes import (
    COAT_F0,
    COAT_SLOWED,
    LEAST_COSINE,
    SHEEN,
    SHEEN_ROUGHNESS,
    SMOOTHEST,
    added,
    find,
    four_at,
    ggx,
    half_terms,
    open_share,
)
from torchrender.kernels.shading.records import SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, INV_PI, ONE, TWO, ZERO, dielectric, exp2, f4, log2

NX, NY, NZ, SX, SY, SZ = (SLOT[n] for n in ("NX", "NY", "NZ", "SX", "SY", "SZ"))
EX, EY, EZ, LX, LY, LZ = (SLOT[n] for n in ("EX", "EY", "EZ", "LX", "LY", "LZ"))
AM, VS, NV, OC, CC, CK, YR = (SLOT[n] for n in ("AM", "VS", "NV", "OC", "CC", "CK", "YR"))
TA, TU, TV, FL = (SLOT[n] for n in ("TA", "TU", "TV", "FL"))


@kernel(counted=False)
def add_sheen(s, n, mat, looks, light):
    """One light on sheen."""
    numbers = looks.numbers
    for i in range(n):
        nx, ny, nz, lx, ly, lz = s[NX + i], s[NY + i], s[NZ + i], s[LX + i], s[LY + i], s[LZ + i]
        sine, _ = half_terms((nx, ny, nz), (s[EX + i], s[EY + i], s[EZ + i]), (lx, ly, lz))
        rough = max(numbers[mat[i], SHEEN_ROUGHNESS], f4(0.07))
        inverse = ONE / (rough * rough)
        spread = (TWO + inverse) * exp2(HALF * inverse * log2(max(sine, f4(1e-12)))) * HALF * INV_PI
        nl, nv = max(nx * lx + ny * ly + nz * lz, LEAST_COSINE), max(s[NV + i], LEAST_COSINE)
        s[VS + i] = s[AM + i] * spread / (f4(4) * (nl + nv - nl * nv))
    for c in range(3):
        t, color = s[c * SPAN :], light[7 + c]
        for i in range(n):
            t[YR + i] += color * numbers[mat[i], SHEEN + c] * s[VS + i]


@kernel(counted=False)
def add_coat(s, n, light):
    """One light on the clear coat, which lies flat under the normal map."""
    for i in range(n):
        sx, sy, sz, lx, ly, lz = s[SX + i], s[SY + i], s[SZ + i], s[LX + i], s[LY + i], s[LZ + i]
        ex, ey, ez = s[EX + i], s[EY + i], s[EZ + i]
        bent = max(s[NX + i] * lx + s[NY + i] * ly + s[NZ + i] * lz, LEAST_COSINE)
        nl = max(sx * lx + sy * ly + sz * lz, ZERO)
        nv = min(max(sx * ex + sy * ey + sz * ez, f4(1e-4)), ONE)
        sine, half = half_terms((sx, sy, sz), (ex, ey, ez), (lx, ly, lz))
        rough = max(s[CK + i], SMOOTHEST)
        f = s[CC + i] * dielectric(COAT_SLOWED, half)
        s[VS + i] = s[AM + i] / bent * nl * f * ggx(sine, nl, nv, rough * rough)
    for c in range(3):
        t, color = s[c * SPAN :], light[7 + c]
        for i in range(n):
            t[YR + i] += color * s[VS + i]


@kernel(counted=False)
def share_of_coat(s, n, sky):
    """What the coat mirrors of light from all around, into VS, and what of that Fresnel's term adds, into FL."""
    for i in range(n):
        nv = s[SX + i] * s[EX + i] + s[SY + i] * s[EY + i] + s[SZ + i] * s[EZ + i]
        s[AM + i] = min(max(nv, f4(1e-4)), ONE)
    find(s, n, sky.albedo.shape[0], AM, CK)
    for i in range(n):
        a, b, c, _ = four_at(sky.albedo, s[TA + i], s[TU + i], s[TV + i], 0)
        s[FL + i] = added(COAT_F0, a, b, b + c)
        s[VS + i] = s[CC + i] * (COAT_F0 * a + b + c) * open_share(s[AM + i], s[OC + i], s[CK + i])


@kernel(counted=False)
def add_coat_sky(s, n):
    """The light from all around, which is in LX.., times what the coat mirrors of it."""
    for c in range(3):
        t = s[c * SPAN :]
        for i in range(n):
            t[YR + i] += s[VS + i] * t[LX + i]
