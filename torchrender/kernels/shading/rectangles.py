"""What glossy surfaces mirror of a rectangle: the share of their lobe that it fills, by linearly transformed cosines.

The twin in torch is :func:`torchrender.shading.linear_cosines.mirrored_share`; numbers of the table are told there.
"""

from __future__ import annotations

import math

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.lights import polygon
from torchrender.kernels.shading.lobes import COAT_F0, SMOOTHEST, diffuse_share, find, four_at, fresnel, half_terms
from torchrender.kernels.shading.records import SLOT, SPAN
from torchrender.kernels.shading.simd import HALF, INV_PI, ONE, TINY, TWO, ZERO, f4

PX, PY, PZ, NX, NY, NZ, SX, SY, SZ = (SLOT[n] for n in ("PX", "PY", "PZ", "NX", "NY", "NZ", "SX", "SY", "SZ"))
EX, EY, EZ, LX, LY, LZ = (SLOT[n] for n in ("EX", "EY", "EZ", "LX", "LY", "LZ"))
AM, VS, RO, MA, LA, LB, LC, LD, LE = (SLOT[n] for n in ("AM", "VS", "RO", "MA", "LA", "LB", "LC", "LD", "LE"))
MR, WR, YR, CC, CK, FL = (SLOT[n] for n in ("MR", "WR", "YR", "CC", "CK", "FL"))
TA, TU, TV = (SLOT[n] for n in ("TA", "TU", "TV"))
FR, KR, AB = (SLOT[n] for n in ("FR", "KR", "AB"))
UPRIGHT, MOST, LEVEL_RAY = f4(1e-12), f4(1.0 - 1e-7), f4(1e-3)


@kernel(inline=True, counted=False)
def dot(a, b):
    """Of vectors of three components."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@kernel(inline=True, counted=False)
def moved(p, frame, matrix):
    """A corner, seen from the surface, where the lobe is a cosine about the third axis."""
    across, beside, along = frame
    a, b, c, d, e = matrix
    x, y, z = dot(p, across), dot(p, beside), dot(p, along)
    return e * x - b * z, (a * e - b * d) / c * y, a * z - d * x


@kernel(inline=True, counted=False)
def upright(n):
    """A unit vector at right angles to one (Duff et al. 2017)."""
    sign = ONE if n[2] >= ZERO else -ONE
    a = -ONE / (sign + n[2])
    return ONE + sign * n[0] * n[0] * a, sign * n[0] * n[1] * a, -sign * n[0]


@kernel(inline=True, counted=False)
def flattened(facing):
    """Cosine between normal and eye as far as tables hold it."""
    return min(max(facing, f4(1e-4)), MOST)


@kernel(counted=False)
def lay(s, n, table, normal, rough):
    """How the lobes lie about the normals in slot ``normal``, for :func:`filled`, into LA, LB, LC, LD, LE."""
    up, roughness = s[normal:], s[rough:]
    for i in range(n):
        facing = up[i] * s[EX + i] + up[SPAN + i] * s[EY + i] + up[2 * SPAN + i] * s[EZ + i]
        s[FL + i] = flattened(facing)
        s[TV + i] = min(max(roughness[i], SMOOTHEST), ONE)
    find(s, n, table.shape[0], FL, TV)
    for i in range(n):
        at, u, v = s[TA + i], s[TU + i], s[TV + i]
        s[LA + i], s[LB + i], s[LC + i], s[LD + i] = four_at(table, at, u, v, 0)
        s[LE + i], _, _, _ = four_at(table, at, u, v, 4)


@kernel(counted=False)
def filled(s, n, light, normal):
    """Share of the lobes that the rectangle fills, as far as it is visible, into FL; after :func:`lay`."""
    ax, ay, az, bx, by, bz = light[16], light[17], light[18], light[19], light[20], light[21]
    cx, cy, cz, dx, dy, dz = light[22], light[23], light[24], light[25], light[26], light[27]
    ups = s[normal:]
    for i in range(n):
        x, y, z = s[PX + i], s[PY + i], s[PZ + i]
        up = ups[i], ups[SPAN + i], ups[2 * SPAN + i]
        eye = s[EX + i], s[EY + i], s[EZ + i]
        facing = dot(up, eye)
        nv = flattened(facing)
        sine = math.sqrt(ONE - nv * nv)
        a, b, c, d, e = s[LA + i], sine * s[LB + i], s[LC + i], sine * s[LD + i], s[LE + i]
        lx, ly, lz = eye[0] - facing * up[0], eye[1] - facing * up[1], eye[2] - facing * up[2]
        length = lx * lx + ly * ly + lz * lz
        across, inv = upright(up), ONE / math.sqrt(max(length, UPRIGHT))
        stands = length < UPRIGHT
        lx, ly, lz = (
            (across[0] if stands else lx * inv),
            (across[1] if stands else ly * inv),
            (across[2] if stands else lz * inv),
        )
        frame = (
            (sine * up[0] + nv * lx, sine * up[1] + nv * ly, sine * up[2] + nv * lz),
            (up[1] * lz - up[2] * ly, up[2] * lx - up[0] * lz, up[0] * ly - up[1] * lx),
            (nv * up[0] - sine * lx, nv * up[1] - sine * ly, nv * up[2] - sine * lz),
        )
        matrix = (a, b, c, d, e)
        total = polygon(
            moved((ax - x, ay - y, az - z), frame, matrix),
            moved((bx - x, by - y, bz - z), frame, matrix),
            moved((cx - x, cy - y, cz - z), frame, matrix),
            moved((dx - x, dy - y, dz - z), frame, matrix),
            (ZERO, ZERO, ONE),
        )
        tilt, height = a * sine + d * nv, b * sine + e * nv
        above = HALF * (ONE + height / max(math.sqrt(tilt * tilt + height * height), f4(1e-12)))
        share = min(total * INV_PI / max(above, f4(1e-3)), ONE) * s[VS + i]
        s[FL + i] = share if s[AM + i] > ZERO else ZERO


@kernel(counted=False)
def nearest(s, n, light):
    """Cosine to the facets that mirror the rectangle's point next to the mirrored ray, into TA."""
    mx, my, mz, cx, cy, cz = light[12], light[13], light[14], light[1], light[2], light[3]
    inv = ONE / light[29]
    ux, uy, uz = light[19] - light[16], light[20] - light[17], light[21] - light[18]
    vx, vy, vz = light[25] - light[16], light[26] - light[17], light[27] - light[18]
    # In-plane vectors that tell shares along one edge and not along the other.
    ax, ay, az = (vy * mz - vz * my) * inv, (vz * mx - vx * mz) * inv, (vx * my - vy * mx) * inv
    bx, by, bz = (my * uz - mz * uy) * inv, (mz * ux - mx * uz) * inv, (mx * uy - my * ux) * inv
    for i in range(n):
        nx, ny, nz, ex, ey, ez = s[NX + i], s[NY + i], s[NZ + i], s[EX + i], s[EY + i], s[EZ + i]
        twice = TWO * (nx * ex + ny * ey + nz * ez)
        rx, ry, rz = twice * nx - ex, twice * ny - ey, twice * nz - ez
        qx, qy, qz = cx - s[PX + i], cy - s[PY + i], cz - s[PZ + i]
        t = (mx * qx + my * qy + mz * qz) / min(mx * rx + my * ry + mz * rz, -LEVEL_RAY)
        wx, wy, wz = t * rx - qx, t * ry - qy, t * rz - qz
        p = min(max(ax * wx + ay * wy + az * wz, -HALF), HALF)
        q = min(max(bx * wx + by * wy + bz * wz, -HALF), HALF)
        lx, ly, lz = qx + p * ux + q * vx, qy + p * uy + q * vy, qz + p * uz + q * vz
        near = ONE / math.sqrt(max(lx * lx + ly * ly + lz * lz, TINY))
        _, s[TA + i] = half_terms((nx, ny, nz), (ex, ey, ez), (lx * near, ly * near, lz * near))


