"""Points to screen-space ellipses: elliptical weighted averaging with the cheapest filter that is good enough.

One record per point that may be seen, in float32; everything that leads to it is computed in float64. Depth is kept as
its inverse, which is affine over the image of a plane.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, fetch_add
from torchrender.kernels.compile import kernel
from torchrender.kernels.points.records import Splat, Target

FULL, RECONSTRUCTION, LOW_PASS, SQUARE, EACH_POINT = 0, 1, 2, 3, 4
"""How a point is filtered; the last one: decided point by point."""

# Places in a record.
U, V, INVERSE_Z, SLOPE_X, SLOPE_Y, INVERSE_LOW, INVERSE_HIGH = 0, 1, 2, 3, 4, 5, 6
XX, XY, YY, SCALE, TOLERANCE, RED, GREEN, BLUE = 7, 8, 9, 10, 11, 12, 13, 14
RECORD = 16
BOX = 5  # first and last column, first and last row, filter

# What is counted.
BEHIND, BACK, OUTSIDE, DEGENERATE, LARGE, CAPPED, MODES = 0, 1, 2, 3, 4, 5, 6
COUNTS = 10

THIN = 1e-12  # determinant of the ellipse, px^4, below which nothing is drawn
FLOOR = 1e-4  # px^2 added to an ellipse that has no low-pass: it must not vanish between pixel centres
STEEPEST = 16.0  # tangent of the angle between normal and view up to which the tolerance of depth grows
COARSE = 0.2  # radius over depth from which on the affine projection is wrong


@kernel(inline=True)
def screen_covariance(ox, oy, oz, n, k):
    """J J^T (xx, xy, yy) and |det J| of the projection of a plane, pixels per scene unit.

    J J^T = A (I - n n^T) A^T; det J = fx fy (o.n) / oz^3 (specification 06, section 5, with skew).
    """
    s = 1.0 / oz
    a0, a1 = k[0, 0] * s, k[0, 1] * s
    a2 = -(k[0, 0] * ox + k[0, 1] * oy) * s * s
    b1, b2 = k[1, 1] * s, -k[1, 1] * oy * s * s
    an = a0 * n[0] + a1 * n[1] + a2 * n[2]
    bn = b1 * n[1] + b2 * n[2]
    xx = a0 * a0 + a1 * a1 + a2 * a2 - an * an
    xy = a1 * b1 + a2 * b2 - an * bn
    yy = b1 * b1 + b2 * b2 - bn * bn
    det = k[0, 0] * k[1, 1] * abs(ox * n[0] + oy * n[1] + oz * n[2]) * s * s * s
    return max(xx, 0.0), xy, max(yy, 0.0), det


@kernel(inline=True)
def choose_mode(xx, xy, yy, det, r2, area, filters):
    """Filter of one point. ``area``: S_proj / S_h."""
    if filters.by_axes:
        low = filters.r_h * filters.r_h
        half = 0.5 * (xx + yy)
        root = math.sqrt(max(0.25 * (xx - yy) * (xx - yy) + xy * xy, 0.0))
        most = half + root
        least = det * det / most if most > 0.0 else 0.0
        if r2 * least > filters.c_max * low:
            return RECONSTRUCTION
        return LOW_PASS if r2 * most < filters.c_min * low else FULL
    if area > filters.c_max:
        return RECONSTRUCTION
    return LOW_PASS if filters.c_eta * area < filters.c_min else FULL


@kernel(inline=True)
def put_box(u, v, rx, ry, border, lens, out):
    """Pixels whose centres lie within rx, ry of (u, v): False if there are none in the image.

    ``border``: pixels that the box may begin left of and above the image.
    """
    width, height, box = lens.width, lens.height, out.box
    if not (u + rx >= 0.5 and u - rx <= width - 0.5 and v + ry >= 0.5 and v - ry <= height - 0.5):
        out.tally[OUTSIDE] += 1
        return False
    if u - rx < -width or u + rx > 2 * width or v - ry < -height or v + ry > 2 * height:
        out.tally[CAPPED] += 1
    x0, x1 = math.ceil(max(u - rx - 0.5, -border)), math.floor(min(u + rx - 0.5, width - 1.0))
    y0, y1 = math.ceil(max(v - ry - 0.5, -border)), math.floor(min(v + ry - 0.5, height - 1.0))
    box[0], box[1], box[2], box[3] = x0, x1, y0, y1
    return x0 <= x1 and y0 <= y1


@kernel()
def clip_to_sphere(o, r, k, reach, box):
    """Cut a box down to the image of the sphere about a point, and ``reach`` pixels; False if nothing is left.

    The affine projection of a point that is wide against its depth covers pixels that its disc never reaches.
    """
    low_y, high_y = sphere_range(o[1], o[2], r)
    low_x, high_x = sphere_range(o[0], o[2], r)
    slant = abs(k[0, 1]) * (high_y - low_y) if k[0, 1] != 0.0 else 0.0
    low_u, high_u = k[0, 0] * low_x + k[0, 2] - reach - slant, k[0, 0] * high_x + k[0, 2] + reach + slant
    low_v, high_v = k[1, 1] * low_y + k[1, 2] - reach, k[1, 1] * high_y + k[1, 2] + reach
    if low_u - 0.5 > box[1] or high_u - 0.5 < box[0] or low_v - 0.5 > box[3] or high_v - 0.5 < box[2]:
        return False
    box[0], box[1] = max(box[0], math.ceil(max(low_u - 0.5, -1.0))), min(box[1], math.floor(min(high_u - 0.5, 4e4)))
    box[2], box[3] = max(box[2], math.ceil(max(low_v - 0.5, -1.0))), min(box[3], math.floor(min(high_v - 0.5, 4e4)))
    return box[0] <= box[1] and box[2] <= box[3]


@kernel()
def sphere_range(x, z, r):
    """Least and greatest x / z of a circle about (x, z); infinite where it reaches beside or behind the eye."""
    distance = math.sqrt(x * x + z * z)
    if distance <= r:
        return -np.inf, np.inf
    angle, half = math.atan2(x, z), math.asin(r / distance)
    low, high = -np.inf, np.inf
    if angle - half > -0.5 * math.pi:
        low = math.tan(angle - half)
    if angle + half < 0.5 * math.pi:
        high = math.tan(angle + half)
    return low, high


@kernel(inline=True)
def put_ellipse(xx, xy, yy, det, r2, low_pass, record):
    """The ellipse q <= 1 of r^2 J J^T + low_pass I; returns its half extents, negative if it is nothing, and |H|."""
    least = low_pass
    xx, xy, yy = r2 * xx, r2 * xy, r2 * yy
    if low_pass == 0.0:
        half = 0.5 * (xx + yy)
        most = half + math.sqrt(max(0.25 * (xx - yy) * (xx - yy) + xy * xy, 0.0))
        thin = (r2 * det) ** 2 / most if most > 0.0 else 0.0
        least = max(FLOOR - thin, 0.0)
    # In this form the determinant does not cancel for ellipses that are nearly edge-on.
    area = (r2 * det) ** 2 + least * (xx + yy) + least * least
    xx, yy = xx + least, yy + least
    if not area >= THIN:
        return -1.0, -1.0, 1.0
    record[XX], record[XY], record[YY] = yy / area, -2.0 * xy / area, xx / area
    return math.sqrt(xx), math.sqrt(yy), area


@kernel(inline=True)
def put_depth(splat, lens, record):
    """Inverse depth of the point's plane over the image, held within [z - r, z + r]."""
    n, k, oz, r = splat.n, lens.k, splat.z, splat.r
    offset = n[0] * splat.x + n[1] * splat.y + n[2] * oz
    gx = n[0] / (k[0, 0] * offset)
    gy = (n[1] - k[0, 1] * n[0] / k[0, 0]) / (k[1, 1] * offset)
    # Held in float32's range: edge-on, the limits below decide.
    record[SLOPE_X], record[SLOPE_Y] = min(max(gx, -1e30), 1e30), min(max(gy, -1e30), 1e30)
    record[INVERSE_LOW] = 1.0 / (oz + r)
    record[INVERSE_HIGH] = 1.0 / max(oz - r, lens.near)


