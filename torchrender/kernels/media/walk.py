"""Where a ray is lit, by a walk along its image in the light's depth images: exact for their texels.

The walk asks a pyramid of least and greatest values and passes whole cells that lie before or behind the ray.
Source: specification 09, section 12; pyramids as Tevs, Ihrke, Seidel, Maximum mipmaps for fast, accurate, and scalable
dynamic height field rendering, 2008.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.media.records import BIG

F: Any = np.float32
BAND = 32  # rows of an image that a thread takes at a time
BEGIN = 4  # level at which a walk begins
MOST_FACES = 24  # of a cube that a ray may meet, ties counted again
BEYOND = F(2e-3)  # texels by which a place is looked up behind an edge


@kernel(parallel=True)
def build_pyramid(depth, parallel, levels, pyramid):
    """Fill ``pyramid`` (V,K,2) from depths (V,H,W), +inf where a light sees nothing.

    Args:
        parallel: values are depths; else -1/depth.
        levels: (L,3) int64 first entry, rows, columns of each level; the rows of the next one are half as many, rounded
            up.
    """
    views, height, width = depth.shape
    for band in prange(views * ((height + BAND - 1) // BAND)):
        view, part = band // ((height + BAND - 1) // BAND), band % ((height + BAND - 1) // BAND)
        for r in range(part * BAND, min(part * BAND + BAND, height)):
            for c in range(width):
                z = depth[view, r, c]
                q = min(z, BIG) if parallel else F(-1.0) / max(z, F(1e-30))
                k = r * width + c
                pyramid[view, k, 0] = q
                pyramid[view, k, 1] = q
    for level in range(1, len(levels)):
        below, own = levels[level - 1], levels[level]
        for row in prange(views * own[1]):
            image, line = np.int64(row // own[1]), np.int64(row % own[1])
            for c in range(own[2]):
                low, high = F(BIG), -F(BIG)
                for j in range(2 * line, min(2 * line + 2, below[1])):
                    for i in range(2 * c, min(2 * c + 2, below[2])):
                        b = below[0] + j * below[2] + i
                        low, high = min(low, pyramid[image, b, 0]), max(high, pyramid[image, b, 1])
                at = own[0] + line * own[2] + c
                pyramid[image, at, 0] = low
                pyramid[image, at, 1] = high


@kernel(inline=True)
def cut(begin, end, value, rate):
    """The part of [begin, end] where ``value + rate t >= 0``."""
    if rate == F(0.0):
        return (begin, end) if value >= F(0.0) else (F(1.0), F(0.0))
    at = -value / rate
    return (max(begin, at), end) if rate > F(0.0) else (begin, min(end, at))


@kernel(inline=True)
def add_span(spans, count, begin, end):
    """Append a lit part, or lengthen the last one where they touch."""
    if not end > begin:
        return count
    if count > 0 and abs(spans[count - 1, 1] - begin) <= F(1e-6) * abs(begin):
        spans[count - 1, 1] = end
        return count
    if count < spans.shape[0]:
        spans[count, 0], spans[count, 1] = begin, end
        return count + 1
    return count


@kernel(inline=True)
def length_at(share, ta, tb, wa, wb):
    """Ray length at a share of the image between two lengths, whose depths are ``wa`` and ``wb``."""
    return ta + (tb - ta) * share * wa / ((F(1.0) - share) * wb + share * wa)


@kernel()
def walk_image(pyramid, levels, line, ends, spans, count):
    """Walk one line in one view.

    Args:
        line: (u, v, value) at its two ends, in texels.
        ends: the ray's lengths there and their depths (1 and 1 where light is parallel).

    Returns:
        Number of lit parts in ``spans`` and of cells that were looked at.
    """
    u0, v0, q0, u1, v1, q1 = line
    ta, tb, wa, wb = ends
    rows, columns = levels[0, 1], levels[0, 2]
    # An end beside the image is there by rounding, by however much where it lies next to the light's plane.
    u0, u1 = min(max(u0, F(-1.0)), F(columns + 1)), min(max(u1, F(-1.0)), F(columns + 1))
    v0, v1 = min(max(v0, F(-1.0)), F(rows + 1)), min(max(v1, F(-1.0)), F(rows + 1))
    du, dv = u1 - u0, v1 - v0
    size = max(max(abs(du), abs(dv)), F(1e-3))
    inverse = F(1.0) / size
    du, dv, dq = du * inverse, dv * inverse, (q1 - q0) * inverse
    flat_u, flat_v = abs(du) <= F(1e-6), abs(dv) <= F(1e-6)
    iu = BIG if flat_u else F(1.0) / du
    iv = BIG if flat_v else F(1.0) / dv
    pu, pv = np.int64(du > F(0.0)), np.int64(dv > F(0.0))
    top = len(levels) - 1
    level = min(BEGIN, top)
    along, lit, since, looks = F(0.0), False, ta, 0
    while along < size:
        ahead = along + BEYOND
        cu = min(max(np.int64(u0 + du * ahead), 0), columns - 1) >> level
        cv = min(max(np.int64(v0 + dv * ahead), 0), rows - 1) >> level
        eu = BIG if flat_u else (F((cu + pu) << level) - u0) * iu
        ev = BIG if flat_v else (F((cv + pv) << level) - v0) * iv
        leave = min(max(min(eu, ev), ahead), size)
        qa, qb = q0 + dq * along, q0 + dq * leave
        k = levels[level, 0] + cv * levels[level, 2] + cu
        low, high = pyramid[k, 0], pyramid[k, 1]
        looks += 1
        if max(qa, qb) <= low:
            new = True
        elif min(qa, qb) > high:
            new = False
        elif level > 0:
            level -= 1
            continue
        else:  # the ray passes its texel's value inside of the texel
            first = qa <= low
            here = length_at(along * inverse, ta, tb, wa, wb)
            if first and not lit:
                since = here
            elif lit and not first:
                count = add_span(spans, count, since, here)
            cross = length_at(min(max((low - q0) / dq, along), leave) * inverse, ta, tb, wa, wb)
            if first:
                count = add_span(spans, count, since, cross)
            else:
                since = cross
            lit = new = not first
        if new != lit:
            here = length_at(along * inverse, ta, tb, wa, wb)
            if new:
                since = here
            else:
                count = add_span(spans, count, since, here)
            lit = new
        along = leave
        # Up only where the cell above ends here, too.
        if level < top and ((cu & 1) == pu if eu < ev else (cv & 1) == pv):
            level += 1
    if lit:
        count = add_span(spans, count, since, tb)
    return count, looks


@kernel(inline=True)
def in_view(m, o, d):
    """A ray in a view: where it is at length 0, and what it moves by per length, along x, y and z."""
    return (
        m[0] * o[0] + m[1] * o[1] + m[2] * o[2] + m[3], m[4] * o[0] + m[5] * o[1] + m[6] * o[2] + m[7],
        m[8] * o[0] + m[9] * o[1] + m[10] * o[2] + m[11], m[0] * d[0] + m[1] * d[1] + m[2] * d[2],
        m[4] * d[0] + m[5] * d[1] + m[6] * d[2], m[8] * d[0] + m[9] * d[1] + m[10] * d[2],
    )  # fmt: skip


@kernel(inline=True)
def leaves_at(value, rate, end):
    """Length at which ``value + rate t`` becomes negative."""
    return min(end, -value / rate) if rate < F(0.0) else end


@kernel()
def walk_lamp(images, n, ray, begin, end, spans, count):
    """The part of a ray in one view around a point."""
    x, y, z, dx, dy, dz = ray
    m = images.views[n]
    wa, wb = max(z + dz * begin, F(1e-6)), max(z + dz * end, F(1e-6))
    ia, ib = F(1.0) / wa, F(1.0) / wb
    line = (
        m[12] * (x + dx * begin) * ia + m[14], m[13] * (y + dy * begin) * ia + m[15], -ia,
        m[12] * (x + dx * end) * ib + m[14], m[13] * (y + dy * end) * ib + m[15], -ib,
    )  # fmt: skip
    return walk_image(images.pyramid[n], images.levels, line, (begin, end, wa, wb), spans, count)


@kernel()
def walk_cube(images, o, d, begin, end, spans):
    """Lit parts of a ray around a point with several views, each of which has what it lies in front of most."""
    count, looks, t = np.int64(0), np.int64(0), begin
    for _ in range(MOST_FACES):
        if not t < end:
            break
        # Past the tie of two views: by an angle at the lamp, and by what numbers of float32 are off.
        x, y, z, dx, dy, dz = in_view(images.views[0], o, d)
        away = abs(x + dx * t) + abs(y + dy * t) + abs(z + dz * t)
        probe = min(t + max(max(F(1e-6) * away, F(1e-6) * abs(t)), F(1e-12) * (end - begin)), end)
        best, size = -1, F(0.0)
        for n in range(images.views.shape[0]):
            m = images.views[n]
            z = m[8] * (o[0] + d[0] * probe) + m[9] * (o[1] + d[1] * probe) + m[10] * (o[2] + d[2] * probe) + m[11]
            if z > size:
                best, size = n, z
        if best < 0:
            t = probe
            continue
        ray = in_view(images.views[best], o, d)
        x, y, z, dx, dy, dz = ray
        leave = leaves_at(z - x, dz - dx, leaves_at(z + x, dz + dx, end))
        leave = leaves_at(z - y, dz - dy, leaves_at(z + y, dz + dy, leave))
        leave = max(leave, probe)
        count, more = walk_lamp(images, best, ray, t, leave, spans, count)
        looks += more
        t = leave
    return count, looks


@kernel()
def walk_ray(images, o, d, begin, end, spans):
    """Lit parts of a ray between two lengths, in ``spans`` (K,2).

    What lies beside the image of parallel light is lit; what no view around a point looks at is not.

    Returns:
        Their number, and of cells that were looked at.
    """
    if not images.parallel and images.views.shape[0] > 1:
        return walk_cube(images, o, d, begin, end, spans)
    width, height = F(images.levels[0, 2]), F(images.levels[0, 1])
    m = images.views[0]
    ray = in_view(m, o, d)
    x, y, z, dx, dy, dz = ray
    if not images.parallel:
        a, b = cut(begin, end, m[12] * x + m[14] * z, m[12] * dx + m[14] * dz)
        a, b = cut(a, b, (width - m[14]) * z - m[12] * x, (width - m[14]) * dz - m[12] * dx)
        a, b = cut(a, b, m[13] * y + m[15] * z, m[13] * dy + m[15] * dz)
        a, b = cut(a, b, (height - m[15]) * z - m[13] * y, (height - m[15]) * dz - m[13] * dy)
        a, b = cut(a, b, z, dz)
        return walk_lamp(images, 0, ray, a, b, spans, np.int64(0)) if b > a else (np.int64(0), np.int64(0))
    u, v, du, dv = m[12] * x + m[14], m[13] * y + m[15], m[12] * dx, m[13] * dy
    a, b = cut(begin, end, u, du)
    a, b = cut(a, b, width - u, -du)
    a, b = cut(a, b, v, dv)
    a, b = cut(a, b, height - v, -dv)
    if not b > a:
        spans[0, 0], spans[0, 1] = begin, end
        return np.int64(1), np.int64(0)
    count = add_span(spans, np.int64(0), begin, a)
    line = (u + du * a, v + dv * a, z + dz * a, u + du * b, v + dv * b, z + dz * b)
    count, looks = walk_image(images.pyramid[0], images.levels, line, (a, b, F(1.0), F(1.0)), spans, count)
    return add_span(spans, count, b, end), looks
