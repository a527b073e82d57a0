"""What pixels of a new view mirror, read from a key frame through the picture of its moved reflections.

A pixel looks up where its surface point lies in the key frame, finds there which key pixels' reflections have moved to
that place, corrects the position so that the reflected point lies on its own reflected ray, and reads the key frame's
colour once. Specification 04, sections 7 (reverse form) and 14.1.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.reflections.shift import SURE, link

FOUND, OUTSIDE, OTHER_SURFACE, UNRELIABLE, BROKEN, OFF_RAY, CONTRAST = 0, 1, 2, 3, 4, 5, 6
"""What became of a pixel; see ``gather``."""

BLOCK = 64
_NO_WEIGHT = 1e-3  # taps of less weight need not be reliable
_FARTHEST = 8.0  # key pixels between the sources of neighbouring pixels on one patch
_SINGULAR = 1e-9


class Ray(NamedTuple):
    """A reflected ray relative to the key eye."""

    start: tuple[float, float, float]
    direction: tuple[float, float, float]
    across: np.ndarray  # (2,3) two unit vectors at right angles to it


@kernel(inline=True)
def moved_source(at, own, tolerance, frame):
    """Position in the key frame whose reflection has moved to (u, v), and what became of it.

    Interpolated between the four nearest pixels if all can be trusted, else the nearest one's: the correction on the
    pixel's own ray makes up for the part of a pixel.
    """
    surface, ids, source, certainty = frame.surface, frame.ids, frame.source, frame.certainty
    height, width = ids.shape
    u, v, z = at
    if not (z > 0.0 and u >= 0.0 and v >= 0.0 and u < width and v < height):
        return 0.0, 0.0, OUTSIDE
    near_x, near_y = np.int64(math.floor(u)), np.int64(math.floor(v))
    if ids[near_y, near_x] != own or not abs(np.float64(surface[near_y, near_x, 7]) - z) <= tolerance:
        return 0.0, 0.0, OTHER_SURFACE
    if certainty[near_y, near_x] != SURE:
        return 0.0, 0.0, UNRELIABLE
    fx, fy = np.float64(source[near_y, near_x, 0]), np.float64(source[near_y, near_x, 1])
    x0, y0 = np.int64(math.floor(u - 0.5)), np.int64(math.floor(v - 0.5))
    a, b = u - 0.5 - x0, v - 0.5 - y0
    sx, sy = 0.0, 0.0
    for j in range(2):
        for i in range(2):
            weight = (a if i == 1 else 1.0 - a) * (b if j == 1 else 1.0 - b)
            if weight < _NO_WEIGHT:
                continue
            y, x = y0 + j, x0 + i
            if y < 0 or x < 0 or y >= height or x >= width or ids[y, x] != own or certainty[y, x] != SURE:
                return fx + (u - near_x - 0.5), fy + (v - near_y - 0.5), FOUND
            px, py = np.float64(source[y, x, 0]), np.float64(source[y, x, 1])
            if abs(px - fx) > _FARTHEST or abs(py - fy) > _FARTHEST:
                return fx, fy, FOUND
            if not abs(np.float64(surface[y, x, 7]) - z) <= tolerance:
                return fx, fy, FOUND
            sx += weight * px
            sy += weight * py
    return sx, sy, FOUND


@kernel(inline=True)
def load_corner(k, y, x, own, frame, corner):
    """Reflected point, whether it is a point, colour and distance of one key pixel; False off the reflector."""
    ids, reached, span, colors = frame.ids, frame.reached, frame.span, frame.colors
    if y < 0 or x < 0 or y >= ids.shape[0] or x >= ids.shape[1] or ids[y, x] != own:
        return False
    for c in range(4):
        corner[k, c] = np.float64(reached[y, x, c])
    for c in range(3):
        corner[k, 4 + c] = np.float64(colors[y, x, c])
    corner[k, 7] = np.float64(span[y, x])
    return True


@kernel(inline=True)
def inside(missing, a, b):
    """Is (a, b) in the half of the unit square that does not touch the missing corner?"""
    p = a if missing == 3 or missing == 1 else 1.0 - a
    q = b if missing == 3 or missing == 2 else 1.0 - b
    return missing < 0 or p + q <= 1.0 + _NO_WEIGHT


@kernel(inline=True)
def links(x0, y0, breaks, missing):
    """Links between the four pixels, the missing one left aside: 0 if whole, with 1 if visibly broken, else FAINT."""
    y, x = max(y0, 0), max(x0, 0)
    found = 0
    if missing != 0 and missing != 1:
        found |= link(breaks, y, x, y, x + 1)
    if missing != 0 and missing != 2:
        found |= link(breaks, y, x, y + 1, x)
    if missing != 2 and missing != 3:
        found |= link(breaks, y0 + 1, x, y0 + 1, x + 1)
    if missing != 1 and missing != 3:
        found |= link(breaks, y, x0 + 1, y + 1, x0 + 1)
    return found


@kernel(inline=True)
def load_window(x0, y0, a, b, own, frame, corner):
    """Fill ``corner`` (4,8) from the 2 x 2 pixels at (x0, y0), of which one may be missing if (a, b) does not need it.

    0 where they lie on one patch of the reflector that mirrors one patch of the scene, 1 where they do not, FAINT where
    they mirror different things that look alike.
    """
    missing, count = -1, 0
    for k in range(4):
        if load_corner(k, y0 + k // 2, x0 + k % 2, own, frame, corner):
            count += 1
        else:
            missing = k
    if count < 3 or not inside(missing, a, b):
        return 1
    found = links(x0, y0, frame.breaks, missing)
    ends = 0
    for k in range(4):
        ends += 1 if k != missing and corner[k, 3] == 0.0 else 0
    if ends != 0 and ends != count:
        return 1
    if missing >= 0:  # the plane through the other three
        far, left, right = 3 - missing, missing ^ 1, missing ^ 2
        for c in range(8):
            corner[missing, c] = corner[left, c] + corner[right, c] - corner[far, c]
        corner[missing, 3] = corner[far, 3]
    return found


@kernel(inline=True)
def find_window(sx, sy, own, frame, corner):
    """Weights (a, b) of a key position in the window that was loaded, and what ``load_window`` says about it.

    A position on a pixel centre belongs to the windows on either side of it.
    """
    x0, y0 = np.int64(math.floor(sx - 0.5)), np.int64(math.floor(sy - 0.5))
    a, b = sx - 0.5 - x0, sy - 0.5 - y0
    if a > 1.0 - _NO_WEIGHT:
        x0, a = x0 + 1, 0.0
    if b > 1.0 - _NO_WEIGHT:
        y0, b = y0 + 1, 0.0
    for j in range(2 if b < _NO_WEIGHT else 1):
        for i in range(2 if a < _NO_WEIGHT else 1):
            found = load_window(x0 - i, y0 - j, a + i, b + j, own, frame, corner)
            if found & 1 == 0:
                return a + i, b + j, found
    return a, b, 1


@kernel(inline=True)
def mix(corner, c, a, b):
    top = (1.0 - a) * corner[0, c] + a * corner[1, c]
    return (1.0 - b) * top + b * ((1.0 - a) * corner[2, c] + a * corner[3, c])


@kernel(inline=True)
def off_ray(corner, a, b, ray):
    """Interpolated reflected point, as seen from the ray: (right, down) off it in ``across``, and how far along it."""
    start, direction, across = ray
    kind = corner[0, 3]  # 1: points, 0: directions to points at infinity
    dx = mix(corner, 0, a, b) - kind * start[0]
    dy = mix(corner, 1, a, b) - kind * start[1]
    dz = mix(corner, 2, a, b) - kind * start[2]
    right = dx * across[0, 0] + dy * across[0, 1] + dz * across[0, 2]
    down = dx * across[1, 0] + dy * across[1, 1] + dz * across[1, 2]
    return right, down, dx * direction[0] + dy * direction[1] + dz * direction[2]


@kernel(inline=True)
def correction(corner, a, b, right, down, across):
    """Key pixels (x, y) by which the position must move so that the reflected point meets the ray."""
    right_x, right_y, down_x, down_y = 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        gx = (1.0 - b) * (corner[1, c] - corner[0, c]) + b * (corner[3, c] - corner[2, c])
        gy = (1.0 - a) * (corner[2, c] - corner[0, c]) + a * (corner[3, c] - corner[1, c])
        right_x += gx * across[0, c]
        right_y += gy * across[0, c]
        down_x += gx * across[1, c]
        down_y += gy * across[1, c]
    determinant = right_x * down_y - right_y * down_x
    size = (right_x * right_x + down_x * down_x) * (right_y * right_y + down_y * down_y)
    if not determinant * determinant > _SINGULAR * size:
        return 0.0, 0.0, False
    return (right_y * down - down_y * right) / determinant, (down_x * right - right_x * down) / determinant, True


@kernel(inline=True)
def aimed(sx, sy, own, frame, largest, corner, ray):
    """Key position and weights for which the reflected point lies on the ray, and what became of it."""
    a, b, found = find_window(sx, sy, own, frame, corner)
    if found & 1 != 0:
        return sx, sy, a, b, BROKEN
    if largest <= 0.0 or found != 0:
        return sx, sy, a, b, FOUND
    right, down, along = off_ray(corner, a, b, ray)
    dx, dy, solved = correction(corner, a, b, right, down, ray.across)
    if not (solved and abs(dx) <= largest and abs(dy) <= largest and along > 0.0):
        return sx, sy, a, b, OFF_RAY
    sx, sy = sx + dx, sy + dy
    a, b, found = find_window(sx, sy, own, frame, corner)
    return sx, sy, a, b, FOUND if found & 1 == 0 else BROKEN


@kernel(inline=True)
def fill_across(ray, across):
    """Two unit vectors at right angles to a unit vector (Duff et al., Building an orthonormal basis, 2017)."""
    sign = math.copysign(1.0, ray[2])
    p = -1.0 / (sign + ray[2])
    q = ray[0] * ray[1] * p
    across[0, 0], across[0, 1], across[0, 2] = 1.0 + sign * ray[0] * ray[0] * p, sign * q, -sign * ray[0]
    across[1, 0], across[1, 1], across[1, 2] = q, sign + ray[1] * ray[1] * p, -ray[1]


@kernel(inline=True)
def contrast(corner):
    """Largest difference between the colours of a window, in one channel; colours above 1 display as 1."""
    most = 0.0
    for c in range(4, 7):
        low, high = np.inf, 0.0
        for k in range(4):
            value = min(corner[k, c], 1.0)
            low, high = min(low, value), max(high, value)
        most = max(most, high - low)
    return most


@kernel(inline=True)
def key_place(position, matrix, near):
    """u, v and depth in the key view of a point relative to its eye; depth 0 where it has no image."""
    x = matrix[0, 0] * position[0] + matrix[0, 1] * position[1] + matrix[0, 2] * position[2]
    y = matrix[1, 0] * position[0] + matrix[1, 1] * position[1] + matrix[1, 2] * position[2]
    z = matrix[2, 0] * position[0] + matrix[2, 1] * position[1] + matrix[2, 2] * position[2]
    if not z > near:
        return 0.0, 0.0, 0.0
    return x / z, y / z, z


@kernel(parallel=True)
def gather(pixels, view, frame, limits, found):
    """Colour and distance of what N pixels of a new view mirror.

    pixels: :class:`Pixels`; view: :class:`KeyView`; frame: :class:`KeyFrame`; limits: :class:`Limits`; found:
    :class:`Gathered`, filled.
    """
    place, ids_at, tolerance, weight, position, direction = pixels
    eye, matrix, near = view
    largest, most = limits
    color, distance, source, state = found
    count = len(ids_at)
    for block in prange((count + BLOCK - 1) // BLOCK):
        corners, axes = np.zeros((4, 8)), np.zeros((2, 3))
        corner, across, own_frame = borrowed(corners), borrowed(axes), borrowed(frame)
        first = np.int64(block) * BLOCK
        for k in range(first, first + BLOCK):
            if k >= count:
                break
            start = (position[k, 0] - eye[0], position[k, 1] - eye[1], position[k, 2] - eye[2])
            u, v, z = key_place(start, matrix, near)
            if len(place) > 0:
                u, v = place[k, 0], place[k, 1]
            own = ids_at[k]
            sx, sy, became = moved_source((u, v, z), own, tolerance[k], own_frame)
            if became == FOUND:
                toward = (direction[k, 0], direction[k, 1], direction[k, 2])
                fill_across(toward, across)
                ray = Ray(start, toward, across)
                sx, sy, a, b, became = aimed(sx, sy, own, own_frame, largest, corner, ray)
                if became == FOUND and contrast(corner) * weight[k] > most:
                    became = CONTRAST
            state[k] = became
            if became != FOUND:
                continue
            right, down, along = off_ray(corner, a, b, ray)
            source[k, 0], source[k, 1] = sx, sy
            endless = corner[0, 3] == 0.0
            distance[k] = np.inf if endless else math.sqrt(along * along + right * right + down * down)
            for c in range(3):
                color[k, c] = max(mix(corner, 4 + c, a, b), 0.0)
