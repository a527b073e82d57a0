"""Functions of float32 numbers as polynomials that inline: a call of the library's costs as much as a texel."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel

F: Any = np.float32
QUARTER, HALF = F(0.25 * math.pi), F(0.5 * math.pi)


@kernel(inline=True)
def arctan2(y, x):
    """Angle of (x, y); error below 1e-6."""
    a, b = abs(x), abs(y)
    big, small = max(a, b), min(a, b)
    s = small / max(big, F(1e-37))
    # Twice the angle of half: arguments up to tan(pi/8) keep the polynomial short.
    folded = s > F(0.41421356)
    if folded:
        s = (s - F(1.0)) / (s + F(1.0))
    q = s * s
    r = F(0.0805374449538) * q - F(0.138776856032)
    r = (r * q + F(0.199777106478)) * q - F(0.333329491539)
    r = r * q * s + s
    if folded:
        r += QUARTER
    if b > a:
        r = HALF - r
    if x < F(0.0):
        r = F(math.pi) - r
    return r if y >= F(0.0) else -r


@kernel(inline=True)
def tangent(x):
    """Of an angle between plus and minus a right one; relative error below 2e-6."""
    a = abs(x)
    steep = a > QUARTER
    y = HALF - a if steep else a
    q = y * y
    n = y * (F(945.0) - q * (F(105.0) - q))
    m = F(945.0) - q * (F(420.0) - q * F(15.0))
    r = m / max(n, F(1e-30)) if steep else n / m
    return r if x >= F(0.0) else -r


@kernel(inline=True)
def exponential(x):
    """``exp(x)``, relative error below 1e-6; arguments beyond plus or minus 87 count as these."""
    y = min(max(x, F(-87.0)), F(87.0)) * F(1.4426950408889634)
    n = np.int32(y + F(512.5)) - np.int32(512)
    f = (y - F(n)) * F(0.6931471805599453)
    p = F(1.0 / 720.0)
    p = p * f + F(1.0 / 120.0)
    p = p * f + F(1.0 / 24.0)
    p = p * f + F(1.0 / 6.0)
    p = p * f + F(0.5)
    p = (p * f + F(1.0)) * f + F(1.0)
    return p * np.uint32((n + np.int32(127)) << np.int32(23)).view(np.float32)
