"""Which points a body that moved cannot have to do with: neither their light nor what is near them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class Sources(NamedTuple):
    """L lights as far as their place goes."""

    places: np.ndarray  # (L,4) float64 position and 1, or the direction towards parallel light and 0
    extents: np.ndarray  # (L,3) half of what they take along each axis


@kernel()
def meets(start, step, low, high, margins):
    """The way from ``start`` over ``step``, to what has an extent there, meets a box.

    ``margins``: by which the box is larger, and half the extent along each axis: the box grows by so much on the way.
    """
    margin, extent = margins
    enter, leave = 0.0, 1.0
    for k in range(3):
        # low - margin - extent t <= start + step t <= high + margin + extent t
        for slope, bound in (
            (step[k] + extent[k], low[k] - margin - start[k]),
            (extent[k] - step[k], start[k] - high[k] - margin),
        ):
            if slope > 0.0:
                enter = max(enter, bound / slope)
            elif slope < 0.0:
                leave = min(leave, bound / slope)
            elif bound > 0.0:
                return False
    return enter <= leave


@kernel(parallel=True)
def untouched(points, sources, box, margins, out):
    """Of points (N,3) float64: ``out`` (N,L) bool, the way to each light misses ``box`` (2,3).

    ``margins``: by which boxes are larger, and length of ways to parallel light.
    """
    places, extents = sources
    margin, far = margins
    low, high = box[0], box[1]
    for n in prange(points.shape[0]):
        start = (points[n, 0], points[n, 1], points[n, 2])
        for number in range(places.shape[0]):
            x, y, z, w = places[number, 0], places[number, 1], places[number, 2], places[number, 3]
            step = (x - start[0], y - start[1], z - start[2])
            if w == 0.0:
                step = (x * far, y * far, z * far)
            extent = (extents[number, 0], extents[number, 1], extents[number, 2])
            out[n, number] = not meets(start, step, low, high, (margin, extent))