@kernel(counted=False)
def add_metallic_rectangle(s, n, sky, light):
    """A rectangle, through the lobes under the coat: diffuse as light from its centre, mirrored as it is."""
    filled(s, n, light, NX)
    diffuse_share(s, n, sky.albedo)
    nearest(s, n, light)
    for i in range(n):
        s[TU + i], s[TV + i] = fresnel(s, i, s[TA + i])
    for c in range(3):
        t, color = s[c * SPAN :], light[7 + c]
        for i in range(n):
            share = s[FL + i]
            some = (s[TU + i] + t[FR + i] * s[TV + i]) * t[KR + i] * s[AB + i]
            mirrored = share * (some + share * (t[WR + i] - some))
            t[YR + i] += color * (t[MR + i] * s[MA + i] + mirrored)


@kernel(counted=False)
def add_coat_rectangle(s, n, sky, light):
    """A rectangle, on the clear coat."""
    lay(s, n, sky.cosines, SX, CK)
    filled(s, n, light, SX)
    for i in range(n):
        nv = s[SX + i] * s[EX + i] + s[SY + i] * s[EY + i] + s[SZ + i] * s[EZ + i]
        s[MA + i] = min(max(nv, f4(1e-4)), ONE)
    find(s, n, sky.albedo.shape[0], MA, CK)
    for i in range(n):
        a, b, c, _ = four_at(sky.albedo, s[TA + i], s[TU + i], s[TV + i], 0)
        share = s[CC + i] * (COAT_F0 * a + b + c) * s[FL + i]
        for c in range(3):
            s[YR + c * SPAN + i] += light[7 + c] * share
    lay(s, n, sky.cosines, NX, RO)
