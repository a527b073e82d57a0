"""Colours of few rendered pixels for many, along surfaces."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def spread_colors(colors, few, many, materials, limits, wanted, out):
    """``out`` (H,W,C): means of the rendered pixels around each pixel, weighted by nearness and by likeness.

    Args:
        colors: (h,w,C) of the rendered pixels.
        few, many: (depth, triangle, owner) of the rendered pixels (h,w) and of all pixels (H,W); triangle -1: nothing.
        materials: (F,) by triangle. Pixels of one owner and material are of one surface.
        limits: same, other_surface, left_over. A difference d of inverse depth, as a share of the larger one, weighs
            ``exp(-(d / same)^2)``; ``other_surface`` is a factor for pixels of other surfaces; ``left_over`` is added
            to all: they are better than nothing.
        wanted: (H,W) the others stay as they are.

    The four rendered pixels around a pixel count by their bilinear weights. Where none is of the pixel's surface,
    which is thin then, the sixteen around it count, by tents twice as wide.
    """
    depth, triangle, owner = many
    rough_depth, rough_triangle, rough_owner = few
    same, other_surface, left_over = limits
    height, width = depth.shape
    rows, columns = rough_depth.shape
    for j in prange(height):
        y = (j + 0.5) * (rows / height) - 0.5
        for i in range(width):
            if not wanted[j, i]:
                continue
            x = (i + 0.5) * (columns / width) - 0.5
            own, face = 1.0 / depth[j, i], triangle[j, i]
            material = materials[face] if face >= 0 else -1
            for reach in (1, 2):
                weights, likeness = 0.0, 0.0
                out[j, i] = 0.0
                top, left = math.floor(y) + 1 - reach, math.floor(x) + 1 - reach
                for row in range(top, top + 2 * reach):
                    for column in range(left, left + 2 * reach):
                        r, c = min(max(row, 0), rows - 1), min(max(column, 0), columns - 1)
                        other, seen = 1.0 / rough_depth[r, c], rough_triangle[r, c]
                        apart = abs(own - other) / max(own, other, 1e-30)
                        like = math.exp(-((apart / same) ** 2))
                        if rough_owner[r, c] != owner[j, i] or (
                            seen != face and (seen < 0 or materials[seen] != material)
                        ):
                            like *= other_surface
                        weight = (reach - abs(y - row)) * (reach - abs(x - column))
                        likeness += weight * like
                        weight *= like + left_over
                        for k in range(colors.shape[2]):
                            out[j, i, k] += np.float32(weight * colors[r, c, k])
                        weights += weight
                if likeness > other_surface * reach**4:
                    break
            for k in range(colors.shape[2]):
                out[j, i, k] = np.float32(out[j, i, k] / weights)
