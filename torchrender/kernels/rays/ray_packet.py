"""Packets of rays from one point through a triangle tree.

A packet is a thin pyramid that is tested against boxes as a whole; a triangle is tested against all rays at once in
homogeneous coordinates, without clipping or division. Edge functions of two triangles are exact negatives of each other
at a shared edge, so no ray slips through.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from torchrender.kernels.compile import kernel

GROUP = 64
"""Rays of one packet."""

DARK, LIT, OUTSIDE, TRACED, CHOSEN = 0, 1, 2, 3, 4
"""States of a ray: DARK and LIT are decided, TRACED is still to be traced, CHOSEN is in the packet."""

_SPREAD = 0.5  # rays of one packet lie within 60 degrees of its axis
_SMALL = 0.4  # boxes with a smaller share of the pyramid's section are tested against each ray
_HAIR = 1e-9  # widens the pyramid so that rounding cannot cut off its own rays


class Packet(NamedTuple):
    """Rays from one point, as a thin pyramid; scratch that :func:`make_packet` fills."""

    axes: np.ndarray  # (3,3) two vectors across, then the direction
    planes: np.ndarray  # (5,7)
    rays: np.ndarray  # (3,GROUP) x, y and limit of each; limit 0: not in the packet, or blocked


@kernel(inline=True)
def _axes(x, y, z, axes):
    """An orthonormal frame (3,3) in ``axes``: two vectors across the direction, then the unit direction."""
    length = np.sqrt(x * x + y * y + z * z)
    x, y, z = x / length, y / length, z / length
    # Duff et al., Building an orthonormal basis, revisited, 2017.
    sign = np.copysign(1.0, z)
    a = -1.0 / (sign + z)
    b = x * y * a
    axes[0, 0], axes[0, 1], axes[0, 2] = 1.0 + sign * x * x * a, sign * b, -sign * x
    axes[1, 0], axes[1, 1], axes[1, 2] = b, sign + y * y * a, -y
    axes[2, 0], axes[2, 1], axes[2, 2] = x, y, z


@kernel(inline=True)
def make_packet(rays, status, pyramid):
    """Choose rays around one that is still to trace: fills the packet (x, y, limit) and the planes (5,7).

    Rows of ``planes``: four sides with normal (3) and absolute normal (3), inside where ``n.p >= 0``; the axis in the
    same way, and a quarter of the pyramid's cross section.
    Returns the number of chosen rays and the largest limit; chosen rays get limit > 0.
    """
    axes, planes, packet = pyramid
    count = status.shape[0]
    first = 0
    while first < count and status[first] != TRACED:
        first += 1
    if first == count:
        return 0, 0.0
    middle = first
    for j in range(first, (first + count) // 2 + 1):
        if j < count and status[j] == TRACED:
            middle = j
    _axes(rays[middle, 0], rays[middle, 1], rays[middle, 2], axes)
    left = low = np.inf
    right = high = -np.inf
    farthest, chosen = 0.0, 0
    for j in range(count):
        packet[2, j] = 0.0
        if status[j] != TRACED:
            continue
        x, y, z = rays[j, 0], rays[j, 1], rays[j, 2]
        along = axes[2, 0] * x + axes[2, 1] * y + axes[2, 2] * z
        if not along > _SPREAD * np.sqrt(x * x + y * y + z * z):
            continue
        a = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) / along
        b = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z) / along
        packet[0, j], packet[1, j], packet[2, j] = a, b, rays[j, 3] * along
        left, right, low, high = min(left, a), max(right, a), min(low, b), max(high, b)
        farthest = max(farthest, packet[2, j])
        status[j] = CHOSEN
        chosen += 1
    bounds = (left - _HAIR, -right - _HAIR, low - _HAIR, -high - _HAIR)
    for k in range(4):
        sign = 1.0 if k % 2 == 0 else -1.0
        for m in range(3):
            planes[k, m] = sign * axes[k // 2, m] - bounds[k] * axes[2, m]
            planes[k, 3 + m] = abs(planes[k, m])
    for m in range(3):
        planes[4, m] = axes[2, m]
        planes[4, 3 + m] = abs(axes[2, m])
    planes[4, 6] = 0.25 * (right - left) * (high - low)
    return chosen, farthest


@kernel(inline=True)
def _meets(boxes, node, origin, farthest, pyramid):
    """An unblocked ray of the packet may meet the box in front of its limit."""
    ox, oy, oz = origin
    axes, planes, packet = pyramid
    hx, hy, hz = (
        0.5 * (np.float64(boxes[node, 3]) - boxes[node, 0]),
        0.5 * (np.float64(boxes[node, 4]) - boxes[node, 1]),
        0.5 * (np.float64(boxes[node, 5]) - boxes[node, 2]),
    )
    x, y, z = boxes[node, 0] + hx - ox, boxes[node, 1] + hy - oy, boxes[node, 2] + hz - oz
    for k in range(4):
        reach = planes[k, 3] * hx + planes[k, 4] * hy + planes[k, 5] * hz
        if planes[k, 0] * x + planes[k, 1] * y + planes[k, 2] * z + reach < 0.0:
            return False
    wx, wy, wz = axes[2, 0], axes[2, 1], axes[2, 2]
    along = wx * x + wy * y + wz * z
    reach = planes[4, 3] * hx + planes[4, 4] * hy + planes[4, 5] * hz
    nearest = along - reach
    if along + reach <= 0.0 or nearest >= farthest:
        return False
    if nearest <= 0.0:
        return True
    a = (axes[0, 0] * x + axes[0, 1] * y + axes[0, 2] * z) / along
    b = (axes[1, 0] * x + axes[1, 1] * y + axes[1, 2] * z) / along
    inverse = 1.0 / nearest
    ra = _HAIR + inverse * (
        abs(axes[0, 0] - a * wx) * hx + abs(axes[0, 1] - a * wy) * hy + abs(axes[0, 2] - a * wz) * hz
    )
    rb = _HAIR + inverse * (
        abs(axes[1, 0] - b * wx) * hx + abs(axes[1, 1] - b * wy) * hy + abs(axes[1, 2] - b * wz) * hz
    )
    if ra * rb > _SMALL * planes[4, 6]:
        return True
    a0, a1, b0, b1 = a - ra, a + ra, b - rb, b + rb
    inside = np.int64(0)
    for j in range(np.uintp(GROUP)):
        px, py = packet[0, j], packet[1, j]
        inside += np.int64((px >= a0) & (px <= a1) & (py >= b0) & (py <= b1) & (packet[2, j] > nearest))
    return inside > 0


@kernel(inline=True)
def _block_rays(corners, slot, origin, near, farthest, pyramid):
    """Set the limits of all rays that the triangle blocks to zero; returns how many."""
    ox, oy, oz = origin
    axes, planes, packet = pyramid
    x, y, z = corners[slot, 0] - ox, corners[slot, 1] - oy, corners[slot, 2] - oz
    x1, y1, z1 = corners[slot, 3] - ox, corners[slot, 4] - oy, corners[slot, 5] - oz
    x2, y2, z2 = corners[slot, 6] - ox, corners[slot, 7] - oy, corners[slot, 8] - oz
    for k in range(4):
        p, q, r = planes[k, 0], planes[k, 1], planes[k, 2]
        if p * x + q * y + r * z < 0.0 and p * x1 + q * y1 + r * z1 < 0.0 and p * x2 + q * y2 + r * z2 < 0.0:
            return 0
    p, q, r = axes[2, 0], axes[2, 1], axes[2, 2]
    at, bt, ct = p * x + q * y + r * z, p * x1 + q * y1 + r * z1, p * x2 + q * y2 + r * z2
    if min(at, min(bt, ct)) >= farthest or max(at, max(bt, ct)) <= near:
        return 0
    p, q, r = axes[0, 0], axes[0, 1], axes[0, 2]
    ax, bx, cx = p * x + q * y + r * z, p * x1 + q * y1 + r * z1, p * x2 + q * y2 + r * z2
    p, q, r = axes[1, 0], axes[1, 1], axes[1, 2]
    ay, by, cy = p * x + q * y + r * z, p * x1 + q * y1 + r * z1, p * x2 + q * y2 + r * z2
    # Normals of the three planes through the light sample and an edge: (y t' - t y', t x' - x t', x y' - y x').
    ux, uy, ut = by * ct - bt * cy, bt * cx - bx * ct, bx * cy - by * cx
    vx, vy, vt = cy * at - ct * ay, ct * ax - cx * at, cx * ay - cy * ax
    wx, wy, wt = ay * bt - at * by, at * bx - ax * bt, ax * by - ay * bx
    det = ax * ux + ay * uy + at * ut
    if det == 0.0:
        return 0
    if det < 0.0:
        det = -det
        ux, uy, ut, vx, vy, vt, wx, wy, wt = -ux, -uy, -ut, -vx, -vy, -vt, -wx, -wy, -wt
    blocked = np.int64(0)
    for j in range(np.uintp(GROUP)):
        px, py, limit = packet[0, j], packet[1, j], packet[2, j]
        u = ux * px + uy * py + ut
        v = vx * px + vy * py + vt
        w = wx * px + wy * py + wt
        total = u + v + w
        hit = (u >= 0.0) & (v >= 0.0) & (w >= 0.0) & (det < limit * total) & (det > near * total)
        packet[2, j] = 0.0 if hit else limit
        blocked += np.int64(hit)
    return blocked


@kernel(inline=True)
def block_listed(corners, slots, count, origin, near, farthest, alive, pyramid):
    """Block rays of a packet by the first ``count`` triangles of ``slots``.

    What blocks moves towards the front: it is likely to block the next packet, too.
    """
    for n in range(count):
        slot = np.int64(slots[n])
        blocked = _block_rays(corners, slot, origin, near, farthest, pyramid)
        if blocked > 0:
            ahead = n >> 1
            slots[n], slots[ahead] = slots[ahead], slots[n]
            alive -= blocked
            if alive <= 0:
                return


@kernel(inline=True)
def block_packet(tree, origin, near, farthest, alive, pyramid, stack):
    """Block rays of a packet until none is left or the tree is done."""
    boxes, links, _, corners, frame = tree
    within = (origin[0] - frame[0], origin[1] - frame[1], origin[2] - frame[2])
    if not _meets(boxes, 1, within, farthest, pyramid):
        return
    size, node = 0, np.int64(1)
    while True:
        left, right = np.int64(links[node, 0]), np.int64(links[node, 1])
        if left < 0:
            for slot in range(-left - 1, -left - 1 + right):
                alive -= _block_rays(corners, slot, origin, near, farthest, pyramid)
            if alive <= 0:
                return
        else:
            a = _meets(boxes, left, within, farthest, pyramid)
            b = _meets(boxes, right, within, farthest, pyramid)
            if a:
                if b:
                    stack[size] = right
                    size += 1
                node = left
                continue
            if b:
                node = right
                continue
        if size == 0:
            return
        size -= 1
        node = np.int64(stack[size])