@kernel(inline=True)
def depth_per_pixel(cosine, oz, focal):
    """How much a point's plane recedes over a pixel: z / f tan(theta), at least z / f, at most that at ``STEEPEST``.

    A low-pass spreads a point over its neighbours' pixels. On ground seen at a grazing angle these are much further
    or nearer than the radius of the point: without this, the nearest would hide all others instead of blending. What
    then shines through at outlines has a weight that is as small as its cosine.
    """
    slope = math.sqrt(max(1.0 - cosine * cosine, 0.0)) / max(cosine, 1e-9)
    return oz / focal * min(max(slope, 1.0), STEEPEST)


@kernel(inline=True)
def put_square(splat, u, v, focal, lens, out):
    """An opaque square of the point's projected size, at least a pixel."""
    side = max(splat.r * focal / splat.z, 0.5)
    out.record[SCALE], out.record[TOLERANCE] = 1.0, 0.0
    return put_box(u, v, side, side, 0.0, lens, out)


@kernel(inline=True)
def put_splat(splat, distance, mode, u, v, lens, filters, out):
    """Weight, ellipse, depth and box of a point that faces the eye; returns whether it is drawn, and its filter."""
    ox, oy, oz, n, r = splat
    k, record, r_h = lens.k, out.record, filters.r_h
    focal, r2, low = max(k[0, 0], k[1, 1]), r * r, r_h * r_h
    iz = 1.0 / oz
    cosine = -(n[0] * ox + n[1] * oy + n[2] * oz) / distance
    # |det J| = fx fy |n.o| / oz^3, in pixels per squared unit: weights stay in range for scenes of any size.
    area = k[0, 0] * k[1, 1] * cosine * iz * iz
    det = area * distance * iz
    xx, xy, yy = 0.0, 0.0, 0.0
    if mode != LOW_PASS:
        xx, xy, yy, det = screen_covariance(ox, oy, oz, n, k)
    if mode == EACH_POINT:
        mode = choose_mode(xx, xy, yy, det, r2, r2 * area / low, filters)
    if mode != RECONSTRUCTION:
        record[TOLERANCE] = filters.eps_scale * (r + r_h * depth_per_pixel(cosine, oz, focal))
    if mode == LOW_PASS:
        record[SCALE] = det * filters.unit * filters.peak / low
        return put_box(u, v, r_h, r_h, 8.0, lens, out), mode
    rx, ry, spread = put_ellipse(xx, xy, yy, det, r2, low if mode == FULL else 0.0, record)
    if rx < 0.0:
        out.tally[DEGENERATE] += 1
        return False, mode
    put_depth(splat, lens, record)
    record[SCALE] = det * filters.unit * filters.peak / math.sqrt(spread)
    drawn = put_box(u, v, rx, ry, 0.0, lens, out)
    if drawn and r > COARSE * oz:
        drawn = clip_to_sphere((ox, oy, oz), r, k, r_h, out.box)
    return drawn, mode


