"""Where on a mirror a reflected point is seen from a moved eye: best-match search over the pixels of a key frame.

A candidate pixel with point W and normal n reflects the point P along ``u = reflect((W - P) / |W - P|, n)``; its
residual is what of ``E - W`` stands at right angles to u, and is zero exactly where the law of reflection holds for the
eye E. Specification 04, section 5 (stable form, feasibility, local search, acceptance) and 14.1 (refinement).

``surface`` (H,W,8) float32 holds per pixel the point relative to the key frame's eye, the normal, the footprint and the
depth; ``ids`` (H,W) int32 the reflector, -1 elsewhere. All arithmetic is float64.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

VALID, BORDER, SILHOUETTE, RATIO, STEPS = 0, 1, 2, 3, 4
"""Causes why a pixel has no match; see ``match``."""

BLOCK = 64  # pixels handed to a thread at once
_NEIGHBOURS = 3  # feasible ones that a minimum needs around it
_FARTHEST = 1.0  # pixels by which refinement may move a match


@kernel(inline=True)
def residual(surface, y, x, point, endless, eye):
    """Residual (3,), its scale to lengths on the mirror, and 0 for feasible, 1 for contact, 2 for infeasible.

    ``point``: reflected point relative to the key eye; if ``endless``, the unit direction towards it.
    """
    wx, wy, wz = np.float64(surface[y, x, 0]), np.float64(surface[y, x, 1]), np.float64(surface[y, x, 2])
    nx, ny, nz = np.float64(surface[y, x, 3]), np.float64(surface[y, x, 4]), np.float64(surface[y, x, 5])
    ex, ey, ez = eye[0] - wx, eye[1] - wy, eye[2] - wz
    if ex * nx + ey * ny + ez * nz <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 2
    if endless:
        tx, ty, tz = point[0], point[1], point[2]
        length = np.inf
    else:
        tx, ty, tz = point[0] - wx, point[1] - wy, point[2] - wz
        length = math.sqrt(tx * tx + ty * ty + tz * tz)
        if length < 0.5 * np.float64(surface[y, x, 6]):
            return 0.0, 0.0, 0.0, 0.0, 1
        tx, ty, tz = tx / length, ty / length, tz / length
    rise = tx * nx + ty * ny + tz * nz
    if rise <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 2
    ux, uy, uz = 2.0 * rise * nx - tx, 2.0 * rise * ny - ty, 2.0 * rise * nz - tz
    along = ex * ux + ey * uy + ez * uz
    scale = 1.0
    if not endless:
        reach = math.sqrt(ex * ex + ey * ey + ez * ez)
        scale = length / (reach + length)
    return ex - along * ux, ey - along * uy, ez - along * uz, scale, 0


@kernel(inline=True)
def distance(surface, ids, y, x, own, point, endless, eye):
    """d(s, s_n) of section 5: 0 at contact, +inf off the reflector and where infeasible."""
    if y < 0 or x < 0 or y >= ids.shape[0] or x >= ids.shape[1]:
        return np.inf
    if ids[y, x] != own:
        return np.inf
    a, b, c, _, state = residual(surface, y, x, point, endless, eye)
    if state == 2:
        return np.inf
    return math.sqrt(a * a + b * b + c * c)


@kernel(inline=True)
def slope(surface, ids, y, x, dy, dx, here, own, point, endless, eye):
    """Change of the scaled residual per pixel along (dy, dx), from both neighbours or one; False without any."""
    forth = (0.0, 0.0, 0.0)
    back = (0.0, 0.0, 0.0)
    ahead, behind = False, False
    if 0 <= y + dy < ids.shape[0] and 0 <= x + dx < ids.shape[1] and ids[y + dy, x + dx] == own:
        a, b, c, s, state = residual(surface, y + dy, x + dx, point, endless, eye)
        ahead = state == 0
        forth = (a * s, b * s, c * s)
    if 0 <= y - dy < ids.shape[0] and 0 <= x - dx < ids.shape[1] and ids[y - dy, x - dx] == own:
        a, b, c, s, state = residual(surface, y - dy, x - dx, point, endless, eye)
        behind = state == 0
        back = (a * s, b * s, c * s)
    if ahead and behind:
        return 0.5 * (forth[0] - back[0]), 0.5 * (forth[1] - back[1]), 0.5 * (forth[2] - back[2]), True
    if ahead:
        return forth[0] - here[0], forth[1] - here[1], forth[2] - here[2], True
    if behind:
        return here[0] - back[0], here[1] - back[1], here[2] - back[2], True
    return 0.0, 0.0, 0.0, False


@kernel()
def refine(surface, ids, y, x, own, point, endless, eye):
    """One Gauss-Newton step from pixel (y, x): offset (dy, dx) and whether it stays within a pixel."""
    a, b, c, s, state = residual(surface, y, x, point, endless, eye)
    if state != 0:
        return 0.0, 0.0, True
    here = (a * s, b * s, c * s)
    ax, bx, cx, across = slope(surface, ids, y, x, 0, 1, here, own, point, endless, eye)
    ay, by, cy, down = slope(surface, ids, y, x, 1, 0, here, own, point, endless, eye)
    if not (across and down):
        return 0.0, 0.0, True
    xx, xy, yy = ax * ax + bx * bx + cx * cx, ax * ay + bx * by + cx * cy, ay * ay + by * by + cy * cy
    gx, gy = ax * here[0] + bx * here[1] + cx * here[2], ay * here[0] + by * here[1] + cy * here[2]
    determinant = xx * yy - xy * xy
    if not determinant > 1e-12 * xx * yy:
        return 0.0, 0.0, False
    dx, dy = (xy * gy - yy * gx) / determinant, (xy * gx - xx * gy) / determinant
    return dy, dx, abs(dx) <= _FARTHEST and abs(dy) <= _FARTHEST


@kernel()
def walk(surface, ids, y, x, own, point, endless, eye, max_steps):
    """Pixel and distance where the walk over the 8 neighbours ends, and its steps; ``max_steps + 1`` if cut off."""
    best = distance(surface, ids, y, x, own, point, endless, eye)
    steps = 0
    while True:
        ny, nx, least = y, x, best
        for dy in range(-1, 2):
            for dx in range(-1, 2):
                if dy != 0 or dx != 0:
                    d = distance(surface, ids, y + dy, x + dx, own, point, endless, eye)
                    if d < least:
                        ny, nx, least = y + dy, x + dx, d
        if not least < best:
            return y, x, best, steps
        if steps == max_steps:
            return y, x, best, steps + 1
        y, x, best = ny, nx, least
        steps += 1


@kernel()
def verdict(surface, ids, y, x, best, own, point, endless, eye, ratio):
    """VALID or why the end of a walk is no match: no true minimum, beside the border, beside another surface."""
    total, count, edge, rim = 0.0, 0, False, False
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if dy == 0 and dx == 0:
                continue
            if y + dy < 0 or x + dx < 0 or y + dy >= ids.shape[0] or x + dx >= ids.shape[1]:
                edge = True
                continue
            if ids[y + dy, x + dx] != own:
                rim = True
                continue
            d = distance(surface, ids, y + dy, x + dx, own, point, endless, eye)
            if d < np.inf:
                total += d
                count += 1
    if best < np.inf and count >= _NEIGHBOURS and (ratio >= 1.0 or best * count <= ratio * total):
        return VALID
    return BORDER if edge else (SILHOUETTE if rim else RATIO)


@kernel(parallel=True)
def match(surface, ids, reached, pixels, eye, start, options, end, offset, cause, steps):
    """The match of each of N key pixels for an eye relative to the key eye.

    reached (H,W,4) float32 reflected point relative to the key eye and 1, or unit direction and 0; pixels (N,) int64
    flat; start (N,2) int32 pixels (dy, dx) to begin at; options (max_steps, ratio, refined). Fills end (N,2) int32,
    offset (N,2) float32 (dy, dx, with the refinement), cause (N,) uint8 and steps (N,) int32.
    """
    width = ids.shape[1]
    max_steps, ratio, refined = options
    count = len(pixels)
    for block in prange((count + BLOCK - 1) // BLOCK):
        first = np.int64(block) * BLOCK
        for k in range(first, min(first + BLOCK, count)):
            y0, x0 = pixels[k] // width, pixels[k] % width
            own = ids[y0, x0]
            far = reached[y0, x0]
            point = (np.float64(far[0]), np.float64(far[1]), np.float64(far[2]))
            endless = far[3] == 0.0
            y, x = y0 + start[k, 0], x0 + start[k, 1]
            if y < 0 or x < 0 or y >= ids.shape[0] or x >= width or ids[y, x] != own:
                y, x = y0, x0
            y, x, best, taken = walk(surface, ids, y, x, own, point, endless, eye, max_steps)
            steps[k] = min(taken, max_steps)
            end[k, 0], end[k, 1] = y - y0, x - x0
            offset[k, 0], offset[k, 1] = y - y0, x - x0
            found = verdict(surface, ids, y, x, best, own, point, endless, eye, ratio)
            if taken > max_steps:
                found = STEPS
            if found == VALID and refined:
                dy, dx, fine = refine(surface, ids, y, x, own, point, endless, eye)
                if fine:
                    offset[k, 0] += np.float32(dy)
                    offset[k, 1] += np.float32(dx)
                else:
                    found = RATIO
            cause[k] = found
