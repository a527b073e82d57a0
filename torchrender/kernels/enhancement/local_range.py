"""Least and greatest values around each pixel."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


@kernel(parallel=True)
def range_along_rows(low, high, reach, out_low, out_high):
    """Of pictures (H,W,C) float32: least of ``low`` and greatest of ``high`` among 2 reach + 1 pixels of a row."""
    height, width, channels = low.shape
    for j in prange(height):
        for i in range(width):
            for c in range(channels):
                least, greatest = np.float32(np.inf), np.float32(-np.inf)
                for k in range(max(i - reach, 0), min(i + reach + 1, width)):
                    least = min(least, low[j, k, c])
                    greatest = max(greatest, high[j, k, c])
                out_low[j, i, c] = least
                out_high[j, i, c] = greatest


@kernel(parallel=True)
def limit_to_range(low, high, plain, how, picture):
    """Keep ``picture`` (H,W,C), changed in place, within the range over 2 reach + 1 rows, widened by a share of it.

    Args:
        low, high: (H,W,C) ranges along rows. plain: (H,W,C) that ``picture`` may always be.
        how: reach, share.
    """
    height, width, channels = low.shape
    reach, share = how
    for j in prange(height):
        for i in range(width):
            for c in range(channels):
                least, greatest = np.float32(np.inf), np.float32(-np.inf)
                for k in range(max(j - reach, 0), min(j + reach + 1, height)):
                    least = min(least, low[k, i, c])
                    greatest = max(greatest, high[k, i, c])
                room = np.float32(share) * (greatest - least)
                value = picture[j, i, c]
                value = max(min(value, max(greatest + room, plain[j, i, c])), min(least - room, plain[j, i, c]))
                picture[j, i, c] = value
