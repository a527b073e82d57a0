"""Where on a mirror a reflected point is seen from a moved eye: best-match search over the pixels of a key frame.

A candidate pixel with point W and normal n reflects the point P along ``u = reflect((W - P) / |W - P|, n)``; its
residual is what of ``E - W`` stands at right angles to u, and is zero exactly where the law of reflection holds for the
eye E. Specification 04, section 5 (stable form, feasibility, local search, acceptance) and 14.1 (refinement).

``surface`` (H*W,8) float32 holds per pixel the point relative to the key frame's eye, the normal, the footprint and the
depth; ``ids`` (H*W,) int32 the reflector, -1 elsewhere. All arithmetic is float64.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

VALID, BORDER, SILHOUETTE, RATIO, STEPS = 0, 1, 2, 3, 4
"""Causes why a pixel has no match; see ``match``."""

BLOCK = 64  # pixels handed to a thread at once
_NEIGHBOURS = 3  # feasible ones that a minimum needs around it
_FARTHEST = 1.0  # pixels by which refinement may move a match
_LEAPS, _FAR, _HALVINGS = 8, 32.0, 4  # Gauss-Newton steps before the walk, pixels of the longest, and its halvings


class KeyPixels(NamedTuple):
    """The pixels of a key frame, H rows of W."""

    surface: np.ndarray  # (H*W,8) float32
    ids: np.ndarray  # (H*W,) int32
    reached: np.ndarray  # (H*W,4) float32 reflected point relative to the key eye and 1, or unit direction and 0
    height: int
    width: int


class Settings(NamedTuple):
    """How matches are searched."""

    max_steps: int  # of a walk
    ratio: float  # of a minimum's residual over the mean of its neighbours'
    leaping: bool  # Gauss-Newton steps before the walk
    refined: bool  # to a part of a pixel


class Matches(NamedTuple):
    """Of N pixels."""

    end: np.ndarray  # (N,2) int32 rows and columns from the pixel to its match
    offset: np.ndarray  # (N,2) float32 the same with the refinement
    cause: np.ndarray  # (N,) uint8
    steps: np.ndarray  # (N,) int32 of the walk


class Query(NamedTuple):
    """Whose reflection is looked for."""

    own: int  # reflector
    point: tuple[float, float, float]  # reflected point relative to the key eye; if ``endless``, direction towards it
    endless: bool
    eye: np.ndarray  # (3,) moved eye relative to the key eye


@kernel(inline=True)
def residual(surface, p, point, endless, eye):
    """Residual (3,) at flat pixel p, and 0 for feasible, 1 for contact, 2 for infeasible.

    ``point``: reflected point relative to the key eye; if ``endless``, the unit direction towards it.
    """
    wx, wy, wz = np.float64(surface[p, 0]), np.float64(surface[p, 1]), np.float64(surface[p, 2])
    nx, ny, nz = np.float64(surface[p, 3]), np.float64(surface[p, 4]), np.float64(surface[p, 5])
    ex, ey, ez = eye[0] - wx, eye[1] - wy, eye[2] - wz
    tx, ty, tz = point[0], point[1], point[2]
    contact = False
    if not endless:
        tx, ty, tz = tx - wx, ty - wy, tz - wz
        half = 0.5 * np.float64(surface[p, 6])
        contact = tx * tx + ty * ty + tz * tz < half * half
    rise = tx * nx + ty * ny + tz * nz
    if ex * nx + ey * ny + ez * nz <= 0.0 or (rise <= 0.0 and not contact):
        return 0.0, 0.0, 0.0, 2
    if contact:
        return 0.0, 0.0, 0.0, 1
    ux, uy, uz = 2.0 * rise * nx - tx, 2.0 * rise * ny - ty, 2.0 * rise * nz - tz
    along = (ex * ux + ey * uy + ez * uz) / (ux * ux + uy * uy + uz * uz)
    return ex - along * ux, ey - along * uy, ez - along * uz, 0


@kernel(inline=True)
def squared(key, p, query):
    """d(s, s_n) of section 5, squared: 0 at contact, +inf off the reflector and where infeasible."""
    if key.ids[p] != query.own:
        return np.inf
    a, b, c, state = residual(key.surface, p, query.point, query.endless, query.eye)
    return np.inf if state == 2 else a * a + b * b + c * c


@kernel(inline=True)
def scaled(key, p, query):
    """Residual as a length on the mirror: times |P - W| / (|E - W| + |P - W|); False where there is none."""
    surface = key.surface
    own, point, endless, eye = query
    if key.ids[p] != own:
        return 0.0, 0.0, 0.0, False
    a, b, c, state = residual(surface, p, point, endless, eye)
    scale = 1.0
    if not endless:
        near, far = 0.0, 0.0
        for k in range(3):
            w = np.float64(surface[p, k])
            near += (eye[k] - w) * (eye[k] - w)
            far += (point[k] - w) * (point[k] - w)
        scale = math.sqrt(far) / (math.sqrt(near) + math.sqrt(far))
    return a * scale, b * scale, c * scale, state == 0


@kernel(inline=True)
def slope(key, p, step, back_inside, forth_inside, here, query):
    """Change of the scaled residual per pixel over ``step``, from both neighbours or one; False without any."""
    ax, ay, az, ahead = 0.0, 0.0, 0.0, False
    bx, by, bz, behind = 0.0, 0.0, 0.0, False
    if forth_inside:
        ax, ay, az, ahead = scaled(key, np.uintp(p + step), query)
    if back_inside:
        bx, by, bz, behind = scaled(key, np.uintp(p - step), query)
    if ahead and behind:
        return 0.5 * (ax - bx), 0.5 * (ay - by), 0.5 * (az - bz), True
    if ahead:
        return ax - here[0], ay - here[1], az - here[2], True
    if behind:
        return here[0] - bx, here[1] - by, here[2] - bz, True
    return 0.0, 0.0, 0.0, False


@kernel()
def refine(key, y, x, query):
    """One Gauss-Newton step from pixel (y, x): offset (dy, dx) and whether it stays within a pixel."""
    height, width = key.height, key.width
    p = y * width + x
    a, b, c, feasible = scaled(key, np.uintp(p), query)
    if not feasible:
        return 0.0, 0.0, True
    here = (a, b, c)
    ax, bx, cx, across = slope(key, p, 1, x > 0, x + 1 < width, here, query)
    ay, by, cy, down = slope(key, p, width, y > 0, y + 1 < height, here, query)
    if not (across and down):
        return 0.0, 0.0, True
    xx, xy, yy = ax * ax + bx * bx + cx * cx, ax * ay + bx * by + cx * cy, ay * ay + by * by + cy * cy
    gx, gy = ax * a + bx * b + cx * c, ay * a + by * b + cy * c
    determinant = xx * yy - xy * xy
    if not determinant > 1e-12 * xx * yy:
        return 0.0, 0.0, False
    dx, dy = (xy * gy - yy * gx) / determinant, (xy * gx - xx * gy) / determinant
    return dy, dx, abs(dx) <= _FARTHEST and abs(dy) <= _FARTHEST


@kernel(inline=True)
def neighbours(key, y, x, query, around):
    """Squared distances of the 8 neighbours, into ``around``; +inf outside the image."""
    height, width = key.height, key.width
    k = 0
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if dy == 0 and dx == 0:
                continue
            ny, nx = y + dy, x + dx
            around[k] = np.inf
            if 0 <= ny < height and 0 <= nx < width:
                around[k] = squared(key, np.uintp(ny * width + nx), query)
            k += 1


@kernel(inline=True)
def walk(key, y, x, query, max_steps, around):
    """Pixel and squared distance where the walk over the 8 neighbours ends, and its steps; max_steps + 1 if cut off.

    ``around`` (8,) holds the squared distances about the end.
    """
    best = squared(key, np.uintp(y * key.width + x), query)
    steps = 0
    while True:
        neighbours(key, y, x, query, around)
        least, place = best, -1
        for k in range(8):
            if around[k] < least:
                least, place = around[k], k
        if place < 0:
            return y, x, best, steps
        if steps == max_steps:
            return y, x, best, steps + 1
        place += 1 if place >= 4 else 0
        y, x, best = y + place // 3 - 1, x + place % 3 - 1, least
        steps += 1


@kernel(inline=True)
def verdict(key, y, x, best, own, around, ratio):
    """VALID or why the end of a walk is no match: no true minimum, beside the border, beside another surface."""
    if best == 0.0:  # contact: what touches the mirror is seen where it touches, whatever the neighbours
        return VALID
    total, count = 0.0, 0
    for k in range(8):
        if around[k] < np.inf:
            total += math.sqrt(around[k])
            count += 1
    if best < np.inf and count >= _NEIGHBOURS and (ratio >= 1.0 or math.sqrt(best) * count <= ratio * total):
        return VALID
    height, width = key.height, key.width
    if y == 0 or x == 0 or y == height - 1 or x == width - 1:
        return BORDER
    for dy in range(-1, 2):
        for dx in range(-1, 2):
            if key.ids[np.uintp((y + dy) * width + x + dx)] != own:
                return SILHOUETTE
    return RATIO


@kernel(inline=True)
def leap(key, y, x, query, ratio):
    """The match found by Gauss-Newton steps alone, and whether they led to one: else the walk goes on from there.

    Four neighbours stand for eight: a minimum is true if the residual there is small beside its change per pixel.
    """
    height, width = key.height, key.width
    for _ in range(_LEAPS):
        if y <= 0 or x <= 0 or y >= height - 1 or x >= width - 1:
            return y, x, 0.0, 0.0, False
        p = y * width + x
        a, b, c, feasible = scaled(key, np.uintp(p), query)
        if not feasible:
            return y, x, 0.0, 0.0, False
        rx, ry, rz, right = scaled(key, np.uintp(p + 1), query)
        lx, ly, lz, left = scaled(key, np.uintp(p - 1), query)
        dx, dy, dz, below = scaled(key, np.uintp(p + width), query)
        ux, uy, uz, above = scaled(key, np.uintp(p - width), query)
        if not (right and left and below and above):
            return y, x, 0.0, 0.0, False
        here = a * a + b * b + c * c
        right_d, left_d = rx * rx + ry * ry + rz * rz, lx * lx + ly * ly + lz * lz
        below_d, above_d = dx * dx + dy * dy + dz * dz, ux * ux + uy * uy + uz * uz
        ax, ay, az = 0.5 * (rx - lx), 0.5 * (ry - ly), 0.5 * (rz - lz)
        bx, by, bz = 0.5 * (dx - ux), 0.5 * (dy - uy), 0.5 * (dz - uz)
        xx, xy, yy = ax * ax + ay * ay + az * az, ax * bx + ay * by + az * bz, bx * bx + by * by + bz * bz
        gx, gy = ax * a + ay * b + az * c, bx * a + by * b + bz * c
        determinant = xx * yy - xy * xy
        if not determinant > 1e-6 * xx * yy:
            return y, x, 0.0, 0.0, False
        step_x, step_y = (xy * gy - yy * gx) / determinant, (xy * gx - xx * gy) / determinant
        if abs(step_x) <= 0.5 and abs(step_y) <= 0.5:
            mean = 0.25 * (math.sqrt(right_d) + math.sqrt(left_d) + math.sqrt(below_d) + math.sqrt(above_d))
            least = min(min(right_d, left_d), min(below_d, above_d))
            return y, x, step_y, step_x, here <= least and math.sqrt(here) <= ratio * mean
        longest = max(abs(step_x), abs(step_y))
        if not longest < np.inf:
            return y, x, 0.0, 0.0, False
        part = min(1.0, _FAR / longest)
        ny, nx = y, x
        for _ in range(_HALVINGS):  # a step off the reflector is halved: the walk then begins near the outline
            ny, nx = y + np.int64(round(part * step_y)), x + np.int64(round(part * step_x))
            if 0 <= ny < height and 0 <= nx < width and key.ids[np.uintp(ny * width + nx)] == query.own:
                break
            part *= 0.5
            ny, nx = y, x
        if ny == y and nx == x:
            return y, x, 0.0, 0.0, False
        y, x = ny, nx
    return y, x, 0.0, 0.0, False


@kernel(parallel=True)
def match(key, pixels, eye, start, settings, found):
    """The match of each of N pixels of a key frame for an eye relative to the key eye.

    key: :class:`KeyPixels`; pixels (N,) int64 flat; start (N,2) int32 pixels (dy, dx) to begin at; settings:
    :class:`Settings`; found: :class:`Matches`, filled.
    """
    height, width, reached = key.height, key.width, key.reached
    max_steps, ratio, leaping, refined = settings
    end, offset, cause, steps = found
    count = len(pixels)
    for block in prange((count + BLOCK - 1) // BLOCK):
        eight = np.zeros(8)
        around = borrowed(eight)
        plain, toward = borrowed(key), borrowed(eye)
        own_ids = plain.ids
        first = np.int64(block) * BLOCK
        for k in range(first, first + BLOCK):
            if k >= count:
                break
            p = np.uintp(pixels[k])
            y0, x0 = pixels[k] // width, pixels[k] % width
            own = own_ids[p]
            point = (np.float64(reached[p, 0]), np.float64(reached[p, 1]), np.float64(reached[p, 2]))
            query = Query(own, point, reached[p, 3] == 0.0, toward)
            y, x = y0 + start[k, 0], x0 + start[k, 1]
            if y < 0 or x < 0 or y >= height or x >= width or own_ids[y * width + x] != own:
                y, x = y0, x0
            if leaping:
                leapt_y, leapt_x, dy, dx, there = leap(plain, y, x, query, ratio)
                if there:
                    end[k, 0], end[k, 1] = leapt_y - y0, leapt_x - x0
                    offset[k, 0] = leapt_y - y0 + (dy if refined else 0.0)
                    offset[k, 1] = leapt_x - x0 + (dx if refined else 0.0)
                    cause[k], steps[k] = VALID, 0
                    continue
                here = squared(plain, np.uintp(y * width + x), query)
                there_now = squared(plain, np.uintp(leapt_y * width + leapt_x), query)
                if there_now < here:
                    y, x = leapt_y, leapt_x
            y, x, best, taken = walk(plain, y, x, query, max_steps, around)
            steps[k] = min(taken, max_steps)
            end[k, 0], end[k, 1] = y - y0, x - x0
            offset[k, 0], offset[k, 1] = y - y0, x - x0
            found = STEPS if taken > max_steps else verdict(plain, y, x, best, own, around, ratio)
            if found == VALID and refined:
                dy, dx, fine = refine(plain, y, x, query)
                if fine:
                    offset[k, 0] += np.float32(dy)
                    offset[k, 1] += np.float32(dx)
                else:
                    found = RATIO
            cause[k] = found
