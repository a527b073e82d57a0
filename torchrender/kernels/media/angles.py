"""Angles and tangents in float32, as polynomials that inline: a call of the library's costs as much as a texel."""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel

F = np.float32
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
