"""Sums and boxes over the pixels of each cluster: what its camera is made from.

Pixels are sorted by cluster and cut into chunks of one cluster each, so that threads share the work whatever the sizes;
the callers add up the chunks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

SUMS = 19  # columns of ``moments`` that are added up; two that are minima and two that are maxima follow
BOX = 4  # low x, low y, high x, high y


class Bundle(NamedTuple):
    """The mirrored rays of N pixels in K chunks."""

    chunks: np.ndarray  # (K,2) int64 runs of ``order``
    owner: np.ndarray  # (K,) int64 cluster of each chunk
    order: np.ndarray  # (N,) int64 pixels, cluster by cluster
    position: np.ndarray  # (N,3) float64 about a common reference
    normal: np.ndarray  # (N,3) float64
    direction: np.ndarray  # (N,3) float64


class Pictures(NamedTuple):
    """Where the pixels lie in their pictures."""

    place: np.ndarray  # (B*H*W,) int64 number of the pixel there, or -1
    pixel: np.ndarray  # (N,) int64 flat
    cluster: np.ndarray  # (N,) int64
    width: int


@kernel(inline=True)
def dot(a, i, v, j):
    """Row ``i`` of ``a`` times row ``j`` of ``v``."""
    return a[i, 0] * v[j, 0] + a[i, 1] * v[j, 1] + a[i, 2] * v[j, 2]


@kernel(parallel=True)
def moments(bundle, column, row, out):
    """Per chunk: count, sums of position, normal, direction, of ``I - r r^T`` (xx, xy, xz, yy, yz, zz) and of that
    times position; smallest and largest column and row."""
    chunks, _, order, position, normal, direction = bundle
    for c in prange(chunks.shape[0]):
        for k in range(SUMS):
            out[c, k] = 0.0
        out[c, SUMS] = out[c, SUMS + 1] = math.inf
        out[c, SUMS + 2] = out[c, SUMS + 3] = -math.inf
        for slot in range(chunks[c, 0], chunks[c, 1]):
            i = order[slot]
            px, py, pz = position[i, 0], position[i, 1], position[i, 2]
            rx, ry, rz = direction[i, 0], direction[i, 1], direction[i, 2]
            out[c, 0] += 1.0
            for k in range(3):
                out[c, 1 + k] += position[i, k]
                out[c, 4 + k] += normal[i, k]
                out[c, 7 + k] += direction[i, k]
            xx, xy, xz = 1.0 - rx * rx, -rx * ry, -rx * rz
            yy, yz, zz = 1.0 - ry * ry, -ry * rz, 1.0 - rz * rz
            out[c, 10] += xx
            out[c, 11] += xy
            out[c, 12] += xz
            out[c, 13] += yy
            out[c, 14] += yz
            out[c, 15] += zz
            out[c, 16] += xx * px + xy * py + xz * pz
            out[c, 17] += xy * px + yy * py + yz * pz
            out[c, 18] += xz * px + yz * py + zz * pz
            out[c, SUMS] = min(out[c, SUMS], column[i])
            out[c, SUMS + 1] = min(out[c, SUMS + 1], row[i])
            out[c, SUMS + 2] = max(out[c, SUMS + 2], column[i])
            out[c, SUMS + 3] = max(out[c, SUMS + 3], row[i])


@kernel(parallel=True)
def plane_spread(bundle, centre, axis, out):
    """Per chunk: largest height above and below the fitting plane, smallest cosine to its normal, largest squared
    distance from its centre. ``centre``, ``axis`` (C,3)."""
    chunks, owner, order, position, normal, _ = bundle
    for c in prange(chunks.shape[0]):
        g = owner[c]
        above, below, cosine, radius = -math.inf, -math.inf, math.inf, 0.0
        for slot in range(chunks[c, 0], chunks[c, 1]):
            i = order[slot]
            x = position[i, 0] - centre[g, 0]
            y = position[i, 1] - centre[g, 1]
            z = position[i, 2] - centre[g, 2]
            height = x * axis[g, 0] + y * axis[g, 1] + z * axis[g, 2]
            above, below = max(above, height), max(below, -height)
            cosine = min(cosine, dot(normal, i, axis, g))
            radius = max(radius, x * x + y * y + z * z)
        out[c, 0], out[c, 1], out[c, 2], out[c, 3] = above, below, -cosine, radius


@kernel(inline=True)
def ray_end(height, climb, far, longest):
    """Length at which a ray that starts at ``height`` over the fitting plane and climbs by ``climb`` per unit ends."""
    if climb > 0.0:
        return min((far - height) / climb, longest)
    return longest


@kernel(parallel=True)
def eye_boxes(bundle, frames, reach, out):
    """Per chunk: boxes of ray starts and ray ends as seen from the mirrored eye, on the fitting plane; and the sums
    that tell whether the bundle crosses: count, start, end, start . end, |start|^2 of the rays in both boxes.

    ``frames`` (C,4,3) = centre, right, down, normal; ``reach`` (C,6) = mirrored eye (3), far distance, longest ray,
    smallest cosine to the normal that counts.
    """
    chunks, owner, order, position, _, direction = bundle
    for c in prange(chunks.shape[0]):
        g = owner[c]
        for k in range(2):
            out[c, 4 * k] = out[c, 4 * k + 1] = math.inf
            out[c, 4 * k + 2] = out[c, 4 * k + 3] = -math.inf
        for k in range(8, 15):
            out[c, k] = 0.0
        ex, ey, ez = reach[g, 0], reach[g, 1], reach[g, 2]
        centre, right, down, normal = frames[g, 0], frames[g, 1], frames[g, 2], frames[g, 3]
        h = (centre[0] - ex) * normal[0] + (centre[1] - ey) * normal[1] + (centre[2] - ez) * normal[2]
        for slot in range(chunks[c, 0], chunks[c, 1]):
            i = order[slot]
            climb = direction[i, 0] * normal[0] + direction[i, 1] * normal[1] + direction[i, 2] * normal[2]
            x, y, z = position[i, 0] - ex, position[i, 1] - ey, position[i, 2] - ez
            depth = x * normal[0] + y * normal[1] + z * normal[2]
            if depth <= 0.0:
                continue
            px = h * (x * right[0] + y * right[1] + z * right[2]) / depth
            py = h * (x * down[0] + y * down[1] + z * down[2]) / depth
            out[c, 0], out[c, 1] = min(out[c, 0], px), min(out[c, 1], py)
            out[c, 2], out[c, 3] = max(out[c, 2], px), max(out[c, 3], py)
            if climb < reach[g, 5]:
                continue
            t = ray_end(depth - h, climb, reach[g, 3], reach[g, 4])
            x, y, z = x + t * direction[i, 0], y + t * direction[i, 1], z + t * direction[i, 2]
            depth = x * normal[0] + y * normal[1] + z * normal[2]
            qx = h * (x * right[0] + y * right[1] + z * right[2]) / depth
            qy = h * (x * down[0] + y * down[1] + z * down[2]) / depth
            out[c, 4], out[c, 5] = min(out[c, 4], qx), min(out[c, 5], qy)
            out[c, 6], out[c, 7] = max(out[c, 6], qx), max(out[c, 7], qy)
            out[c, 8] += 1.0
            out[c, 9] += px
            out[c, 10] += py
            out[c, 11] += qx
            out[c, 12] += qy
            out[c, 13] += px * qx + py * qy
            out[c, 14] += px * px + py * py


@kernel(parallel=True)
def ray_deviation(bundle, eyes, out):
    """Per chunk: sum of ``1 - cos`` of the angle between each ray and the line to it from each of the eyes (C,E,3)."""
    chunks, owner, order, position, _, direction = bundle
    for c in prange(chunks.shape[0]):
        g = owner[c]
        for e in range(eyes.shape[1]):
            total = 0.0
            for slot in range(chunks[c, 0], chunks[c, 1]):
                i = order[slot]
                x, y, z = position[i, 0] - eyes[g, e, 0], position[i, 1] - eyes[g, e, 1], position[i, 2] - eyes[g, e, 2]
                length = math.sqrt(x * x + y * y + z * z)
                along = x * direction[i, 0] + y * direction[i, 1] + z * direction[i, 2]
                total += 1.0 - (along / length if length > 0.0 else 1.0)
            out[c, e] = total


@kernel(inline=True)
def grow_box(out, c, x, y, depth, slope):
    """Take the tangents of a point into the box of chunk ``c``; False if it lies beyond the largest slope."""
    if depth <= 0.0:
        return False
    u, v = x / depth, y / depth
    inside = abs(u) <= slope and abs(v) <= slope
    u, v = min(max(u, -slope), slope), min(max(v, -slope), slope)
    out[c, 0], out[c, 1] = min(out[c, 0], u), min(out[c, 1], v)
    out[c, 2], out[c, 3] = max(out[c, 2], u), max(out[c, 3], v)
    return inside


@kernel(parallel=True)
def image_boxes(bundle, lens, frames, reach, images, out):
    """Per chunk: box, in tangents, of ray starts and (widened) ray ends seen from the camera's eye; number of rays
    outside the largest slope; sum and number of distances between neighbouring pixels, in tangents; smallest depth.

    ``frames`` (C,5,3) = centre of the fitting plane, image right, image down, view axis, normal of the fitting plane.

    ``lens`` (C,2) = lobe half angle's sine and cosine; ``reach`` (C,6) = eye (3), far distance, longest ray, largest
    slope; ``images``: :class:`Pictures`.
    """
    chunks, owner, order, position, _, direction = bundle
    place, pixel, cluster, width = images
    for c in prange(chunks.shape[0]):
        g = owner[c]
        out[c, 0] = out[c, 1] = math.inf
        out[c, 2] = out[c, 3] = -math.inf
        out[c, 4] = out[c, 5] = out[c, 6] = 0.0
        out[c, 7] = math.inf
        centre, right, down, axis, normal = frames[g, 0], frames[g, 1], frames[g, 2], frames[g, 3], frames[g, 4]
        ex, ey, ez = reach[g, 0], reach[g, 1], reach[g, 2]
        # The plane's normal as the camera sees it.
        nx = normal[0] * right[0] + normal[1] * right[1] + normal[2] * right[2]
        ny = normal[0] * down[0] + normal[1] * down[1] + normal[2] * down[2]
        nz = normal[0] * axis[0] + normal[1] * axis[1] + normal[2] * axis[2]
        for slot in range(chunks[c, 0], chunks[c, 1]):
            i = order[slot]
            x, y, z = position[i, 0] - ex, position[i, 1] - ey, position[i, 2] - ez
            px = x * right[0] + y * right[1] + z * right[2]
            py = x * down[0] + y * down[1] + z * down[2]
            pz = x * axis[0] + y * axis[1] + z * axis[2]
            out[c, 7] = min(out[c, 7], pz)
            inside = grow_box(out, c, px, py, pz, reach[g, 5])
            dx = direction[i, 0] * right[0] + direction[i, 1] * right[1] + direction[i, 2] * right[2]
            dy = direction[i, 0] * down[0] + direction[i, 1] * down[1] + direction[i, 2] * down[2]
            dz = direction[i, 0] * axis[0] + direction[i, 1] * axis[1] + direction[i, 2] * axis[2]
            height = (position[i, 0] - centre[0]) * normal[0]
            height += (position[i, 1] - centre[1]) * normal[1] + (position[i, 2] - centre[2]) * normal[2]
            for turn in range(5 if lens[g, 0] > 0.0 else 1):
                ax, ay, az = widened(dx, dy, dz, turn, lens[g, 0], lens[g, 1])
                t = ray_end(height, ax * nx + ay * ny + az * nz, reach[g, 3], reach[g, 4])
                inside &= grow_box(out, c, px + t * ax, py + t * ay, pz + t * az, reach[g, 5])
            out[c, 4] += 0.0 if inside else 1.0
            for step in (1, width):
                if step == 1 and (pixel[i] + 1) % width == 0:
                    continue
                if pixel[i] + step >= place.shape[0] or pz <= 0.0:
                    continue
                j = place[pixel[i] + step]
                if j < 0 or cluster[j] != cluster[i]:
                    continue
                x, y, z = position[j, 0] - ex, position[j, 1] - ey, position[j, 2] - ez
                depth = x * axis[0] + y * axis[1] + z * axis[2]
                if depth <= 0.0:
                    continue
                u = (x * right[0] + y * right[1] + z * right[2]) / depth - px / pz
                v = (x * down[0] + y * down[1] + z * down[2]) / depth - py / pz
                out[c, 5] += math.sqrt(u * u + v * v)
                out[c, 6] += 1.0


@kernel(inline=True)
def widened(x, y, z, turn, sine, cosine):
    """The direction itself (turn 0), or turned by the lobe's half angle towards one of four sides."""
    if turn == 0:
        return x, y, z
    across = math.sqrt(x * x + z * z)
    ux, uz = (z / across, -x / across) if across > 1e-9 else (1.0, 0.0)
    vx, vy, vz = y * uz, z * ux - x * uz, -y * ux
    if turn >= 3:
        ux, uy, uz = vx, vy, vz
    else:
        uy = 0.0
    if turn % 2 == 0:
        ux, uy, uz = -ux, -uy, -uz
    return cosine * x + sine * ux, cosine * y + sine * uy, cosine * z + sine * uz
