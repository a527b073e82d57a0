"""Tests that may refuse a fragment before it enters the depth buffer: redundancy with earlier images, and holes."""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.atomics import borrowed
from torchrender.kernels.compile import kernel
from torchrender.kernels.raster.records import SOLID, EarlierLens

IDENTITY, AGREES, CAPTURED = 0, 1, 2
"""What makes a fragment redundant: the stored triangle; also the stored depth; lying no deeper than what is stored."""

DEPTH_TOLERANCE = 2.0  # pixel footprints by which depths of one surface may differ
LEAST_COSINE = 0.1  # surfaces seen at a more grazing angle than this get no more tolerance


@kernel(inline=True)
def lens_of(lenses, j):
    """Row ``j`` by name."""
    return EarlierLens(
        lenses[j, 0], lenses[j, 1], lenses[j, 2], lenses[j, 3], lenses[j, 4],
        lenses[j, 5], lenses[j, 6], lenses[j, 7], lenses[j, 8],
    )  # fmt: skip


@kernel()
def cosines(px, py, key, slope, uvz, lens, matrix, inverse):
    """|n.d| of the fragment's plane for the ray of the image with that ``lens``, and for this image's own.

    The plane is ``key = kx x + ky y + kc``, so that ``k . X = 1`` for its points X in homogeneous pixels.
    """
    matrix, inverse = borrowed(matrix), borrowed(inverse)
    kx, ky = slope
    kc = key - kx * px - ky * py
    u, v, z = uvz
    nx = matrix[0, 0] * kx + matrix[1, 0] * ky + matrix[2, 0] * kc
    ny = matrix[0, 1] * kx + matrix[1, 1] * ky + matrix[2, 1] * kc
    nz = matrix[0, 2] * kx + matrix[1, 2] * ky + matrix[2, 2] * kc
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    y = (v - lens.cy) / lens.fy
    x = (u - lens.cx - lens.skew * y) / lens.fx
    far = z * math.sqrt(x * x + y * y + 1.0)
    there = abs(1.0 - kx * lens.eye_x - ky * lens.eye_y - kc * lens.eye_w) / (length * far)
    dx = inverse[0, 0] * px + inverse[0, 1] * py + inverse[0, 2]
    dy = inverse[1, 0] * px + inverse[1, 1] * py + inverse[1, 2]
    dz = inverse[2, 0] * px + inverse[2, 1] * py + inverse[2, 2]
    here = key / (length * math.sqrt(dx * dx + dy * dy + dz * dz))
    return min(there, 1.0), min(here, 1.0)


@kernel()
def same_surface(t, j, uvz, there, lens, earlier):
    """AGREES: image ``j`` stores triangle ``t`` in one of the 2 x 2 nearest pixels, or about the same depth in its own.

    CAPTURED: the pixel of image ``j`` stores nothing that lies clearly before the fragment.
    """
    earlier = borrowed(earlier)
    u, v, z = uvz
    ids, test = earlier.ids, earlier.test
    stored = np.float64(earlier.depth[j, np.int64(math.floor(v)), np.int64(math.floor(u))])
    tolerance = DEPTH_TOLERANCE * z * lens.footprint / max(there, LEAST_COSINE)
    if test == CAPTURED:
        return z <= stored + tolerance
    if abs(stored - z) <= tolerance:
        return True
    x0, y0 = np.int64(math.floor(u - 0.5)), np.int64(math.floor(v - 0.5))
    for y in range(y0, y0 + 2):
        for x in range(x0, x0 + 2):
            if 0 <= y < ids.shape[1] and 0 <= x < ids.shape[2] and ids[j, y, x] == t:
                return True
    return False


@kernel()
def image_has(t, px, py, key, slope, j, uvz, earlier):
    """The tests of section 13, for a fragment that projects into image ``j`` at pixel (u, v) and depth z."""
    earlier = borrowed(earlier)
    lens = lens_of(earlier.lenses, j)
    there, here = cosines(px, py, key, slope, uvz, lens, earlier.matrix, earlier.inverse)
    if earlier.test != IDENTITY:
        found = same_surface(t, j, uvz, there, lens, earlier)
    else:
        found = earlier.ids[j, np.int64(math.floor(uvz[1])), np.int64(math.floor(uvz[0]))] == t
    # A copy seen at a much coarser footprint does not count; multiplied out, because a cosine may be zero.
    return found and not uvz[2] * lens.footprint * here > earlier.ratio * earlier.footprint / key * there


@kernel(inline=True)
def stored_key(key):
    """The key of the depth that an image will store: what is decided for it holds when the sample is tested again."""
    return 1.0 / np.float64(np.float32(1.0 / key))


