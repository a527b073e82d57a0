"""Single pixels that no sample reached within a surface that its neighbours show: closed from those."""

from __future__ import annotations

import numpy as np

from torchrender.kernels.warp.pinholes import close

SMOOTH = 0.05
"""Relative difference of depths across the pixel, up to which both sides are one surface."""
AGREE = 0.01
"""Relative difference of inverse depths at the pixel that lines through it may give: on a plane they give one."""
FEWEST = 2
"""Lines through the pixel that must lie on the surface."""


def close_pinholes(color: np.ndarray, depth: np.ndarray, valid: np.ndarray, source: np.ndarray) -> int:
    """Fill pinholes of one picture in place; returns how many there were.

    A pixel is a pinhole where at least two of the four lines through it have both neighbours on one surface, and give
    it the same depth. It gets the mean inverse depth and colour of these. Outlines and what is really hidden stay
    empty: there the sides differ, or miss.

    Args:
        color: (H,W,3) float32. depth: (H,W) float32 camera z, +inf where nothing is. valid: (H,W) bool. source: (H,W)
            int64.
    """
    if min(valid.shape) < 3:
        return 0
    return int(close(color, depth, valid, source, FEWEST, (SMOOTH, AGREE)).sum())
