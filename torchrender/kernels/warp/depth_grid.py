"""Which triangles between neighbouring pixel centres lie on one surface."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.warp.corners import ALONE, DIAGONAL, EDGE_ON, FIRST, SECOND


@kernel()
def on_plane(plane, z, du, dv, other, limits):
    """The test of section 3.2: does depth ``other``, at (du, dv) pixels from a sample, lie on the sample's plane?

    ``plane`` = its product with the ray at the sample's own pixel, and its steps right and down.
    """
    here, right, down = plane
    slope = here + right * du + down * dv
    target = z
    if abs(slope) >= EDGE_ON:
        predicted = z * here / slope
        if predicted > 0.0 and predicted < np.inf:
            target = predicted
    return abs(other - target) <= limits[0] * z + limits[1] * abs(target - z)


@kernel()
def joined_pair(a, b, depths, planes, limits):
    """Both samples of a block see the other one on their plane; corners count as in ``corners``."""
    du = (1.0 if b >= 2 else 0.0) - (1.0 if a >= 2 else 0.0)
    dv = (1.0 if b == 1 or b == 2 else 0.0) - (1.0 if a == 1 or a == 2 else 0.0)
    forth = on_plane((planes[a, 0], planes[a, 1], planes[a, 2]), depths[a], du, dv, depths[b], limits)
    return forth and on_plane((planes[b, 0], planes[b, 1], planes[b, 2]), depths[b], -du, -dv, depths[a], limits)


@kernel()
def load_block(depth, normal, matrix, j, i, depths, planes):
    for k in range(4):
        y = j + (1 if k == 1 or k == 2 else 0)
        x = i + (1 if k >= 2 else 0)
        nx, ny, nz = np.float64(normal[y, x, 0]), np.float64(normal[y, x, 1]), np.float64(normal[y, x, 2])
        right = matrix[0, 0] * nx + matrix[0, 1] * ny + matrix[0, 2] * nz
        down = matrix[1, 0] * nx + matrix[1, 1] * ny + matrix[1, 2] * nz
        base = matrix[2, 0] * nx + matrix[2, 1] * ny + matrix[2, 2] * nz
        depths[k] = depth[y, x]
        planes[k, 0] = base + right * (x + 0.5) + down * (y + 0.5)
        planes[k, 1], planes[k, 2] = right, down


@kernel()
def block_shape(depths, linked, adaptive):
    """Shape bits of a block from the six links between its samples, linked[a, b] with a < b."""
    best = 0
    flatter = abs(depths[1] - depths[3]) < abs(depths[0] - depths[2])
    for turn in range(2 if adaptive else 1):
        diagonal = (turn == 1) != (adaptive and flatter)
        if diagonal:  # triangles 1 2 3 and 3 0 1, both along 1-3
            first = linked[1, 2] and linked[2, 3] and linked[1, 3]
            second = linked[0, 3] and linked[0, 1] and linked[1, 3]
        else:
            first = linked[0, 1] and linked[1, 2] and linked[0, 2]
            second = linked[2, 3] and linked[0, 3] and linked[0, 2]
        bits = (FIRST if first else 0) | (SECOND if second else 0)
        if first and second:
            return bits | (DIAGONAL if diagonal else 0)
        if bits != 0 and best == 0:
            best = bits | (DIAGONAL if diagonal else 0)
    return best


@kernel()
def word_of(bits):
    """``joined`` of the corner inside a block: pixel k of the block is the one whose own corner (k + 2) % 4 this is."""
    if bits & FIRST and bits & SECOND:
        return np.int32(1 << 8)
    if bits == 0:
        return np.int32(ALONE)
    missing = 3 if bits & FIRST else 1  # pixel of the block that is not in the triangle
    if bits & DIAGONAL:
        missing = 0 if bits & FIRST else 2
    apart = (missing + 2) % 4
    low = 1 if apart == 0 else 0
    word = apart << (2 * apart)
    for k in range(4):
        if k != apart:
            word |= low << (2 * k)
    return np.int32(word | 1 << (8 + low))


@kernel(parallel=True)
def fit_blocks(images, matrices, limits, adaptive, corners, shape, joined):
    """Corner depths (B,H-1,4,W-1), shape and ``joined`` of the quads between pixel centres; see ``corners.fit``."""
    depth, normal, ids = images
    count, rows, columns = shape.shape
    match = ids.shape[1] > 0
    for n in prange(count * rows):
        b, j = np.int64(n) // rows, np.int64(n) % rows
        depths, planes = np.zeros(4), np.zeros((4, 3))
        linked = np.zeros((4, 4), np.bool_)
        limit = (limits[b, 0], limits[b, 1])
        for i in range(columns):
            load_block(depth[b], normal[b], matrices[b], j, i, depths, planes)
            for k in range(4):
                for other in range(k + 1, 4):
                    linked[k, other] = False
                    if depths[k] < np.inf and depths[other] < np.inf:
                        same = True
                        if match:
                            own = ids[b, j + (1 if k in (1, 2) else 0), i + (1 if k >= 2 else 0)]
                            same = own == ids[b, j + (1 if other in (1, 2) else 0), i + (1 if other >= 2 else 0)]
                        linked[k, other] = same and joined_pair(k, other, depths, planes, limit)
            bits = block_shape(depths, linked, adaptive)
            shape[b, j, i] = bits
            joined[b, j + 1, i + 1] = word_of(bits)
            for k in range(4):
                corners[b, j, k, i] = depths[k]
