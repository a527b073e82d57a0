"""Searches for what hides the sky from a visible point, along slices through the eye of depth images around it.

A slice is a plane through the eye and the point. Within it, everything is flat: a surface that the eye sees at an angle
``b`` from the point, at distance ``r``, lies at the angle ``atan2(r sin b, r0 - r cos b)`` from the direction to the
eye, where ``r0`` is the point's own distance. Directions of a slice are kept as 32 sectors to either side of the eye.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, keep
from torchrender.kernels.compile import kernel

SECTORS = 32
PATTERN = 16
"""Points of a tile of 4 x 4 search along different slices, at different steps; their mean stands for all of them."""


LEVEL = np.float32(0.02)
"""Sine of the angle to a point's plane below which surfaces belong to it: normals are no more exact."""


class Surroundings(NamedTuple):
    """Depth of the surfaces around one eye, float32, +inf where there is none.

    Faces of the cube look along +x -x +y -y +z -z of the camera's frame. Columns and rows go along the two other axes
    in turn (y z, z y, z x, x z, x y, y x), so that every face is a camera.
    """

    front: np.ndarray  # (H,W) of the picture's own view
    back: np.ndarray  # (h,w) of the nearest surface that is seen from behind, in the same view
    lens: np.ndarray  # (4,) fx, fy, cx, cy of that view, pixels of ``front``
    cube_front: np.ndarray  # (6,S,S); S = 0: none
    cube_back: np.ndarray


class Points(NamedTuple):
    """What is asked for, in the camera's frame."""

    direction: np.ndarray  # (N,3) float32 unit, from the eye
    distance: np.ndarray  # (N,)
    normal: np.ndarray  # (N,3) unit, towards the eye
    number: np.ndarray  # (N,) int64 in the pattern


class Search(NamedTuple):
    """How thoroughly."""

    slices: int
    steps: np.ndarray  # (PATTERN,S) float32 ascending: 0 the point, 1 the end of its reach, 2 once around
    first: float  # angle of the nearest step
    reach: float  # what is farther away hides no near light
    joined: float  # surfaces at neighbouring steps are one if their distances differ by less than this times the step
    thickness: float  # of surfaces that are seen from behind, in their distance


@kernel(inline=True, counted=False)
def cube_place(x, y, z, size):
    """Face, row and column of a direction, and its component along the face's axis."""
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        face, major, u, v = (0, ax, y, z) if x > 0 else (1, ax, z, y)
    elif ay >= az:
        face, major, u, v = (2, ay, z, x) if y > 0 else (3, ay, x, z)
    else:
        face, major, u, v = (4, az, x, y) if z > 0 else (5, az, y, x)
    scale = np.float32(0.5) * np.float32(size) / major
    half = np.float32(0.5) * np.float32(size)
    column = min(max(np.int64(u * scale + half), 0), size - 1)
    row = min(max(np.int64(v * scale + half), 0), size - 1)
    return face, row, column, major


@kernel(inline=True, counted=False)
def cube_point(face, j, i, size, depth):
    """What the centre of a face's pixel sees at that depth."""
    u = (np.float32(2 * i + 1) / np.float32(size) - np.float32(1.0)) * depth
    v = (np.float32(2 * j + 1) / np.float32(size) - np.float32(1.0)) * depth
    if face < 2:
        return (depth, u, v) if face == 0 else (-depth, v, u)
    if face < 4:
        return (v, depth, u) if face == 2 else (u, -depth, v)
    return (u, v, depth) if face == 4 else (v, u, -depth)


@kernel(inline=True, counted=False)
def distances(around, x, y, z):
    """Distance to the front and to the back of what lies in a direction, and the point that its pixel's centre sees.

    Negative: not known.
    """
    height, width = around.front.shape
    if z > np.float32(1e-6):
        one, half = np.float32(1.0), np.float32(0.5)
        fx, fy, cx, cy = around.lens[0], around.lens[1], around.lens[2], around.lens[3]
        inverse, share = one / z, np.float32(around.back.shape[0]) / np.float32(height)
        column, row = x * inverse * fx + cx, y * inverse * fy + cy
        if column >= 0 and column < width and row >= 0 and row < height:
            j = np.uintp(min(np.int64(row * share), around.back.shape[0] - 1))
            i = np.uintp(min(np.int64(column * share), around.back.shape[1] - 1))
            depth = around.front[np.uintp(row), np.uintp(column)]
            px = (np.floor(column) + half - cx) * (one / fx) * depth
            py = (np.floor(row) + half - cy) * (one / fy) * depth
            return depth * inverse, around.back[j, i] * inverse, px, py, depth
    size = around.cube_front.shape[1]
    if size == 0:
        return np.float32(-1.0), np.float32(-1.0), np.float32(0.0), np.float32(0.0), np.float32(0.0)
    face, j, i, major = cube_place(x, y, z, size)
    inverse = np.float32(1.0) / major
    depth = around.cube_front[np.uintp(face), np.uintp(j), np.uintp(i)]
    px, py, pz = cube_point(face, j, i, size, depth)
    return depth * inverse, around.cube_back[np.uintp(face), np.uintp(j), np.uintp(i)] * inverse, px, py, pz


