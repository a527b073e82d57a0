"""Integrals of light along a ray, from where it begins to any place, by panels.

In a panel the light that would arrive without shadows is a quadratic times an exponential whose exponent is linear:
exact for parallel light in a homogeneous medium, however thick, and close everywhere else. Where the exponent hardly
changes, the product itself is taken as a quadratic.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.functions import exponential

F: Any = np.float32
THIN = F(0.5)
"""Change of the exponent within a panel up to which the product is taken as a quadratic."""
WIDTH = 9
"""Numbers of a panel: begin, width, integral before, three coefficients, exponent's change, factor, integral after."""


@kernel(inline=True)
def fill_panel(panel, begin, width, before, a, e):
    """Numbers of one panel; returns the integral after it.

    Args:
        a, e: factor and exponent (of ``a exp(-e)``) at the panel's begin, middle and end.
    """
    panel[0], panel[1], panel[2] = begin, width, before
    rise = e[2] - e[0]
    bend = min(max(F(0.5) * (e[0] + e[2]) - e[1], F(-30.0)), F(8.0))
    if abs(rise) <= THIN:
        g0, g1, g2 = a[0] * exponential(-e[0]), a[1] * exponential(-e[1]), a[2] * exponential(-e[2])
        factor, rise = F(1.0), F(0.0)
    else:
        # The larger of both ends is taken out, so that nothing overflows.
        base = e[0] if rise > F(0.0) else e[2]
        g0, g1, g2 = a[0], a[1] * exponential(bend), a[2]
        factor = exponential(-base)
    panel[3] = g0
    panel[4] = F(4.0) * g1 - F(3.0) * g0 - g2
    panel[5] = F(2.0) * (g0 + g2) - F(4.0) * g1
    panel[6], panel[7] = rise, factor
    return before + width * max(part_of_panel(panel, F(1.0)), F(0.0))


@kernel(inline=True)
def part_of_panel(panel, s):
    """Integral over the first share ``s`` of a panel, for width one."""
    c0, c1, c2, rise = panel[3], panel[4], panel[5], panel[6]
    if rise == F(0.0):
        return s * (c0 + s * (F(0.5) * c1 + s * F(1.0 / 3.0) * c2))
    if rise > F(0.0):
        i0, i1, i2 = moments(rise, s)
        return panel[7] * (c0 * i0 + c1 * i1 + c2 * i2)
    # Seen from its end, where the exponent is least: r = 1 - s.
    d0, d1, d2 = c0 + c1 + c2, -(c1 + F(2.0) * c2), c2
    i0, i1, i2 = moments(-rise, F(1.0))
    whole = d0 * i0 + d1 * i1 + d2 * i2
    i0, i1, i2 = moments(-rise, F(1.0) - s)
    return panel[7] * (whole - (d0 * i0 + d1 * i1 + d2 * i2))


@kernel(inline=True)
def moments(k, s):
    """Integrals of 1, x and x^2 times exp(-k x) from 0 to s, for k > 0."""
    y = k * s
    if y < F(0.7):
        i0 = s * (F(1) - y * (F(1 / 2) - y * (F(1 / 6) - y * (F(1 / 24) - y * (F(1 / 120) - y * F(1 / 720))))))
        i1 = s * s * (F(1 / 2) - y * (F(1 / 3) - y * (F(1 / 8) - y * (F(1 / 30) - y * (F(1 / 144) - y * F(1 / 840))))))
        i2 = F(1 / 3) - y * (F(1 / 4) - y * (F(1 / 10) - y * (F(1 / 36) - y * (F(1 / 168) - y * F(1 / 960)))))
        return i0, i1, s * s * s * i2
    e = exponential(-y)
    inverse = F(1.0) / k
    i0 = (F(1.0) - e) * inverse
    i1 = (i0 - s * e) * inverse
    i2 = (F(2.0) * i1 - s * s * e) * inverse
    return i0, i1, i2


@kernel(inline=True)
def integral_to(panels, count, hint, x):
    """Integral from the first panel's begin to ``x``, and the panel it lies in; ``hint``: one that is not behind it."""
    k = hint
    while k + 1 < count and x >= panels[k + 1, 0]:
        k += 1
    panel = panels[k]
    s = min(max((x - panel[0]) / max(panel[1], F(1e-30)), F(0.0)), F(1.0))
    return panel[2] + panel[1] * part_of_panel(panel, s), k