@kernel(inline=True)
def lookup(pixels, near, j, px, py, key):
    """Pixel (u, v) of image ``j`` into which the fragment projects, times w, and w; w is 0 where that is nowhere."""
    w = pixels[j, 2, 0] * px + pixels[j, 2, 1] * py + pixels[j, 2, 2] + pixels[j, 2, 3] * key
    if not w >= near[j] * key:  # w / key is the depth in image j, and key > 0
        return 0.0, 0.0, 0.0
    u = pixels[j, 0, 0] * px + pixels[j, 0, 1] * py + pixels[j, 0, 2] + pixels[j, 0, 3] * key
    v = pixels[j, 1, 0] * px + pixels[j, 1, 1] * py + pixels[j, 1, 2] + pixels[j, 1, 3] * key
    return u, v, w


@kernel(inline=True)
def has_triangle(t, px, py, key, ids, pixels, near):
    """Pixel redundancy: one of the earlier images stores triangle ``t`` where this fragment projects to.

    Unpacked arrays and scalar reads only: views and tuples count references, which threads fight over.
    """
    key = stored_key(key)
    width, height = np.float64(ids.shape[2]), np.float64(ids.shape[1])
    for j in range(np.uintp(ids.shape[0])):
        u, v, w = lookup(pixels, near, j, px, py, key)
        if w > 0.0:
            inverse = 1.0 / w
            u *= inverse
            v *= inverse
            if u >= 0.0 and v >= 0.0 and u < width and v < height and ids[j, np.uintp(v), np.uintp(u)] == t:
                return True
    return False


@kernel()
def has_surface(t, px, py, key, slope, earlier):
    """As :func:`has_triangle`, with the tests of section 13; ``slope``: the key's steps per pixel."""
    earlier = borrowed(earlier)
    ids, pixels, near = earlier.ids, earlier.pixels, earlier.near
    key = stored_key(key)
    for j in range(np.uintp(ids.shape[0])):
        u, v, w = lookup(pixels, near, j, px, py, key)
        if w > 0.0:
            inverse = 1.0 / w
            u *= inverse
            v *= inverse
            inside = u >= 0.0 and v >= 0.0 and u < ids.shape[2] and v < ids.shape[1]
            if inside and image_has(t, px, py, key, slope, j, (u, v, w / key), earlier):
                return True
    return False


@kernel(inline=True)
def only_identity(earlier):
    """True if neither depth nor footprints are compared."""
    return earlier.test == IDENTITY and earlier.ratio == np.inf


@kernel(inline=True)
def is_identity_alone(t, tests):
    """True if fragments of a triangle are tested by :func:`has_triangle` and by nothing else."""
    limits, earlier, holes = tests
    holed = holes.mask.shape[0] > 0 and holes.mask[t] >= 0
    return earlier.ids.shape[0] > 0 and only_identity(earlier) and limits.keys.shape[0] == 0 and not holed


@kernel(inline=True)
def wrapped(x, wrap):
    """A coordinate moved into [0, 1]: repeated (0), mirrored (1) or clamped (2)."""
    if wrap == 2:
        return min(max(x, 0.0), 1.0)
    if wrap == 1:
        half = x * 0.5
        return 1.0 - abs(1.0 - 2.0 * (half - math.floor(half)))
    return x - math.floor(x)


@kernel()
def is_hole(t, u, v, faces, holes):
    """True if the texel at barycentric weights (u, v) of triangle ``t`` is missing."""
    faces = borrowed(faces)
    mask, table, texels, uv = borrowed(holes)
    row = mask[t]
    if row < 0:
        return False
    a, b, c = faces[t, 0], faces[t, 1], faces[t, 2]
    s = uv[a, 0] + u * (uv[b, 0] - uv[a, 0]) + v * (uv[c, 0] - uv[a, 0])
    r = uv[a, 1] + u * (uv[b, 1] - uv[a, 1]) + v * (uv[c, 1] - uv[a, 1])
    opacity = uv[a, 2] + u * (uv[b, 2] - uv[a, 2]) + v * (uv[c, 2] - uv[a, 2])
    if not (math.isfinite(s) and math.isfinite(r)):
        return False
    height, width, wraps = table[row, 1], table[row, 2], table[row, 3]
    i = min(np.int64(wrapped(np.float64(s), wraps % 3) * width), width - 1)
    j = min(np.int64((1.0 - wrapped(np.float64(r), wraps // 3)) * height), height - 1)
    return texels[table[row, 0] + j * width + i] * opacity < SOLID - 1e-3


@kernel(parallel=True)
def redundant_samples(triangle, spot, key, slope, earlier, known):
    """Set ``known`` (N,) bool where a sample that an image stores is in one of the ``earlier`` images.

    ``triangle`` (N,), ``spot`` (N,2) pixel centres counted from the image centre, ``key`` (N,), ``slope`` (N,2). What
    is already known is skipped.
    """
    ids, pixels, near = earlier.ids, earlier.pixels, earlier.near
    plain = only_identity(earlier)
    for n in prange(triangle.shape[0]):
        t = triangle[n]
        if t < 0 or known[n]:
            continue
        if plain:
            known[n] = has_triangle(t, spot[n, 0], spot[n, 1], key[n], ids, pixels, near)
        else:
            known[n] = has_surface(t, spot[n, 0], spot[n, 1], key[n], (slope[n, 0], slope[n, 1]), earlier)
