"""Which points a body that moved cannot have to do with: neither their light nor what is near them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel


class Sources(NamedTuple):
    """L lights as far as their place goes."""

    places: np.ndarray  # (L,4) float64 position and 1, or the direction towards parallel light and 0
    radii: np.ndarray  # (L,) half the extent


@kernel()
def meets(start, step, low, high, margin):
    """The segment from ``start`` over ``step`` meets a box that is larger by ``margin`` on each side."""
    enter, leave = 0.0, 1.0
    for k in range(3):
        below, above = low[k] - margin - start[k], high[k] + margin - start[k]
        if step[k] == 0.0:
            if below > 0.0 or above < 0.0:
                return False
            continue
        a, b = below / step[k], above / step[k]
        enter, leave = max(enter, min(a, b)), min(leave, max(a, b))
    return enter <= leave


@kernel(parallel=True)
def untouched(points, sources, box, margins, out):
    """Of points (N,3) float64: ``out`` (N,L) bool, the way to each light misses ``box`` (2,3).

    ``margins``: by which boxes are larger, and length of ways to parallel light.
    """
    places, radii = sources
    margin, far = margins
    for n in prange(points.shape[0]):
        start = (points[n, 0], points[n, 1], points[n, 2])
        for number in range(places.shape[0]):
            x, y, z, w = places[number, 0], places[number, 1], places[number, 2], places[number, 3]
            step = (x - start[0], y - start[1], z - start[2])
            if w == 0.0:
                step = (x * far, y * far, z * far)
            out[n, number] = not meets(start, step, box[0], box[1], margin + radii[number])
