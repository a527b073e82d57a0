"""What each light brings to the pixels of a tile: irradiance into AM, direction into LX, LY, LZ."""

from __future__ import annotations

import math

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import CENTRE, PARALLEL, SLOT
from torchrender.kernels.shading.simd import HALF, LEVEL, MOST_BENT, ONE, TINY, ZERO, angle, f4

PX, PY, PZ, NX, NY, NZ = (SLOT[n] for n in ("PX", "PY", "PZ", "NX", "NY", "NZ"))
GX, GY, GZ, SX, SY, SZ = (SLOT[n] for n in ("GX", "GY", "GZ", "SX", "SY", "SZ"))
AM, VS, LX, LY, LZ = (SLOT[n] for n in ("AM", "VS", "LX", "LY", "LZ"))


@kernel(inline=True, counted=False)
def norm1(x, y, z):
    """Sum of the absolute components."""
    return abs(x) + abs(y) + abs(z)


@kernel(inline=True, counted=False)
def horizon(s, i):
    """Normal of the smooth surface that vertex normals stand for, or of the triangle where these lean too far."""
    gx, gy, gz = s[GX + i], s[GY + i], s[GZ + i]
    sx, sy, sz = s[SX + i], s[SY + i], s[SZ + i]
    smooth = sx * gx + sy * gy + sz * gz > MOST_BENT
    return (sx if smooth else gx), (sy if smooth else gy), (sz if smooth else gz)


@kernel(inline=True, counted=False)
def edge(a, b, ha, hb, normal):
    """One edge of a polygon seen from 0, cut at the horizon: its term, and where it leaves and enters, or 0."""
    ax, ay, az = a
    bx, by, bz = b
    nx, ny, nz = normal
    ex, ey, ez = bx - ax, by - ay, bz - az
    up, down = ha > ZERO, hb > ZERO
    cross = up != down
    meet = ha / (ha - hb) if cross else ZERO
    meet = min(max(meet, ZERO), ONE)
    rises, sinks = cross and down, cross and up
    begin = meet if rises else ZERO
    end = meet if sinks else (ONE if (up or down) else ZERO)
    fx, fy, fz = ax + begin * ex, ay + begin * ey, az + begin * ez
    lx, ly, lz = ax + end * ex, ay + end * ey, az + end * ez
    cx, cy, cz = ay * ez - az * ey, az * ex - ax * ez, ax * ey - ay * ex
    sine = math.sqrt(cx * cx + cy * cy + cz * cz)
    span = end - begin
    term = (cx * nx + cy * ny + cz * nz) / max(sine, TINY) * angle(span * sine, fx * lx + fy * ly + fz * lz)
    term = term if span > ZERO and sine > ZERO else ZERO
    s, r = (ONE if sinks else ZERO), (ONE if rises else ZERO)
    return term, (s * lx, s * ly, s * lz), (r * fx, r * fy, r * fz)


@kernel(inline=True, counted=False)
def polygon(a, b, c, d, normal):
    """Irradiance of a parallelogram of radiance one at 0, whose corners are given (Lambert's formula)."""
    nx, ny, nz = normal
    ha, hb = a[0] * nx + a[1] * ny + a[2] * nz, b[0] * nx + b[1] * ny + b[2] * nz
    hc, hd = c[0] * nx + c[1] * ny + c[2] * nz, d[0] * nx + d[1] * ny + d[2] * nz
    t0, l0, r0 = edge(a, b, ha, hb, normal)
    t1, l1, r1 = edge(b, c, hb, hc, normal)
    t2, l2, r2 = edge(c, d, hc, hd, normal)
    t3, l3, r3 = edge(d, a, hd, ha, normal)
    ox, oy, oz = l0[0] + l1[0] + l2[0] + l3[0], l0[1] + l1[1] + l2[1] + l3[1], l0[2] + l1[2] + l2[2] + l3[2]
    ix, iy, iz = r0[0] + r1[0] + r2[0] + r3[0], r0[1] + r1[1] + r2[1] + r3[1], r0[2] + r1[2] + r2[2] + r3[2]
    turn = (oy * iz - oz * iy) * nx + (oz * ix - ox * iz) * ny + (ox * iy - oy * ix) * nz
    close = angle(abs(turn), ox * ix + oy * iy + oz * iz)
    close = -close if turn < ZERO else (close if turn > ZERO else ZERO)
    return HALF * abs(t0 + t1 + t2 + t3 + close)


