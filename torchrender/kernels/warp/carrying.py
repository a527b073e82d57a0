"""Light of a picture for another view of the same scene."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

STEPS = 6
CLOSE = 0.6
"""Pixels: nearer than that, the pixel beside is no better guess."""


@kernel(inline=True)
def _projected(matrix, u, v, z):
    """Pixel coordinates of a pixel of depth ``z`` in another camera, and the depth there; infinitely far ones by their
    direction. Without a depth ahead of that camera the coordinates mean nothing.

    ``matrix``: (3,4), homogeneous pixel = z M[:, :3] (u, v, 1) + M[:, 3].
    """
    near, shift = (z, 1.0) if z < np.inf else (1.0, 0.0)
    w = near * (matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]) + shift * matrix[2, 3]
    scale = w if w > 0.0 else 1.0
    x = near * (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) + shift * matrix[0, 3]
    y = near * (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) + shift * matrix[1, 3]
    return x / scale, y / scale, w


@kernel(parallel=True)
def carry_surfaces(seen, source, light, materials, matrix, limits, known, out):
    """Look up what every pixel shows in the picture of another camera; ``known`` pixels stay as they are.

    Args:
        seen, source: (depth, triangle, owner) of the view (H,W) and of the other picture (h,w); triangle -1: nothing.
            Pixels of different owners have nothing to do with each other.
        light: (h,w,3) of the other picture, leave out what mirrors show.
        materials: (F,) by triangle. Pixels of one owner and material are of one surface.
        matrix: (3,4), homogeneous pixel of the other camera = z M[:, :3] (u, v, 1) + M[:, 3].
        limits: same, least. The four pixels around a place count by their bilinear weights. A difference d of inverse
            depth, as a share of the larger one, weighs ``exp(-(d / same)^2)`` among pixels of one surface, 1 on one
            triangle; where the four weigh less than ``least`` in all, nothing is carried.
        known: (H,W) set where light was found.
        out: (H,W,3) the light.
    """
    depth, triangle, owner = seen
    other_depth, other_triangle, other_owner = source
    same, least = limits
    height, width = depth.shape
    rows, columns = other_depth.shape
    for j in prange(height):
        for i in range(width):
            if known[j, i]:
                continue
            face = triangle[j, i]
            x, y, w = _projected(matrix, i + 0.5, j + 0.5, depth[j, i] if face >= 0 else np.inf)
            if w <= 0.0:
                continue
            x, y = x - 0.5, y - 0.5
            if not (-0.5 <= x <= columns - 0.5 and -0.5 <= y <= rows - 0.5):
                continue
            left, top = math.floor(x), math.floor(y)
            material = materials[face] if face >= 0 else -1
            red, green, blue, total = 0.0, 0.0, 0.0, 0.0
            for row in range(max(top, 0), min(top + 2, rows)):
                for column in range(max(left, 0), min(left + 2, columns)):
                    if other_owner[row, column] != owner[j, i]:
                        continue
                    found = other_triangle[row, column]
                    weight = (1.0 - abs(x - column)) * (1.0 - abs(y - row))
                    if found != face:
                        if found < 0 or face < 0 or materials[found] != material:
                            continue
                        inverse = 1.0 / other_depth[row, column]
                        apart = abs(1.0 / w - inverse) / max(1.0 / w, inverse)
                        weight *= math.exp(-((apart / same) ** 2))
                    red += weight * light[row, column, 0]
                    green += weight * light[row, column, 1]
                    blue += weight * light[row, column, 2]
                    total += weight
            if total >= least:
                out[j, i, 0] = np.float32(red / total)
                out[j, i, 1] = np.float32(green / total)
                out[j, i, 2] = np.float32(blue / total)
                known[j, i] = True


@kernel(parallel=True)
def carry_mirrors(seen, source, mirror, matrix, back, reach, wanted, out):
    """Look up what mirrors show in the picture of another camera, where it seems to be.

    The place of a pixel's virtual point in the other picture is found by steps: from the place of the mirror's own
    point there, by as much as the virtual point found last is off in the view.

    Args:
        seen: (depth, triangle, object) of the view (H,W).
        source: object (h,w) of the other picture.
        mirror: (depth of the virtual points, light (h,w,3), known) of the other picture's mirrors (h,w).
        matrix: (3,4) as :func:`carry_surfaces` has it. back: the other way, from pixel and depth of the other camera.
        reach: pixels of the view by which the best virtual point that was met may be off.
        wanted: (H,W) pixels to look for.
        out: (depth (H,W) of the virtual points in the view, light (H,W,3), state (H,W) uint8: 0 what is there does not
            mirror, 1 light of a virtual point, 2 none was found and the light is that of the mirror's own point).
    """
    depth, triangle, owner = seen
    virtual, light, mirrors = mirror
    virtual_depth, mirrored, state = out
    height, width = depth.shape
    rows, columns = virtual.shape
    for j in prange(height):
        for i in range(width):
            if not wanted[j, i] or triangle[j, i] < 0:
                continue
            u, v, z = i + 0.5, j + 0.5, depth[j, i]
            x, y, w = _projected(matrix, u, v, z)
            if w <= 0.0:
                continue
            row, column = _nearest(x - 0.5, y - 0.5, source, owner[j, i], mirrors)
            if row < 0:
                continue
            state[j, i] = 2
            for k in range(3):
                mirrored[j, i, k] = light[row, column, k]
            virtual_depth[j, i] = np.float32(z)
            best = reach
            for _ in range(STEPS):
                far = virtual[row, column]
                ou, ov = column + 0.5, row + 0.5
                du, dv, ahead = _projected(back, ou, ov, far)
                if ahead <= 0.0:
                    break
                du, dv = u - du, v - dv
                error = max(abs(du), abs(dv))
                if error < best:
                    best = error
                    x, y = min(max(du, -1.0), 1.0) + ou - 0.5, min(max(dv, -1.0), 1.0) + ov - 0.5
                    _take((x, y), (source, mirrors, light), owner[j, i], mirrored[j, i])
                    virtual_depth[j, i] = np.float32(ahead) if far < np.inf else np.float32(np.inf)
                    state[j, i] = 1
                if error < CLOSE:
                    break
                row, column = math.floor(ov + dv), math.floor(ou + du)
                if not (0 <= row < rows and 0 <= column < columns):
                    break
                if not mirrors[row, column] or source[row, column] != owner[j, i]:
                    break


@kernel()
def _nearest(x, y, source, own, mirrors):
    """Of the four pixels around a place the nearest that mirrors and is of an object: its row and column, else -1."""
    rows, columns = mirrors.shape
    left, top = math.floor(x), math.floor(y)
    most, found_row, found_column = -1.0, -1, -1
    for row in range(max(top, 0), min(top + 2, rows)):
        for column in range(max(left, 0), min(left + 2, columns)):
            weight = (1.0 - abs(x - column)) * (1.0 - abs(y - row))
            if weight > most and mirrors[row, column] and source[row, column] == own:
                most, found_row, found_column = weight, row, column
    return found_row, found_column


@kernel()
def _take(place, picture, own, mirrored):
    """Bilinear light of the mirror around a place; there is at least one pixel of it."""
    x, y = place
    source, mirrors, light = picture
    rows, columns = mirrors.shape
    left, top = math.floor(x), math.floor(y)
    red, green, blue, total = 0.0, 0.0, 0.0, 0.0
    for row in range(max(top, 0), min(top + 2, rows)):
        for column in range(max(left, 0), min(left + 2, columns)):
            if mirrors[row, column] and source[row, column] == own:
                weight = (1.0 - abs(x - column)) * (1.0 - abs(y - row)) + 1e-9
                red += weight * light[row, column, 0]
                green += weight * light[row, column, 1]
                blue += weight * light[row, column, 2]
                total += weight
    if total > 0.0:
        mirrored[0] = np.float32(red / total)
        mirrored[1] = np.float32(green / total)
        mirrored[2] = np.float32(blue / total)
