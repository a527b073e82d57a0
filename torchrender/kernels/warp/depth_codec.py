"""Depth as streams carry it: inverse depth in whole codes, each less what its neighbours let expect.

Planes are linear in inverse depth, so ``left + up - upper left`` predicts them almost perfectly and most residuals are
-1, 0 or 1; zigzag order and separate planes of low and high bytes then let a byte compressor see long runs.
"""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel


@kernel()
def encode_planes(depth, near, levels, planes):
    """Byte planes (2,H,W) of depth (H,W), and whether a surface was so far that its code 0 had to become 1."""
    height, width = depth.shape
    above = np.zeros(width + 1, np.int32)
    lifted = False
    scale = near * levels
    for j in range(height):
        left, corner = 0, 0
        for i in range(width):
            z = depth[j, i]
            code = 0
            if z < np.inf:
                code = int(scale / z + 0.5)
                if code < 1:
                    code, lifted = 1, True
            up = above[i]
            # Modulo 2^16, read as a signed number.
            residual = np.int32(np.int16(code - left - up + corner))
            word = (residual << 1) ^ (residual >> 31)
            planes[0, j, i] = word & 255
            planes[1, j, i] = (word >> 8) & 255
            above[i] = code
            left, corner = code, up
    return lifted


@kernel()
def decode_planes(planes, near, levels, codes, depth):
    """Inverse of :func:`encode_planes`: codes (H,W) uint16 and depth (H,W), +inf where the code is 0."""
    height, width = codes.shape
    for j in range(height):
        left, corner = 0, 0
        for i in range(width):
            word = int(planes[0, j, i]) | (int(planes[1, j, i]) << 8)
            residual = (word >> 1) ^ -(word & 1)
            up = int(codes[j - 1, i]) if j > 0 else 0
            code = (left + up - corner + residual) & 0xFFFF
            codes[j, i] = code
            depth[j, i] = near * levels / code if code > 0 else np.inf
            left, corner = code, up


@kernel()
def display_codes(radiance, gain, table, codes):
    """8-bit sRGB codes (N,) of linear light (N,) times ``gain``, clamped to [0,1], by a table over [0,1]."""
    last = len(table) - 1
    for k in range(len(radiance)):
        value = radiance[k] * gain
        if not value > 0.0:
            codes[k] = table[0]
        elif value >= 1.0:
            codes[k] = table[last]
        else:
            codes[k] = table[int(value * last + 0.5)]


@kernel()
def fill_blocks(codes, known, size):
    """Give pixels of (H,W,3) that are not ``known`` the mean of the known ones in their block of ``size`` pixels.

    A block without any continues the block before it. What a lossy picture holds there is never shown, but blocks of
    one colour take no room, and sharp edges would reach into what is shown.
    """
    height, width = known.shape
    mean = np.zeros(3, np.int64)
    for top in range(0, height, size):
        for left in range(0, width, size):
            bottom, right = min(top + size, height), min(left + size, width)
            total, count = np.zeros(3, np.int64), 0
            for j in range(top, bottom):
                for i in range(left, right):
                    if known[j, i]:
                        count += 1
                        for c in range(3):
                            total[c] += codes[j, i, c]
            if count == (bottom - top) * (right - left):
                continue
            if count > 0:
                for c in range(3):
                    mean[c] = total[c] // count
            for j in range(top, bottom):
                for i in range(left, right):
                    if not known[j, i]:
                        for c in range(3):
                            codes[j, i, c] = mean[c]
