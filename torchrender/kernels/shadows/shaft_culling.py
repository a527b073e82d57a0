"""Shafts between a group of receivers and a light, or a part of it: only triangles that reach into one cast shadows.

Source: Haines and Wallace, Shaft culling for efficient ray-cast radiosity, 1991.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel
from torchrender.kernels.rays.boxes import SCALE

NONE, SHAFT, ABOVE = 0, 1, 2

_FLAT = 1.0 - 1e-6  # cosine between normals that make one plane
_STEEP = 0.1  # cosine towards the light below which the slope bias is capped
_THIN = 0.01  # share of the bias
_HAIR = 1e-9  # of the shaft's width and length: covers rounding


class Receivers(NamedTuple):
    """A group of neighbouring points."""

    points: np.ndarray  # (P,3) float64
    normals: np.ndarray  # (P,3) float64, towards the viewer
    begin: int  # first of the group
    members: int


@kernel(inline=True)
def _cross_into(rows, k, a, b, scale):
    (ax, ay, az), (bx, by, bz) = a, b
    rows[k, 0], rows[k, 1], rows[k, 2] = (
        (ay * bz - az * by) * scale, (az * bx - ax * bz) * scale, (ax * by - ay * bx) * scale,
    )  # fmt: skip


@kernel(inline=True)
def _group_box(group, shaft):
    """Rows 5 to 7 of the shaft; False, and no tangent plane, if the receivers do not share one."""
    points, normals, begin, members = group
    low0 = low1 = low2 = np.inf
    high0 = high1 = high2 = -np.inf
    nx, ny, nz = normals[begin, 0], normals[begin, 1], normals[begin, 2]
    flat = True
    for i in range(begin, begin + members):
        flat = flat and nx * normals[i, 0] + ny * normals[i, 1] + nz * normals[i, 2] >= _FLAT
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        low0, low1, low2 = min(low0, x), min(low1, y), min(low2, z)
        high0, high1, high2 = max(high0, x), max(high1, y), max(high2, z)
    cx, cy, cz = 0.5 * (low0 + high0), 0.5 * (low1 + high1), 0.5 * (low2 + high2)
    shaft[6, 0], shaft[6, 1], shaft[6, 2] = cx, cy, cz
    shaft[7, 0], shaft[7, 1], shaft[7, 2] = high0 - cx, high1 - cy, high2 - cz
    shaft[5, 0] = shaft[5, 1] = shaft[5, 2] = 0.0
    shaft[5, 3] = -np.inf
    if flat:
        below = np.inf
        for i in range(begin, begin + members):
            below = min(below, nx * (points[i, 0] - cx) + ny * (points[i, 1] - cy) + nz * (points[i, 2] - cz))
        shaft[5, 0], shaft[5, 1], shaft[5, 2], shaft[5, 3] = nx, ny, nz, below
    return flat


@kernel(inline=True)
def _stands_above(shaft, light, qx, qy, qz):
    """Every corner of the light stands well above the receivers' tangent plane."""
    nx, ny, nz = shaft[5, 0], shaft[5, 1], shaft[5, 2]
    for k in range(4):
        x, y, z = (qx + (k & 1) * light[1, 0] + (k >> 1) * light[2, 0],
                   qy + (k & 1) * light[1, 1] + (k >> 1) * light[2, 1],
                   qz + (k & 1) * light[1, 2] + (k >> 1) * light[2, 2])  # fmt: skip
        if nx * x + ny * y + nz * z < _STEEP * np.sqrt(x * x + y * y + z * z):
            return False
    return True


