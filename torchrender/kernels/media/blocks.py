"""Which pixels are integrated, and what the others get from these. Source: specification 09, section 4, and 12.

The picture is cut into blocks, and one pixel of each, its sample, is integrated. So are pixels whose way through the
medium differs from that of their block, pixels around a lamp, and pixels whose samples disagree about light and shadow
along the ray: what is interpolated over the edge of a shaft would be wrong however dense the samples are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

F: Any = np.float32
I64: Any = np.int64
NONE, NEAREST, LSQ = 0, 1, 2
"""Gradients at samples."""
FEWEST = 3  # neighbours that a least-squares gradient needs
DAMPING = F(1e-9)


@kernel(inline=True)
def hashed(x, y, seed):
    """A number in [0, 65535] that neighbouring blocks do not share."""
    h = np.uint64(x) * np.uint64(73856093) ^ np.uint64(y) * np.uint64(19349663) ^ np.uint64(seed) * np.uint64(83492791)
    h = (h ^ (h >> np.uint64(13))) * np.uint64(2654435761)
    return I64((h >> np.uint64(15)) & np.uint64(0xFFFF))


@kernel(parallel=True)
def mark_blocks(length, block, eps, guard, seed, marked, samples):
    """Mark one pixel of every block, pixels that differ in length, and pixels around a lamp.

    Args:
        length: (H,W) of the way through the media, 0 for none; such pixels take no part.
        eps: share of its own length by which a pixel may differ from its block's mean.
        guard: column, row and radius around a lamp; radius 0 for none.
        marked: (H,W) bool, written. samples: (H/block,W/block,2) int32 row and column of each block's pixel, -1 for
            none.
    """
    height, width = length.shape
    for by in prange(samples.shape[0]):
        for bx in range(samples.shape[1]):
            top, left = I64(by) * block, bx * block
            low, right = min(top + block, height), min(left + block, width)
            total, count = F(0.0), 0
            for y in range(top, low):
                for x in range(left, right):
                    if length[y, x] > F(0.0):
                        total += length[y, x]
                        count += 1
            samples[by, bx, 0], samples[by, bx, 1] = -1, -1
            pick = hashed(bx, by, seed) % max(count, 1)
            mean = total / F(max(count, 1))
            for y in range(top, low):
                for x in range(left, right):
                    d = length[y, x]
                    marked[y, x] = False
                    if not d > F(0.0):
                        continue
                    if pick == 0:
                        samples[by, bx, 0], samples[by, bx, 1] = y, x
                        marked[y, x] = True
                    pick -= 1
                    u, v = F(x) + F(0.5) - guard[0], F(y) + F(0.5) - guard[1]
                    if abs(d - mean) > eps * d or u * u + v * v < guard[2] * guard[2]:
                        marked[y, x] = True


@kernel(parallel=True)
def mark_doubtful(length, marked, samples, told, limits, more):
    """Mark, in ``more`` (H,W), pixels that were not marked and have no samples around, or ones that disagree.

    Args:
        told: (H W,3) share of each ray that is lit, and number of lit parts, where it was integrated.
        limits: (block, eps, largest difference of lit shares).
    """
    block, eps, tolerance = limits
    height, width = length.shape
    for y in prange(height):
        for x in range(width):
            more[y, x] = False
            d = length[y, x]
            if marked[y, x] or not d > F(0.0):
                continue
            count, low, high = 0, F(2.0), F(-1.0)
            by, bx = I64(y) // block, x // block
            for j in range(max(by - 1, 0), min(by + 2, samples.shape[0])):
                for i in range(max(bx - 1, 0), min(bx + 2, samples.shape[1])):
                    ky, kx = I64(samples[j, i, 0]), I64(samples[j, i, 1])
                    if ky < 0:
                        continue
                    k = ky * width + kx
                    if abs(kx - x) <= block and abs(ky - I64(y)) <= block and abs(length[ky, kx] - d) < eps * d:
                        count += 1
                        low, high = min(low, told[k, 0]), max(high, told[k, 0])
            more[y, x] = count == 0 or high - low > tolerance


@kernel(parallel=True)
def find_gradients(length, norm, samples, told, limits, gradient, radiance, found):
    """Normalised value and its gradient at every sample, ``found`` (H/block,W/block,3,C).

    Args:
        norm: (H,W) what radiance is divided by. radiance: (H W,C).
        limits: as :func:`mark_doubtful`. gradient: NONE, NEAREST (the nearest sample along each axis, as printed) or
            LSQ (least squares over the samples around).
    """
    block, eps, tolerance = limits
    width, channels = length.shape[1], radiance.shape[1]
    for line in prange(samples.shape[0]):
        by = I64(line)
        for bx in range(samples.shape[1]):
            y, x = I64(samples[by, bx, 0]), I64(samples[by, bx, 1])
            if y < 0:
                continue
            p = y * width + x
            d, share = length[y, x], told[p, 0]
            for c in range(channels):
                found[by, bx, 0, c] = radiance[p, c] / max(norm[y, x], F(1e-8))
                found[by, bx, 1, c] = F(0.0)
                found[by, bx, 2, c] = F(0.0)
            if gradient == NONE:
                continue
            xx, xy, yy, count = DAMPING, F(0.0), DAMPING, 0
            near_x, near_y = F(1e9), F(1e9)
            for j in range(max(by - 2, 0), min(by + 3, samples.shape[0])):
                for i in range(max(bx - 2, 0), min(bx + 3, samples.shape[1])):
                    ky, kx = I64(samples[j, i, 0]), I64(samples[j, i, 1])
                    k = ky * width + kx
                    if ky < 0 or k == p:
                        continue
                    if abs(kx - x) > 2 * block or abs(ky - y) > 2 * block:
                        continue
                    if abs(length[ky, kx] - d) >= eps * d or abs(told[k, 0] - share) > tolerance:
                        continue
                    dx, dy = F(kx - x), F(ky - y)
                    square = dx * dx + dy * dy
                    if gradient == NEAREST:
                        if j == by and kx != x and square < near_x:
                            near_x = square
                            for c in range(channels):
                                change = radiance[k, c] / max(norm[ky, kx], F(1e-8)) - found[by, bx, 0, c]
                                found[by, bx, 1, c] = change / dx
                        if i == bx and ky != y and square < near_y:
                            near_y = square
                            for c in range(channels):
                                change = radiance[k, c] / max(norm[ky, kx], F(1e-8)) - found[by, bx, 0, c]
                                found[by, bx, 2, c] = change / dy
                        continue
                    weight = F(1.0) / square
                    count += 1
                    xx += weight * dx * dx
                    xy += weight * dx * dy
                    yy += weight * dy * dy
                    for c in range(channels):
                        change = weight * (radiance[k, c] / max(norm[ky, kx], F(1e-8)) - found[by, bx, 0, c])
                        found[by, bx, 1, c] += change * dx
                        found[by, bx, 2, c] += change * dy
            if gradient == LSQ:
                size = xx * yy - xy * xy
                usable = count >= FEWEST and size > F(1e-4) * xx * yy
                for c in range(channels):
                    a, b = found[by, bx, 1, c], found[by, bx, 2, c]
                    found[by, bx, 1, c] = (yy * a - xy * b) / size if usable else F(0.0)
                    found[by, bx, 2, c] = (xx * b - xy * a) / size if usable else F(0.0)


@kernel(parallel=True)
def fill_between(length, norm, integrated, samples, limits, found, radiance):
    """Radiance of the pixels that were not integrated: means of what the samples around say of them.

    Args:
        integrated: (H,W) bool. found: from :func:`find_gradients`. radiance: (H W,C), written.
    """
    block, eps, _ = limits
    height, width = length.shape
    channels = radiance.shape[1]
    for y in prange(height):
        near = borrowed(np.empty((9, 4), np.int64))
        for x in range(width):
            d = length[y, x]
            if integrated[y, x]:
                continue
            p = I64(y) * width + x
            for c in range(channels):
                radiance[p, c] = F(0.0)
            if not d > F(0.0):
                continue
            by, bx = I64(y) // block, x // block
            count = 0
            for j in range(max(by - 1, 0), min(by + 2, samples.shape[0])):
                for i in range(max(bx - 1, 0), min(bx + 2, samples.shape[1])):
                    ky, kx = I64(samples[j, i, 0]), I64(samples[j, i, 1])
                    if ky < 0:
                        continue
                    dx, dy = I64(x) - kx, I64(y) - ky
                    if abs(dx) <= block and abs(dy) <= block and abs(length[ky, kx] - d) < eps * d:
                        near[count, 0], near[count, 1], near[count, 2], near[count, 3] = j, i, dx, dy
                        count += 1
            for c in range(channels):
                total, top = F(0.0), F(0.0)
                for n in range(count):
                    j, i = near[n, 0], near[n, 1]
                    value = found[j, i, 0, c]
                    total += value + found[j, i, 1, c] * F(near[n, 2]) + found[j, i, 2, c] * F(near[n, 3])
                    top = max(top, value)
                value = min(max(total / F(max(count, 1)), F(0.0)), F(2.0) * top)
                radiance[p, c] = value * norm[y, x]
