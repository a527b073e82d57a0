"""Binary trees over points: median splits across the principal axis, and the nodes of every level."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import fetch_add
from torchrender.kernels.compile import kernel


class Limits(NamedTuple):
    """When a run of points is a patch."""

    n_min: int  # points: always
    n_max: int  # points: where it is flat and its normals agree
    sigma_max: float  # flatness
    cone_max: float  # half angle of the normals


class Headers(NamedTuple):
    """What is known of N patches."""

    starts: np.ndarray  # (N,L+1) first node of each level
    table: np.ndarray  # (N,L,3) least, mean and greatest radius
    boxes: np.ndarray  # (N,2,3) low and high corner
    cones: np.ndarray  # (N,4) axis and half angle of the normals
    sigma: np.ndarray  # (N,) flatness


@kernel()
def moments(position, order, low, high):
    """Mean (3) and covariance (xx, xy, xz, yy, yz, zz) of some of the points."""
    count = high - low
    mx, my, mz = 0.0, 0.0, 0.0
    # Relative to the first point: far from the origin the sums would lose the small differences.
    x0, y0, z0 = position[order[low], 0], position[order[low], 1], position[order[low], 2]
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(low, high):
        x, y, z = position[order[k], 0] - x0, position[order[k], 1] - y0, position[order[k], 2] - z0
        mx += x
        my += y
        mz += z
        xx += x * x
        xy += x * y
        xz += x * z
        yy += y * y
        yz += y * z
        zz += z * z
    s = 1.0 / count
    mx, my, mz = mx * s, my * s, mz * s
    covariance = (xx * s - mx * mx, xy * s - mx * my, xz * s - mx * mz, yy * s - my * my, yz * s - my * mz,
                  zz * s - mz * mz)  # fmt: skip
    return (mx + x0, my + y0, mz + z0), covariance


@kernel()
def principal_axis(c):
    """Direction of the largest eigenvalue, by squaring the matrix five times; any axis if it is zero."""
    xx, xy, xz, yy, yz, zz = c
    for _ in range(5):
        trace = xx + yy + zz
        if not trace > 0.0:
            return 1.0, 0.0, 0.0
        s = 1.0 / trace
        xx, xy, xz, yy, yz, zz = xx * s, xy * s, xz * s, yy * s, yz * s, zz * s
        xx, xy, xz, yy, yz, zz = (
            xx * xx + xy * xy + xz * xz,
            xx * xy + xy * yy + xz * yz,
            xx * xz + xy * yz + xz * zz,
            xy * xy + yy * yy + yz * yz,
            xy * xz + yy * yz + yz * zz,
            xz * xz + yz * yz + zz * zz,
        )
    if xx >= yy and xx >= zz:
        return xx, xy, xz
    if yy >= zz:
        return xy, yy, yz
    return xz, yz, zz


@kernel()
def flatness(c):
    """sigma = l0 / (l0 + l1 + l2) from the eigenvalues of a covariance, 0 where it is zero (closed form)."""
    xx, xy, xz, yy, yz, zz = c
    trace = xx + yy + zz
    if not trace > 0.0:
        return 0.0
    s = 1.0 / trace
    xx, xy, xz, yy, yz, zz = xx * s, xy * s, xz * s, yy * s, yz * s, zz * s
    q = 1.0 / 3.0
    a, b, d = xx - q, yy - q, zz - q
    p = math.sqrt((a * a + b * b + d * d + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if p < 1e-12:
        return q
    det = a * (b * d - yz * yz) - xy * (xy * d - yz * xz) + xz * (xy * yz - b * xz)
    r = min(1.0, max(-1.0, det / (2.0 * p * p * p)))
    least = q + 2.0 * p * math.cos(math.acos(r) / 3.0 + 2.0 * math.pi / 3.0)
    return min(q, max(0.0, least))


@kernel()
def cone(normal, order, low, high):
    """Axis and half angle of the cone of the normals; pi where one is missing or they cancel."""
    ax, ay, az = 0.0, 0.0, 0.0
    known = True
    for k in range(low, high):
        x, y, z = normal[order[k], 0], normal[order[k], 1], normal[order[k], 2]
        known = known and (x != 0.0 or y != 0.0 or z != 0.0)
        ax += x
        ay += y
        az += z
    length = math.sqrt(ax * ax + ay * ay + az * az)
    if not known or length < 1e-6:
        return 0.0, 0.0, 1.0, math.pi
    ax, ay, az = ax / length, ay / length, az / length
    least = 1.0
    for k in range(low, high):
        cosine = ax * normal[order[k], 0] + ay * normal[order[k], 1] + az * normal[order[k], 2]
        least = min(least, cosine)
    # float32 normals are off unit length by 1e-7: acos would turn that into 5e-4 too little.
    return ax, ay, az, math.acos(max(-1.0, least - 1e-6))


@kernel()
def select(key, order, low, high, middle):
    """Quickselect: the smallest keys before ``middle``, the others after it; both arrays move together."""
    left, right = low, high - 1
    while left < right:
        a, b, c = key[left], key[(left + right) // 2], key[right]
        pivot = max(min(a, b), min(max(a, b), c))
        i, j = left, right
        while i <= j:
            while key[i] < pivot:
                i += 1
            while key[j] > pivot:
                j -= 1
            if i <= j:
                key[i], key[j] = key[j], key[i]
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            right = j
        elif middle >= i:
            left = i
        else:
            return


@kernel()
def halve(position, order, key, low, high, covariance):
    """Split at the median across the principal axis; returns the first place of the right half."""
    ax, ay, az = principal_axis(covariance)
    first = order[low]
    x0, y0, z0 = position[first, 0], position[first, 1], position[first, 2]
    for k in range(low, high):
        p = order[k]
        key[k] = (position[p, 0] - x0) * ax + (position[p, 1] - y0) * ay + (position[p, 2] - z0) * az
    middle = low + (high - low + 1) // 2
    if middle < high:
        select(key, order, low, high, middle)
    return middle


@kernel(parallel=True)
def split_segments(points, order, key, segments, limits, threads, middle):
    """Each segment (low, high) of ``order`` becomes a patch (middle -1), or is split there.

    ``points``: :class:`Nodes`; ``limits``: :class:`Limits`; ``key`` (P,) is scratch.
    """
    position, normal = points.position, points.normal
    counter = np.zeros(1, np.int64)
    for worker in prange(threads):
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= len(segments):
                break
            low, high = segments[turn, 0], segments[turn, 1]
            middle[turn] = -1
            if high - low <= limits.n_min:
                continue
            covariance = moments(position, order, low, high)[1]
            if high - low <= limits.n_max and flatness(covariance) <= limits.sigma_max:
                if cone(normal, order, low, high)[3] <= limits.cone_max:
                    continue
            middle[turn] = halve(position, order, key, low, high, covariance)


@kernel()
def split_patch(position, order, key, low, high):
    """Median splits down to single points: afterwards every node is a run of points, found by halving."""
    stack = np.zeros((64, 2), np.int64)
    stack[0, 0], stack[0, 1] = low, high
    depth = 1
    while depth > 0:
        depth -= 1
        low, high = stack[depth, 0], stack[depth, 1]
        if high - low < 3:
            continue
        covariance = moments(position, order, low, high)[1]
        middle = halve(position, order, key, low, high, covariance)
        stack[depth, 0], stack[depth, 1] = low, middle
        stack[depth + 1, 0], stack[depth + 1, 1] = middle, high
        depth += 2


@kernel()
def levels_of(count):
    """Number of levels of a patch: the deepest holds every point, those above 1, 2, 4 ... nodes."""
    levels, width = 1, 1
    while width < count:
        width *= 2
        levels += 1
    return levels


@kernel()
def merge(nodes, weight, parent, first, pair):
    """One node from its one or two children: weighted means, and a radius that encloses theirs."""
    position, normal, radius, color, has_color = nodes
    total = weight[first]
    if pair:
        total += weight[first + 1]
    share = weight[first] / total if pair and total > 0.0 else 1.0 - 0.5 * pair
    second = first + pair
    for c in range(3):
        position[parent, c] = share * position[first, c] + (1.0 - share) * position[second, c]
        normal[parent, c] = share * normal[first, c] + (1.0 - share) * normal[second, c]
        if has_color:
            color[parent, c] = share * color[first, c] + (1.0 - share) * color[second, c]
    reach = 0.0
    for child in range(first, second + 1):
        x = np.float64(position[child, 0]) - position[parent, 0]
        y = np.float64(position[child, 1]) - position[parent, 1]
        z = np.float64(position[child, 2]) - position[parent, 2]
        reach = max(reach, math.sqrt(x * x + y * y + z * z) + radius[child])
    # Rounding to float32 must not leave a child outside.
    radius[parent] = reach * (1.0 + 1e-6) if pair else radius[first]
    weight[parent] = total


@kernel(parallel=True)
def fill_nodes(points, order, key, patches, threads, nodes, weight, headers):
    """Nodes of every patch, breadth first, and its header.

    ``points``: :class:`Nodes` of the input, positions float64; ``patches`` (N,2) runs of ``order``; ``nodes``:
    :class:`Nodes`, filled, positions relative to the box's centre; ``weight`` (T,) of each, and ``key`` (P,): scratch;
    ``headers``: :class:`Headers`, filled.
    """
    in_position, in_normal, in_radius, in_color, _ = points
    position, normal, radius, color, has_color = nodes
    starts, table, boxes, cones, sigma = headers
    counter = np.zeros(1, np.int64)
    for worker in prange(threads):
        while True:
            turn = fetch_add(counter, 0, 1)
            if turn >= len(patches):
                break
            low, high = patches[turn, 0], patches[turn, 1]
            count = high - low
            split_patch(in_position, order, key, low, high)
            sigma[turn] = flatness(moments(in_position, order, low, high)[1])
            cones[turn, 0], cones[turn, 1], cones[turn, 2], cones[turn, 3] = cone(in_normal, order, low, high)
            for c in range(3):
                boxes[turn, 0, c], boxes[turn, 1, c] = np.inf, -np.inf
            for k in range(low, high):
                for c in range(3):
                    boxes[turn, 0, c] = min(boxes[turn, 0, c], in_position[order[k], c])
                    boxes[turn, 1, c] = max(boxes[turn, 1, c], in_position[order[k], c])
            levels = levels_of(count)
            last = starts[turn, levels - 1]
            for k in range(count):
                p = order[low + k]
                for c in range(3):
                    centre = 0.5 * (boxes[turn, 0, c] + boxes[turn, 1, c])
                    position[last + k, c] = in_position[p, c] - centre
                    normal[last + k, c] = in_normal[p, c]
                    if has_color:
                        color[last + k, c] = in_color[p, c]
                radius[last + k] = in_radius[p]
                weight[last + k] = np.float64(in_radius[p]) * in_radius[p]
            for level in range(levels - 2, -1, -1):
                child = starts[turn, level + 1]
                for k in range(1 << level):
                    # Below the last but one level every node has two children; there, one where it holds one point.
                    pair = 1
                    if level == levels - 2 and size_of(count, level, k) == 1:
                        pair = 0
                    merge(nodes, weight, starts[turn, level] + k, child, pair)
                    child += 1 + pair
            for level in range(levels):
                finish_level(normal, radius, starts[turn, level], starts[turn, level + 1], table[turn, level])
            for level in range(levels, table.shape[1]):
                for c in range(3):
                    table[turn, level, c] = table[turn, levels - 1, c]


@kernel()
def size_of(count, level, number):
    """Points under a node: halving ``count``, the larger half first, along the bits of ``number``."""
    for bit in range(level - 1, -1, -1):
        count = count // 2 if (number >> bit) & 1 else (count + 1) // 2
    return count


@kernel()
def finish_level(normal, radius, first, end, row):
    """Normals to unit length (zero stays), and the radii of a level in numbers."""
    least, total, most = np.inf, 0.0, 0.0
    for k in range(first, end):
        x, y, z = np.float64(normal[k, 0]), np.float64(normal[k, 1]), np.float64(normal[k, 2])
        length = math.sqrt(x * x + y * y + z * z)
        s = 1.0 / length if length > 1e-6 else 0.0
        normal[k, 0], normal[k, 1], normal[k, 2] = x * s, y * s, z * s
        least = min(least, np.float64(radius[k]))
        most = max(most, np.float64(radius[k]))
        total += radius[k]
    row[0], row[1], row[2] = least, total / (end - first), most
