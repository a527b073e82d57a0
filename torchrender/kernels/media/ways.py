"""Eye rays of a picture, and how much of each medium lies on them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.media.density import box_span, trilinear, way_through
from torchrender.kernels.media.records import AXIS, BIG, SUN
from torchrender.kernels.voxels.bits import span as block_of

F: Any = np.float32
GROUP = 512


@kernel(inline=True)
def media_span(media, o, d, length):
    """Lengths between which a ray may meet a medium; the first is greater where it meets none."""
    begin, end = F(1.0), F(0.0)
    for m in range(media.low.shape[0]):
        a, b = box_span(media.low[m], media.high[m], o[0], o[1], o[2], d[0], d[1], d[2])
        a, b = max(a, F(0.0)), min(b, length)
        if b > a:
            if end > begin:
                begin, end = min(begin, a), max(end, b)
            else:
                begin, end = a, b
    return begin, end


@kernel(parallel=True)
def eye_rays(media, camera, depth, position, beams):
    """Rays of a perspective camera through all pixels, or to the surfaces that they see.

    Args:
        media: :class:`Media`, relative to the eye.
        camera: (matrix (3,3) float32 from pixels to directions, eye (3,) float64).
        depth: (H,W) camera z, +inf where nothing is seen.
        position: (H,W,3) float64 places of the surfaces, which decide where given; else (0,0,3).
        beams: :class:`Beams` with an origin of zeros; direction and span (H W,...) are written.
    """
    matrix, eye = camera
    height, width = depth.shape
    for row in prange(height):
        fields = borrowed(media)
        origin, direction, span = borrowed(beams)
        for column in range(width):
            i = np.int64(row) * width + column
            u, v = F(column) + F(0.5), F(row) + F(0.5)
            x = matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]
            y = matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]
            z = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]
            seen = depth[row, column] < F(np.inf)
            length = F(BIG)
            if seen and position.shape[0] > 0:
                x = F(position[row, column, 0] - eye[0])
                y = F(position[row, column, 1] - eye[1])
                z = F(position[row, column, 2] - eye[2])
            size = math.sqrt(x * x + y * y + z * z)
            inverse = F(1.0) / max(size, F(1e-30))
            if seen:
                length = size if position.shape[0] > 0 else size * depth[row, column]
            direction[i, 0], direction[i, 1], direction[i, 2] = x * inverse, y * inverse, z * inverse
            span[i, 0], span[i, 1] = media_span(fields, origin[0], direction[i], length)


@kernel(parallel=True)
def clip_rays(media, beams, lengths):
    """Spans of rays with these lengths (N,) between which they may meet a medium."""
    count = len(lengths)
    for group in prange((count + GROUP - 1) // GROUP):
        fields = borrowed(media)
        origin, direction, span = borrowed(beams)
        begin, end = block_of(group, GROUP, count)
        for i in range(begin, end):
            k = i if len(origin) > 1 else 0
            span[i, 0], span[i, 1] = media_span(fields, origin[k], direction[i], lengths[i])


@kernel(parallel=True)
def ways_through(media, beams, steps, ways):
    """Integrals of the densities along rays, ``ways`` (N,M) float32; through grids in ``steps`` steps."""
    count, boxes = ways.shape
    for group in prange((count + GROUP - 1) // GROUP):
        fields, out = borrowed(media), borrowed(ways)
        origin, direction, span = borrowed(beams)
        begin, end = block_of(group, GROUP, count)
        for i in range(begin, end):
            k = i if len(origin) > 1 else 0
            o, d, enter = origin[k], direction[i], span[i, 0]
            for m in range(boxes):
                out[i, m] = F(0.0)
                if span[i, 1] > enter:
                    x, y, z = o[0] + d[0] * enter, o[1] + d[1] * enter, o[2] + d[2] * enter
                    out[i, m] = way_through(fields, m, (x, y, z), d, span[i, 1] - enter, steps)


@kernel(parallel=True)
def light_means(media, m, kind, light, steps, means):
    """Mean densities of a grid on the ways from its cells to a light, of what of these lies in its box.

    Args:
        m: medium, of kind GRID. means: (D,H,W) float32 cells of any number over the same box, written.
    """
    rows = means.shape[0] * means.shape[1]
    for row in prange(rows):
        fields, out, lamp = borrowed(media), borrowed(means), borrowed(light)
        k, j = np.int64(row // out.shape[1]), np.int64(row % out.shape[1])
        low, high = fields.low[m], fields.high[m]
        for i in range(out.shape[2]):
            x = low[0] + (F(i) + F(0.5)) / F(out.shape[2]) * (high[0] - low[0])
            y = low[1] + (F(j) + F(0.5)) / F(out.shape[1]) * (high[1] - low[1])
            z = low[2] + (F(k) + F(0.5)) / F(out.shape[0]) * (high[2] - low[2])
            if kind == SUN:
                wx, wy, wz, length = -lamp[AXIS], -lamp[AXIS + 1], -lamp[AXIS + 2], F(BIG)
            else:
                wx, wy, wz = lamp[0] - x, lamp[1] - y, lamp[2] - z
                length = math.sqrt(wx * wx + wy * wy + wz * wz)
                inverse = F(1.0) / max(length, F(1e-20))
                wx, wy, wz = wx * inverse, wy * inverse, wz * inverse
            _, end = box_span(low, high, x, y, z, wx, wy, wz)
            step = max(min(end, length), F(0.0)) / F(steps)
            total = F(0.0)
            for s in range(steps):
                t = (F(s) + F(0.5)) * step
                total += trilinear(fields.cells, fields.dims[m], low, high, x + wx * t, y + wy * t, z + wz * t)
            out[k, j, i] = total / F(steps)
