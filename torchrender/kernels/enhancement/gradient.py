"""The size of the shading's gradient in one pass over the pixels: curvature, lights, projection."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SIGNED, SUM, L1, L2 = range(4)
POINT, PARALLEL, SPOT, RECTANGLE = range(4)


@kernel()
def light_at(light, x, y, z, nearest):
    """Unit direction to a light (row of the table), inverse distance (0: parallel), share of its colour."""
    dx, dy, dz = light[1], light[2], light[3]
    if light[0] == PARALLEL:
        return dx, dy, dz, 0.0, 1.0
    dx, dy, dz = dx - x, dy - y, dz - z
    square = dx * dx + dy * dy + dz * dz
    inverse = 1.0 / max(math.sqrt(square), nearest)
    dx, dy, dz = dx * inverse, dy * inverse, dz * inverse
    share = inverse * inverse
    faded = square * light[12]
    share *= max(1.0 - faded * faded, 0.0)
    if light[0] == SPOT:
        cosine = -(dx * light[4] + dy * light[5] + dz * light[6])
        open_ = min(max((cosine - light[11]) / max(light[10] - light[11], 1e-6), 0.0), 1.0)
        share *= open_ * open_
    elif light[0] == RECTANGLE:
        share *= max(-(dx * light[4] + dy * light[5] + dz * light[6]), 0.0) * light[10]
    return dx, dy, dz, inverse, share


@kernel(parallel=True)
def gradient_size(seen, lens, lighting, how, out):
    """``out`` (N,3) float32: ``mag(grad_p I)`` of each pixel for a white surface; 0 where nothing is.

    Args:
        seen: position (N,3) float64, normal, face normal (N,3) float32, depth, reference depth, strength (N,) float32.
        lens: eye (3,), axes (2,3) to the right and down, forward (3,), world space; 1 if orthographic; least cosine;
            1 with projection.
        lighting: table (L,14) from the eye, visibility (L,N) float32 or (0,0): all is lit, derivative of irradiance
            along the normal as harmonics (9,3), already with their factors; nearest distance that counts.
        how: magnitude, 1 with the light's own gradient.
    """
    position, normals, faces, depths, references, strengths = seen
    eye, axes, forward, orthographic, grazing, projected = lens
    table, visibility, harmonics, nearest = lighting
    magnitude, moving = how
    for p in prange(len(depths)):
        for c in range(3):
            out[p, c] = 0.0
        depth = float(depths[p])
        if not depth < math.inf:
            continue
        x, y, z = position[p, 0] - eye[0], position[p, 1] - eye[1], position[p, 2] - eye[2]
        s = np.float64(strengths[p])
        nx, ny, nz = np.float64(normals[p, 0]), np.float64(normals[p, 1]), np.float64(normals[p, 2])
        fx, fy, fz = np.float64(faces[p, 0]), np.float64(faces[p, 1]), np.float64(faces[p, 2])
        if orthographic:
            rx, ry, rz = forward[0], forward[1], forward[2]
            depth = 1.0
        else:
            rx, ry, rz = x / depth, y / depth, z / depth
        facing = -max(-(fx * rx + fy * ry + fz * rz), grazing * math.sqrt(rx * rx + ry * ry + rz * rz))
        scale = depth / np.float64(references[p])
        ux, uy, uz = axes[0, 0], axes[0, 1], axes[0, 2]
        vx, vy, vz = axes[1, 0], axes[1, 1], axes[1, 2]
        if projected:
            along = (fx * ux + fy * uy + fz * uz) / facing
            ux, uy, uz = (ux - rx * along) * scale, (uy - ry * along) * scale, (uz - rz * along) * scale
            along = (fx * vx + fy * vy + fz * vz) / facing
            vx, vy, vz = (vx - rx * along) * scale, (vy - ry * along) * scale, (vz - rz * along) * scale
        reach = np.float64(references[p])  # a step in the picture, in scene units
        g0u, g1u, g2u, g0v, g1v, g2v = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        m0, m1, m2 = 0.0, 0.0, 0.0
        for k in range(len(table)):
            light = table[k]
            dx, dy, dz, inverse, share = light_at(light, x, y, z, nearest)
            cosine = nx * dx + ny * dy + nz * dz
            if len(visibility):
                share *= visibility[k, p]
            if not (cosine > 0.0 and share > 0.0):
                continue
            share /= math.pi
            gu, gv = s * (dx * ux + dy * uy + dz * uz), s * (dx * vx + dy * vy + dz * vz)
            if magnitude == SIGNED:
                size = share * math.copysign(math.sqrt(gu * gu + gv * gv), s)
                m0 += size * light[7]
                m1 += size * light[8]
                m2 += size * light[9]
                continue
            if moving:
                # n . grad w = -(n - (n . w) w) / distance
                tx, ty, tz = nx - cosine * dx, ny - cosine * dy, nz - cosine * dz
                gu -= (tx * ux + ty * uy + tz * uz) * inverse * reach
                gv -= (tx * vx + ty * vy + tz * vz) * inverse * reach
            gu *= share
            gv *= share
            g0u += gu * light[7]
            g1u += gu * light[8]
            g2u += gu * light[9]
            g0v += gv * light[7]
            g1v += gv * light[8]
            g2v += gv * light[9]
        for c in range(3):
            ex = harmonics[3, c] + ny * harmonics[4, c] + nz * harmonics[7, c] + nx * harmonics[8, c]
            ey = harmonics[1, c] + nx * harmonics[4, c] + nz * harmonics[5, c] - ny * harmonics[8, c]
            ez = harmonics[2, c] + ny * harmonics[5, c] + nz * harmonics[6, c] + nx * harmonics[7, c]
            along = ex * nx + ey * ny + ez * nz
            ex, ey, ez = ex - along * nx, ey - along * ny, ez - along * nz
            gu = s * (ex * ux + ey * uy + ez * uz) / math.pi
            gv = s * (ex * vx + ey * vy + ez * vz) / math.pi
            if magnitude == SIGNED:
                size = math.copysign(math.sqrt(gu * gu + gv * gv), s)
                if c == 0:
                    size += m0
                elif c == 1:
                    size += m1
                else:
                    size += m2
                out[p, c] = np.float32(size)
                continue
            if c == 0:
                gu, gv = gu + g0u, gv + g0v
            elif c == 1:
                gu, gv = gu + g1u, gv + g1v
            else:
                gu, gv = gu + g2u, gv + g2v
            if magnitude == SUM:
                out[p, c] = np.float32(gu + gv)
            elif magnitude == L1:
                out[p, c] = np.float32(abs(gu) + abs(gv))
            else:
                out[p, c] = np.float32(math.sqrt(gu * gu + gv * gv))
