"""Single pixels that samples missed within a surface that its neighbours show: closed from those."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.warp.pinholes import DOWN, RIGHT, close

SMOOTH = 0.05
"""Relative difference of depths across the pixel, up to which both sides are one surface."""
AGREE = 0.01
"""Relative difference of inverse depths at the pixel that lines through it may give: on a plane they give one."""
APART = 0.15
"""Relative difference of depths across a pixel that shows what is behind both sides, up to which these are one surface,
or two that meet there: through cracks along edges hidden samples show, such as the dark inside of a wall."""
FEWEST = (2, 3)
"""Lines through the pixel that must lie on the surface: where nothing is, and where something behind it shows."""


class Closed(NamedTuple):
    """P pinholes and what they were closed with: means over pairs of pixels on the four lines through them."""

    rows: np.ndarray  # (P,) int64
    columns: np.ndarray
    one: tuple[np.ndarray, np.ndarray]  # (P,4) rows and columns of the pixels on one side
    other: tuple[np.ndarray, np.ndarray]
    weight: np.ndarray  # (P,4) of the lines, their sum is one


def close_pinholes(
    color: np.ndarray, depth: np.ndarray, valid: np.ndarray, source: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Fill pinholes of one picture in place.

    A pixel is a pinhole where no sample reached, or one of another image than what is beside it and behind that, and
    where two of the four lines through it, or three in the second case, have both neighbours on one surface, and give
    it the same depth. It gets the mean inverse depth and colour of these. Outlines and what is really hidden stay as
    they are: there the sides differ, or miss. A pixel of the second case that cannot be closed is emptied: what it
    shows is hidden by what is beside it, as along the edge where two walls meet.

    Args:
        color: (H,W,3) float32. depth: (H,W) float32 camera z, +inf where nothing is. valid: (H,W) bool. source: (H,W)
            int64.

    Returns:
        (H,W) bool: the pinholes; (H,W) bool: what they could be closed from.
    """
    if min(valid.shape) < 3:
        return np.zeros_like(valid), valid.copy()
    closed, own = close(color, depth, valid, source, FEWEST, (SMOOTH, AGREE, APART))
    return closed, own


def closed_pinholes(depth: np.ndarray, closed: np.ndarray, own: np.ndarray) -> Closed | None:
    """How :func:`close_pinholes` closed, for who follows its colours; None if that is nothing.

    Args:
        depth: (H,W) afterwards. closed, own: (H,W) bool, what it returned.
    """
    rows, columns = np.nonzero(closed)
    if not len(rows):
        return None
    one = (rows[:, None] + np.asarray(DOWN), columns[:, None] + np.asarray(RIGHT))
    other = (rows[:, None] - np.asarray(DOWN), columns[:, None] - np.asarray(RIGHT))
    both = own[one] & own[other]
    near, far = (np.where(both, depth[side], 1.0).astype(np.float64) for side in (one, other))
    both &= np.abs(near - far) <= SMOOTH * np.minimum(near, far)
    return Closed(rows, columns, one, other, both / both.sum(axis=1, keepdims=True))
