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


@kernel(parallel=True)
def add_residuals(data, chosen, rays, eye, depth, limits, image):
    """Add to ``image`` (H,W,3) linear what the photos ``chosen`` (K,) saw there; ``rays`` (3,3) world direction of a
    pixel.

    ``limits``: tolerance of depth, the angle (1 - cos) that counts as near, and the weight of no change at all. A photo
    counts by the inverse fourth power of the angle between its view of the point and the camera's, and fades in from
    its
    border, so that nothing pops.
    """
    height, width = depth.shape
    tolerance, near, rest = limits
    rows, columns = data.inverse_depth.shape[1], data.inverse_depth.shape[2]
    for j in prange(height):
        for i in range(width):
            z = np.float64(depth[j, i])
            if not z < np.inf:
                continue
            u, v = i + 0.5, j + 0.5
            dx = rays[0, 0] * u + rays[0, 1] * v + rays[0, 2]
            dy = rays[1, 0] * u + rays[1, 1] * v + rays[1, 2]
            dz = rays[2, 0] * u + rays[2, 1] * v + rays[2, 2]
            length = math.sqrt(dx * dx + dy * dy + dz * dz)
            x, y, w = eye[0] + z * dx, eye[1] + z * dy, eye[2] + z * dz
            total, red, green, blue = rest, 0.0, 0.0, 0.0
            for t in range(len(chosen)):
                k = chosen[t]
                q = moved(data.pose[k], x, y, w)
                if q[2] <= 1e-9:
                    continue
                a = data.lens[k, 0] * q[0] / q[2] + data.lens[k, 2]
                b = data.lens[k, 1] * q[1] / q[2] + data.lens[k, 3]
                if not (0.0 < a < columns and 0.0 < b < rows):
                    continue
                found, r0, r1, r2 = look_up(data, k, a, b, 1.0 / q[2], tolerance)
                if found <= 0.0:
                    continue
                ex, ey, ez = x - data.eye[k, 0], y - data.eye[k, 1], w - data.eye[k, 2]
                far = math.sqrt(ex * ex + ey * ey + ez * ez)
                angle = max(1.0 - (ex * dx + ey * dy + ez * dz) / max(far * length, 1e-30), 0.0)
                border = min(min(a, columns - a), min(b, rows - b)) / 6.0
                share = min(border, 1.0) / ((near + angle) * (near + angle))
                total += share * found
                red, green, blue = red + share * r0, green + share * r1, blue + share * r2
            scale = 1.0 / (total * SCALE)
            for c in range(3):
                change = (red if c == 0 else green if c == 1 else blue) * scale
                root = math.sqrt(max(np.float64(image[j, i, c]), 0.0)) + change
                image[j, i, c] = min(max(root, 0.0), 1.0) ** 2
