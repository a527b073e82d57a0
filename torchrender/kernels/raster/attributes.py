"""Surface attributes at the pixels of a visibility buffer."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel

MIN_COSINE = 0.1  # texture footprints stop growing at this grazing angle


class Mesh(NamedTuple):
    """Triangles and what their corners carry; the last three have no rows where absent."""

    vertices: np.ndarray  # (V,3) float64
    faces: np.ndarray  # (F,3) int32
    material: np.ndarray  # (F,) int64
    normals: np.ndarray  # (V,3) float32
    uv: np.ndarray  # (V,2) float32
    colors: np.ndarray  # (V,3) float32


class Eye(NamedTuple):
    """Where the pixels of an image look from."""

    rays: np.ndarray  # (3,3) from (column, row, 1) to the direction with camera z 1, or across an orthographic image
    origin: np.ndarray  # (3,)
    forward: np.ndarray  # (3,)
    footprint: float  # pixel size, per unit of depth unless orthographic
    orthographic: bool


class Rays(NamedTuple):
    """N rays."""

    origins: np.ndarray  # (N,3)
    directions: np.ndarray  # (N,3)
    widths: np.ndarray  # (N,) at the hit


class Hits(NamedTuple):
    """What pixels or rays see."""

    depth: np.ndarray  # camera depth, or ray parameter
    triangle: np.ndarray  # -1: nothing
    barycentric: np.ndarray  # weights of the second and third corner


class Surface(NamedTuple):
    """A row per point, all zero but material, which is -1."""

    position: np.ndarray  # (N,3) float64
    normal: np.ndarray  # (N,3) float32
    geometric: np.ndarray  # (N,3) float32
    uv: np.ndarray  # (N,2) float32
    footprint: np.ndarray  # (N,) float32
    color: np.ndarray  # (N,3) float32
    material: np.ndarray  # (N,) int64


@kernel()
def unit(x, y, z):
    """The unit vector; zero for a zero or non-finite one. Scaled first, so tiny and huge vectors keep their angle."""
    scale = max(abs(x), max(abs(y), abs(z)))
    if not (scale > 0.0 and math.isfinite(scale)):
        return 0.0, 0.0, 0.0
    x, y, z = x / scale, y / scale, z / scale
    length = math.sqrt(x * x + y * y + z * z)
    return x / length, y / length, z / length


@kernel()
def face_cross(vertices, faces, t):
    """Right-hand normal times twice the area, and the first corner."""
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    e0 = vertices[b, 0] - vertices[a, 0]
    e1 = vertices[b, 1] - vertices[a, 1]
    e2 = vertices[b, 2] - vertices[a, 2]
    f0 = vertices[c, 0] - vertices[a, 0]
    f1 = vertices[c, 1] - vertices[a, 1]
    f2 = vertices[c, 2] - vertices[a, 2]
    return e1 * f2 - e2 * f1, e2 * f0 - e0 * f2, e0 * f1 - e1 * f0


@kernel()
def blend(values, faces, t, u, v, k):
    """Component ``k`` of a vertex attribute at barycentric weights (u, v)."""
    a, b, c = values[faces[t, 0], k], values[faces[t, 1], k], values[faces[t, 2], k]
    return (1.0 - u - v) * a + u * b + v * c


@kernel()
def uv_density(vertices, faces, uv, t):
    """Texture-coordinate length per scene-unit length of triangle ``t``."""
    nx, ny, nz = face_cross(vertices, faces, t)
    area = math.sqrt(nx * nx + ny * ny + nz * nz)
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    texture = abs((uv[b, 0] - uv[a, 0]) * (uv[c, 1] - uv[a, 1]) - (uv[b, 1] - uv[a, 1]) * (uv[c, 0] - uv[a, 0]))
    return math.sqrt(texture / area) if area > 0.0 and math.isfinite(area) else 0.0


@kernel(inline=True)
def turned_to(normal, face):
    """A unit normal turned to the side of the face normal; the face normal where it has none."""
    sx, sy, sz = normal
    same_side = sx * face[0] + sy * face[1] + sz * face[2]
    if same_side < 0.0:
        return -sx, -sy, -sz
    if same_side == 0.0:
        return face
    return sx, sy, sz


@kernel()
def shading_normal(normals, faces, t, u, v, face):
    """The interpolated normal, turned to the side of the face normal; the face normal where there is none."""
    normal = unit(
        blend(normals, faces, t, u, v, 0), blend(normals, faces, t, u, v, 1), blend(normals, faces, t, u, v, 2)
    )
    return turned_to(normal, face)


@kernel()
def ray_of(rays, x, y):
    """World direction of the centre of pixel (x, y)."""
    px, py = x + 0.5, y + 0.5
    return (
        rays[0, 0] * px + rays[0, 1] * py + rays[0, 2],
        rays[1, 0] * px + rays[1, 1] * py + rays[1, 2],
        rays[2, 0] * px + rays[2, 1] * py + rays[2, 2],
    )


@kernel()
def texture_footprint(density, size, facing, d):
    """Width of a pixel in texture coordinates on a surface that faces the ray ``d`` by ``facing`` = n.d."""
    length = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    cosine = max(abs(facing) / length, MIN_COSINE) if length > 0.0 else 1.0
    return density * size / math.sqrt(cosine)


@kernel(inline=True)
def face_of(mesh, t):
    """Unit right-hand normal of triangle ``t`` and its uv density."""
    vertices, faces, uvs = mesh.vertices, mesh.faces, mesh.uv
    nx, ny, nz = face_cross(vertices, faces, t)
    gx, gy, gz = unit(nx, ny, nz)
    density = uv_density(vertices, faces, uvs, t) if uvs.shape[0] > 0 else 0.0
    return gx, gy, gz, density


@kernel(inline=True)
def write_surface(mesh, t, weights, face, d, texture, row, outputs):
    """Everything but the position of one point, into ``row`` = index of flat ``outputs``.

    ``face`` = normal of the triangle, ``d`` = direction of the ray, ``texture`` = (uv density, width of the ray there).
    """
    _, faces, material_of, normals, uvs, colors = mesh
    _, normal, geometric, uv, footprint, color, material = outputs
    u, v = weights
    facing = face[0] * d[0] + face[1] * d[1] + face[2] * d[2]
    sign = -1.0 if facing > 0.0 else 1.0
    towards = (face[0] * sign, face[1] * sign, face[2] * sign)
    shade = shading_normal(normals, faces, t, u, v, towards) if normals.shape[0] > 0 else towards
    for k in range(3):
        geometric[row, k] = towards[k]
        normal[row, k] = shade[k]
        color[row, k] = blend(colors, faces, t, u, v, k) if colors.shape[0] > 0 else 1.0
    if uvs.shape[0] > 0:
        uv[row, 0] = blend(uvs, faces, t, u, v, 0)
        uv[row, 1] = blend(uvs, faces, t, u, v, 1)
        footprint[row] = texture_footprint(texture[0], texture[1], facing, d)
    material[row] = material_of[t]


@kernel(parallel=True)
def place(mesh, eye, visible, position, geometric, material):
    """Position, normal of the triangle and material alone, of the pixels of one camera; rows as of a Surface."""
    rays, origin, forward, _, orthographic = eye
    depth, triangle, _ = visible
    vertices, faces, material_of, _, _, _ = mesh
    width = depth.shape[1]
    for y in prange(depth.shape[0]):
        last = np.int64(-1)
        gx = gy = gz = 0.0
        for x in range(width):
            t = triangle[y, x]
            if t < 0:
                continue
            dx, dy, dz = ray_of(rays, x, y)
            if t != last:
                nx, ny, nz = face_cross(vertices, faces, t)
                gx, gy, gz = unit(nx, ny, nz)
                last = t
            z = np.float64(depth[y, x])
            row = y * width + x
            if orthographic:
                position[row, 0] = origin[0] + dx + z * forward[0]
                position[row, 1] = origin[1] + dy + z * forward[1]
                position[row, 2] = origin[2] + dz + z * forward[2]
                dx, dy, dz = forward[0], forward[1], forward[2]
            else:
                position[row, 0] = origin[0] + z * dx
                position[row, 1] = origin[1] + z * dy
                position[row, 2] = origin[2] + z * dz
            sign = -1.0 if gx * dx + gy * dy + gz * dz > 0.0 else 1.0
            geometric[row, 0], geometric[row, 1], geometric[row, 2] = gx * sign, gy * sign, gz * sign
            material[row] = material_of[t]


@kernel(parallel=True)
def interpolate(mesh, eye, visible, outputs):
    """Fill the G-buffer of one camera: ``outputs``, a :class:`Surface` with a row per pixel.

    ``mesh``: :class:`Mesh`; ``eye``: :class:`Eye`; ``visible``: :class:`Hits` as images.
    """
    rays, origin, forward, footprint, orthographic = eye
    depth, triangle, barycentric = visible
    position = outputs.position
    width = depth.shape[1]
    for y in prange(depth.shape[0]):
        shape, room = borrowed(mesh), borrowed(outputs)  # threads would fight over the counts of references
        last = np.int64(-1)
        gx = gy = gz = density = 0.0
        for x in range(width):
            t = triangle[y, x]
            if t < 0:
                continue
            dx, dy, dz = ray_of(rays, x, y)
            if t != last:
                gx, gy, gz, density = face_of(shape, t)
                last = t
            z = np.float64(depth[y, x])
            row = y * width + x
            size = footprint * z
            if orthographic:  # the ray matrix goes across the image, the depth along ``forward``
                position[row, 0] = origin[0] + dx + z * forward[0]
                position[row, 1] = origin[1] + dy + z * forward[1]
                position[row, 2] = origin[2] + dz + z * forward[2]
                dx, dy, dz = forward[0], forward[1], forward[2]
                size = footprint
            else:
                position[row, 0] = origin[0] + z * dx
                position[row, 1] = origin[1] + z * dy
                position[row, 2] = origin[2] + z * dz
            weights = (np.float64(barycentric[y, x, 0]), np.float64(barycentric[y, x, 1]))
            write_surface(shape, t, weights, (gx, gy, gz), (dx, dy, dz), (density, size), row, room)


@kernel(parallel=True)
def interpolate_hits(mesh, rays, hits, outputs):
    """The same for :class:`Rays` and their :class:`Hits`."""
    origins, directions, widths = rays
    t_hit, triangle, barycentric = hits
    position = outputs.position
    for row in prange(triangle.shape[0]):
        t = triangle[row]
        if t < 0:
            continue
        shape, room = borrowed(mesh), borrowed(outputs)
        d = (directions[row, 0], directions[row, 1], directions[row, 2])
        gx, gy, gz, density = face_of(shape, t)
        for k in range(3):
            position[row, k] = origins[row, k] + t_hit[row] * d[k]
        weights = (np.float64(barycentric[row, 0]), np.float64(barycentric[row, 1]))
        write_surface(shape, t, weights, (gx, gy, gz), d, (density, widths[row]), row, room)
