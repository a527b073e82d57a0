"""Pictures with one sample a pixel as smooth as the mean of several: at outlines, and within objects."""

from __future__ import annotations

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SHORTEST = 0.75
"""Pixels that a triangle must span for its end to be an outline's: smaller ones go on in others."""


@kernel(inline=True)
def _corner(vertices, row, matrix):
    """A vertex in pixels, and its depth."""
    x, y, z = vertices[row, 0], vertices[row, 1], vertices[row, 2]
    w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
    scale = w if w > 0.0 else 1.0
    u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / scale
    v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / scale
    return u, v, w


@kernel()
def _end(vertices, corners, matrix, x, y, dx, dy):
    """Share of the way (dx, dy) from a place in a triangle at which the triangle ends; 0.5 where that tells nothing."""
    au, av, aw = _corner(vertices, corners[0], matrix)
    bu, bv, bw = _corner(vertices, corners[1], matrix)
    cu, cv, cw = _corner(vertices, corners[2], matrix)
    if aw <= 0.0 or bw <= 0.0 or cw <= 0.0:
        return 0.5
    turn = 1.0 if (bu - au) * (cv - av) - (bv - av) * (cu - au) >= 0.0 else -1.0
    enters, leaves = -np.inf, np.inf
    for fu, fv, tu, tv in ((au, av, bu, bv), (bu, bv, cu, cv), (cu, cv, au, av)):
        here = max(0.0, turn * ((tu - fu) * (y - fv) - (tv - fv) * (x - fu)))
        change = turn * ((tu - fu) * dy - (tv - fv) * dx)
        if change < 0.0:
            leaves = min(leaves, here / -change)
        elif change > 0.0:
            enters = max(enters, -here / change)
    if leaves > 1.0 or leaves - enters < SHORTEST:
        return 0.5
    return leaves


@kernel(parallel=True)
def blend_outlines(seen, mesh, matrix, light, out):
    """Where another object stands beside a pixel, the light of both by how far the nearer triangle reaches.

    Args:
        seen: (depth, triangle, object) (H,W); triangle -1: nothing, infinitely far.
        mesh: (vertices (V,3) float64, faces (F,3)).
        matrix: (3,4), homogeneous pixel = matrix (vertex, 1).
        light: (H,W,3). out: (H,W,3). Of the four neighbours the one that reaches in most counts.
    """
    depth, triangle, owner = seen
    vertices, faces = mesh
    height, width = depth.shape
    for j in prange(height):
        for i in range(width):
            most, down, aside = 0.0, 0, 0
            for dj, di in ((0, 1), (0, -1), (1, 0), (-1, 0)):
                r, c = j + dj, i + di
                if r < 0 or c < 0 or r >= height or c >= width or owner[r, c] == owner[j, i]:
                    continue
                if depth[j, i] <= depth[r, c]:
                    if triangle[j, i] < 0:
                        continue
                    share = 0.5 - _end(vertices, faces[triangle[j, i]], matrix, i + 0.5, j + 0.5, di, dj)
                else:
                    share = _end(vertices, faces[triangle[r, c]], matrix, c + 0.5, r + 0.5, -di, -dj) - 0.5
                if share > most:
                    most, down, aside = share, dj, di
            for k in range(3):
                own, other = light[j, i, k], light[j + down, i + aside, k]
                out[j, i, k] = np.float32(own + most * (other - own))


@kernel(parallel=True)
def weigh_neighbours(owner, weights, light, out):
    """Of each pixel the weighted light of those around it that are of its own object.

    Args:
        owner: (H,W) object; -1: nothing.
        weights: (3,3) float32, sum 1; that of what is beyond the picture, or of another object, is the pixel's own.
        light: (H,W,3). out: (H,W,3).
    """
    height, width = owner.shape
    for j in prange(height):
        for i in range(width):
            own = owner[j, i]
            red, green, blue = light[j, i, 0], light[j, i, 1], light[j, i, 2]
            first, second, third = red, green, blue
            for dj in range(-1, 2):
                r = j + dj
                if r < 0 or r >= height:
                    continue
                for di in range(-1, 2):
                    c = i + di
                    if c < 0 or c >= width or owner[r, c] != own:
                        continue
                    weight = weights[dj + 1, di + 1]
                    first += weight * (light[r, c, 0] - red)
                    second += weight * (light[r, c, 1] - green)
                    third += weight * (light[r, c, 2] - blue)
            out[j, i, 0], out[j, i, 1], out[j, i, 2] = first, second, third
