"""Surface attributes at the pixels of a visibility buffer."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

MIN_COSINE = 0.1  # texture footprints stop growing at this grazing angle


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


@kernel()
def shading_normal(normals, faces, t, u, v, face):
    """The interpolated normal, turned to the side of the face normal; the face normal where there is none."""
    sx, sy, sz = unit(
        blend(normals, faces, t, u, v, 0), blend(normals, faces, t, u, v, 1), blend(normals, faces, t, u, v, 2)
    )
    same_side = sx * face[0] + sy * face[1] + sz * face[2]
    if same_side < 0.0:
        return -sx, -sy, -sz
    if same_side == 0.0:
        return face
    return sx, sy, sz


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


@kernel(parallel=True)
def interpolate(scene, optional, view, visibility, outputs):
    """Fill the G-buffer of one camera.

    ``scene`` = (vertices, faces, material of each face), ``optional`` = (normals, uv, colors), empty where absent;
    ``view`` = (ray matrix (3,3) from (column, row, 1) to direction with camera z 1, camera origin (3,), forward (3,),
    (pixel size per unit depth, orthographic)); ``outputs`` = (position, normal, geometric normal, uv, footprint,
    color, material), all zero but material, which is -1.
    """
    vertices, faces, material_of = scene
    normals, uvs, colors = optional
    rays, origin, forward, settings = view
    orthographic = settings[1] != 0.0
    depth, triangle, barycentric = visibility
    position, normal, geometric, uv, footprint, color, material = outputs
    for y in prange(depth.shape[0]):
        last = np.int64(-1)
        gx = gy = gz = density = 0.0
        for x in range(depth.shape[1]):
            t = triangle[y, x]
            if t < 0:
                continue
            if t != last:
                nx, ny, nz = face_cross(vertices, faces, t)
                gx, gy, gz = unit(nx, ny, nz)
                density = uv_density(vertices, faces, uvs, t) if uvs.shape[0] > 0 else 0.0
                last = t
            u, v = np.float64(barycentric[y, x, 0]), np.float64(barycentric[y, x, 1])
            z = np.float64(depth[y, x])
            dx, dy, dz = ray_of(rays, x, y)
            if orthographic:  # the ray matrix goes across the image, the depth along ``forward``
                for k in range(3):
                    across = dx if k == 0 else (dy if k == 1 else dz)
                    position[y, x, k] = origin[k] + across + z * forward[k]
                dx, dy, dz = forward[0], forward[1], forward[2]
            else:
                position[y, x, 0] = origin[0] + z * dx
                position[y, x, 1] = origin[1] + z * dy
                position[y, x, 2] = origin[2] + z * dz
            facing = gx * dx + gy * dy + gz * dz
            sign = -1.0 if facing > 0.0 else 1.0
            face = (gx * sign, gy * sign, gz * sign)
            shade = shading_normal(normals, faces, t, u, v, face) if normals.shape[0] > 0 else face
            for k in range(3):
                geometric[y, x, k] = face[k]
                normal[y, x, k] = shade[k]
                color[y, x, k] = blend(colors, faces, t, u, v, k) if colors.shape[0] > 0 else 1.0
            if uvs.shape[0] > 0:
                uv[y, x, 0] = blend(uvs, faces, t, u, v, 0)
                uv[y, x, 1] = blend(uvs, faces, t, u, v, 1)
                size = settings[0] if orthographic else settings[0] * z
                footprint[y, x] = texture_footprint(density, size, facing, (dx, dy, dz))
            material[y, x] = material_of[t]
