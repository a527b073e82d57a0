"""Which pixels are integrated, and what the others get from these. Source: specification 09, section 4, and 12.

The picture is cut into blocks, and one pixel of each, its sample, is integrated. So are pixels whose way through the
medium differs from that of their block, pixels around a lamp, and pixels whose samples disagree about light and shadow
along the ray: what is interpolated over the edge of a shaft would be wrong however dense the samples are.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel

F: Any = np.float32
I64: Any = np.int64
NONE, NEAREST, LSQ = 0, 1, 2
"""Gradients at samples."""
FEWEST = 3  # neighbours that a least-squares gradient needs
DAMPING = F(1e-9)
BAND = 8  # rows of blocks that a thread takes at a time: what it reads of samples is gathered once
ROW, COLUMN, LENGTH, LIT = 0, 1, 2, 3  # numbers of a gathered sample; the row is negative where a block has none


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


@kernel(inline=True)
def gather(samples, length, told, first, near):
    """Numbers of the samples of some rows of blocks, from row ``first`` on, in ``near`` (R,W/block,4)."""
    for j in range(near.shape[0]):
        by = first + j
        for bx in range(near.shape[1]):
            near[j, bx, ROW] = F(-1.0)
            if by < 0 or by >= samples.shape[0]:
                continue
            y, x = I64(samples[by, bx, 0]), I64(samples[by, bx, 1])
            if y >= 0:
                near[j, bx, ROW], near[j, bx, COLUMN] = F(y), F(x)
                near[j, bx, LENGTH], near[j, bx, LIT] = length[y, x], told[y * length.shape[1] + x, 0]


@kernel(parallel=True)
def mark_doubtful(length, marked, samples, told, limits, more):
    """Mark, in ``more`` (H,W), pixels that were not marked and have no samples around, or ones that disagree.

    Args:
        told: (H W,3) share of each ray that is lit, and number of lit parts, where it was integrated.
        limits: (block, eps, largest difference of lit shares).
    """
    block, eps, tolerance = limits
    height, width = length.shape
    rows, columns = samples.shape[0], samples.shape[1]
    for band in prange((rows + BAND - 1) // BAND):
        first = I64(band) * BAND
        own = np.empty((BAND + 2, columns, 4), F), np.empty(columns, np.bool_)
        (near, calm), side = borrowed(own), F(block)
        gather(samples, length, told, first - 1, near)
        for by in range(first, min(first + BAND, rows)):
            row = by - first
            find_calm(near, row, tolerance, calm)
            for y in range(by * block, min((by + 1) * block, height)):
                for x in range(width):
                    d, bx = length[y, x], x // block
                    more[y, x] = False
                    if marked[y, x] or not d > F(0.0):
                        continue
                    limit = eps * d
                    if not (calm[bx] and abs(near[row + 1, bx, LENGTH] - d) < limit):
                        more[y, x] = is_doubtful(near, (row, bx), (F(y), F(x), side), (d, limit, tolerance))
        keep(own)


@kernel(inline=True)
def find_calm(near, row, tolerance, calm):
    """Blocks that have a sample, where none of the samples around disagree: most pixels need no closer look."""
    columns = near.shape[1]
    for bx in range(columns):
        low, high = F(2.0), F(-1.0)
        for j in range(row, row + 3):
            for i in range(max(bx - 1, 0), min(bx + 2, columns)):
                if near[j, i, ROW] >= F(0.0):
                    low, high = min(low, near[j, i, LIT]), max(high, near[j, i, LIT])
        calm[bx] = high - low <= tolerance and near[row + 1, bx, ROW] >= F(0.0)


@kernel(inline=True)
def is_doubtful(near, block, pixel, limits):
    """A pixel has no samples around that count for it, or ones that disagree.

    Args:
        near: gathered samples. block: (row of them before the pixel's own, column). pixel: (row, column, side of a
            block). limits: (length, largest difference of lengths, largest difference of lit shares).
    """
    row, bx = block
    y, x, side = pixel
    d, limit, tolerance = limits
    count, low, high = 0, F(2.0), F(-1.0)
    for j in range(row, row + 3):
        for i in range(max(bx - 1, 0), min(bx + 2, near.shape[1])):
            ky, kx = near[j, i, ROW], near[j, i, COLUMN]
            if ky < F(0.0) or abs(kx - x) > side or abs(ky - y) > side:
                continue
            if abs(near[j, i, LENGTH] - d) < limit:
                count += 1
                low, high = min(low, near[j, i, LIT]), max(high, near[j, i, LIT])
    return count == 0 or high - low > tolerance


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
    rows, columns = samples.shape[0], samples.shape[1]
    settings = (F(2 * block), eps, tolerance, gradient)
    for band in prange((rows + BAND - 1) // BAND):
        first, out = I64(band) * BAND, borrowed(found)
        own = np.empty((BAND + 4, columns, 4), F), np.empty((BAND + 4, columns, channels), F)
        near, values = borrowed(own)
        gather(samples, length, told, first - 2, near)
        for j in range(BAND + 4):
            for bx in range(columns):
                if near[j, bx, ROW] >= F(0.0):
                    y, x = I64(near[j, bx, ROW]), I64(near[j, bx, COLUMN])
                    inverse = F(1.0) / max(norm[y, x], F(1e-8))
                    for c in range(channels):
                        values[j, bx, c] = radiance[y * width + x, c] * inverse
        for by in range(first, min(first + BAND, rows)):
            for bx in range(columns):
                row = by - first + 2
                if near[row, bx, ROW] >= F(0.0):
                    ends = (max(bx - 2, 0), min(bx + 3, columns))
                    gradient_at(near, values, (row, bx), ends, settings, out[by, bx])
        keep(own)


@kernel(inline=True)
def gradient_at(near, values, place, ends, limits, found):
    """Value and gradient of one sample, ``found`` (3,C), from gathered ones up to two blocks away."""
    own, bx = place
    side, eps, tolerance, gradient = limits
    channels = values.shape[2]
    for c in range(channels):
        found[0, c], found[1, c], found[2, c] = values[own, bx, c], F(0.0), F(0.0)
    if gradient == NONE:
        return
    y, x, d, share = near[own, bx, ROW], near[own, bx, COLUMN], near[own, bx, LENGTH], near[own, bx, LIT]
    xx, xy, yy, count = DAMPING, F(0.0), DAMPING, 0
    near_x, near_y, limit = F(1e9), F(1e9), eps * d
    for j in range(own - 2, own + 3):
        for i in range(ends[0], ends[1]):
            ky, kx = near[j, i, ROW], near[j, i, COLUMN]
            dx, dy = kx - x, ky - y
            if ky < F(0.0) or (j == own and i == bx) or abs(dx) > side or abs(dy) > side:
                continue
            if abs(near[j, i, LENGTH] - d) >= limit or abs(near[j, i, LIT] - share) > tolerance:
                continue
            square = dx * dx + dy * dy
            if gradient == NEAREST:
                if j == own and dx != F(0.0) and square < near_x:
                    near_x = square
                    for c in range(channels):
                        found[1, c] = (values[j, i, c] - found[0, c]) / dx
                if i == bx and dy != F(0.0) and square < near_y:
                    near_y = square
                    for c in range(channels):
                        found[2, c] = (values[j, i, c] - found[0, c]) / dy
                continue
            weight = F(1.0) / square
            count += 1
            xx += weight * dx * dx
            xy += weight * dx * dy
            yy += weight * dy * dy
            for c in range(channels):
                change = weight * (values[j, i, c] - found[0, c])
                found[1, c] += change * dx
                found[2, c] += change * dy
    if gradient == LSQ:
        size = xx * yy - xy * xy
        usable = count >= FEWEST and size > F(1e-4) * xx * yy
        for c in range(channels):
            a, b = found[1, c], found[2, c]
            found[1, c] = (yy * a - xy * b) / size if usable else F(0.0)
            found[2, c] = (xx * b - xy * a) / size if usable else F(0.0)


@kernel(parallel=True)
def fill_between(length, norm, integrated, samples, limits, found, radiance):
    """Radiance of the pixels that were not integrated: means of what the samples around say of them.

    Args:
        integrated: (H,W) bool. found: from :func:`find_gradients`. radiance: (H W,C), written.
    """
    block, eps, _ = limits
    height, width = length.shape
    channels = radiance.shape[1]
    columns = samples.shape[1]
    for y in prange(height):
        own = np.empty((9, 4), np.int64)
        near = borrowed(own)
        by, row = I64(y) // block, I64(y)
        for x in range(width):
            d = length[y, x]
            if integrated[y, x]:
                continue
            p = row * width + x
            for c in range(channels):
                radiance[p, c] = F(0.0)
            if not d > F(0.0):
                continue
            bx, limit = x // block, eps * d
            count = 0
            for j in range(max(by - 1, 0), min(by + 2, samples.shape[0])):
                for i in range(max(bx - 1, 0), min(bx + 2, columns)):
                    ky, kx = I64(samples[j, i, 0]), I64(samples[j, i, 1])
                    dx, dy = x - kx, row - ky
                    if ky < 0 or abs(dx) > block or abs(dy) > block:
                        continue
                    if abs(length[ky, kx] - d) < limit:
                        near[count, 0], near[count, 1], near[count, 2], near[count, 3] = j, i, dx, dy
                        count += 1
            share = F(1.0) / F(max(count, 1))
            for c in range(channels):
                total, top = F(0.0), F(0.0)
                for n in range(count):
                    j, i = near[n, 0], near[n, 1]
                    value = found[j, i, 0, c]
                    total += value + found[j, i, 1, c] * F(near[n, 2]) + found[j, i, 2, c] * F(near[n, 3])
                    top = max(top, value)
                value = min(max(total * share, F(0.0)), F(2.0) * top)
                radiance[p, c] = value * norm[y, x]
        keep(own)
