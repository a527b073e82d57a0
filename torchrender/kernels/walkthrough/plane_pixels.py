"""Colours of the pixels that show planes: an inverse homography per plane, then a mip-mapped texture."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class Atlas(NamedTuple):
    """The textures of P planes with all their mip levels in one list of texels."""

    texels: Any  # (T,4) uint8 sRGB codes and alpha
    offset: Any  # (P,L) int64 first texel of each level
    height: Any  # (P,L) int64
    width: Any  # (P,L) int64
    levels: Any  # (P,) int64
    table: Any  # (256,) float32 linear light of a code


@kernel(inline=True)
def bilinear(atlas, p, level, s, t):
    """Linear colour at texel coordinates (s, t) of a level; the border repeats."""
    height, width, offset = atlas.height[p, level], atlas.width[p, level], atlas.offset[p, level]
    x, y = min(max(s - 0.5, 0.0), width - 1.0), min(max(t - 0.5, 0.0), height - 1.0)
    x0, y0 = int(x), int(y)
    x1, y1 = min(x0 + 1, width - 1), min(y0 + 1, height - 1)
    a, b = np.float32(x - x0), np.float32(y - y0)
    one = np.float32(1.0)
    i00, i01 = offset + y0 * width + x0, offset + y0 * width + x1
    i10, i11 = offset + y1 * width + x0, offset + y1 * width + x1
    w00, w01, w10, w11 = (one - a) * (one - b), a * (one - b), (one - a) * b, a * b
    texels, table = atlas.texels, atlas.table
    return (
        w00 * table[texels[i00, 0]] + w01 * table[texels[i01, 0]]
        + w10 * table[texels[i10, 0]] + w11 * table[texels[i11, 0]],
        w00 * table[texels[i00, 1]] + w01 * table[texels[i01, 1]]
        + w10 * table[texels[i10, 1]] + w11 * table[texels[i11, 1]],
        w00 * table[texels[i00, 2]] + w01 * table[texels[i01, 2]]
        + w10 * table[texels[i10, 2]] + w11 * table[texels[i11, 2]],
    )  # fmt: skip


@kernel(parallel=True)
def shade_planes(triangle, plane_of, matrices, atlas, image, filled):
    """Colours of one view.

    ``triangle`` (H,W) int64, ``plane_of`` (F,) int64 plane of each triangle, ``matrices`` (P,3,3) texel from pixel;
    fills ``image`` (H,W,3) float32 linear, and ``filled`` (H,W) uint8: 1 where the texel was made up.
    """
    height, width = triangle.shape
    for y in prange(height):
        for x in range(width):
            if triangle[y, x] < 0:
                continue
            p = plane_of[triangle[y, x]]
            m = matrices[p]
            u, v = x + 0.5, y + 0.5
            w = m[2, 0] * u + m[2, 1] * v + m[2, 2]
            s = (m[0, 0] * u + m[0, 1] * v + m[0, 2]) / w
            t = (m[1, 0] * u + m[1, 1] * v + m[1, 2]) / w
            # Texels that a pixel covers: the Jacobian determinant of the map.
            ds, es = (m[0, 0] - s * m[2, 0]) / w, (m[0, 1] - s * m[2, 1]) / w
            dt, et = (m[1, 0] - t * m[2, 0]) / w, (m[1, 1] - t * m[2, 1]) / w
            level = 0.5 * math.log2(max(abs(ds * et - es * dt), 1e-12))
            last = atlas.levels[p] - 1
            level = min(max(level, 0.0), float(last))
            fine = int(level)
            share = np.float32(level - fine)
            size = (atlas.width[p, fine] / atlas.width[p, 0], atlas.height[p, fine] / atlas.height[p, 0])
            r, g, b = bilinear(atlas, p, fine, s * size[0], t * size[1])
            if share > 0.0 and fine < last:
                size = (atlas.width[p, fine + 1] / atlas.width[p, 0], atlas.height[p, fine + 1] / atlas.height[p, 0])
                r2, g2, b2 = bilinear(atlas, p, fine + 1, s * size[0], t * size[1])
                r, g, b = r + share * (r2 - r), g + share * (g2 - g), b + share * (b2 - b)
            image[y, x, 0], image[y, x, 1], image[y, x, 2] = r, g, b
            column = min(max(int(s), 0), atlas.width[p, 0] - 1)
            row = min(max(int(t), 0), atlas.height[p, 0] - 1)
            alpha = atlas.texels[atlas.offset[p, 0] + row * atlas.width[p, 0] + column, 3]
            filled[y, x] = 1 if alpha == 254 else 0