@kernel(counted=False)
def rectangle(s, n, light):
    """Exact irradiance of a rectangle, and the direction to its centre."""
    mx, my, mz, d0, x0, y0, z0 = light[12], light[13], light[14], light[15], light[1], light[2], light[3]
    ax, ay, az, bx, by, bz = light[16], light[17], light[18], light[19], light[20], light[21]
    cx, cy, cz, dx, dy, dz = light[22], light[23], light[24], light[25], light[26], light[27]
    size = max(max(norm1(ax, ay, az), norm1(bx, by, bz)), max(norm1(cx, cy, cz), norm1(dx, dy, dz)))
    for i in range(n):
        x, y, z = s[PX + i], s[PY + i], s[PZ + i]
        gx, gy, gz = horizon(s, i)
        a, b = (ax - x, ay - y, az - z), (bx - x, by - y, bz - z)
        c, d = (cx - x, cy - y, cz - z), (dx - x, dy - y, dz - z)
        top = max(
            max(a[0] * gx + a[1] * gy + a[2] * gz, b[0] * gx + b[1] * gy + b[2] * gz),
            max(c[0] * gx + c[1] * gy + c[2] * gz, d[0] * gx + d[1] * gy + d[2] * gz),
        )
        least = LEVEL * (size + norm1(x, y, z))
        sees = (mx * x + my * y + mz * z - d0 > least) and top > least
        total = polygon(a, b, c, d, (s[NX + i], s[NY + i], s[NZ + i]))
        s[AM + i] = total * s[VS + i] if sees else ZERO
        ux, uy, uz = x0 - x, y0 - y, z0 - z
        inv = ONE / math.sqrt(max(ux * ux + uy * uy + uz * uz, TINY))
        s[LX + i], s[LY + i], s[LZ + i] = ux * inv, uy * inv, uz * inv


@kernel(counted=False)
def small_light(s, n, light):
    """Point, spot and parallel lights, and rectangles taken as if all came from their centre."""
    parallel, centre = light[0] == f4(PARALLEL), light[0] == f4(CENTRE)
    far = ZERO if parallel else ONE
    bx, by, bz = (-light[4], -light[5], -light[6]) if parallel else (light[1], light[2], light[3])
    ax, ay, az, outer, slope, nearest = light[4], light[5], light[6], light[10], light[11], light[28]
    mx, my, mz, area, fade = light[12], light[13], light[14], light[29], light[30]
    size = norm1(bx, by, bz)
    for i in range(n):
        ux, uy, uz = bx - far * s[PX + i], by - far * s[PY + i], bz - far * s[PZ + i]
        square = ux * ux + uy * uy + uz * uz
        gx, gy, gz = horizon(s, i)
        height = gx * ux + gy * uy + gz * uz
        above = height > LEVEL * (size + far * norm1(s[PX + i], s[PY + i], s[PZ + i]))
        inv = ONE / math.sqrt(max(square, TINY))
        ux, uy, uz = ux * inv, uy * inv, uz * inv
        amount = max(s[NX + i] * ux + s[NY + i] * uy + s[NZ + i] * uz, ZERO)
        faded = square * fade
        amount *= ONE if parallel else max(ONE - faded * faded, ZERO) / max(square, nearest)
        amount *= max(-(mx * ux + my * uy + mz * uz), ZERO) * area if centre else ONE
        wx, wy, wz = ux + ax, uy + ay, uz + az  # one minus a cosine of float32 has no digits left in narrow cones
        share = min(max((outer - HALF * (wx * wx + wy * wy + wz * wz)) * slope, ZERO), ONE)
        amount *= share * share * s[VS + i]
        s[AM + i] = amount if above else ZERO
        s[LX + i], s[LY + i], s[LZ + i] = ux, uy, uz
