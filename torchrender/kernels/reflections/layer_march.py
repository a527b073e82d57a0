"""Rays marched through depth images with several layers: the images name triangles, the rays are intersected with them.

Inverse depth is linear along the projection of a ray. At each texel step the surfaces whose depths the ray passes, in
the nearest 2 x 2 texels and all layers, are intersected with the ray itself; the nearest hit counts. A ray that runs
behind the last layer of a texel may have met something that no layer holds: what it hits later is not sure.
Source: specification 03, section 7 (algorithm 7), with layers beyond it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.fragments import is_hole
from torchrender.kernels.raster.records import Holes
from torchrender.kernels.rays.depth_march import CLEAR, EDGE, HIT, UNKNOWN, clip, cross_triangle, depth_at, length_at
from torchrender.kernels.reflections.layer_draw import LayerViews, to_camera

UNSURE = 3
"""A hit, but something nearer may be hidden from the image."""

GROUP = 64  # rays that a thread takes at a time
AHEAD = 2.0  # steps within which an exact hit stands for the surface that a texel names, and after the start
SLACK = 4.0  # texel widths of depth by which a surface may miss the ray's own depths within a step


@kernel(inline=True)
def crossing(scene, layers, texels, z, ray, best):
    """The nearest hit before ``best`` among the surfaces of 2 x 2 texels whose depths lie between ``z`` = (low, high).

    ``texels`` = (x, y of the first one, columns, rows, first texel); ``ray`` = (start, direction, least parameter).
    """
    vertices, faces, holes = scene
    depth, triangle = layers
    x0, y0, columns, rows, first = texels
    p, d, t_low = ray
    last = np.int64(-1)
    for y in range(max(y0, 0), min(y0 + 2, rows)):
        for x in range(max(x0, 0), min(x0 + 2, columns)):
            texel = first + y * columns + x
            for k in range(depth.shape[1]):
                surface = np.float64(depth[texel, k])
                if surface > z[1]:
                    break
                number = np.int64(triangle[texel, k])
                if surface < z[0] or number == last:
                    continue
                last = number
                t, u, v = cross_triangle(vertices, faces, number, p, d)
                if t <= t_low or t >= best[0] or u < -EDGE or v < -EDGE or u + v > 1.0 + EDGE:
                    continue
                if holes.mask.shape[0] > 0 and is_hole(number, np.float32(u), np.float32(v), faces, holes):
                    continue
                best = (t, u, v, number)
    return best


@kernel(inline=True)
def on_layer(scene, layers, texel, z, ray, piece):
    """The nearest surface of a texel whose depth lies between ``z`` = (low, high), where the ray meets its plane.

    For surfaces finer than texels: the triangle that is hit may be in no texel, but its neighbours are. Weights are
    kept within the triangle; a plane met elsewhere counts at the end of the step, ``piece`` = (first, last parameter).
    """
    vertices, faces, _ = scene
    depth, triangle = layers
    p, d, _ = ray
    for k in range(depth.shape[1]):
        surface = np.float64(depth[texel, k])
        if surface > z[1]:
            break
        if surface < z[0]:
            continue
        number = np.int64(triangle[texel, k])
        t, u, v = cross_triangle(vertices, faces, number, p, d)
        if not (t >= piece[0] and t <= piece[1]):
            t = piece[1]
        u, v = min(max(u, 0.0), 1.0), min(max(v, 0.0), 1.0)
        if u + v > 1.0:
            u, v = u / (u + v), v / (u + v)
        return t, u, v, number
    return math.inf, 0.0, 0.0, np.int64(-1)


@kernel(inline=True)
def march_layers(scene, views, layers, c, p, d, ends):
    """One ray in image ``c``, ``ends`` = first and last parameter: what happened, (t, weights, triangle), steps."""
    eye, look, box, size, near, first = views
    nothing = (math.inf, 0.0, 0.0, np.int64(-1))
    hx = p[0] - eye[c, 0]
    hy = p[1] - eye[c, 1]
    hz = p[2] - eye[c, 2]
    ox = look[c, 0, 0] * hx + look[c, 0, 1] * hy + look[c, 0, 2] * hz
    oy = look[c, 1, 0] * hx + look[c, 1, 1] * hy + look[c, 1, 2] * hz
    oz = look[c, 2, 0] * hx + look[c, 2, 1] * hy + look[c, 2, 2] * hz
    rx = look[c, 0, 0] * d[0] + look[c, 0, 1] * d[1] + look[c, 0, 2] * d[2]
    ry = look[c, 1, 0] * d[0] + look[c, 1, 1] * d[1] + look[c, 1, 2] * d[2]
    rz = look[c, 2, 0] * d[0] + look[c, 2, 1] * d[1] + look[c, 2, 2] * d[2]
    t0, t1 = ends
    z0, z1 = oz + t0 * rz, oz + t1 * rz
    sure = True
    if z0 < near[c]:
        if z1 <= near[c]:
            return UNKNOWN, nothing, 0
        t0, z0, sure = t0 + (near[c] - z0) / rz, near[c], False
    elif z1 < near[c]:
        t1, z1, sure = (near[c] - oz) / rz, near[c], False
    columns, rows = size[c, 0], size[c, 1]
    dx, dy = (box[c, 2] - box[c, 0]) / columns, (box[c, 3] - box[c, 1]) / rows
    u0, v0 = ((ox + t0 * rx) / z0 - box[c, 0]) / dx, ((oy + t0 * ry) / z0 - box[c, 1]) / dy
    u1, v1 = ((ox + t1 * rx) / z1 - box[c, 0]) / dx, ((oy + t1 * ry) / z1 - box[c, 1]) / dy
    begin, end = clip(u0, u1 - u0, 0.0, np.float64(columns), 0.0, 1.0)
    begin, end = clip(v0, v1 - v0, 0.0, np.float64(rows), begin, end)
    if end < begin:
        return UNKNOWN, nothing, 0
    starts_inside = begin <= 0.0 and sure
    leaves = end < 1.0 or (z1 <= near[c] and rz < 0.0)
    piece = (t0, t1, z0, z1)
    k1, k2 = 1.0 / z0, 1.0 / z1 - 1.0 / z0
    count = max(1.0, math.ceil(max(abs(u1 - u0), abs(v1 - v0))))
    m, last = math.floor(begin * count) + 1.0, math.ceil(end * count - 1e-9)
    hidden, steps = False, 0
    before = z0 if m <= 1.0 else depth_at(k1, k2, (m - 1.0) / count)
    texels = np.float64(max(dx, dy))
    best, guess, deepest = nothing, nothing, layers[0].shape[1] - 1
    while m <= max(last, 1.0):
        along = min(m / count, 1.0)
        z = depth_at(k1, k2, along)
        u, v = u0 + along * (u1 - u0), v0 + along * (v1 - v0)
        middle = along - 0.5 / count
        uh, vh = u0 + middle * (u1 - u0), v0 + middle * (v1 - v0)
        low, high = min(before, z), max(before, z)
        slack = SLACK * texels * high
        place = (np.int64(math.floor(uh - 0.5)), np.int64(math.floor(vh - 0.5)), columns, rows, first[c])
        best = crossing(scene, layers, place, (low - slack, high + slack), (p, d, ends[0]), best)
        steps += 1
        if best[0] <= length_at(piece, along):
            break
        if m > AHEAD and guess[3] < 0 and best[0] > length_at(piece, min(along + AHEAD / count, 1.0)):
            x, y = min(max(np.int64(uh), 0), columns - 1), min(max(np.int64(vh), 0), rows - 1)
            own = (length_at(piece, max(along - 1.0 / count, 0.0)), length_at(piece, along))
            guess = on_layer(scene, layers, first[c] + y * columns + x, (low, high), (p, d, ends[0]), own)
        x, y = min(max(np.int64(u), 0), columns - 1), min(max(np.int64(v), 0), rows - 1)
        hidden = hidden or z > layers[0][first[c] + y * columns + x, deepest] * (1.0 + 1e-4)
        before = z
        m += 1.0
    if best[3] >= 0:
        return (HIT if starts_inside and not hidden and guess[3] < 0 else UNSURE), best, steps
    if guess[3] >= 0:
        return UNSURE, guess, steps
    return (UNKNOWN if hidden or leaves or not starts_inside else CLEAR), nothing, steps


@kernel(parallel=True)
def march_clusters(scene, holes, views, layers, rays, ends, found):
    """March N rays and fill ``found`` = state (N,), t (N,), triangle (N,), weights (N,2), steps (N / GROUP,).

    ``scene`` = vertices, faces; ``rays`` = origins, directions (N,3) float64, image (N,) int64; ``ends`` = first and
    last parameter (N,).
    """
    eye, look, box, size, near, first = views
    depth, triangle = layers
    origins, directions, image = rays
    begin, end = ends
    state, t, number, weights, visits = found
    vertices, faces = scene
    mask, table, texels, uv = holes
    for group in prange((image.shape[0] + GROUP - 1) // GROUP):
        visits[group] = 0
        for i in range(group * GROUP, min((group + 1) * GROUP, image.shape[0])):
            p = (origins[i, 0], origins[i, 1], origins[i, 2])
            d = (directions[i, 0], directions[i, 1], directions[i, 2])
            kind, hit, steps = march_layers(
                (vertices, faces, Holes(mask, table, texels, uv)),
                LayerViews(eye, look, box, size, near, first),
                (depth, triangle),
                image[i],
                p,
                d,
                (begin[i], end[i]),
            )
            state[i], t[i], number[i] = kind, hit[0], hit[3]
            weights[i, 0], weights[i, 1] = hit[1], hit[2]
            visits[group] += steps


@kernel(parallel=True)
def mark_blocks(views, block, blocks, rays, ends):
    """Set ``blocks`` where N rays pass: blocks of ``block`` texels a side of image ``c``, row by row from its place in
    ``blocks`` on. ``block`` = (texels, first block of each image (C,)); ``rays``, ``ends`` as ``march_clusters`` takes.
    """
    eye, look, box, size, near, _ = views
    origins, directions, image = rays
    begin, end = ends
    texels, places = block
    for i in prange(image.shape[0]):
        c = image[i]
        columns, rows = size[c, 0], size[c, 1]
        across, down = (columns + texels - 1) // texels, (rows + texels - 1) // texels
        a = to_camera(origins, i, eye, look, c)
        rx = ry = rz = 0.0
        for k in range(3):
            rx += look[c, 0, k] * directions[i, k]
            ry += look[c, 1, k] * directions[i, k]
            rz += look[c, 2, k] * directions[i, k]
        t0, t1 = begin[i], end[i]
        z0, z1 = a[2] + t0 * rz, a[2] + t1 * rz
        if z0 < near[c]:
            if z1 <= near[c]:
                continue
            t0, z0 = t0 + (near[c] - z0) / rz, near[c]
        elif z1 < near[c]:
            t1, z1 = (near[c] - a[2]) / rz, near[c]
        dx, dy = (box[c, 2] - box[c, 0]) / columns * texels, (box[c, 3] - box[c, 1]) / rows * texels
        u0, v0 = ((a[0] + t0 * rx) / z0 - box[c, 0]) / dx, ((a[1] + t0 * ry) / z0 - box[c, 1]) / dy
        u1, v1 = ((a[0] + t1 * rx) / z1 - box[c, 0]) / dx, ((a[1] + t1 * ry) / z1 - box[c, 1]) / dy
        first_in, last_in = clip(u0, u1 - u0, -1.0, np.float64(across) + 1.0, 0.0, 1.0)
        first_in, last_in = clip(v0, v1 - v0, -1.0, np.float64(down) + 1.0, first_in, last_in)
        if last_in < first_in:
            continue
        count = np.int64(math.ceil(2.0 * (last_in - first_in) * max(abs(u1 - u0), abs(v1 - v0)))) + 1
        for m in range(count + 1):
            along = first_in + (last_in - first_in) * m / count
            x, y = math.floor(u0 + along * (u1 - u0)), math.floor(v0 + along * (v1 - v0))
            for j in range(max(y - 1, 0), min(y + 2, down)):
                for k in range(max(x - 1, 0), min(x + 2, across)):
                    blocks[places[c] + j * across + k] = 1
