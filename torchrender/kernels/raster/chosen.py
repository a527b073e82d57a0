"""Chosen surface attributes of many pictures at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed, foresee
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.attributes import (
    Eye,
    Mesh,
    Surface,
    blend,
    face_cross,
    ray_of,
    texture_footprint,
    turned_to,
    unit,
    uv_density,
)

AHEAD = 6  # pixels


class Eyes(NamedTuple):
    """Where the pixels of B images look from, as :class:`Eye`."""

    rays: np.ndarray  # (B,3,3)
    origins: np.ndarray  # (B,3)
    forwards: np.ndarray  # (B,3)
    footprints: np.ndarray  # (B,)
    orthographic: bool


class Wanted(NamedTuple):
    """Attributes that are written, and what they are made of."""

    mesh: Mesh
    eyes: Eyes
    surface: Surface  # a row per pixel of B images, or none of what is not wanted


_NONE, _NO_PAIRS, _NO_NUMBERS = (np.zeros(shape, np.float32) for shape in ((0, 3), (0, 2), 0))
NO_ATTRIBUTES = Wanted(
    Mesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros(0, np.int64), _NONE, _NO_PAIRS, _NONE),
    Eyes(np.zeros((0, 3, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), False),
    Surface(_NONE, _NONE, _NONE, _NO_PAIRS, _NO_NUMBERS, _NONE, np.zeros(0, np.int64)),
)


@kernel(inline=True)
def clear_row(row, outputs):
    """Nothing is seen there."""
    for values in (outputs.position, outputs.normal, outputs.geometric, outputs.color):
        if values.shape[0] > 0:
            for k in range(3):
                values[row, k] = 0.0
    if outputs.uv.shape[0] > 0:
        outputs.uv[row, 0] = outputs.uv[row, 1] = 0.0
    if outputs.footprint.shape[0] > 0:
        outputs.footprint[row] = 0.0
    if outputs.material.shape[0] > 0:
        outputs.material[row] = -1


@kernel(inline=True)
def corner_normals(normals, faces, t):
    """Nine numbers: those of its corners, one after the other."""
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    return (
        np.float64(normals[a, 0]), np.float64(normals[a, 1]), np.float64(normals[a, 2]),
        np.float64(normals[b, 0]), np.float64(normals[b, 1]), np.float64(normals[b, 2]),
        np.float64(normals[c, 0]), np.float64(normals[c, 1]), np.float64(normals[c, 2]),
    )  # fmt: skip


@kernel(inline=True)
def blended_normal(corners, u, v, face):
    """As :func:`shading_normal`, of :func:`corner_normals`."""
    ax, ay, az, bx, by, bz, cx, cy, cz = corners
    w = 1.0 - u - v
    return turned_to(unit(w * ax + u * bx + v * cx, w * ay + u * by + v * cy, w * az + u * bz + v * cz), face)


@kernel(inline=True)
def write_chosen(mesh, t, weights, face, ray, row, outputs):
    """What has room in ``outputs`` of one point, as :func:`write_surface` and :func:`interpolate` write it.

    ``face`` = normal of the triangle, its uv density, normals of its corners; ``ray`` = its direction, the point, width
    of a pixel there.
    """
    _, faces, material_of, normals, uvs, colors = mesh
    d, point, size = ray
    u, v = weights
    facing = face[0] * d[0] + face[1] * d[1] + face[2] * d[2]
    sign = -1.0 if facing > 0.0 else 1.0
    towards = (face[0] * sign, face[1] * sign, face[2] * sign)
    if outputs.position.shape[0] > 0:
        for k in range(3):
            outputs.position[row, k] = point[k]
    if outputs.geometric.shape[0] > 0:
        for k in range(3):
            outputs.geometric[row, k] = towards[k]
    if outputs.normal.shape[0] > 0:
        shade = blended_normal(face[4], u, v, towards) if normals.shape[0] > 0 else towards
        for k in range(3):
            outputs.normal[row, k] = shade[k]
    if outputs.color.shape[0] > 0:
        for k in range(3):
            outputs.color[row, k] = blend(colors, faces, t, u, v, k) if colors.shape[0] > 0 else 1.0
    known = uvs.shape[0] > 0
    if outputs.uv.shape[0] > 0:
        outputs.uv[row, 0] = blend(uvs, faces, t, u, v, 0) if known else 0.0
        outputs.uv[row, 1] = blend(uvs, faces, t, u, v, 1) if known else 0.0
    if outputs.footprint.shape[0] > 0:
        outputs.footprint[row] = texture_footprint(face[3], size, facing, d) if known else 0.0
    if outputs.material.shape[0] > 0:
        outputs.material[row] = material_of[t]


@kernel(inline=True)
def look_ahead(mesh, row, x, smooth):
    """What pixels further on in a ``row`` of triangles read is on its way, from memory in no order."""
    last = row.shape[0] - 1
    far, near, before = row[min(x + 2 * AHEAD, last)], row[min(x + AHEAD, last)], row[min(x + AHEAD - 1, last)]
    if far >= 0:
        foresee(mesh.faces, np.uintp(far))
    if near >= 0 and near != before:
        for k in range(3):
            corner = np.uintp(mesh.faces[near, k])
            foresee(mesh.vertices, corner)
            if smooth:
                foresee(mesh.normals, corner)


@kernel(inline=True)
def write_line(mesh, eye, line, outputs):
    """Chosen attributes of a row of pixels; ``eye``: :class:`~.attributes.Eye`.

    ``line``: the image's :class:`~.attributes.Hits`, the row in it, and the row of ``outputs`` of its first pixel.
    """
    rays, origin, forward, footprint, orthographic = eye
    (depth, triangle, barycentric), y, start = line
    smooth = outputs.normal.shape[0] > 0 and mesh.normals.shape[0] > 0
    textured = outputs.footprint.shape[0] > 0 and mesh.uv.shape[0] > 0
    last = np.int64(-1)
    gx = gy = gz = density = 0.0
    corners = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    ids = borrowed(triangle[y])
    for x in range(triangle.shape[1]):
        look_ahead(mesh, ids, x, smooth)
        t = triangle[y, x]
        row = start + x
        if t < 0:
            clear_row(row, outputs)
            continue
        dx, dy, dz = ray_of(rays, x, y)
        if t != last:
            nx, ny, nz = face_cross(mesh.vertices, mesh.faces, t)
            gx, gy, gz = unit(nx, ny, nz)
            if textured:
                density = uv_density(mesh.vertices, mesh.faces, mesh.uv, t)
            if smooth:
                corners = corner_normals(mesh.normals, mesh.faces, t)
            last = t
        z = np.float64(depth[y, x])
        size = footprint * z
        if orthographic:
            px = origin[0] + dx + z * forward[0]
            py = origin[1] + dy + z * forward[1]
            pz = origin[2] + dz + z * forward[2]
            dx, dy, dz = forward[0], forward[1], forward[2]
            size = footprint
        else:
            px, py, pz = origin[0] + z * dx, origin[1] + z * dy, origin[2] + z * dz
        weights = (np.float64(barycentric[y, x, 0]), np.float64(barycentric[y, x, 1]))
        ray = ((dx, dy, dz), (px, py, pz), size)
        write_chosen(mesh, t, weights, (gx, gy, gz, density, corners), ray, row, outputs)


@kernel(parallel=True)
def interpolate_views(mesh, eyes, visible, outputs, parts):
    """Chosen attributes of B images at once: those of ``outputs``, a :class:`Surface`, that have rows, one per pixel.

    Positions may be float32. ``eyes``: :class:`Eyes`; ``visible``: :class:`Hits` of images (B,H,W); the work is handed
    out in so many ``parts``.
    """
    all_rays, origins, forwards, footprints, orthographic = eyes
    depth, triangle, barycentric = visible
    position, normal, geometric, uv, footprint, color, material = outputs
    height, width = depth.shape[1], depth.shape[2]
    count = depth.shape[0] * height
    for part in prange(parts):
        # Threads would fight over the counts of references.
        shape = borrowed(mesh)
        room = borrowed(Surface(position, normal, geometric, uv, footprint, color, material))
        for number in range(np.int64(part), count, np.int64(parts)):
            b, y = number // height, number % height
            rays, origin, forward = borrowed((all_rays[b], origins[b], forwards[b]))
            eye = Eye(rays, origin, forward, footprints[b], orthographic)
            image = borrowed((depth[b], triangle[b], barycentric[b]))
            write_line(shape, eye, (image, y, number * width), room)