@kernel(inline=True)
def project_point(splat, mode, lens, filters, out):
    """Record and box of one point in the camera's frame; False where it is not drawn."""
    ox, oy, oz, n, r = splat
    k = lens.k
    record, box, count = out
    if not lens.near < oz <= lens.far:
        count[BEHIND] += 1
        return False
    offset = n[0] * ox + n[1] * oy + n[2] * oz
    distance = math.sqrt(ox * ox + oy * oy + oz * oz)
    if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
        n = (-ox / distance, -oy / distance, -oz / distance)
        offset = -distance
    if offset >= 0.0:
        if filters.one_sided or offset == 0.0:
            count[BACK] += 1
            return False
        n = (-n[0], -n[1], -n[2])
    iz, focal = 1.0 / oz, max(k[0, 0], k[1, 1])
    u = (k[0, 0] * ox + k[0, 1] * oy) * iz + k[0, 2]
    v = k[1, 1] * oy * iz + k[1, 2]
    record[INVERSE_Z] = iz
    record[SLOPE_X], record[SLOPE_Y] = 0.0, 0.0
    record[INVERSE_LOW], record[INVERSE_HIGH] = iz, iz
    record[TOLERANCE] = filters.eps_scale * (r + oz / focal)
    if r > COARSE * oz:
        count[LARGE] += 1
    if mode == SQUARE:
        drawn = put_square(splat, u, v, focal, lens, out)
    else:
        drawn, mode = put_splat(Splat(ox, oy, oz, n, r), distance, mode, u, v, lens, filters, out)
    if not drawn or not record[SCALE] > 0.0:
        return False
    # Relative to its box, float32 places a point well anywhere in a large image.
    record[U], record[V] = u - 0.5 - box[0], v - 0.5 - box[2]
    box[4] = mode
    count[MODES + mode] += 1
    return True


