"""Shafts between a group of receivers and a light: if no triangle reaches into one, all of the light is seen.

Source: Haines and Wallace, Shaft culling for efficient ray-cast radiosity, 1991.
"""

from __future__ import annotations

import numpy as np

from torchrender.kernels.compile import kernel

_FLAT = 1.0 - 1e-6  # cosine between normals that make one plane
_STEEP = 0.1  # cosine towards the light below which the slope bias is capped
_THIN = 0.01  # share of the bias


@kernel(inline=True)
def _cross_into(rows, k, ax, ay, az, bx, by, bz, scale):
    rows[k, 0], rows[k, 1], rows[k, 2] = (
        (ay * bz - az * by) * scale, (az * bx - ax * bz) * scale, (ax * by - ay * bx) * scale,
    )  # fmt: skip


@kernel(inline=True)
def _group_box(points, normals, begin, members, shaft):
    """Rows 5 to 7 of the shaft; False if the receivers do not share one tangent plane direction."""
    low0 = low1 = low2 = np.inf
    high0 = high1 = high2 = -np.inf
    nx, ny, nz = normals[begin, 0], normals[begin, 1], normals[begin, 2]
    for i in range(begin, begin + members):
        if not nx * normals[i, 0] + ny * normals[i, 1] + nz * normals[i, 2] >= _FLAT:
            return False
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        low0, low1, low2 = min(low0, x), min(low1, y), min(low2, z)
        high0, high1, high2 = max(high0, x), max(high1, y), max(high2, z)
    cx, cy, cz = 0.5 * (low0 + high0), 0.5 * (low1 + high1), 0.5 * (low2 + high2)
    below = np.inf
    for i in range(begin, begin + members):
        below = min(below, nx * (points[i, 0] - cx) + ny * (points[i, 1] - cy) + nz * (points[i, 2] - cz))
    shaft[5, 0], shaft[5, 1], shaft[5, 2], shaft[5, 3] = nx, ny, nz, below
    shaft[6, 0], shaft[6, 1], shaft[6, 2] = cx, cy, cz
    shaft[7, 0], shaft[7, 1], shaft[7, 2] = high0 - cx, high1 - cy, high2 - cz
    return True


@kernel(inline=True)
def make_shaft(points, normals, begin, members, views, shaft):
    """Planes around everything between a group of receivers and the light in ``shaft`` (8,4); False: there are none.

    Rows 0 to 5: normal, and the value that is reached inside; a convex body lies outside if ``max n.(x - centre)`` is
    smaller. Four sides, the receivers' end of the shaft, their common tangent plane; then the group's centre and half
    extent.
    """
    if not _group_box(points, normals, begin, members, shaft):
        return False
    cx, cy, cz = shaft[6, 0], shaft[6, 1], shaft[6, 2]
    nx, ny, nz = shaft[5, 0], shaft[5, 1], shaft[5, 2]
    light = views.outline
    qx, qy, qz = light[0, 0] - cx, light[0, 1] - cy, light[0, 2] - cz
    ux, uy, uz = light[1, 0], light[1, 1], light[1, 2]
    vx, vy, vz = light[2, 0], light[2, 1], light[2, 2]
    distance = np.sqrt(qx * qx + qy * qy + qz * qz)
    for k in range(4):  # every corner of the light stands well above the receivers' plane
        x, y, z = (qx + (k & 1) * ux + (k >> 1) * vx, qy + (k & 1) * uy + (k >> 1) * vy,
                   qz + (k & 1) * uz + (k >> 1) * vz)  # fmt: skip
        if nx * x + ny * y + nz * z < _STEEP * np.sqrt(x * x + y * y + z * z):
            return False
    det = qx * (uy * vz - uz * vy) + qy * (uz * vx - ux * vz) + qz * (ux * vy - uy * vx)
    size = np.sqrt((ux * ux + uy * uy + uz * uz) * (vx * vx + vy * vy + vz * vz)) * distance
    if not abs(det) > 1e-6 * size:
        return False
    _cross_into(shaft, 0, vx, vy, vz, qx, qy, qz, 1.0 / det)
    _cross_into(shaft, 2, qx, qy, qz, ux, uy, uz, 1.0 / det)
    _cross_into(shaft, 4, ux, uy, uz, vx, vy, vz, 1.0 / det)
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
        shaft[k, 3] = -(
            abs(shaft[k, 0]) * (shaft[7, 0] + slack)
            + abs(shaft[k, 1]) * (shaft[7, 1] + slack)
            + abs(shaft[k, 2]) * (shaft[7, 2] + slack)
        )
    # What lies this close above the tangent plane is within the bias.
    shaft[5, 3] += _THIN * views.constant_bias * distance
    return True


@kernel(inline=True)
def is_clear(tree, shaft, stack):
    """No triangle reaches into the shaft."""
    boxes, links, corners, frame = tree
    scale = frame[3]
    gx, gy, gz = shaft[6, 0] * scale, shaft[6, 1] * scale, shaft[6, 2] * scale
    size, node = 0, np.int64(1)
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
                    return False
        if size == 0:
            return True
        size -= 1
        node = np.int64(stack[size])
