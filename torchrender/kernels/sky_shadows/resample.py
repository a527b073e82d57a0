"""Means of a latitude-longitude picture over the texels of a cube map, and texels weighed by cosines."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def texel_means(picture, azimuth, height, turn, out):
    """Means out (T,3) float64 of a picture (H,W,3) float32 at places (T,K): azimuth in turns, height 0 to 1 from above.

    Bilinear, periodic in azimuth, clamped at the poles; ``turn`` is added to the azimuth.
    """
    rows, columns = picture.shape[0], picture.shape[1]
    for t in prange(out.shape[0]):
        red = green = blue = 0.0
        for k in range(azimuth.shape[1]):
            x = (azimuth[t, k] + turn + 0.5) * columns - 0.5
            y = height[t, k] * rows - 0.5
            i, j = math.floor(x), math.floor(y)
            a, b = x - i, y - j
            i0 = int(i) % columns
            i1 = i0 + 1 if i0 + 1 < columns else 0
            j0, j1 = min(max(int(j), 0), rows - 1), min(max(int(j) + 1, 0), rows - 1)
            p, q = (1.0 - b) * (1.0 - a), (1.0 - b) * a
            r, s = b * (1.0 - a), b * a
            red += p * picture[j0, i0, 0] + q * picture[j0, i1, 0] + r * picture[j1, i0, 0] + s * picture[j1, i1, 0]
            green += p * picture[j0, i0, 1] + q * picture[j0, i1, 1] + r * picture[j1, i0, 1] + s * picture[j1, i1, 1]
            blue += p * picture[j0, i0, 2] + q * picture[j0, i1, 2] + r * picture[j1, i0, 2] + s * picture[j1, i1, 2]
        share = 1.0 / np.float64(azimuth.shape[1])
        out[t, 0], out[t, 1], out[t, 2] = red * share, green * share, blue * share


@kernel(parallel=True)
def weigh_blocks(cosine, light, out):
    """Sums out (N,B,4) float32 over the 16 texels of each block: cosines (N,B,16) of N normals, light (B,16,4)."""
    for n in prange(out.shape[0]):
        for b in range(out.shape[1]):
            red = green = blue = even = np.float32(0.0)
            for t in range(16):
                weight = cosine[n, b, t]
                red += weight * light[b, t, 0]
                green += weight * light[b, t, 1]
                blue += weight * light[b, t, 2]
                even += weight * light[b, t, 3]
            out[n, b, 0], out[n, b, 1], out[n, b, 2], out[n, b, 3] = red, green, blue, even
