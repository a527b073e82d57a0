"""Tests that may refuse a fragment before it enters the depth buffer: peeling, redundancy with earlier images, holes.

``tests`` = (``limits``, ``earlier``, ``holes``):

- ``limits`` = (key (H,W) float64, triangle (H,W) int64): only fragments farther than the key and of another triangle
  pass; empty arrays switch it off.
- ``earlier`` = (ids (J,h,w) int64, pixels (J,3,4) float64, near (J,)): a fragment is refused if the pixel of an earlier
  perspective image into which it projects stores the same triangle (pixel redundancy, specification 01 section 5).
  ``pixels`` takes (x, y, 1, key) of this image, pixels counted from its centre, to homogeneous pixels over depth.
- ``holes`` = (mask (F,) int32, table (K,3) int64, texels uint8, uv (V,2) float32): see ``scene.cutout``.
"""

from __future__ import annotations

import math

import numpy as np

from torchrender.kernels.compile import kernel


@kernel()
def is_redundant(t, px, py, key, earlier):
    """True if one of the earlier images stores triangle ``t`` where this fragment projects to."""
    ids, pixels, near = earlier
    for j in range(ids.shape[0]):
        m = pixels[j]
        w = m[2, 0] * px + m[2, 1] * py + m[2, 2] + m[2, 3] * key
        if not w >= near[j] * key:  # w / key is the depth in image j, and key > 0
            continue
        u = (m[0, 0] * px + m[0, 1] * py + m[0, 2] + m[0, 3] * key) / w
        v = (m[1, 0] * px + m[1, 1] * py + m[1, 2] + m[1, 3] * key) / w
        if (
            u >= 0.0
            and v >= 0.0
            and u < ids.shape[2]
            and v < ids.shape[1]
            and ids[j, np.int64(math.floor(v)), np.int64(math.floor(u))] == t
        ):
            return True
    return False


@kernel()
def is_hole(t, u, v, faces, holes):
    """True if the texel at barycentric weights (u, v) of triangle ``t`` is missing."""
    mask, table, texels, uv = holes
    row = mask[t]
    if row < 0:
        return False
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    s = uv[a, 0] + u * (uv[b, 0] - uv[a, 0]) + v * (uv[c, 0] - uv[a, 0])
    r = uv[a, 1] + u * (uv[b, 1] - uv[a, 1]) + v * (uv[c, 1] - uv[a, 1])
    if not (math.isfinite(s) and math.isfinite(r)):
        return False
    height, width = table[row, 1], table[row, 2]
    i = min(np.int64((s - math.floor(s)) * width), width - 1)
    j = min(np.int64((1.0 - (r - math.floor(r))) * height), height - 1)
    return texels[table[row, 0] + j * width + i] == 0


@kernel()
def is_refused(t, pixel, centre, key, faces, planes, orthographic, tests):
    """True if a fragment must not enter the depth buffer.

    ``pixel`` (x, y) in the image, ``centre`` the image centre, ``planes`` the barycentric planes of the triangle.
    """
    limits, earlier, holes = tests
    x, y = pixel
    if limits[0].shape[0] > 0 and (not key < limits[0][y, x] or limits[1][y, x] == t):
        return True
    px = x + 0.5 - centre[0]
    py = y + 0.5 - centre[1]
    if holes[0].shape[0] > 0 and holes[0][t] >= 0:
        ux, uy, uc, vx, vy, vc = planes
        weight = 1.0 if orthographic else 1.0 / key
        if is_hole(t, (ux * px + uy * py + uc) * weight, (vx * px + vy * py + vc) * weight, faces, holes):
            return True
    return earlier[0].shape[0] > 0 and is_redundant(t, px, py, key, earlier)