@kernel(inline=True)
def put_color(splat, red, green, blue, light, record):
    """Colour of a point, lit by Lambert's law."""
    ox, oy, oz, n, _ = splat
    if light.lit:
        lx, ly, lz = light.x, light.y, light.z
        if lx == 0.0 and ly == 0.0 and lz == 0.0:
            s = 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)
            lx, ly, lz = -ox * s, -oy * s, -oz * s
        facing = n[0] * lx + n[1] * ly + n[2] * lz
        if n[0] * ox + n[1] * oy + n[2] * oz > 0.0:
            facing = -facing
        if n[0] == 0.0 and n[1] == 0.0 and n[2] == 0.0:
            facing = 1.0
        shade = light.ambient + (1.0 - light.ambient) * max(facing, 0.0)
        red, green, blue = red * shade, green * shade, blue * shade
    record[RED], record[GREEN], record[BLUE] = red, green, blue


@kernel(inline=True)
def splat_of(nodes, row, turn, origin, s):
    """Node ``row``, of slice ``s``, in the camera's frame."""
    position, normal = nodes.position, nodes.normal
    x, y, z = np.float64(position[row, 0]), np.float64(position[row, 1]), np.float64(position[row, 2])
    ox = turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z + origin[s, 0]
    oy = turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z + origin[s, 1]
    oz = turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z + origin[s, 2]
    x, y, z = np.float64(normal[row, 0]), np.float64(normal[row, 1]), np.float64(normal[row, 2])
    n = (
        turn[0, 0] * x + turn[0, 1] * y + turn[0, 2] * z,
        turn[1, 0] * x + turn[1, 1] * y + turn[1, 2] * z,
        turn[2, 0] * x + turn[2, 1] * y + turn[2, 2] * z,
    )
    return Splat(ox, oy, oz, n, np.float64(nodes.radius[row]))


@kernel(parallel=True)
def project_points(nodes, slices, lens, filters, light, tile, threads, made):
    """Records of the points of S slices, and how many each chunk of slices sends to each tile.

    ``nodes``: all :class:`Nodes`; ``light``: :class:`Coloring`; ``made``: :class:`Projected`, filled.
    """
    records, boxes, tiles, counts = made
    rows, modes, first, origin, chunks = slices
    across = (lens.width + tile - 1) // tile
    counter = np.zeros(1, np.int64)
    for worker in prange(threads):
        own = borrowed(nodes)
        color = own.color
        all_records, all_boxes, all_counts = borrowed(records), borrowed(boxes), borrowed(counts)
        camera = borrowed(lens)
        while True:
            chunk = fetch_add(counter, 0, 1)
            if chunk >= len(chunks):
                break
            count = all_counts[chunk]
            for s in range(chunks[chunk, 0], chunks[chunk, 1]):
                at = first[s]
                for row in range(rows[s, 0], rows[s, 1]):
                    splat = splat_of(own, row, camera.turn, origin, s)
                    n = splat.n
                    record, box = all_records[at], all_boxes[at]
                    at += 1
                    if not project_point(splat, modes[s], camera, filters, Target(record, box, count)):
                        box[0], box[1] = 1, 0
                        continue
                    if light.normals:
                        record[RED], record[GREEN], record[BLUE] = n
                        if n[0] * splat.x + n[1] * splat.y + n[2] * splat.z > 0.0:
                            record[RED], record[GREEN], record[BLUE] = -n[0], -n[1], -n[2]
                    elif own.has_color:
                        put_color(splat, color[row, 0], color[row, 1], color[row, 2], light, record)
                    else:
                        put_color(splat, light.plain, light.plain, light.plain, light, record)
                    for ty in range(max(box[2], 0) // tile, box[3] // tile + 1):
                        for tx in range(max(box[0], 0) // tile, box[1] // tile + 1):
                            tiles[chunk, ty * across + tx] += 1
