"""A lamp in a homogeneous medium: one table gives the light from any stretch of any ray.

With the angle at the lamp as variable, extinction on both ways is ``exp(-u (tan x + 1 / cos x))``, where ``u`` is the
optical depth of the ray's distance from the lamp. Sources: Sun, Ramamoorthi, Narasimhan, Nayar, A practical analytic
single scattering model for real time rendering, 2005; the angle: Lecocq, Michelin, Arques, Kemeny, 2000.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.nodes import phase

F: Any = np.float32
HALF_TURN = F(math.pi)


@kernel(parallel=True)
def fill_airlight(optical_depths, g, table):
    """``table[c, i, j]``: integral to angle j, in (-pi/2, pi/2), of phase function times extinction.

    Args:
        optical_depths: (C,) of the greatest distance from the lamp; row i belongs to ``(i / (rows - 1))^2`` of it.
        table: (C,R,K) float32, written.
    """
    channels, rows, columns = table.shape
    width = math.pi / (columns - 1)
    for row in prange(channels * rows):
        c, i = row // rows, row % rows
        share = i / (rows - 1.0)
        u = np.float64(optical_depths[c]) * share * share
        total = 0.0
        table[c, i, 0] = F(0.0)
        for j in range(1, columns):
            for k in range(2):  # Gauss, two points
                x = -0.5 * math.pi + (j - 0.5 + (k - 0.5) * 0.5773502691896257) * width
                # tan x + 1 / cos x = tan(x / 2 + pi / 4), without the difference of two large numbers.
                way = math.tan(0.5 * x + 0.25 * math.pi)
                total += math.exp(-u * way) * np.float64(phase(F(g), F(-math.sin(x)))) * 0.5 * width
            table[c, i, j] = F(total)


@kernel(inline=True)
def airlight_to(table, c, row, weight, x):
    """Integral to angle ``x``; ``row`` and ``weight`` from :func:`airlight_row`."""
    columns = table.shape[2]
    v = (x + F(0.5) * HALF_TURN) * (F(columns - 1) / HALF_TURN)
    j = min(max(np.int32(v), np.int32(0)), np.int32(columns - 2))
    v = min(max(v - F(j), F(0.0)), F(1.0))
    a = table[c, row, j] + (table[c, row, j + 1] - table[c, row, j]) * v
    b = table[c, row + 1, j] + (table[c, row + 1, j + 1] - table[c, row + 1, j]) * v
    return a + (b - a) * weight


@kernel(inline=True)
def airlight_row(table, share):
    """Row of the table and weight of the next one for a distance that is this share of the greatest."""
    rows = table.shape[1]
    at = math.sqrt(min(max(share, F(0.0)), F(1.0))) * F(rows - 1)
    row = min(np.int32(at), np.int32(rows - 2))
    lower, upper = F(row) / F(rows - 1), F(row + 1) / F(rows - 1)
    lower, upper = lower * lower, upper * upper
    return row, (share - lower) / (upper - lower)
