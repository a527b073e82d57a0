"""Light of single samples for a view that sees the same surfaces."""

from __future__ import annotations

import math

from torchrender.kernels.compile import kernel


@kernel()
def place_samples(samples, matrix, seen, materials, same, wanted, out):
    """Give pixels the light of the last sample that falls into them and is of what they show.

    Args:
        samples: points (N,3) float64 world, their triangles and owners (N,), light (N,3).
        matrix: (3,4), homogeneous pixel of the view = matrix (point, 1).
        seen: (depth, triangle, owner) of the view (H,W); triangle -1: nothing. A sample of another owner has nothing to
            do with a pixel.
        materials: (F,) by triangle. Samples of one owner and material are of one surface.
        same: difference of inverse depth, as a share of the larger one, up to which they are so.
        wanted: (H,W) pixels to look at; False afterwards where light was found.
        out: (H,W,3) the light.
    """
    points, faces, owners, light = samples
    depth, triangle, owner = seen
    height, width = depth.shape
    for n in range(len(faces) - 1, -1, -1):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        w = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        if w <= 0.0:
            continue
        u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / w
        v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / w
        if not (0.0 <= u < width and 0.0 <= v < height):
            continue
        j, i = math.floor(v), math.floor(u)
        face, found = triangle[j, i], faces[n]
        if not wanted[j, i] or face < 0 or owners[n] != owner[j, i]:
            continue
        if found != face:
            if materials[found] != materials[face]:
                continue
            inverse = 1.0 / depth[j, i]
            if abs(1.0 / w - inverse) > same * max(1.0 / w, inverse):
                continue
        wanted[j, i] = False
        for k in range(3):
            out[j, i, k] = light[n, k]