@kernel(inline=True)
def make_shaft(group, light, views, shaft):
    """Planes around everything between a group of receivers and a parallelogram ``light`` (3,3), in ``shaft`` (8,4).

    Rows 0 to 5: normal, and the value that is reached inside; a convex body lies outside if ``max n.(x - centre)`` is
    smaller. Four sides, the receivers' end of the shaft, their common tangent plane (where they have one and the light
    stands above it); then the group's centre and half extent.

    Returns NONE (there are no such planes), SHAFT, or ABOVE if the tangent plane is one of them.
    """
    flat = _group_box(group, shaft)
    cx, cy, cz = shaft[6, 0], shaft[6, 1], shaft[6, 2]
    qx, qy, qz = light[0, 0] - cx, light[0, 1] - cy, light[0, 2] - cz
    ux, uy, uz = light[1, 0], light[1, 1], light[1, 2]
    vx, vy, vz = light[2, 0], light[2, 1], light[2, 2]
    distance = np.sqrt(qx * qx + qy * qy + qz * qz)
    det = qx * (uy * vz - uz * vy) + qy * (uz * vx - ux * vz) + qz * (ux * vy - uy * vx)
    size = np.sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)) * distance
    if not abs(det) > 1e-6 * size:
        return NONE
    q, u, v = (qx, qy, qz), (ux, uy, uz), (vx, vy, vz)
    _cross_into(shaft, 0, v, q, 1.0 / det)
    _cross_into(shaft, 2, q, u, 1.0 / det)
    _cross_into(shaft, 4, u, v, 1.0 / det)
    # Rows 0, 2, 4 take a point to (a t, b t, t) with the light at t = 1, 0 <= a, b <= 1.
    slack = 0.0
    if views.texels:  # aims stray by less than a texel
        for s in range(views.focal.shape[0]):
            slack = max(slack, 1.0 / views.focal[s])
        slack *= 2.0 * (distance + np.sqrt(ux * ux + uy * uy + uz * uz) + np.sqrt(vx * vx + vy * vy + vz * vz))
    for m in range(3):
        shaft[1, m] = shaft[4, m] - shaft[0, m]
        shaft[3, m] = shaft[4, m] - shaft[2, m]
    for k in range(5):
        shaft[k, 3] = -_HAIR - (
            abs(shaft[k, 0]) * (shaft[7, 0] + slack)
            + abs(shaft[k, 1]) * (shaft[7, 1] + slack)
            + abs(shaft[k, 2]) * (shaft[7, 2] + slack)
        )
    if flat and _stands_above(shaft, light, qx, qy, qz):
        # What lies this close above the tangent plane is within the bias.
        shaft[5, 3] += _THIN * views.constant_bias * distance
        return ABOVE
    shaft[5, 0] = shaft[5, 1] = shaft[5, 2] = 0.0
    shaft[5, 3] = -np.inf
    return SHAFT


@kernel(inline=True)
def collect(tree, shaft, stack, found, most):
    """Slots of triangles that may reach into the shaft, in ``found``; how many, or ``most`` + 1 if there are more."""
    boxes, links, _, corners, frame = tree
    scale = frame[SCALE]
    gx, gy, gz = shaft[6, 0] * scale, shaft[6, 1] * scale, shaft[6, 2] * scale
    size, count, node = 0, 0, np.int64(1)
    while True:
        hx, hy, hz = (
            0.5 * (np.float64(boxes[node, 3]) - boxes[node, 0]),
            0.5 * (np.float64(boxes[node, 4]) - boxes[node, 1]),
            0.5 * (np.float64(boxes[node, 5]) - boxes[node, 2]),
        )
        x, y, z = (boxes[node, 0] + hx + frame[0] - gx, boxes[node, 1] + hy + frame[1] - gy,
                   boxes[node, 2] + hz + frame[2] - gz)  # fmt: skip
        inside = True
        for k in range(6):
            p, q, r = shaft[k, 0], shaft[k, 1], shaft[k, 2]
            if p * x + q * y + r * z + abs(p) * hx + abs(q) * hy + abs(r) * hz < shaft[k, 3] * scale:
                inside = False
                break
        if inside:
            left, right = np.int64(links[node, 0]), np.int64(links[node, 1])
            if left >= 0:
                stack[size] = right
                size += 1
                node = left
                continue
            for slot in range(-left - 1, -left - 1 + right):
                outside = False
                for k in range(6):
                    p, q, r = shaft[k, 0], shaft[k, 1], shaft[k, 2]
                    reach = -np.inf
                    for c in range(0, 9, 3):
                        reach = max(reach, p * (corners[slot, c] - gx) + q * (corners[slot, c + 1] - gy)
                                    + r * (corners[slot, c + 2] - gz))  # fmt: skip
                    if reach < shaft[k, 3] * scale:
                        outside = True
                        break
                if not outside:
                    if count == most:
                        return most + 1
                    found[count] = slot
                    count += 1
        if size == 0:
            return count
        size -= 1
        node = np.int64(stack[size])
