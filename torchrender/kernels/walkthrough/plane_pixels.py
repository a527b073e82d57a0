"""Colours of the pixels that show planes: an inverse homography per plane, then a mip-mapped texture."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

PLANE, FILLED = 1, 2
"""What a pixel is marked with."""

MADE_UP = 254
"""Alpha of texels that no photo saw."""

FINENESS = 16
"""Entries of the table of linear light for each code."""


class Atlas(NamedTuple):
    """The textures of P planes with all their mip levels in one list of texels."""

    texels: Any  # (T,) uint32 red, green, blue sRGB codes and alpha, from the lowest byte up
    offset: Any  # (P,L) int64 first texel of each level
    height: Any  # (P,L) int64
    width: Any  # (P,L) int64
    levels: Any  # (P,) int64
    table: Any  # (255 * FINENESS + 1,) float32 linear light of fractions of a code


@kernel(inline=True)
def bilinear(atlas, p, level, s, t):
    """Codes at texel coordinates (s, t) of a level, and the alpha of the nearest texel; the border repeats."""
    height, width, offset = atlas.height[p, level], atlas.width[p, level], atlas.offset[p, level]
    x, y = min(max(s - 0.5, 0.0), width - 1.0), min(max(t - 0.5, 0.0), height - 1.0)
    x0, y0 = int(x), int(y)
    right, down = (1 if x0 < width - 1 else 0), (width if y0 < height - 1 else 0)
    a, b = np.float32(x - x0), np.float32(y - y0)
    first = offset + y0 * width + x0
    texels = atlas.texels
    c00, c01, c10, c11 = texels[first], texels[first + right], texels[first + down], texels[first + down + right]
    one = np.float32(1.0)
    w00, w01, w10, w11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    byte = np.uint32(255)
    red = (
        w00 * np.float32(c00 & byte) + w01 * np.float32(c01 & byte)
        + w10 * np.float32(c10 & byte) + w11 * np.float32(c11 & byte)
    )  # fmt: skip
    green = (
        w00 * np.float32((c00 >> np.uint32(8)) & byte) + w01 * np.float32((c01 >> np.uint32(8)) & byte)
        + w10 * np.float32((c10 >> np.uint32(8)) & byte) + w11 * np.float32((c11 >> np.uint32(8)) & byte)
    )  # fmt: skip
    blue = (
        w00 * np.float32((c00 >> np.uint32(16)) & byte) + w01 * np.float32((c01 >> np.uint32(16)) & byte)
        + w10 * np.float32((c10 >> np.uint32(16)) & byte) + w11 * np.float32((c11 >> np.uint32(16)) & byte)
    )  # fmt: skip
    near = (c11 if a > 0.5 else c10) if b > 0.5 else (c01 if a > 0.5 else c00)
    return red, green, blue, near >> np.uint32(24)


@kernel(parallel=True)
def shade_planes(triangle, plane_of, matrices, atlas, image, kind):
    """Colours of one view.

    ``triangle`` (H,W) int64, ``plane_of`` (F,) int64 plane of each triangle, ``matrices`` (P,3,3) texel from pixel;
    fills ``image`` (H,W,3) float32 linear, and ``kind`` (H,W) uint8: PLANE, or FILLED where the texel was made up.
    Codes are interpolated, as they were when the texture was made, and turned to linear light at the end.
    """
    height, width = triangle.shape
    texels, offset, tall, wide, levels, table = atlas
    area = np.empty(len(matrices))
    for p in range(len(matrices)):
        m = matrices[p]
        area[p] = abs(
            m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
            - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
            + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
        )
    for y in prange(height):
        v = np.float64(y) + 0.5
        own = Atlas(texels, offset, tall, wide, levels, table)
        p = -1
        ws, wt, ww, last = 0.0, 0.0, 0.0, 0
        m00, m10, m20 = 0.0, 0.0, 0.0
        for x in range(width):
            if triangle[y, x] < 0:
                continue
            if plane_of[triangle[y, x]] != p:
                p = plane_of[triangle[y, x]]
                m = matrices[p]
                m00, m10, m20 = m[0, 0], m[1, 0], m[2, 0]
                ws, wt, ww = m[0, 1] * v + m[0, 2], m[1, 1] * v + m[1, 2], m[2, 1] * v + m[2, 2]
                last = levels[p] - 1
            u = x + 0.5
            inverse = 1.0 / (m20 * u + ww)
            s, t = (m00 * u + ws) * inverse, (m10 * u + wt) * inverse
            # Texels that a pixel covers: the Jacobian determinant of a homography is det / w^3.
            covered = area[p] * abs(inverse * inverse * inverse)
            fine, share = 0, np.float32(0.0)
            if covered > 1.0:
                level = min(np.float32(0.5) * math.log2(np.float32(covered)), np.float32(last))
                fine = int(level)
                share = np.float32(level - fine)
            if fine == 0:
                r, g, b, alpha = bilinear(own, p, 0, s, t)
            else:
                grow_s, grow_t = wide[p, fine] / wide[p, 0], tall[p, fine] / tall[p, 0]
                r, g, b, alpha = bilinear(own, p, fine, s * grow_s, t * grow_t)
            if share > np.float32(0.01) and fine < last:
                grow_s, grow_t = wide[p, fine + 1] / wide[p, 0], tall[p, fine + 1] / tall[p, 0]
                r2, g2, b2, _ = bilinear(own, p, fine + 1, s * grow_s, t * grow_t)
                r, g, b = r + share * (r2 - r), g + share * (g2 - g), b + share * (b2 - b)
            image[y, x, 0] = table[int(r * np.float32(FINENESS) + np.float32(0.5))]
            image[y, x, 1] = table[int(g * np.float32(FINENESS) + np.float32(0.5))]
            image[y, x, 2] = table[int(b * np.float32(FINENESS) + np.float32(0.5))]
            kind[y, x] = FILLED if alpha == np.uint32(MADE_UP) else PLANE
