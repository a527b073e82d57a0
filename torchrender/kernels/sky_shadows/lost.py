"""Light of an environment that surfaces do not send because objects hide a part of it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.shading.records import IRRADIANCE_SIDE
from torchrender.kernels.shading.simd import ONE, ZERO, f4
from torchrender.kernels.shading.sky import map_corners, map_place, map_weights, octahedral

_LEAST = f4(1e-6)
_ROW = 1024
"""Pixels that a thread takes at a time."""


class Seen(NamedTuple):
    """N pixels."""

    left: np.ndarray  # (N,4) float32 shares of the light that spheres leave, the fourth of even light
    normal: np.ndarray  # (N,4) float32 shading normal, and something else
    sent: np.ndarray  # (N,3) float32 what the surface sends of diffuse light from all around; 0: left out


class Known(NamedTuple):
    """What the picture's light was computed with."""

    taken: np.ndarray  # (N,) float32 share of light that arrived; no rows: all of it, everywhere
    sky: np.ndarray  # (N,) float32 share of the sky that is open
    bent: np.ndarray  # (N,3) float32 where light was looked up; no rows: along the normal


@kernel(inline=True)
def _arriving(texels, x, y, z):
    """Irradiance over pi, three colours, about a unit direction."""
    across, down = octahedral(x, y, z)
    texel, u, v = map_place(f4(IRRADIANCE_SIDE), across, down)
    places = map_corners(np.int64(0), IRRADIANCE_SIDE, texel)
    a, b, c, d = places[0] // 3, places[1] // 3, places[2] // 3, places[3] // 3
    p, q, r, s = map_weights(u, v, ONE)
    red = p * texels[a, 0] + q * texels[b, 0] + r * texels[c, 0] + s * texels[d, 0]
    green = p * texels[a, 1] + q * texels[b, 1] + r * texels[c, 1] + s * texels[d, 1]
    blue = p * texels[a, 2] + q * texels[b, 2] + r * texels[c, 2] + s * texels[d, 2]
    return red, green, blue


@kernel(parallel=True)
def take_away(seen, known, texels, out):
    """Radiance out (N,3) float32 that is not sent; ``texels`` (T,3) octahedral map of irradiance over pi."""
    left, normal, sent = seen.left, seen.normal, seen.sent
    taken, sky, bent = known.taken, known.sky, known.bent
    count = sent.shape[0]
    for part in prange((count + _ROW - 1) // _ROW):
        first = np.int64(part) * _ROW
        for i in range(first, min(first + _ROW, count)):
            if sent[i, 0] == ZERO and sent[i, 1] == ZERO and sent[i, 2] == ZERO:
                continue
            x, y, z = normal[i, 0], normal[i, 1], normal[i, 2]
            if taken.shape[0] == 0:
                red, green, blue = _arriving(texels, x, y, z)
                out[i, 0] = red * (ONE - left[i, 0]) * sent[i, 0]
                out[i, 1] = green * (ONE - left[i, 1]) * sent[i, 1]
                out[i, 2] = blue * (ONE - left[i, 2]) * sent[i, 2]
                continue
            whole = sky[i]
            others = min(max(whole / max(left[i, 3], _LEAST), ZERO), ONE)  # share that is left by what else is there
            if bent.shape[0] == 0:
                red, green, blue = _arriving(texels, x, y, z)
                was = (red, green, blue)
            else:
                # The open sky's middle lies off the normal in the measure in which others hide it.
                a, b, c = bent[i, 0], bent[i, 1], bent[i, 2]
                was = _arriving(texels, a, b, c)
                share = min(max((ONE - others) / max(ONE - whole, _LEAST), ZERO), ONE)
                x, y, z = x + share * (a - x), y + share * (b - y), z + share * (c - z)
                scale = ONE / max(f4(math.sqrt(x * x + y * y + z * z)), f4(1e-12))
                red, green, blue = _arriving(texels, x * scale, y * scale, z * scale)
            out[i, 0] = (was[0] * taken[i] - red * others * left[i, 0]) * sent[i, 0]
            out[i, 1] = (was[1] * taken[i] - green * others * left[i, 1]) * sent[i, 1]
            out[i, 2] = (was[2] * taken[i] - blue * others * left[i, 2]) * sent[i, 2]
