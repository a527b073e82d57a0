"""Depth as streams carry it: inverse depth in whole codes, each less what its neighbours let expect.

Planes are linear in inverse depth, so ``left + up - upper left`` predicts them almost perfectly and most residuals are
-1, 0 or 1; zigzag order and separate planes of low and high bytes then let a byte compressor see long runs.
"""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

_ZERO, _HALF, _ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)
_KNEE, _SLOPE = np.float32(0.0031308), np.float32(255.0 * 12.92)
"""Of the sRGB transfer function (IEC 61966-2-1): below it the curve is a line."""
_C0, _C1, _C2 = np.float32(-15.67825051), np.float32(41.69135078), np.float32(318.69389341)
_C3, _C4, _C5 = np.float32(-144.68387342), np.float32(71.64761896), np.float32(-16.67206247)
"""Of a Chebyshev fit to ``255 (1.055 t^(5/3) - 0.055)``, where t is the fourth root of linear light above the knee."""


@kernel()
def encode_planes(depth, near, levels, planes):
    """Byte planes (2,H,W) of depth (H,W), and whether a surface was so far that its code 0 had to become 1.

    A row of codes comes first, then what it differs by from what is expected: neither loop needs what it has just made,
    so that both run on several pixels at once.
    """
    height, width = depth.shape
    above, row = np.zeros(width + 1, np.int32), np.zeros(width + 1, np.int32)  # element 0 is left of the picture
    lifted = 0
    scale = near * levels
    for j in range(height):
        for i in range(width):
            z = depth[j, i]
            code = np.int32(scale / z + 0.5)
            far = (z < np.inf) & (code < 1)
            lifted += far
            row[i + 1] = 1 if far else code
        for i in range(width):
            # Modulo 2^16, read as a signed number.
            residual = np.int32(np.int16(row[i + 1] - row[i] - above[i + 1] + above[i]))
            word = (residual << 1) ^ (residual >> 31)
            planes[0, j, i] = word & 255
            planes[1, j, i] = (word >> 8) & 255
        above, row = row, above
    return lifted > 0


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
def display_codes(radiance, gain, codes):
    """8-bit sRGB codes (N,) of linear light (N,) float32 times ``gain``, clamped to [0,1]; NaN is black.

    The power of the transfer function is a polynomial in the fourth root, off by 0.002 of a code at most: unlike a
    table it is computed for several values at once.
    """
    factor = np.float32(gain)
    for k in range(len(radiance)):
        value = radiance[k] * factor
        value = value if value > _ZERO else _ZERO
        value = value if value < _ONE else _ONE
        root = np.sqrt(np.sqrt(value))
        curve = ((((_C5 * root + _C4) * root + _C3) * root + _C2) * root + _C1) * root + _C0
        codes[k] = np.uint8((curve if value > _KNEE else value * _SLOPE) + _HALF)


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
