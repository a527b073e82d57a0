"""What the photos saw differently from where they stood: small residual pictures, looked up by depth."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.walkthrough.density import moved

SCALE = 127.0
"""Codes of a residual of one, in square roots of linear light."""


class Residuals(NamedTuple):
    """N small pictures."""

    residual: Any  # (N,h,w,3) int8 photo minus model, square roots of linear light
    inverse_depth: Any  # (N,h,w) uint16 codes, 0: nothing is known
    unit: Any  # (N,) inverse depth of a code
    lens: Any  # (N,4) fx, fy, cx, cy of the small pictures
    pose: Any  # (N,3,4) camera from world
    eye: Any  # (N,3)


@kernel(inline=True)
def look_up(data, k, u, v, inverse, tolerance):
    """Residual at pixel coordinates of picture ``k`` among samples of the same depth, and the weight found."""
    height, width = data.inverse_depth.shape[1], data.inverse_depth.shape[2]
    x, y = math.floor(u - 0.5), math.floor(v - 0.5)
    a, b = u - 0.5 - x, v - 0.5 - y
    total, r0, r1, r2 = 0.0, 0.0, 0.0, 0.0
    for t in range(4):
        px, py = int(x) + (t & 1), int(y) + (t >> 1)
        if px < 0 or py < 0 or px >= width or py >= height:
            continue
        code = data.inverse_depth[k, py, px]
        if code == 0 or abs(code * data.unit[k] - inverse) > tolerance * inverse:
            continue
        w = (a if t & 1 else 1.0 - a) * (b if t >> 1 else 1.0 - b)
        total += w
        r0 += w * data.residual[k, py, px, 0]
        r1 += w * data.residual[k, py, px, 1]
        r2 += w * data.residual[k, py, px, 2]
    return total, r0, r1, r2


class Looks(NamedTuple):
    """Which photos one picture looks at, and how."""

    chosen: Any  # (K,) int64
    fade: Any  # (K,) float64 share of each, towards 0 for one that is about to be replaced
    rays: Any  # (3,3) float64 world direction of a pixel
    eye: Any  # (3,) float64
    tolerance: float  # of depth, share
    near: float  # angle (1 - cos) that counts as near
    rest: float  # weight of no change at all


@kernel()
def change_at(data, looks, u, v, z):
    """Change of the square root of linear light at pixel coordinates (u, v) and depth z: the mean over the photos.

    A photo counts by the inverse fourth power of the angle between its view of the point and the camera's, and fades
    in from its border, so that nothing pops.
    """
    rows, columns = data.inverse_depth.shape[1], data.inverse_depth.shape[2]
    rays, eye = looks.rays, looks.eye
    dx = rays[0, 0] * u + rays[0, 1] * v + rays[0, 2]
    dy = rays[1, 0] * u + rays[1, 1] * v + rays[1, 2]
    dz = rays[2, 0] * u + rays[2, 1] * v + rays[2, 2]
    length = math.sqrt(dx * dx + dy * dy + dz * dz)
    x, y, w = eye[0] + z * dx, eye[1] + z * dy, eye[2] + z * dz
    total, red, green, blue = looks.rest, 0.0, 0.0, 0.0
    for t in range(len(looks.chosen)):
        k = looks.chosen[t]
        q = moved(data.pose[k], x, y, w)
        if q[2] <= 1e-9:
            continue
        inverse = 1.0 / q[2]
        a = data.lens[k, 0] * q[0] * inverse + data.lens[k, 2]
        b = data.lens[k, 1] * q[1] * inverse + data.lens[k, 3]
        if not (0.0 < a < columns and 0.0 < b < rows):
            continue
        found, r0, r1, r2 = look_up(data, k, a, b, inverse, looks.tolerance)
        if found <= 0.0:
            continue
        ex, ey, ez = x - data.eye[k, 0], y - data.eye[k, 1], w - data.eye[k, 2]
        far = math.sqrt(ex * ex + ey * ey + ez * ez)
        angle = max(1.0 - (ex * dx + ey * dy + ez * dz) / max(far * length, 1e-30), 0.0)
        border = min(min(a, columns - a), min(b, rows - b)) / 6.0
        share = looks.fade[t] * min(border, 1.0) / ((looks.near + angle) * (looks.near + angle))
        total += share * found
        red, green, blue = red + share * r0, green + share * r1, blue + share * r2
    scale = 1.0 / (total * SCALE)
    return np.float32(red * scale), np.float32(green * scale), np.float32(blue * scale)


STEP = 4
"""Pixels from one place where the change is looked up to the next."""

FLAT = 0.01
"""Share of inverse depth within which a pixel lies on the surface between the places around it."""

STEEP = 0.25
"""Share of inverse depth by which these places may differ."""


@kernel(parallel=True)
def add_residuals(data, looks, depth, grid, inverse, image):
    """Add to ``image`` (H,W,3) linear what photos saw there differently.

    The residual pictures are coarse, so the change is looked up in every ``STEP``-th pixel; between them it is
    interpolated where the surface goes on from one to the next, and looked up where it does not. ``grid`` (h,w,3) and
    ``inverse`` (h,w) float32 are room for that, not cleared: h = (H - 1) // STEP + 2, w likewise.
    """
    residual, codes, unit, lens, pose, eyes = data
    chosen, fade, rays, eye, tolerance, near, rest = looks
    height, width = depth.shape
    tall, wide = inverse.shape
    zero, one = np.float32(0.0), np.float32(1.0)
    for b in prange(tall):
        photos = Residuals(residual, codes, unit, lens, pose, eyes)
        how = Looks(chosen, fade, rays, eye, tolerance, near, rest)
        j = min(np.int64(b) * STEP, height - 1)
        for a in range(wide):
            i = min(a * STEP, width - 1)
            z = depth[j, i]
            inverse[b, a] = zero
            if z < np.inf:
                inverse[b, a] = one / z
                grid[b, a, 0], grid[b, a, 1], grid[b, a, 2] = change_at(photos, how, i + 0.5, j + 0.5, np.float64(z))
    flat, steep = np.float32(FLAT), np.float32(STEEP)
    for j in prange(height):
        photos = Residuals(residual, codes, unit, lens, pose, eyes)
        how = Looks(chosen, fade, rays, eye, tolerance, near, rest)
        b = np.int64(j) // STEP
        below = max(min((b + 1) * STEP, height - 1) - b * STEP, 1)
        fv = np.float32(np.int64(j) - b * STEP) / np.float32(below)
        for i in range(width):
            z = depth[j, i]
            if not z < np.inf:
                continue
            a = i // STEP
            beside = max(min((a + 1) * STEP, width - 1) - a * STEP, 1)
            fu = np.float32(i - a * STEP) / np.float32(beside)
            q00, q01, q10, q11 = inverse[b, a], inverse[b, a + 1], inverse[b + 1, a], inverse[b + 1, a + 1]
            q = one / z
            least, most = min(min(q00, q01), min(q10, q11)), max(max(q00, q01), max(q10, q11))
            w00, w01, w10, w11 = (one - fu) * (one - fv), fu * (one - fv), (one - fu) * fv, fu * fv
            between = w00 * q00 + w01 * q01 + w10 * q10 + w11 * q11
            if least > zero and most - least <= steep * q and abs(between - q) <= flat * q:
                red = (
                    w00 * grid[b, a, 0]
                    + w01 * grid[b, a + 1, 0]
                    + w10 * grid[b + 1, a, 0]
                    + w11 * grid[b + 1, a + 1, 0]
                )
                green = (
                    w00 * grid[b, a, 1]
                    + w01 * grid[b, a + 1, 1]
                    + w10 * grid[b + 1, a, 1]
                    + w11 * grid[b + 1, a + 1, 1]
                )
                blue = (
                    w00 * grid[b, a, 2]
                    + w01 * grid[b, a + 1, 2]
                    + w10 * grid[b + 1, a, 2]
                    + w11 * grid[b + 1, a + 1, 2]
                )
            else:
                red, green, blue = change_at(photos, how, i + 0.5, j + 0.5, np.float64(z))
            red, green, blue = (
                math.sqrt(image[j, i, 0]) + red, math.sqrt(image[j, i, 1]) + green, math.sqrt(image[j, i, 2]) + blue
            )  # fmt: skip
            red, green, blue = min(max(red, zero), one), min(max(green, zero), one), min(max(blue, zero), one)
            image[j, i, 0], image[j, i, 1], image[j, i, 2] = red * red, green * green, blue * blue
