"""Least and greatest values around each pixel, on its own side of creases and outlines."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def limit_to_range(normals, nearness, plain, how, picture):
    """Keep ``picture`` (H,W,C) float32, changed in place, within the range of ``plain`` over pixels of its own side.

    Args:
        normals: (H,W,3) float32 of the faces. nearness: (H,W) float32 inverse depth; 0 where nothing is.
        plain: (H,W,C) float32.
        how: reach in pixels, share that the range is widened by on either side, least cosine between normals of one
            side, greatest difference of nearness, as a share.
    """
    height, width, channels = plain.shape
    reach, share, cosine, jump = how
    for j in prange(height):
        for i in range(width):
            own = nearness[j, i]
            if not own > 0.0:
                continue
            nx, ny, nz = normals[j, i, 0], normals[j, i, 1], normals[j, i, 2]
            for c in range(channels):
                least, greatest = plain[j, i, c], plain[j, i, c]
                for y in range(max(j - reach, 0), min(j + reach + 1, height)):
                    for x in range(max(i - reach, 0), min(i + reach + 1, width)):
                        along = nx * normals[y, x, 0] + ny * normals[y, x, 1] + nz * normals[y, x, 2]
                        if along < cosine or abs(nearness[y, x] - own) > jump * own:
                            continue
                        value = plain[y, x, c]
                        least, greatest = min(least, value), max(greatest, value)
                room = share * (greatest - least)
                picture[j, i, c] = np.float32(max(min(picture[j, i, c], greatest + room), least - room))
