"""Single pixels that no sample reached within a surface that its neighbours show: closed from those."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

SMOOTH = 0.05
"""Relative difference of depths across the pixel, up to which both sides are one surface."""
AGREE = 0.01
"""Relative difference of inverse depths at the pixel that lines through it may give: on a plane they give one."""
FEWEST = 2
"""Lines through the pixel that must lie on the surface."""

LINES = np.array([[-1, 0], [0, -1], [-1, -1], [-1, 1]])


class Closed(NamedTuple):
    """P pinholes and what they were closed with: means over pairs of pixels on the four lines through them."""

    rows: np.ndarray  # (P,) int64
    columns: np.ndarray
    one: tuple[np.ndarray, np.ndarray]  # (P,4) rows and columns of the pixels on one side
    other: tuple[np.ndarray, np.ndarray]
    weight: np.ndarray  # (P,4) of the lines, their sum is one


def close_pinholes(color: np.ndarray, depth: np.ndarray, valid: np.ndarray, source: np.ndarray) -> Closed | None:
    """Fill pinholes of one picture in place; returns them, None if there were none.

    A pixel is a pinhole where at least two of the four lines through it have both neighbours on one surface, and give
    it the same depth. It gets the mean inverse depth and colour of these. Outlines and what is really hidden stay
    empty: there the sides differ, or miss.

    Args:
        color: (H,W,3) float32. depth: (H,W) float32 camera z, +inf where nothing is. valid: (H,W) bool. source: (H,W)
            int64.
    """
    import cv2  # here, for most pictures are not reprojected

    height, width = valid.shape
    if height < 3 or width < 3:
        return None
    around = cv2.boxFilter(valid.view(np.uint8), -1, (3, 3), normalize=False, borderType=cv2.BORDER_CONSTANT)
    rows, columns = np.nonzero(~valid[1:-1, 1:-1] & (around[1:-1, 1:-1] >= 2 * FEWEST))
    if not len(rows):
        return None
    rows, columns = rows + 1, columns + 1
    one = (rows[:, None] + LINES[:, 0], columns[:, None] + LINES[:, 1])
    other = (rows[:, None] - LINES[:, 0], columns[:, None] - LINES[:, 1])
    both = valid[one] & valid[other]
    near, far = np.where(both, depth[one], 1.0).astype(np.float64), np.where(both, depth[other], 1.0).astype(np.float64)
    both &= np.abs(near - far) <= SMOOTH * np.minimum(near, far)
    count = both.sum(1)
    inverse = np.where(both, 0.5 / near + 0.5 / far, 0.0)
    mean = inverse.sum(1) / np.maximum(count, 1)
    agree = (np.abs(inverse - mean[:, None]) <= AGREE * mean[:, None]) | ~both
    filled = (count >= FEWEST) & agree.all(1)
    if not filled.any():
        return None
    rows, columns, weight = rows[filled], columns[filled], (both / np.maximum(count, 1)[:, None])[filled]
    one, other = (one[0][filled], one[1][filled]), (other[0][filled], other[1][filled])
    sides = 0.5 * (color[one].astype(np.float64) + color[other])
    first = both[filled].argmax(1)[:, None]
    origin = tuple(np.take_along_axis(axis, first, 1)[:, 0] for axis in one)
    color[rows, columns] = (sides * weight[..., None]).sum(1)
    depth[rows, columns] = 1.0 / mean[filled]
    source[rows, columns] = source[origin]
    valid[rows, columns] = True
    return Closed(rows, columns, one, other, weight)
