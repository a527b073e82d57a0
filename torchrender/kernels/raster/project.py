"""Vertices into the image: homogeneous pixel coordinates, snapped positions, and the clusters that are in view."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SUBPIXEL_BITS = 15
SUBPIXEL = 1 << SUBPIXEL_BITS
GUARD = 1 << 14  # pixels around the image centre; with the bits above every edge function stays below 2**62
BLOCK = 256  # vertices projected or skipped together

NEEDS_CLIP = np.int64(-(2**63))  # in place of a snapped position: before the near plane or outside the guard band


@kernel(inline=True)
def snap(x, y):
    """Both fixed-point coordinates in one 64-bit integer."""
    return (np.int64(np.floor(x * SUBPIXEL + 0.5)) << 32) | (
        np.int64(np.floor(y * SUBPIXEL + 0.5)) & np.int64(0xFFFFFFFF)
    )


@kernel(inline=True)
def snapped_x(packed):
    return packed >> 32


@kernel(inline=True)
def snapped_y(packed):
    return (packed << 32) >> 32


@kernel()
def visible_clusters(bounds, planes):
    """Clusters whose box (C,2,3) meets the frustum given by planes (6,4): indices, and distance to the near plane."""
    count = bounds.shape[0]
    out = np.zeros(count, np.int64)
    distance = np.zeros(count)
    n = 0
    for c in range(count):
        inside = True
        for p in range(planes.shape[0]):
            reach = planes[p, 3]
            size = abs(planes[p, 3])
            for k in range(3):
                side = bounds[c, 1, k] if planes[p, k] > 0 else bounds[c, 0, k]
                reach += planes[p, k] * side
                size += abs(planes[p, k] * side)
            if reach < -1e-12 * size:
                inside = False
                break
        if inside:
            out[n] = c
            distance[n] = planes[4, 3]
            for k in range(3):
                side = bounds[c, 0, k] if planes[4, k] > 0 else bounds[c, 1, k]
                distance[n] += planes[4, k] * side
            n += 1
    return out[:n], distance[:n]


@kernel()
def needed_blocks(chosen, starts, blocks, vertex_count):
    """Indices of the blocks of BLOCK vertices that the chosen clusters use; starts (C+1,) into blocks."""
    wanted = np.zeros((vertex_count + BLOCK - 1) // BLOCK, np.bool_)
    for c in chosen:
        for place in range(starts[c], starts[c + 1]):
            wanted[blocks[place]] = True
    return np.nonzero(wanted)[0]


@kernel(inline=True)
def project_block(vertices, block, matrix, eye, limits, out, packed):
    """One block of :func:`project_vertices`; ``limits``: near, whether orthographic."""
    near, orthographic = limits
    for v in range(block * BLOCK, min((block + 1) * BLOCK, vertices.shape[0])):
        x = vertices[v, 0] - eye[0]
        y = vertices[v, 1] - eye[1]
        z = vertices[v, 2] - eye[2]
        px = matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z
        py = matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z
        out[v, 0] = px
        out[v, 1] = py
        out[v, 2] = w
        if not w >= near:
            packed[v, 3] = NEEDS_CLIP
            continue
        if not orthographic:
            px /= w
            py /= w
        if abs(px) < GUARD and abs(py) < GUARD:
            packed[v, 3] = snap(px, py)
        else:
            packed[v, 3] = NEEDS_CLIP


@kernel(parallel=True)
def project_vertices(vertices, blocks, matrix, eye, near, orthographic, out, packed):
    """Fill ``out`` (V,4) and its integer twin ``packed`` (the same memory) for the wanted blocks.

    ``matrix`` (3,3) takes a world vector from ``eye`` to (X, Y, z): perspective pixel = X/z, Y/z; orthographic
    pixel = X, Y. Pixels count from the image centre. Column 3 holds the snapped pixel position.
    """
    for b in prange(blocks.shape[0]):
        project_block(vertices, blocks[b], matrix, eye, (near, orthographic), out, packed)