@kernel(inline=True, counted=False)
def sector(along, across):
    """Place in 0..SECTORS of an angle in [0, pi] with that cosine and sine, of any length: even steps of a diamond."""
    size = abs(along) + across
    share = along / max(size, np.float32(1e-30))
    return (np.float32(1.0) - share) * np.float32(SECTORS // 2)


@kernel(inline=True, counted=False)
def between(low, high):
    """Bits of the sectors whose middles lie between two places."""
    first = np.int64(max(low + np.float32(0.5), np.float32(0.0)))
    last = np.int64(min(high + np.float32(0.5), np.float32(SECTORS)))
    if last <= first:
        return np.uint64(0)
    return ((np.uint64(1) << np.uint64(last - first)) - np.uint64(1)) << np.uint64(first)


@kernel(counted=False)
def end_of_plane(r0, older, last, angle):
    """Place and squared distance of the middle between the last step and ``angle``, on the plane of two steps.

    The inverse distances of a plane are ``A cos b + B sin b``. With one step, the surface is a sphere about the eye.
    """
    middle = np.float32(0.5) * (last[1] + angle)
    r = last[0]
    if older[0] > np.float32(0.0):
        inverse = math.sin(last[1] - middle) / older[0] + math.sin(middle - older[1]) / last[0]
        turn = math.sin(last[1] - older[1])
        if inverse > np.float32(0.25) * turn / last[0]:
            r = np.float32(turn / inverse)
        else:
            r = np.float32(4.0) * last[0]
    along, across = r0 - r * np.float32(math.cos(middle)), r * np.float32(math.sin(middle))
    return sector(along, across), along * along + across * across


@kernel(counted=False)
def search_side(around, point, normal, tangent, steps, search):
    """Sectors that are hidden on one side: by anything, and by what is within reach."""
    dx, dy, dz, r0 = point
    plane = r0 * (dx * normal[0] + dy * normal[1] + dz * normal[2])
    tx, ty, tz = tangent
    hidden, near = np.uint64(0), np.uint64(0)
    before = before_place = older = np.float32(-1.0)
    before_angle = older_angle = before_apart = np.float32(0.0)
    far, lowest, sees_sky = np.float32(np.inf), np.float32(SECTORS), False
    reach = np.float32(search.reach) * np.float32(search.reach)
    for s in range(steps.shape[0]):
        angle, c, w = steps[s, 0], steps[s, 1], steps[s, 2]
        front, back, qx, qy, qz = distances(around, c * dx + w * tx, c * dy + w * ty, c * dz + w * tz)
        if front < np.float32(0.0):
            sees_sky = True
            break
        ends = before > np.float32(0.0) and before_place < np.float32(SECTORS)
        if ends and front > before + np.float32(search.joined) * (angle - before_angle) * before:
            # What was seen last ends somewhere between the two steps: half-way, on average.
            place, apart = end_of_plane(r0, (older, older_angle), (before, before_angle), angle)
            link = between(place, before_place)
            hidden |= link
            if apart + before_apart < np.float32(2.0) * reach:
                near |= link
        if front == far:
            sees_sky = True
            before = older = np.float32(-1.0)
            continue
        along, across = r0 - front * c, front * w
        place = sector(along, across)
        over = qx * normal[0] + qy * normal[1] + qz * normal[2] - plane
        if over < LEVEL * math.sqrt(along * along + across * across):  # the point's own plane hides nothing
            place = np.float32(SECTORS)
        lowest = min(lowest, place)
        if back <= front * np.float32(1.0001):
            back = front * (np.float32(1.0) + np.float32(search.thickness))
        if back == far or back <= front * np.float32(1.0001):
            back = front * (np.float32(1.0) + np.float32(search.thickness))
        end = sector(-c, w) if back == far else sector(r0 - back * c, back * w)
        bits = between(place, end)
        apart = along * along + across * across
        is_near = apart < reach
        if before > np.float32(0.0):
            step = angle - before_angle
            if abs(front - before) <= np.float32(search.joined) * step * min(front, before):
                link = between(place, before_place)
                bits |= link
                if apart + before_apart < np.float32(2.0) * reach:
                    near |= link
                older, older_angle = before, before_angle
            else:
                older = np.float32(-1.0)
        hidden |= bits
        if is_near:
            near |= bits
        before, before_place, before_angle, before_apart = front, place, angle, apart
    if not sees_sky:  # the eye is shut in on this side: so is what it sees
        hidden |= between(lowest, np.float32(SECTORS))
    return hidden, near


@kernel(counted=False)
def spread_steps(share, first, reach, steps):
    """Angles from the point, their cosines and sines (S,3): some within the angle of the reach, some all around."""
    last = np.float32(math.pi) - np.float32(0.01)
    middle = min(max(reach, np.float32(4.0) * first), np.float32(1.5))
    for s in range(share.shape[0]):
        near, far = min(share[s], np.float32(1.0)), max(share[s] - np.float32(1.0), np.float32(0.0))
        angle = first + (middle - first) * near * near + (last - middle) * far * far
        steps[s, 0] = angle
        steps[s, 1] = np.float32(math.cos(angle))
        steps[s, 2] = np.float32(math.sin(angle))


@kernel(counted=False)
def visible_share(hidden, near, angles, normal):
    """Sums over the sectors of one side, cosine-weighted: (share, direction in the plane) of the open ones and of all
    of them, and the share that is open to what is within reach.

    ``angles`` (SECTORS,3): cosine, sine and width of each sector; ``normal``: the cosine and the sine, to this side, of
    the angle between the normal in the plane and the direction to the eye.
    """
    total = along = across = most = all_along = all_across = close = np.float32(0.0)
    for k in range(SECTORS):
        c, s = angles[k, 0], angles[k, 1]
        weight = (c * normal[0] + s * normal[1]) * s * angles[k, 2]
        if not weight > np.float32(0.0):
            continue
        most += weight
        all_along += weight * c
        all_across += weight * s
        if not (near >> np.uint64(k)) & np.uint64(1):
            close += weight
        if not (hidden >> np.uint64(k)) & np.uint64(1):
            total += weight
            along += weight * c
            across += weight * s
    return (total, along, across), (most, all_along, all_across), close


@kernel(counted=False)
def measure_point(around, point, normal, number, tables, search, steps):
    """Share of the whole sky, of near light, and the way (three values) to where the sky is open.

    That way is the mean of the open directions less the visible share of the mean of all that were looked at: nothing
    where nothing is hidden, so that few slices do not turn the light there.
    """
    dx, dy, dz, r0 = point
    share = np.float32(search.reach) / r0
    within = np.float32(math.asin(share)) if share < np.float32(1.0) else np.float32(1.5)
    spread_steps(search.steps[number], np.float32(search.first), within, steps)
    angles, turns = tables
    # Two directions at right angles to the ray.
    sign = np.float32(1.0) if dz >= 0 else np.float32(-1.0)
    a = np.float32(-1.0) / (sign + dz)
    b = dx * dy * a
    ux, uy, uz = np.float32(1.0) + sign * dx * dx * a, sign * b, -sign * dx
    vx, vy, vz = b, sign + dy * dy * a, -dy
    sky = most = close = bx = by = bz = ax = ay = az = np.float32(0.0)
    to_eye = -(normal[0] * dx + normal[1] * dy + normal[2] * dz)
    for k in range(search.slices):
        turn = (np.float32(k) + turns[number]) * np.float32(math.pi) / np.float32(search.slices)
        cu, cv = np.float32(math.cos(turn)), np.float32(math.sin(turn))
        tx, ty, tz = cu * ux + cv * vx, cu * uy + cv * vy, cu * uz + cv * vz
        lean = normal[0] * tx + normal[1] * ty + normal[2] * tz
        for side in range(2):
            s = np.float32(1.0) - np.float32(2.0) * np.float32(side)
            facing = (to_eye, s * lean)
            hidden, near = search_side(around, point, normal, (s * tx, s * ty, s * tz), steps, search)
            seen, whole, nearby = visible_share(hidden, near, angles, facing)
            sky, close, most = sky + seen[0], close + nearby, most + whole[0]
            bx += seen[2] * s * tx - seen[1] * dx
            by += seen[2] * s * ty - seen[1] * dy
            bz += seen[2] * s * tz - seen[1] * dz
            ax += whole[2] * s * tx - whole[1] * dx
            ay += whole[2] * s * ty - whole[1] * dy
            az += whole[2] * s * tz - whole[1] * dz
    share = sky / most
    return share, close / most, (bx - share * ax) / most, (by - share * ay) / most, (bz - share * az) / most


@kernel(parallel=True)
def measure_points(around, points, tables, search, out):
    """``out`` (N,5) as :func:`measure_point` has it; ``tables``: sectors' angles, and turns (PATTERN,) of slices."""
    parts = 64
    for part in prange(parts):
        held = np.zeros((search.steps.shape[1], 3), np.float32)
        steps, room, asked = borrowed(held), borrowed(out), borrowed(points)
        near, told, how = borrowed(around), borrowed(tables), borrowed(search)
        for n in range(np.int64(part), asked.distance.shape[0], parts):
            d, m = asked.direction, asked.normal
            point = (d[n, 0], d[n, 1], d[n, 2], asked.distance[n])
            normal = (m[n, 0], m[n, 1], m[n, 2])
            found = measure_point(near, point, normal, asked.number[n], told, how, steps)
            room[n, 0], room[n, 1], room[n, 2], room[n, 3], room[n, 4] = found
        keep(held)
