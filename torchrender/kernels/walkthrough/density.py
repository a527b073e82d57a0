"""Which photo sampled a piece of surface best: every pixel against the photos that see the same point."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

BACKGROUND = np.inf
"""Depth of a pixel that looks past everything; 0: nothing is known."""


EDGE_SHARE = 0.25
"""Of its density that a pixel at a depth edge counts with."""


class Photos(NamedTuple):
    """N photos as the kernels read them."""

    color: Any  # (N,H,W,3) uint8 sRGB codes
    depth: Any  # (N,H,W) float32 camera z; +inf background, 0 unknown
    normal: Any  # (N,H,W,3) int16, 32767 times the unit normal in the camera's frame, facing the camera
    plane: Any  # (N,H,W) int32, -1: on no plane
    guard: Any  # (N,H,W) uint8: 1 within a pixel of a depth edge or the border
    feather: Any  # (N,H,W) uint8 pixels to the border of the picture or of what is known, at most 255
    lens: Any  # (N,4) float64 fx, fy, cx, cy
    log_quality: Any  # (N,) float64, added to the logarithm of the density
    noise: Any  # (N,) float64 standard deviation of inverse depth


NOISE_WIDTH = 3.0
"""Standard deviations of depth by which two photos of one surface may differ."""

MOST_SLACK = 0.05
"""Share of depth that noise may widen the tolerance to: beyond it surfaces are told apart by nothing."""


class Comparison(NamedTuple):
    """Limits of the comparison."""

    tau_z: float  # share of depth within which two samples are of one surface
    through: float  # times that beyond which a photo sees through a point
    eta: float  # step of the logarithm of density below which two photos count as equal
    power: float  # of the density, as the weight of blended colours
    color_gap: float  # codes by which colours may differ and still be blended


@kernel(inline=True)
def density(focal, facing, z):
    """Pixels per unit of surface area: fx fy h / z^3 with h = |n.(X - C)| (specification 13, section 4)."""
    return focal * facing / (z * z * z)


@kernel(inline=True)
def agreeing(photos, j, z, tau_z):
    """Difference of depth within which photo ``j`` sees the surface at depth ``z``: noise grows with its square."""
    return max(tau_z, min(NOISE_WIDTH * photos.noise[j] * z, MOST_SLACK)) * z


@kernel(inline=True)
def moved(m, x, y, z):
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z + m[0, 3],
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z + m[1, 3],
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z + m[2, 3],
    )


@kernel(inline=True)
def turned(m, x, y, z):
    return (
        m[0, 0] * x + m[0, 1] * y + m[0, 2] * z,
        m[1, 0] * x + m[1, 1] * y + m[1, 2] * z,
        m[2, 0] * x + m[2, 1] * y + m[2, 2] * z,
    )


@kernel(inline=True)
def ray(lens, i, x, y, z):
    return (x + 0.5 - lens[i, 2]) / lens[i, 0] * z, (y + 0.5 - lens[i, 3]) / lens[i, 1] * z, z


@kernel(inline=True)
def unit_normal(normal, i, y, x):
    a, b, c = float(normal[i, y, x, 0]), float(normal[i, y, x, 1]), float(normal[i, y, x, 2])
    length = math.sqrt(a * a + b * b + c * c)
    if length < 1.0:
        return 0.0, 0.0, -1.0
    return a / length, b / length, c / length


@kernel(inline=True)
def pixel_of(lens, j, p, height, width):
    """Column and row of a point in camera space; -1 where it is outside the picture or behind the camera."""
    if not p[2] > 1e-9:
        return -1, -1
    u = lens[j, 0] * p[0] / p[2] + lens[j, 2]
    v = lens[j, 1] * p[1] / p[2] + lens[j, 3]
    if not (0.0 <= u < width and 0.0 <= v < height):
        return -1, -1
    return int(u), int(v)


@kernel(parallel=True)
def compare(i, partners, move, photos, limits, outputs):
    """Compare every pixel of photo ``i`` with the photos ``partners``; ``move`` (P,3,4) camera_j from camera_i.

    Fills ``outputs``: keep (H,W) uint8; blended (H,W,3) uint8 colour over the photos that agree, weights density to a
    power; fused (H,W) float32 mean depth over them, weights 1/z^4; through (H,W) uint8 photos that see through.
    """
    keep, blended, fused, through = outputs
    height, width = keep.shape
    lens = photos.lens
    focal = lens[:, 0] * lens[:, 1]
    quality = np.exp(photos.log_quality[partners])
    # Ratios of densities beyond these lie more than a step apart, whatever the rounding: no logarithm is needed.
    high, low = math.exp(1.5 * limits.eta), math.exp(-1.5 * limits.eta)
    for y in prange(height):
        for x in range(width):
            z = np.float64(photos.depth[i, y, x])
            keep[y, x] = 0
            if not (0.0 < z < np.inf):
                continue
            point = ray(lens, i, x, y, z)
            n = unit_normal(photos.normal, i, y, x)
            facing = abs(n[0] * point[0] + n[1] * point[1] + n[2] * point[2])
            own_density = density(focal[i], facing, z) * math.exp(photos.log_quality[i]) + 1e-30
            if photos.guard[i, y, x] != 0:
                # Colours mix at edges: whoever saw the place in the middle of a surface is better.
                own_density *= EDGE_SHARE
            own_key = round(math.log(own_density) / limits.eta) if limits.eta > 0 else 0
            plane = photos.plane[i, y, x]
            own = photos.color[i, y, x]
            total, red, green, blue = 1.0, float(own[0]), float(own[1]), float(own[2])
            weights, shift, seen_through, best = 1.0 / z**4, 0.0, 0, True
            for k in range(len(partners)):
                j = partners[k]
                q = moved(move[k], point[0], point[1], point[2])
                px, py = pixel_of(lens, j, q, height, width)
                if px < 0:
                    continue
                found = np.float64(photos.depth[j, py, px])
                if found <= 0.0:
                    continue
                gap, slack = found - q[2], agreeing(photos, j, q[2], limits.tau_z)
                other = photos.plane[j, py, px]
                # A pixel of the same plane sees this very place, whatever noise says of its depth.
                same = plane >= 0 and other == plane and found < np.inf
                if gap > limits.through * slack and not same:
                    if photos.guard[j, py, px] == 0 and seen_through < 255:
                        seen_through += 1
                    continue
                if abs(gap) > slack and not same:
                    continue
                if plane >= 0 and other >= 0 and plane != other:
                    continue
                m = turned(move[k], n[0], n[1], n[2])
                side = m[0] * q[0] + m[1] * q[1] + m[2] * q[2]
                if side >= 0.0:
                    continue
                ratio = density(focal[j], -side, q[2]) * quality[k] / own_density
                if plane < 0:
                    # Texels of planes are looked up on their own.
                    color = photos.color[j, py, px]
                    r, g, b = float(color[0]), float(color[1]), float(color[2])
                    if max(abs(r - own[0]), abs(g - own[1]), abs(b - own[2])) <= limits.color_gap:
                        share = min(ratio**limits.power, 1e17)
                        red, green, blue, total = red + share * r, green + share * g, blue + share * b, total + share
                    w = 1.0 / (q[2] * q[2] * q[2] * q[2])
                    weights, shift = weights + w, shift + w * gap
                if photos.guard[j, py, px] != 0 or ratio < low:
                    continue
                if ratio > high:
                    best = False
                elif limits.eta > 0:
                    key = round(math.log(own_density * ratio) / limits.eta)
                    if key > own_key or (key == own_key and j < i):
                        best = False
                elif ratio > 1.0 or (ratio == 1.0 and j < i):
                    best = False
            keep[y, x] = 1 if best else 0
            blended[y, x, 0] = int(red / total + 0.5)
            blended[y, x, 1] = int(green / total + 0.5)
            blended[y, x, 2] = int(blue / total + 0.5)
            fused[y, x] = z + shift / weights
            through[y, x] = seen_through


@kernel(parallel=True)
def restore(i, partners, move, photos, keep, tau_z, restored):
    """Mark the dropped pixels of photo ``i`` that no survivor in ``keep`` (N,H,W) stands for, within a pixel and
    ``tau_z``; ``restored`` (H,W) uint8."""
    height, width = restored.shape
    for y in prange(height):
        for x in range(width):
            z = np.float64(photos.depth[i, y, x])
            restored[y, x] = 0
            if keep[i, y, x] != 0 or not (0.0 < z < np.inf):
                continue
            point = ray(photos.lens, i, x, y, z)
            held = False
            for k in range(len(partners)):
                j = partners[k]
                q = moved(move[k], point[0], point[1], point[2])
                px, py = pixel_of(photos.lens, j, q, height, width)
                if px < 0:
                    continue
                slack = agreeing(photos, j, q[2], tau_z)
                for b in range(max(py - 1, 0), min(py + 2, height)):
                    for a in range(max(px - 1, 0), min(px + 2, width)):
                        if keep[j, b, a] != 0 and abs(photos.depth[j, b, a] - q[2]) <= slack:
                            held = True
                if held:
                    break
            restored[y, x] = 0 if held else 1
