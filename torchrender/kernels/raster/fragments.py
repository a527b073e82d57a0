"""Tests that may refuse a fragment before it enters the depth buffer: peeling, redundancy with earlier images, holes.

``tests`` = (``limits``, ``earlier``, ``holes``):

- ``limits`` = (key (H,W) float64, triangle (H,W) int64): only fragments farther than the key and of another triangle
  pass; empty arrays switch it off.
- ``earlier`` = (ids (J,h,w) int64, pixels (J,3,4) float64, near (J,), depth (J,h,w) float32, lens (J,9), own (7,3)): a
  fragment is refused if an earlier perspective image has it (specification 01, sections 5 and 13).
  ``pixels`` takes (x, y, 1, key) of this image, pixels counted from its centre, to homogeneous pixels over depth.
  ``lens`` = (fx, fy, cx, cy, skew, pixel size per depth, then the eye of j in homogeneous pixels of this image),
  ``own`` = the matrix from world to homogeneous pixels of this image, its inverse, and (test: IDENTITY, AGREES or
  CAPTURED, greatest ratio of footprints, pixel size per depth).
- ``holes`` = (mask (F,) int32, table (K,3) int64, texels uint8, uv (V,2) float32): see ``scene.cutout``.
"""

from __future__ import annotations

import math

import numpy as np
from numba import prange

from torchrender.kernels.compile import kernel

IDENTITY, AGREES, CAPTURED = 0, 1, 2
"""What makes a fragment redundant: the stored triangle; also the stored depth; lying no deeper than what is stored."""

DEPTH_TOLERANCE = 2.0  # pixel footprints by which depths of one surface may differ
LEAST_COSINE = 0.1  # surfaces seen at a more grazing angle than this get no more tolerance


@kernel()
def cosines(px, py, key, slope, j, uvz, lens, own):
    """|n.d| of the fragment's plane for the ray of image ``j`` and for this image's own; and the own depth.

    The plane is ``key = kx x + ky y + kc``, so that ``k . X = 1`` for its points X in homogeneous pixels.
    """
    kx, ky = slope
    kc = key - kx * px - ky * py
    u, v, z = uvz
    nx = own[0, 0] * kx + own[1, 0] * ky + own[2, 0] * kc
    ny = own[0, 1] * kx + own[1, 1] * ky + own[2, 1] * kc
    nz = own[0, 2] * kx + own[1, 2] * ky + own[2, 2] * kc
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    y = (v - lens[j, 3]) / lens[j, 1]
    x = (u - lens[j, 2] - lens[j, 4] * y) / lens[j, 0]
    far = z * math.sqrt(x * x + y * y + 1.0)
    there = abs(1.0 - kx * lens[j, 6] - ky * lens[j, 7] - kc * lens[j, 8]) / (length * far)
    dx = own[3, 0] * px + own[3, 1] * py + own[3, 2]
    dy = own[4, 0] * px + own[4, 1] * py + own[4, 2]
    dz = own[5, 0] * px + own[5, 1] * py + own[5, 2]
    here = key / (length * math.sqrt(dx * dx + dy * dy + dz * dz))
    return min(there, 1.0), min(here, 1.0)


@kernel()
def same_surface(t, j, uvz, there, ids, depth, lens, test):
    """AGREES: image ``j`` stores triangle ``t`` in one of the 2 x 2 nearest pixels, or about the same depth in its own.

    CAPTURED: the pixel of image ``j`` stores nothing that lies clearly before the fragment.
    """
    u, v, z = uvz
    stored = np.float64(depth[j, np.int64(math.floor(v)), np.int64(math.floor(u))])
    tolerance = DEPTH_TOLERANCE * z * lens[j, 5] / max(there, LEAST_COSINE)
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
    ids, _, _, depth, lens, own = earlier
    there, here = cosines(px, py, key, slope, j, uvz, lens, own)
    if own[6, 0] != IDENTITY:
        found = same_surface(t, j, uvz, there, ids, depth, lens, own[6, 0])
    else:
        found = ids[j, np.int64(math.floor(uvz[1])), np.int64(math.floor(uvz[0]))] == t
    # A copy seen at a much coarser footprint does not count; multiplied out, because a cosine may be zero.
    return found and not uvz[2] * lens[j, 5] * here > own[6, 1] * own[6, 2] / key * there


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
    ids, pixels, near = earlier[0], earlier[1], earlier[2]
    key = stored_key(key)
    for j in range(ids.shape[0]):
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
def only_identity(own):
    """True if neither depth nor footprints are compared."""
    return own[6, 0] == IDENTITY and own[6, 1] == np.inf


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


@kernel(parallel=True)
def redundant_samples(triangle, spot, key, slope, earlier, known):
    """Set ``known`` (N,) bool where a sample that an image stores is in one of the ``earlier`` images.

    ``triangle`` (N,), ``spot`` (N,2) pixel centres counted from the image centre, ``key`` (N,), ``slope`` (N,2). What
    is already known is skipped.
    """
    ids, pixels, near, own = earlier[0], earlier[1], earlier[2], earlier[5]
    plain = only_identity(own)
    for n in prange(triangle.shape[0]):
        t = triangle[n]
        if t < 0 or known[n]:
            continue
        if plain:
            known[n] = has_triangle(t, spot[n, 0], spot[n, 1], key[n], ids, pixels, near)
        else:
            known[n] = has_surface(t, spot[n, 0], spot[n, 1], key[n], (slope[n, 0], slope[n, 1]), earlier)
